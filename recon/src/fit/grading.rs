//! How long edges should be at each place of a surface: short where it bends, long elsewhere.

use mesh_core::vector::{norm, sub};
use mesh_core::{Topology, TriMesh, coarsen, vertex_normals};
use rayon::prelude::*;

/// The angle that an edge of the wished length spans where the surface bends, radians.
const ANGLE: f32 = 0.7;
/// How much longer edges may be a unit of length further on.
const GROWTH: f32 = 0.5;
/// Rounds in which short edges make their neighbourhood's shorter, and in which curvatures are averaged.
const ROUNDS: usize = 6;
/// The longest edges, in lengths of those of a mesh that is even.
const LONGEST: f64 = 2.5;
/// How often edges are made shorter where faces run through each other.
const REPAIRS: usize = 4;
/// By how much each time, and how far around, in lengths of the edges there.
const SHORTER: (f64, f32) = (0.6, 1.5);

/// A surface in triangles of the wished lengths.
pub(super) struct Graded {
    pub(super) mesh: TriMesh,
    /// Positions of its vertices, near theirs, at which nothing passes through itself, if mending finds some.
    pub(super) sound: Option<Vec<[f32; 3]>>,
}

/// The surface in about `faces` triangles with no edge that is meant to be shorter than `shortest`. Where these run through each
/// other beyond mending, as between bars that are nearer than the edges are long, they are shorter and more.
pub(super) fn graded(mesh: &TriMesh, topology: &Topology, faces: usize, shortest: f64) -> Graded {
    let mut lengths = lengths(mesh, topology, faces, shortest);
    for repair in 0.. {
        let Ok(coarse) = coarsen(mesh, topology, &lengths) else { break };
        let mut mended = coarse.clone();
        let sound = mended.untangle().is_some();
        if repair == REPAIRS || sound {
            return Graded { mesh: coarse, sound: sound.then_some(mended.positions) };
        }
        let around = surroundings(&coarse, &mended.tangled());
        lengths.par_iter_mut().zip(&mesh.positions).for_each(|(length, &at)| {
            if around.iter().any(|&(place, reach)| norm(sub(at, place)) < reach) {
                *length *= SHORTER.0;
            }
        });
    }
    let mut mended = mesh.clone();
    let sound = mended.untangle().is_some();
    Graded { mesh: mesh.clone(), sound: sound.then_some(mended.positions) }
}

/// Where vertices are that are marked, and how far around them edges should be shorter.
fn surroundings(mesh: &TriMesh, marked: &[bool]) -> Vec<([f32; 3], f32)> {
    let topology = Topology::new(mesh.positions.len(), &mesh.faces);
    let marked = (0..marked.len()).filter(|&v| marked[v]);
    let around = |v: usize| {
        let at = mesh.positions[v];
        let ring = topology.vertex_vertices.row(v).iter();
        let edges = ring.map(|&w| norm(sub(mesh.positions[w as usize], at)));
        (at, SHORTER.1 * edges.fold(0.0, f32::max))
    };
    marked.map(around).collect()
}

/// A length for each vertex so that about `faces` triangles result, none shorter than `shortest`.
fn lengths(mesh: &TriMesh, topology: &Topology, faces: usize, shortest: f64) -> Vec<f64> {
    let wished = by_curvature(mesh, topology);
    // An equilateral triangle of side l has the area sqrt(3)/4 l^2.
    let even = (mesh.area() / (0.433 * faces as f64)).sqrt();
    let shortest = shortest.min(even);
    let areas = mesh_core::vertex_areas(&mesh.positions, &mesh.faces);
    let bounded =
        |length: f32, scale: f64| (scale * f64::from(length)).clamp(shortest, LONGEST * even);
    let count = |scale: f64| -> f64 {
        let of = |(&length, &area): (&f32, &f32)| {
            f64::from(area) / (0.433 * bounded(length, scale).powi(2))
        };
        wished.iter().zip(&areas).map(of).sum()
    };
    // The more the longer edges are the fewer there are.
    let (mut low, mut high) = (1e-3f64, 1e3f64);
    for _ in 0..40 {
        let middle = (low * high).sqrt();
        if count(middle) > faces as f64 { low = middle } else { high = middle }
    }
    wished.into_iter().map(|length| bounded(length, high)).collect()
}

/// Lengths that span [`ANGLE`], changing slowly from place to place.
fn by_curvature(mesh: &TriMesh, topology: &Topology) -> Vec<f32> {
    let normals = vertex_normals(&mesh.positions, &mesh.faces);
    let rings = &topology.vertex_vertices;
    let apart = |field: &[[f32; 3]], v: usize, w: u32| -> f32 {
        sub(field[v], field[w as usize]).iter().map(|x| x * x).sum()
    };
    // Squares of curvatures.
    let mut curvature: Vec<f32> = (0..normals.len())
        .into_par_iter()
        .map(|v| {
            let sum = |field| rings.row(v).iter().map(|&w| apart(field, v, w)).sum::<f32>();
            sum(&normals) / sum(&mesh.positions).max(1e-20)
        })
        .collect();
    for _ in 0..ROUNDS {
        curvature = (0..curvature.len())
            .into_par_iter()
            .map(|v| {
                let ring = rings.row(v);
                let sum: f32 = ring.iter().map(|&w| curvature[w as usize]).sum();
                0.5 * (curvature[v] + sum / ring.len().max(1) as f32)
            })
            .collect();
    }
    let mut lengths: Vec<f32> =
        curvature.into_iter().map(|square| ANGLE / square.sqrt().max(1e-3)).collect();
    for _ in 0..ROUNDS {
        for v in 0..lengths.len() {
            for &w in rings.row(v) {
                let near = lengths[w as usize] + GROWTH * apart(&mesh.positions, v, w).sqrt();
                lengths[v] = lengths[v].min(near);
            }
        }
    }
    lengths
}

#[cfg(test)]
mod tests {
    use mesh_core::primitives;

    use super::*;

    #[test]
    fn edges_are_short_where_the_surface_bends() {
        // A thin plate with a round rim.
        let plate = primitives::icosphere(5).scaled([1.0, 0.05, 1.0]);
        let topology = Topology::new(plate.positions.len(), &plate.faces);
        let lengths = lengths(&plate, &topology, 2_000, 1e-3);
        let mean = |range: std::ops::Range<f32>| {
            let within = |p: &[f32; 3]| range.contains(&p[0].hypot(p[2]));
            let kept = plate.positions.iter().zip(&lengths).filter(|(p, _)| within(p));
            let (sum, count) = kept.fold((0.0, 0), |(s, n), (_, l)| (s + l, n + 1));
            sum / f64::from(count)
        };
        let (middle, rim) = (mean(0.0..0.5), mean(0.99..1.01));
        assert!(rim < 0.4 * middle, "{rim} at the rim, {middle} in the middle");
        let areas = mesh_core::vertex_areas(&plate.positions, &plate.faces);
        let faces: f64 =
            areas.iter().zip(&lengths).map(|(&a, l)| f64::from(a) / (0.433 * l * l)).sum();
        assert!((faces / 2_000.0 - 1.0).abs() < 0.02, "{faces} faces");
    }
}
