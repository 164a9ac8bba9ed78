//! What a guess misses of true viewpoints.

use std::f64::consts::{PI, TAU};

use autodiff_lite::{Real, Var};
use ndarray::{Array1, Array2};
use nets::ViewpointGuess;

use super::place::{Viewpoint, wrapped};

/// An angle whose square counts 1, radians: ten degrees.
const ANGLE: f64 = PI / 18.0;
/// A logarithm of distances whose square counts 1: a tenth.
const DISTANCE: f64 = 0.1;

/// The mean over images of
///
/// ```text
/// -Σ_k w_k ln p_k + Σ_k w_k ((2π k / K + turn_k - azimuth) / 10°)² + (Δ elevation / 10°)² + (Δ ln distance / 0.1)²
/// ```
///
/// where `w_k` falls from 1 at the `k`-th direction to 0 at its neighbours: an azimuth between two directions is a hypothesis of
/// both, so that neither has to jump.
///
/// # Shapes
/// `truth` has as many viewpoints as the guess has images; the result is a scalar.
/// # Panics
/// If it has not.
/// # References
/// Mousavian et al. 2017, *3D bounding box estimation using deep learning and geometry*, whose bins overlap likewise; their
/// residual is a sine and a cosine.
#[track_caller]
pub fn viewpoint_loss<'t, F: Real>(
    guess: &ViewpointGuess<'t, F>,
    truth: &[Viewpoint],
) -> Var<'t, F> {
    let [n, k] = guess.logits.dims();
    assert!(n == truth.len(), "viewpoint_loss: {} viewpoints, expected {n}", truth.len());
    let tape = guess.logits.tape();
    let spacing = TAU / k as f64;
    let offset = |i: usize, j: usize| wrapped(truth[i].azimuth - spacing * j as f64);
    let weight = |i: usize, j: usize| (1.0 - offset(i, j).abs() / spacing).max(0.0);
    let table = |f: &dyn Fn(usize, usize) -> f64| {
        tape.constant(Array2::from_shape_fn((n, k), |(i, j)| F::from_f64(f(i, j))))
    };
    let row = |f: &dyn Fn(&Viewpoint) -> f64| {
        tape.constant(Array1::from_shape_fn(n, |i| F::from_f64(f(&truth[i]))))
    };
    let weights = table(&weight);
    let mean = |sum: Var<'t, F>, unit: f64| sum.scale(F::from_f64(1.0 / (n as f64 * unit)));
    let chosen = mean((guess.logits.log_softmax() * weights).sum(), -1.0);
    let turned = ((guess.turns - table(&offset)).square() * weights).sum();
    let raised = (guess.elevation - row(&|v| v.elevation)).square().sum();
    let far = (guess.log_distance - row(&|v| v.distance.ln())).square().sum();
    chosen
        + mean(turned, ANGLE * ANGLE)
        + mean(raised, ANGLE * ANGLE)
        + mean(far, DISTANCE * DISTANCE)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use autodiff_lite::Tape;
    use autodiff_lite::testkit::{Options, check, function};
    use ndarray::{arr1, arr2};

    use super::*;

    fn at(degrees: f64) -> Viewpoint {
        Viewpoint { azimuth: degrees.to_radians(), elevation: 0.4, distance: 0.7 }
    }

    /// Of four directions, 100 degrees is the second's but for a ninth that is the third's.
    #[test]
    fn it_is_the_formula() {
        let tape = Tape::<f64>::eval();
        let (p, turns) = ([0.1, 0.6, 0.2, 0.1_f64], [5.0, 13.0, -60.0, 0.0].map(f64::to_radians));
        let guess = ViewpointGuess {
            logits: tape.constant(arr2(&[p.map(f64::ln)])),
            turns: tape.constant(arr2(&[turns])),
            elevation: tape.constant(arr1(&[0.4 + 0.5 * ANGLE])),
            log_distance: tape.constant(arr1(&[0.7_f64.ln() - 0.2])),
        };
        let w = [8.0 / 9.0, 1.0 / 9.0];
        let expected = -w[0] * 0.6_f64.ln() - w[1] * 0.2_f64.ln()
            + w[0] * 0.3_f64.powi(2)
            + w[1] * 2.0_f64.powi(2)
            + 0.25
            + 4.0;
        for degrees in [100.0, -260.0, 460.0] {
            let found = viewpoint_loss(&guess, &[at(degrees)]).item();
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
    }

    #[test]
    fn its_gradient_is_right() {
        let truth = [at(100.0), at(359.0), at(0.0)];
        let f = function(|v| {
            let [logits, turns, elevation, log_distance] = [v[0], v[1], v[2], v[3]];
            viewpoint_loss(&ViewpointGuess { logits, turns, elevation, log_distance }, &truth)
        });
        let options = Options::default();
        let shapes = [vec![3, 5], vec![3, 5], vec![3], vec![3]];
        check(&f, &options.draw(&shapes), &options).unwrap();
    }
}
