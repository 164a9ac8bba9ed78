//! The few viewpoints that a guess holds likely.

use std::f64::consts::TAU;

use nets::ViewpointGuess;

use super::place::{Viewpoint, wrapped};

/// The share of the likeliest's probability below which a hypothesis is not worth a look.
const LEAST: f64 = 0.02;

/// A viewpoint, and how likely it is held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hypothesis {
    /// From where.
    pub viewpoint: Viewpoint,
    /// From 0 to 1; all of an image together are at most 1.
    pub probability: f64,
}

/// At most `count` hypotheses of each image, and at least one, the likeliest first. Those that say the same, within half of the angle between two
/// directions, are one, whose azimuth is their mean.
pub fn hypotheses(guess: &ViewpointGuess<'_>, count: usize) -> Vec<Vec<Hypothesis>> {
    let [n, k] = guess.logits.dims();
    let [p, turns] = [guess.logits.softmax(), guess.turns].map(|x| x.value());
    let [elevation, log_distance] = [guess.elevation, guess.log_distance].map(|x| x.value());
    let spacing = TAU / k as f64;
    let of_image = |i: usize| {
        let all = (0..k).map(|j| Hypothesis {
            viewpoint: Viewpoint {
                azimuth: spacing * j as f64 + f64::from(turns[[i, j]]),
                elevation: f64::from(elevation[[i]]),
                distance: f64::from(log_distance[[i]]).exp(),
            },
            probability: f64::from(p[[i, j]]),
        });
        let mut merged = merged(all.collect(), 0.5 * spacing);
        let least = merged.first().map_or(0.0, |first| LEAST * first.probability);
        merged.retain(|one| one.probability >= least);
        merged.truncate(count.max(1));
        merged
    };
    (0..n).map(of_image).collect()
}

/// Joins each to the likeliest before it that is nearer than `reach`.
fn merged(mut all: Vec<Hypothesis>, reach: f64) -> Vec<Hypothesis> {
    let likelier = |a: &Hypothesis, b: &Hypothesis| b.probability.total_cmp(&a.probability);
    all.sort_by(likelier);
    let mut kept: Vec<Hypothesis> = Vec::new();
    for one in all {
        let away = |other: &Hypothesis| wrapped(one.viewpoint.azimuth - other.viewpoint.azimuth);
        match kept.iter_mut().find(|other| away(other).abs() < reach) {
            Some(other) => {
                let share =
                    one.probability / (one.probability + other.probability).max(f64::MIN_POSITIVE);
                other.viewpoint.azimuth += share * away(other);
                other.probability += one.probability;
            }
            None => kept.push(one),
        }
    }
    kept.sort_by(likelier);
    for one in &mut kept {
        one.viewpoint.azimuth = wrapped(one.viewpoint.azimuth);
    }
    kept
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use ndarray::{arr1, arr2};

    use super::*;

    /// Two directions that say 30 degrees are one hypothesis, and likelier together than the flipped one.
    #[test]
    fn what_says_the_same_is_one() {
        let tape = Tape::eval();
        let p = [0.3_f32, 0.25, 0.001, 0.0005, 0.4, 0.001, 0.0005, 0.047];
        let turns = [28.0_f32, -13.0, 0.0, 0.0, 20.0, 0.0, 0.0, 0.0].map(f32::to_radians);
        let guess = ViewpointGuess {
            logits: tape.constant(arr2(&[p.map(f32::ln)])),
            turns: tape.constant(arr2(&[turns])),
            elevation: tape.constant(arr1(&[0.5])),
            log_distance: tape.constant(arr1(&[-0.5])),
        };
        let found = &hypotheses(&guess, 8)[0];
        let degrees: Vec<f64> =
            found.iter().map(|one| one.viewpoint.azimuth.to_degrees()).collect();
        assert_eq!(found.len(), 3, "{found:?}");
        // (0.3 * 28 + 0.25 * 32) / 0.55
        assert!((degrees[0] - 29.818).abs() < 0.01 && (found[0].probability - 0.55).abs() < 1e-3);
        assert!(
            (degrees[1] + 160.0).abs() < 0.01 && (degrees[2] + 45.0).abs() < 0.01,
            "{degrees:?}"
        );
        assert!((found[0].viewpoint.distance - (-0.5_f64).exp()).abs() < 1e-6);
        assert_eq!(hypotheses(&guess, 1)[0], found[..1]);
    }
}
