//! The last guard: smoothing away the places where a surface passes through itself or folds.

use mesh_core::{Examination, Topology, TriMesh};

/// Folds sharper than this are smoothed, in degrees: 0 is flat, 180 folded back.
const FOLD: f32 = 165.0;
/// Rounds of smoothing before giving up.
const ROUNDS: usize = 40;

/// Smooths the neighbourhood of every self-intersection and sharp fold until there are none; returns
/// the rounds that it took, or `None` when some remained.
///
/// Nothing moves where the surface is sound. From round to round the neighbourhood grows, so that
/// what a small repair cannot solve is flattened further out.
pub(super) fn untangle(
    positions: &mut Vec<[f32; 3]>,
    faces: &[[u32; 3]],
    topology: &Topology,
) -> Option<usize> {
    for round in 0..ROUNDS {
        let mut marked = tangled(positions, faces, topology);
        if !marked.contains(&true) {
            return Some(round);
        }
        for _ in 0..=round / 8 {
            marked = grown(&marked, topology);
        }
        for _ in 0..3 {
            smooth(positions, &marked, topology);
        }
    }
    (!tangled(positions, faces, topology).contains(&true)).then_some(ROUNDS)
}

/// What to say of a mesh after it, if anything: the count is that of the finished mesh, which rounding may have changed.
pub(super) fn remaining(found: &Examination, untangled: bool) -> Option<String> {
    let fold = || {
        let degrees = found.health.largest_dihedral_degrees;
        format!("the surface is folded by {degrees:.0} degrees")
    };
    let text = found.crossings().or_else(|| (!untangled).then(fold));
    text.map(|text| text + " where smoothing could not help")
}

/// The vertices of faces that intersect others or are folded onto a neighbour.
fn tangled(positions: &mut Vec<[f32; 3]>, faces: &[[u32; 3]], topology: &Topology) -> Vec<bool> {
    let mut marked = vec![false; positions.len()];
    let mesh = TriMesh::new(std::mem::take(positions), faces.to_vec());
    for face in mesh.self_intersections().into_iter().flatten() {
        faces[face as usize].iter().for_each(|&v| marked[v as usize] = true);
    }
    *positions = mesh.positions;
    let normals = mesh_core::face_normals(positions, faces);
    let limit = FOLD.to_radians().cos();
    for &[f, g] in &topology.edge_faces {
        if f == Topology::NONE || g == Topology::NONE {
            continue;
        }
        let (a, b) = (normals[f as usize], normals[g as usize]);
        if (0..3).map(|k| a[k] * b[k]).sum::<f32>() < limit {
            for face in [f, g] {
                faces[face as usize].iter().for_each(|&v| marked[v as usize] = true);
            }
        }
    }
    marked
}

fn grown(marked: &[bool], topology: &Topology) -> Vec<bool> {
    (0..marked.len())
        .map(|v| marked[v] || topology.vertex_vertices.row(v).iter().any(|&n| marked[n as usize]))
        .collect()
}

/// Moves the marked vertices half of the way to the centre of their ring.
fn smooth(positions: &mut [[f32; 3]], marked: &[bool], topology: &Topology) {
    let moved: Vec<(usize, [f32; 3])> = (0..positions.len())
        .filter(|&v| marked[v])
        .map(|v| {
            let ring = topology.vertex_vertices.row(v);
            let share = 0.5 / ring.len().max(1) as f32;
            let to = std::array::from_fn(|k| {
                let sum: f32 = ring.iter().map(|&n| positions[n as usize][k]).sum();
                0.5 * positions[v][k] + share * sum
            });
            (v, to)
        })
        .collect();
    for (v, to) in moved {
        positions[v] = to;
    }
}

#[cfg(test)]
mod tests {
    use mesh_core::primitives;

    use super::*;

    #[test]
    fn a_spike_through_the_far_side_is_withdrawn() {
        let mut sphere = primitives::icosphere(3);
        let topology = Topology::new(sphere.positions.len(), &sphere.faces);
        let before = sphere.positions.clone();
        sphere.positions[5] = sphere.positions[5].map(|c| -1.5 * c);
        assert!(!sphere.self_intersections().is_empty());
        let rounds = untangle(&mut sphere.positions, &sphere.faces, &topology);
        assert!(rounds.is_some_and(|r| r > 0), "{rounds:?}");
        assert!(sphere.self_intersections().is_empty());
        assert!(sphere.health().largest_dihedral_degrees < 170.0);
        let moved = before.iter().zip(&sphere.positions).filter(|(a, b)| a != b).count();
        assert!(moved < before.len() / 2, "{moved} vertices moved");
    }

    #[test]
    fn a_sound_mesh_stays_as_it_is() {
        let mut sphere = primitives::icosphere(2);
        let before = sphere.positions.clone();
        let topology = Topology::new(before.len(), &sphere.faces);
        assert_eq!(untangle(&mut sphere.positions, &sphere.faces, &topology), Some(0));
        assert_eq!(sphere.positions, before);
    }

    #[test]
    fn what_is_said_of_the_rest_is_what_is_counted() {
        let ball = primitives::icosphere(2);
        assert_eq!(remaining(&ball.examined(), true), None);
        // Folds alone are no self-intersections, and are not called so.
        let text = remaining(&ball.examined(), false).unwrap_or_default();
        assert!(text.starts_with("the surface is folded by"), "{text}");
        let mut two = ball.clone();
        assert!(two.append(&ball.translated([0.9, 0.1, 0.2])).is_ok());
        let found = two.examined();
        for untangled in [true, false] {
            let text = remaining(&found, untangled).unwrap_or_default();
            let count = found.self_intersections;
            assert!(
                count > 1
                    && text.starts_with(&format!("{count} pairs of faces run through each other"))
            );
        }
    }
}
