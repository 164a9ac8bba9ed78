//! What an image says for sure about the cells of what its camera sees.

use super::scenes::Scene;

/// What is added to the logit of a cell that is known; the network's own say is left to the others.
const CERTAIN: f32 = 12.0;

/// For each cell, row, column, step in depth: negative where it is empty, as beside the silhouette and before the surface that
/// measured depth shows; positive where that surface runs through it; 0 where the image says nothing.
///
/// A cell before the surface's nearest one is left open: between two pixels the surface may come nearer than at either.
///
/// # References
/// Kutulakos and Seitz 2000, *A Theory of Shape by Space Carving*; Laurentini 1994, *The Visual Hull Concept*.
pub(super) fn carved(scene: &Scene, cells: usize) -> Vec<f32> {
    let side = scene.picture.camera.width;
    let range = |i: usize| i * side / cells..((i + 1) * side).div_ceil(cells);
    let mut known = vec![0.0; cells.pow(3)];
    for (i, ray) in known.chunks_exact_mut(cells).enumerate() {
        let columns = range(i % cells);
        let pixels = range(i / cells).flat_map(|row| columns.clone().map(move |c| row * side + c));
        carve(ray, pixels, scene);
    }
    known
}

/// The cells behind one another that the same pixels see.
fn carve(ray: &mut [f32], pixels: impl Iterator<Item = usize>, scene: &Scene) {
    let (mask, channel) = (&scene.picture.mask, &scene.depth_targets.channel);
    let mut any = false;
    let mut nearest = None;
    let cells = ray.len();
    for p in pixels.filter(|&p| mask[p] > 0) {
        any = true;
        // The channel is 1 at the near end and 0 at the far one, linear in one over the depth as the steps are.
        let seen = channel.get(p).copied().filter(|&c| c > 0.0 && c < 1.0 && mask[p] > 127);
        if let Some(c) = seen {
            let step = (((1.0 - c) * cells as f32) as usize).min(cells - 1);
            ray[step] = CERTAIN;
            nearest = Some(nearest.map_or(step, |other: usize| other.min(step)));
        }
    }
    if !any {
        ray.fill(-CERTAIN);
    } else if let Some(nearest) = nearest {
        ray[..nearest.saturating_sub(1)].fill(-CERTAIN);
    }
}
