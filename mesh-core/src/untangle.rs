//! Moving apart, or smoothing away, the places where a surface passes through itself or folds.

use crate::tangles::{Tangled, Tangles};
use crate::vector::{add, area_vector, narrow, norm, sub, triangle, unit};
use crate::{Topology, TriMesh};

/// Rounds of smoothing before giving up.
const ROUNDS: usize = 40;
/// Rounds in which the two sides of a sheet are moved apart; what is left then is smoothed.
const SWELLS: usize = 24;
/// How far the sides move in a round, in lengths of their edges.
const SWELL: f32 = 0.12;
/// Rounds in which a surface is brought back before giving up; in each the neighbourhood is a ring wider.
const RETURNS: usize = 24;

impl TriMesh {
    /// Mends the mesh where it passes through itself or is folded: [`untangle`] on its own positions. Colours and texture stay
    /// as they are.
    ///
    /// ```
    /// use mesh_core::primitives::icosphere;
    /// let mut ball = icosphere(3);
    /// ball.positions[5] = ball.positions[5].map(|x| -1.5 * x); // a spike through the far side
    /// assert!(!ball.self_intersections().is_empty());
    /// assert!(ball.untangle().is_some_and(|rounds| rounds > 0));
    /// assert!(ball.self_intersections().is_empty());
    /// ```
    pub fn untangle(&mut self) -> Option<usize> {
        let topology = Topology::new(self.positions.len(), &self.faces);
        untangle(&mut self.positions, &self.faces, &topology)
    }

    /// For each vertex whether one of its faces runs through another or is folded onto a neighbour: what
    /// [`untangle`](Self::untangle) mends.
    ///
    /// ```
    /// use mesh_core::primitives::icosphere;
    /// let mut ball = icosphere(3);
    /// assert!(!ball.tangled().contains(&true));
    /// ball.positions[5] = ball.positions[5].map(|x| -1.5 * x); // a spike through the far side
    /// assert!(ball.tangled()[5]);
    /// ```
    pub fn tangled(&self) -> Vec<bool> {
        let topology = Topology::new(self.positions.len(), &self.faces);
        Tangles::of(&self.positions, &self.faces, &topology).found().all
    }
}

/// Mends the neighbourhood of every [self-intersection](TriMesh::self_intersections) and of every edge at which the surface turns
/// by more than 165 degrees, until there are none. Returns the rounds that it took (0 where the mesh was sound, and is unchanged),
/// or `None` when some remained after 40.
///
/// Where the two sides of a sheet pass through each other, or meet in an edge like a blade's, they are moved apart: smoothing
/// would eat the sheet. Elsewhere the surface is smoothed. Nothing moves where it is sound. From round to round the
/// neighbourhood grows, so that what a small repair cannot solve is flattened further out.
///
/// Positions that are not finite, and faces that are not valid, are never mended, as they are never found to intersect.
///
/// # Cost
/// A search for self-intersections, some 5 ms for 5,000 faces; a round then only looks at what has moved.
///
/// # Panics
/// If a face or `topology` names a vertex that does not exist.
pub fn untangle(
    positions: &mut [[f32; 3]],
    faces: &[[u32; 3]],
    topology: &Topology,
) -> Option<usize> {
    let mut tangles = Tangles::of(positions, faces, topology);
    for round in 0..ROUNDS {
        let Tangled { mut thin, all: mut marked } = tangles.found();
        if !marked.contains(&true) {
            return Some(round);
        }
        if round >= SWELLS {
            thin.fill(false);
        }
        for _ in 0..=round / 8 {
            marked = grown(&marked, topology);
            thin = grown(&thin, topology);
        }
        if thin.contains(&true) {
            swell(positions, &thin, faces, topology);
        }
        for (marked, thin) in marked.iter_mut().zip(&thin) {
            *marked &= !thin;
        }
        for _ in 0..3 {
            smooth(positions, &marked, topology);
        }
        tangles.update(positions);
    }
    tangles.is_empty().then_some(ROUNDS)
}

