//! How far refined meshes are from the true surfaces.

use autodiff_lite::Var;
use losses::{
    Directions, Matches, chamfer_distance, chamfer_normals, edge_length, laplacian_squared,
    surface_normals, surface_points,
};
use mesh_core::{SurfacePoint, TriMesh, sample_surface};

use super::config::RefineConfig;
use super::packed::Packed;
use super::scenes::Scene;
use super::stage_meshes::StageMeshes;
use crate::stacked::stacked;

/// The true points of a batch.
pub(super) struct Truth<'t> {
    /// `[N, P, 3]`.
    pub(super) points: Var<'t>,
    /// `[N, P, 3]`, where all have normals.
    pub(super) normals: Option<Var<'t>>,
}

impl<'t> Truth<'t> {
    pub(super) fn new(tape: &'t autodiff_lite::Tape, scenes: &[&Scene]) -> Self {
        let count = scenes[0].truth.positions.len();
        let shape = [scenes.len(), count, 3];
        let points = scenes.iter().map(|scene| scene.truth.positions.as_flattened());
        let points = stacked(tape, points, &shape);
        let all = scenes.iter().all(|scene| scene.truth.normals.len() == count);
        let normals = || scenes.iter().map(|scene| scene.truth.normals.as_flattened());
        Self { points, normals: all.then(|| stacked(tape, normals(), &shape)) }
    }
}

/// Points drawn on the meshes of a stage, and their nearest true ones.
pub(super) struct Sampled {
    samples: Vec<Vec<SurfacePoint>>,
    pub(super) matches: Matches,
}

/// The mean squared distance of both ways, that of normals if it counts, the mean squared edge length.
pub(super) struct SurfaceTerms<'t> {
    pub(super) chamfer: Var<'t>,
    pub(super) normal: Option<Var<'t>>,
    pub(super) edge: Var<'t>,
    /// Weighted, if it counts.
    pub(super) rough: Option<Var<'t>>,
}

/// Compares `[1, ΣV, 3]` with as many points on each mesh as there are true ones.
pub(super) fn compared<'t>(
    packed: &Packed,
    positions: Var<'t>,
    truth: &Truth<'t>,
    with_normals: bool,
    seed: u64,
) -> (SurfaceTerms<'t>, Sampled) {
    let tape = positions.tape();
    let [n, count, _] = truth.points.dims();
    let parts: Vec<Var<'t>> = (0..n).map(|k| packed.part(positions, k)).collect();
    let samples: Vec<Vec<SurfacePoint>> = parts
        .iter()
        .enumerate()
        .map(|(k, part)| drawn(*part, &packed.shapes[k].faces, count, seed.wrapping_add(k as u64)))
        .collect();
    let each = |of: &dyn Fn(usize) -> Var<'t>| tape.stack(&(0..n).map(of).collect::<Vec<_>>(), 0);
    let points = each(&|k| surface_points(parts[k], &packed.shapes[k].faces, &samples[k]));
    let mut matches = Matches::default();
    matches.find(points, truth.points);
    let both = Directions::default();
    let chamfer = chamfer_distance(points, truth.points, &matches, both);
    let normal = truth.normals.filter(|_| with_normals).map(|normals| {
        let own = each(&|k| surface_normals(parts[k], &packed.shapes[k].faces, &samples[k]));
        chamfer_normals(own, normals, &matches, both)
    });
    let edges: Vec<(f32, Var<'t>)> = (0..n)
        .map(|k| (1.0 / n as f32, edge_length(parts[k], &packed.shapes[k].topology.edges, 0.0)))
        .collect();
    let edge = tape.lincomb(&edges);
    (SurfaceTerms { chamfer, normal, edge, rough: None }, Sampled { samples, matches })
}

/// The squared Laplacians that the options weigh, a mean over the meshes and their vertices. In units of each mesh's squared edge,
/// so that a weight means the same at any number of vertices.
pub(super) fn roughness<'t>(stage: &StageMeshes<'t>, config: &RefineConfig) -> Option<Var<'t>> {
    let packed = &stage.packed;
    let tape = stage.positions.tape();
    let mut terms = Vec::new();
    for (k, shape) in packed.shapes.iter().enumerate() {
        let part = |x: Var<'t>| packed.part(x, k);
        let edges = edge_length(part(stage.before), &shape.topology.edges, 0.0).item();
        let unit = 1.0 / (shape.vertices() * packed.shapes.len()) as f64;
        let mut add = |weight: f64, x: Var<'t>, power: i32| {
            if weight > 0.0 && edges > 0.0 {
                let factor = weight * unit / f64::from(edges).powi(power);
                let squared = laplacian_squared(part(x), &shape.topology.vertex_vertices);
                terms.push((factor as f32, squared));
            }
        };
        add(config.smoothness_weight, stage.positions, 1);
        add(config.bending_weight, stage.positions - stage.before, 2);
    }
    (!terms.is_empty()).then(|| tape.lincomb(&terms))
}

/// Points by area; of a mesh that has none, its first corner as often.
fn drawn(positions: Var<'_>, faces: &[[u32; 3]], count: usize, seed: u64) -> Vec<SurfacePoint> {
    let value = positions.value();
    let rows = value.as_slice().as_chunks::<3>().0.to_vec();
    let samples = sample_surface(&TriMesh::new(rows, faces.to_vec()), count, seed);
    if samples.len() == count {
        return samples;
    }
    vec![SurfacePoint { face: 0, barycentric: [1.0, 0.0, 0.0] }; count]
}

/// The mean absolute difference of colours `[1, ΣV, 3]` at the drawn points from those of the nearest true points; none
/// where a scene has no colours.
pub(super) fn color_difference<'t>(
    packed: &Packed,
    colors: Var<'t>,
    sampled: &Sampled,
    scenes: &[&Scene],
) -> Option<Var<'t>> {
    let tape = colors.tape();
    let count = sampled.samples[0].len();
    let known = |scene: &&Scene| scene.colors.len() == scene.truth.positions.len();
    if !scenes.iter().all(known) {
        return None;
    }
    let own: Vec<Var<'t>> = (0..scenes.len())
        .map(|k| {
            let part = packed.part(colors, k);
            surface_points(part, &packed.shapes[k].faces, &sampled.samples[k])
        })
        .collect();
    let nearest = sampled.matches.x_to_y().chunks_exact(count);
    let target: Vec<[f32; 3]> = scenes
        .iter()
        .zip(nearest)
        .flat_map(|(scene, near)| near.iter().map(|&i| scene.colors[i as usize]))
        .collect();
    let shape = [scenes.len(), count, 3];
    let target = stacked(tape, std::iter::once(target.as_flattened()), &shape);
    Some(losses::l1(tape.stack(&own, 0), target, None))
}
