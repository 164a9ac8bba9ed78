//! What an image says for sure about the cells of what its camera sees.

use super::config::DepthKind;
use super::scenes::Scene;

/// What is added to the logit of a cell that is known; the network's own say is left to the others.
const CERTAIN: f32 = 12.0;

/// For each cell, row, column, step in depth: negative where it is empty, as beside the silhouette and before the surface that
/// measured depth shows; positive where that surface runs through it; 0 where the image says nothing.
/// Depth says something if it is the true one.
///
/// A cell before the surface's nearest one is left open: between two pixels the surface may come nearer than at either.
///
/// # References
/// Kutulakos and Seitz 2000, *A Theory of Shape by Space Carving*; Laurentini 1994, *The Visual Hull Concept*.
pub(super) fn carved(scene: &Scene, cells: usize, depth: DepthKind) -> Vec<f32> {
    let side = scene.image.camera.width;
    let range = |i: usize| i * side / cells..((i + 1) * side).div_ceil(cells);
    let mut known = vec![0.0; cells.pow(3)];
    for (i, ray) in known.chunks_exact_mut(cells).enumerate() {
        let columns = range(i % cells);
        let pixels = range(i / cells).flat_map(|row| columns.clone().map(move |c| row * side + c));
        carve(ray, pixels, scene, depth == DepthKind::True);
    }
    known
}

/// Empties what is not joined, side by side, to a cell that is seen: nothing speaks for a piece that floats behind. Where no cell is
/// seen, as without depth, all stays.
pub(super) fn keep_joined(occupied: &mut [bool], known: &[f32], cells: usize) {
    let mut open: Vec<usize> = (0..known.len()).filter(|&i| known[i] > 0.0).collect();
    if open.is_empty() {
        return;
    }
    let mut reached = vec![false; occupied.len()];
    for &i in &open {
        reached[i] = true;
    }
    while let Some(i) = open.pop() {
        for stride in [1, cells, cells * cells] {
            let along = i / stride % cells;
            let lower = (along > 0).then(|| i - stride);
            let upper = (along + 1 < cells).then(|| i + stride);
            for next in [lower, upper].into_iter().flatten() {
                if occupied[next] && !std::mem::replace(&mut reached[next], true) {
                    open.push(next);
                }
            }
        }
    }
    occupied.iter_mut().zip(&reached).for_each(|(occupied, &reached)| *occupied &= reached);
}

/// The cells behind one another that the same pixels see.
fn carve(ray: &mut [f32], pixels: impl Iterator<Item = usize>, scene: &Scene, measured: bool) {
    let (mask, channel) = (&scene.image.mask, &scene.depth_targets.channel);
    let mut any = false;
    let mut nearest = None;
    let cells = ray.len();
    for p in pixels.filter(|&p| mask[p] > 0) {
        any = true;
        // The channel is 1 at the near end and 0 at the far one, linear in one over the depth as the steps are.
        // An estimate's has a scale and a shift of its own, and says nothing of cells.
        let seen = channel.get(p).filter(|_| measured).copied();
        let seen = seen.filter(|&c| c > 0.0 && c < 1.0 && mask[p] > 127);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Of four cells in a row, of which the first is seen: the second stays, the fourth goes; and so for what is beside.
    #[test]
    fn what_floats_is_dropped() {
        let mut known = vec![0.0; 64];
        known[0] = CERTAIN;
        let mut occupied = vec![false; 64];
        for i in [0, 1, 3, 5, 21, 42] {
            occupied[i] = true;
        }
        let all = occupied.clone();
        keep_joined(&mut occupied, &known, 4);
        let kept: Vec<usize> = (0..64).filter(|&i| occupied[i]).collect();
        // 1 is beside 0, 5 beside 1, 21 beside 5; 3 and 42 stand alone.
        assert_eq!(kept, [0, 1, 5, 21]);
        let mut unseen = all.clone();
        keep_joined(&mut unseen, &[0.0; 64], 4);
        assert_eq!(unseen, all);
    }
}