/// Brings the neighbourhood of every self-intersection and fold back to positions in which the same faces had none, as far out as it
/// takes, and says whether that is so now; where it is not after 24 rounds nothing moves. For what [`untangle`] cannot mend: a thin
/// rod that is kinked is smoothed into a thread, and is none when it is brought back.
///
/// ```
/// use mesh_core::{Topology, primitives::icosphere, untangle_towards};
/// let sound = icosphere(3);
/// let topology = Topology::new(sound.positions.len(), &sound.faces);
/// let mut moved = sound.clone();
/// moved.positions[5] = moved.positions[5].map(|x| -1.5 * x); // a spike through the far side
/// assert!(untangle_towards(&sound.positions, &mut moved.positions, &sound.faces, &topology));
/// assert!(moved.self_intersections().is_empty());
/// ```
///
/// # Cost
/// A search for self-intersections, some 5 ms for 5,000 faces; a round then only looks at what has moved.
///
/// # Panics
/// If there are not as many sound positions as positions, or a face or `topology` names a vertex that does not exist.
pub fn untangle_towards(
    sound: &[[f32; 3]],
    positions: &mut [[f32; 3]],
    faces: &[[u32; 3]],
    topology: &Topology,
) -> bool {
    assert_eq!(sound.len(), positions.len(), "as many sound positions as positions");
    let given = positions.to_vec();
    // How much of the way back each vertex goes.
    let mut back = vec![0.0_f32; given.len()];
    let mut tangles = Tangles::of(positions, faces, topology);
    for round in 0..RETURNS {
        let mut marked = tangles.found().all;
        if !marked.contains(&true) {
            return true;
        }
        for _ in 0..round {
            marked = grown(&marked, topology);
        }
        for (back, _) in back.iter_mut().zip(&marked).filter(|(_, marked)| **marked) {
            *back = 1.0;
        }
        back = eased(&back, topology);
        for (v, at) in positions.iter_mut().enumerate() {
            *at = std::array::from_fn(|k| given[v][k] + back[v] * (sound[v][k] - given[v][k]));
        }
        tangles.update(positions);
    }
    let clean = tangles.is_empty();
    if !clean {
        positions.copy_from_slice(&given);
    }
    clean
}

/// Weights that fall off around those that are 1.
fn eased(weights: &[f32], topology: &Topology) -> Vec<f32> {
    (0..weights.len())
        .map(|v| {
            let ring = topology.vertex_vertices.row(v);
            let sum: f32 = ring.iter().map(|&w| weights[w as usize]).sum();
            weights[v].max(sum / ring.len().max(1) as f32)
        })
        .collect()
}

/// Moves the marked vertices outwards, and along the surface towards the centre of their ring.
fn swell(positions: &mut [[f32; 3]], marked: &[bool], faces: &[[u32; 3]], topology: &Topology) {
    let rings = &topology.vertex_vertices;
    let normals = outwards(positions, marked, faces, topology);
    let moved: Vec<(usize, [f32; 3])> = (0..positions.len())
        .filter(|&v| marked[v])
        .map(|v| {
            let (ring, here, normal) = (rings.row(v), positions[v], normals[v]);
            let share = 1.0 / ring.len().max(1) as f32;
            let (mut center, mut edge) = ([0.0; 3], 0.0);
            for &w in ring {
                let to = sub(positions[w as usize], here);
                edge += share * norm(to);
                center = std::array::from_fn(|k| center[k] + share * to[k]);
            }
            let up: f32 = (0..3).map(|k| center[k] * normal[k]).sum();
            let to = std::array::from_fn(|k| {
                here[k] + SWELL * edge * normal[k] + 0.3 * (center[k] - up * normal[k])
            });
            (v, to)
        })
        .collect();
    for (v, to) in moved {
        positions[v] = to;
    }
}

