//! The last steps of a mesh with thin parts, which mending pushed off the masks' edges.

use super::{config::FitConfig, error::FitError, shape::Shape, target::Target, untangle::untangle};

/// How often the mesh is moved and mended again, at most.
const ROUNDS: usize = 6;
/// Steps in between: few enough that sides which were moved apart do not meet again everywhere.
const STEPS: usize = 6;
/// Their length, as a share of a level's first step.
const SHARE: f32 = 0.1;

/// Mends the mesh, then moves and mends it by turns as long as that brings it nearer to the masks. What results has no
/// self-intersections, if mending can have it so.
///
/// # Errors
/// As [`Shape::step`].
pub(super) fn settle(
    shape: &mut Shape,
    targets: &[Target],
    config: &FitConfig,
    step: usize,
) -> Result<(), FitError> {
    if !mend(shape) {
        return Ok(());
    }
    let views: Vec<usize> = (0..targets.len()).collect();
    let mut best = (shape.mask_iou(targets), shape.positions.clone());
    for round in 0..ROUNDS {
        for k in 0..STEPS {
            let edge = shape.mean_edge();
            let stride = |target: &Target| target.lines_between_samples(edge);
            let rate = SHARE * config.learning_rate;
            shape.step(targets, &views, stride, config, rate, step + round * STEPS + k)?;
        }
        if !mend(shape) {
            break;
        }
        let found = shape.mask_iou(targets);
        if found <= best.0 {
            break;
        }
        best = (found, shape.positions.clone());
    }
    shape.place(best.1);
    Ok(())
}

/// Whether nothing of the mesh passes through itself any more.
pub(super) fn mend(shape: &mut Shape) -> bool {
    let mut positions = shape.positions.clone();
    let rounds = untangle(&mut positions, &shape.faces, &shape.topology);
    if rounds != Some(0) {
        shape.place(positions);
    }
    rounds.is_some()
}
