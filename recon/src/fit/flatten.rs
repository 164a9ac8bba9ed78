//! Dimples and ripples between the lines that outlines touch: normals are filtered, and outlines fitted again, in turns.
//!
//! The bending energy of a fit is quadratic: it spreads what is not flat over all of the surface, and leaves a lip where an edge is. A
//! bilateral filter is the robust norm that it lacks: what turns a little becomes flat or evenly round, what turns much stays.

use mesh_core::NormalFilter;

use super::config::FitConfig;
use super::error::FitError;
use super::shape::Shape;
use super::target::Target;

/// A gentle filter: what it does to small parts a few steps mend.
const FILTER: NormalFilter = NormalFilter { rounds: 4, spread: 0.35, steps: 4 };
/// Turns of filtering and fitting.
const TURNS: usize = 4;
/// Steps of fitting in a turn.
const STEPS: usize = 10;
/// Their length, as a share of a level's first step.
const SHARE: f32 = 0.2;
/// How much mask IoU a turn may cost; one that costs more is taken back, and is the last.
const LOSS: f64 = 0.0005;

/// Filters normals and fits the outlines again, as long as the masks of `targets` are covered as well as before.
///
/// # Errors
/// As [`Shape::step`].
pub(super) fn flatten(
    shape: &mut Shape,
    targets: &[Target],
    config: &FitConfig,
    step: usize,
) -> Result<(), FitError> {
    let all: Vec<usize> = (0..targets.len()).collect();
    // The filter keeps it smooth.
    let config = FitConfig { bending: 0.0, ..config.clone() };
    let mut best = shape.mask_iou(targets);
    for _ in 0..TURNS {
        let given = shape.positions.clone();
        let mut filtered = given.clone();
        FILTER.apply(&mut filtered, &shape.faces, &shape.topology);
        shape.place(filtered);
        for k in 0..STEPS {
            let edge = shape.mean_edge();
            let stride = |target: &Target| target.lines_between_samples(edge);
            shape.step(targets, &all, stride, &config, SHARE * config.learning_rate, step)?;
            if config.relax_every.is_some_and(|every| (k + 1).is_multiple_of(every)) {
                shape.relax(config.relax);
            }
        }
        let iou = shape.mask_iou(targets);
        if iou < best - LOSS {
            shape.place(given);
            break;
        }
        best = best.max(iou);
    }
    Ok(())
}