/// Normals of the marked vertices and of those around them, of which those of the marked are averaged twice: where the surface is
/// crumpled only the neighbourhood knows what is outwards.
fn outwards(
    positions: &[[f32; 3]],
    marked: &[bool],
    faces: &[[u32; 3]],
    topology: &Topology,
) -> Vec<[f32; 3]> {
    let rings = &topology.vertex_vertices;
    let mut normals = vec![[0.0; 3]; positions.len()];
    for v in (0..normals.len()).filter(|&v| marked[v]) {
        for &near in [v as u32].iter().chain(rings.row(v)) {
            let around = topology.vertex_faces.row(near as usize).iter();
            let areas = around.map(|&f| area_vector(triangle(positions, faces[f as usize])));
            normals[near as usize] = narrow(unit(areas.fold([0.0; 3], add)));
        }
    }
    for _ in 0..2 {
        let averaged: Vec<(usize, [f32; 3])> = (0..normals.len())
            .filter(|&v| marked[v])
            .map(|v| {
                let sum: [f32; 3] = std::array::from_fn(|k| {
                    let ring = rings.row(v).iter().map(|&w| normals[w as usize][k]);
                    normals[v][k] + ring.sum::<f32>()
                });
                let length = norm(sum);
                (v, if length > 0.0 { sum.map(|x| x / length) } else { normals[v] })
            })
            .collect();
        for (v, normal) in averaged {
            normals[v] = normal;
        }
    }
    normals
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
    use super::*;
    use crate::primitives;

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
    fn a_sheet_whose_sides_have_met_keeps_its_size() {
        let mut sheet = primitives::icosphere(4).scaled([1.0, 0.03, 0.7]);
        let topology = Topology::new(sheet.positions.len(), &sheet.faces);
        // The sides change places in the middle.
        for p in &mut sheet.positions {
            if p[0].hypot(p[2]) < 0.3 {
                p[1] *= -0.4;
            }
        }
        let area = sheet.area();
        assert!(sheet.self_intersections().len() > 20);
        let rounds = untangle(&mut sheet.positions, &sheet.faces, &topology);
        assert!(rounds.is_some(), "{} left", sheet.self_intersections().len());
        assert!(sheet.area() > 0.95 * area, "{} of {area}", sheet.area());
    }

    /// A rod whose end is turned over, into itself.
    #[test]
    fn what_cannot_be_smoothed_goes_back_to_where_it_was_sound() {
        let rod = primitives::icosphere(4).scaled([0.04, 1.0, 0.04]);
        let topology = Topology::new(rod.positions.len(), &rod.faces);
        let mut kinked = rod.clone();
        for p in kinked.positions.iter_mut().filter(|p| p[1] < -0.6) {
            *p = [p[0] + 0.3 * (p[1] + 0.6), -1.25 - p[1], p[2]];
        }
        let before = kinked.self_intersections().len();
        assert!(before > 10, "{before}");
        let moved = &mut kinked.positions;
        assert!(untangle_towards(&rod.positions, moved, &rod.faces, &topology));
        assert!(kinked.self_intersections().is_empty());
        // What was sound is not touched.
        let far = |p: &[f32; 3]| p[1] > 0.5;
        let upper = rod.positions.iter().zip(&kinked.positions).filter(|(p, _)| far(p));
        assert!(upper.clone().count() > 500 && upper.clone().all(|(p, q)| p == q));
    }

    #[test]
    fn without_a_way_back_nothing_moves() {
        let mut crossed = primitives::icosphere(2);
        crossed.positions[5] = crossed.positions[5].map(|c| -1.5 * c);
        let topology = Topology::new(crossed.positions.len(), &crossed.faces);
        let (sound, before) = (crossed.positions.clone(), crossed.positions.clone());
        assert!(!untangle_towards(&sound, &mut crossed.positions, &crossed.faces, &topology));
        assert_eq!(crossed.positions, before);
    }

    #[test]
    fn a_sound_mesh_stays_as_it_is() {
        let mut sphere = primitives::icosphere(2);
        let before = sphere.positions.clone();
        let topology = Topology::new(before.len(), &sphere.faces);
        assert_eq!(untangle(&mut sphere.positions, &sphere.faces, &topology), Some(0));
        assert_eq!(sphere.positions, before);
    }
}
