//! The last steps of a mesh with thin parts, which mending pushed off the masks' edges.

use mesh_core::{Examination, untangle, untangle_towards};

use super::{config::FitConfig, error::FitError, shape::Shape, target::Target};

/// How often the mesh is moved and mended again, at most.
const ROUNDS: usize = 6;
/// Steps in between: few enough that sides which were moved apart do not meet again everywhere.
const STEPS: usize = 6;
/// Their length, as a share of a level's first step.
const SHARE: f32 = 0.1;

/// Mends the mesh, then moves and mends it by turns as long as that brings it nearer to the masks. What mending cannot is brought
/// back to where it was sound, if that is known: `sound` are such positions of the same faces. Cancelled, it ends with the round.
///
/// # Errors
/// As [`Shape::step`].
pub(super) fn settle(
    shape: &mut Shape,
    sound: Option<&[[f32; 3]]>,
    targets: &[Target],
    config: &FitConfig,
    step: usize,
    is_cancelled: &dyn Fn() -> bool,
) -> Result<(), FitError> {
    if !mended(shape, sound, targets) {
        return Ok(());
    }
    let views: Vec<usize> = (0..targets.len()).collect();
    let mut best = (shape.mask_iou(targets), shape.positions.clone());
    for round in 0..ROUNDS {
        if is_cancelled() {
            break;
        }
        for k in 0..STEPS {
            let rate = SHARE * config.learning_rate;
            shape.step(targets, &views, config, rate, step + round * STEPS + k)?;
        }
        if !mended(shape, sound, targets) {
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
fn mended(shape: &mut Shape, sound: Option<&[[f32; 3]]>, targets: &[Target]) -> bool {
    let Some(found) = mend(shape, sound, targets) else { return false };
    shape.place(found);
    true
}

/// Smooths the mesh where it passes through itself, or brings it back there to where it was sound, if that is known: what is nearer
/// to the masks. Returns positions of its vertices at which nothing passes through itself: those that it has now, or others where
/// they are not so near; nothing where none were found.
pub(super) fn mend(
    shape: &mut Shape,
    sound: Option<&[[f32; 3]]>,
    targets: &[Target],
) -> Option<Vec<[f32; 3]>> {
    let given = shape.positions.clone();
    let (faces, topology) = (&shape.faces, &shape.topology);
    let mut smoothed = given.clone();
    let rounds = untangle(&mut smoothed, faces, topology);
    if rounds == Some(0) {
        return Some(given);
    }
    // As often again, the neighbourhood small at first.
    let clean = rounds.is_some() || untangle(&mut smoothed, faces, topology).is_some();
    let mut back = given;
    let found = sound.is_some_and(|sound| untangle_towards(sound, &mut back, faces, topology));
    shape.place(smoothed.clone());
    if !found {
        return clean.then_some(smoothed);
    }
    let near = shape.mask_iou(targets);
    shape.place(back.clone());
    if shape.mask_iou(targets) > near {
        return Some(back);
    }
    shape.place(smoothed.clone());
    Some(if clean { smoothed } else { back })
}

/// What to say of a mesh after mending, if anything: the count is that of the finished mesh, which rounding may have changed.
pub(super) fn remaining(found: &Examination, untangled: bool) -> Option<String> {
    let fold = || {
        let degrees = found.health.largest_dihedral_degrees;
        format!("the surface is folded by {degrees:.0} degrees")
    };
    let text = found.crossings().or_else(|| (!untangled).then(fold));
    text.map(|text| text + " where smoothing could not help")
}

#[cfg(test)]
mod tests {
    use mesh_core::primitives;

    use super::*;

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
