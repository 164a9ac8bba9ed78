//! Dents, dimples and ripples between the lines that outlines touch: normals are made even, and outlines fitted again, in turns.
//!
//! The bending energy of a fit is quadratic: it spreads what is not flat over all of the surface, and leaves a lip where an edge is, and
//! the side behind it sunk. Two robust norms take its place, one that reaches across [whole sides](super::fairing), and a bilateral filter
//! for what is small: what turns a little becomes flat or evenly round, what turns much stays.

use mesh_core::NormalFilter;

use super::config::FitConfig;
use super::error::FitError;
use super::fairing;
use super::order::Order;
use super::shape::Shape;
use super::target::Target;

/// A gentle filter: what it does to small parts a few steps mend.
const FILTER: NormalFilter = NormalFilter { rounds: 4, spread: 0.35, steps: 4 };
/// Turns of filtering and fitting.
const TURNS: usize = 4;
/// Steps of fitting in a turn of fairing, and of filtering.
const STEPS: [usize; 2] = [5, 10];
/// Their length, as a share of a level's first step.
const SHARE: f32 = 0.2;
/// Views of a step, where the configuration does not say how many: the shape is nearly right, and noise is averaged away.
const VIEWS: usize = 32;
/// How much mask IoU a turn of filtering may cost; one that costs more is taken back, and is the last.
const LOSS: f64 = 0.0005;

/// Makes normals even and fits the outlines again, as long as the masks of `targets` are covered about as well as before (mask IoU within
/// 0.0005 for each of both ways). Cancelled, it ends with the step, and what was not yet judged is taken back.
///
/// # Errors
/// As [`Shape::step`].
pub(super) fn flatten(
    shape: &mut Shape,
    targets: &[Target],
    config: &FitConfig,
    step: usize,
    is_cancelled: &dyn Fn() -> bool,
) -> Result<(), FitError> {
    // What is even is smooth.
    let views_per_step = config.views_per_step.or(Some(VIEWS));
    let config = FitConfig { bending: 0.0, views_per_step, ..config.clone() };
    let mut order = Order::new(targets.len(), &config);
    let mut fit = |shape: &mut Shape, steps: usize| {
        for k in 0..steps {
            if is_cancelled() {
                break;
            }
            shape.step(targets, order.next(), &config, SHARE * config.learning_rate, step)?;
            if config.relax_every.is_some_and(|every| (k + 1).is_multiple_of(every)) {
                shape.relax(config.relax);
            }
        }
        Ok(shape.mask_iou(targets))
    };
    let mut best = fairing::fair(shape, targets, &mut |shape| fit(shape, STEPS[0]), is_cancelled)?;
    for _ in 0..TURNS {
        if is_cancelled() {
            break;
        }
        let given = shape.positions.clone();
        let mut filtered = given.clone();
        FILTER.apply(&mut filtered, &shape.faces, &shape.topology);
        shape.place(filtered);
        let iou = fit(shape, STEPS[1])?;
        if iou < best - LOSS {
            shape.place(given);
            break;
        }
        best = best.max(iou);
    }
    Ok(())
}
