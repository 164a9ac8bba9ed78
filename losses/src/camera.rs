//! Losses of a predicted camera.

use autodiff_lite::{Real, Var};

use crate::l2;
use crate::scalar::same_shape;

/// How far two rotations are apart, `mean max(1 - |⟨q, q'⟩|, 0)`: one minus the cosine of half the
/// angle between them, for quaternions of length one.
///
/// # Shapes
/// `rotation` and `target` `[N, 4]` of the same order of components → a scalar in `[0, 1]`.
/// # Gradient
/// To both; `q` and `-q` are the same rotation, and at right angles between them the derivative jumps.
/// # Panics
/// If the shapes differ or are others.
/// # References
/// `|⟨q, q'⟩|` is the real part of `q q'*`: the geodesic loss of Kanazawa et al. 2018, *Learning
/// Category-Specific Mesh Reconstruction from Image Collections*, and of Simoni et al. 2021.
#[track_caller]
pub fn rotation_loss<'t, F: Real>(rotation: Var<'t, F>, target: Var<'t, F>) -> Var<'t, F> {
    same_shape("rotation_loss", ["rotation", "target"], rotation, target);
    quaternions("rotation_loss", rotation);
    let cosine = rotation.mul(target).sum_axis(1).abs();
    cosine.neg().add_scalar(F::one()).relu().mean()
}

/// How far two rotations are apart, `mean √(1 - ⟨q, q'⟩²)`: the sine of half the angle between them, for quaternions of
/// length one.
///
/// Where two rotations are as likely, as for an object whose front looks like its back, [`rotation_loss`] is least halfway
/// between them, at which it is 0.29 for opposite ones, and 0.5 at either. This one is least at either: 0.5, and 0.71 between.
/// Near the target it grows with the angle rather than its square, so single bad targets count less.
///
/// # Shapes
/// `rotation` and `target` `[N, 4]` of the same order of components → a scalar from 0.001, where they are equal, to 1.
/// # Gradient
/// To both; smooth below a thousandth of a radian.
/// # Panics
/// If the shapes differ or are others.
#[track_caller]
pub fn rotation_sine<'t, F: Real>(rotation: Var<'t, F>, target: Var<'t, F>) -> Var<'t, F> {
    same_shape("rotation_sine", ["rotation", "target"], rotation, target);
    quaternions("rotation_sine", rotation);
    let least = F::from_f64(1e-6);
    let square = rotation.mul(target).sum_axis(1).square().neg().add_scalar(F::one()).relu();
    square.add_scalar(least).sqrt().mean()
}

/// The camera loss of MCMR: [`rotation_loss`] plus the mean squared difference of scale and translation,
/// each a plain mean.
///
/// # Shapes
/// `place` and `true_place` `[N, 3]`, scale and translation; `rotation` and `true_rotation` `[N, 4]` → a
/// scalar.
/// # Panics
/// If the shapes differ or are others.
/// # References
/// Simoni et al. 2021, *Multi-Category Mesh Reconstruction From Image Collections*; margin 0.
#[track_caller]
pub fn camera_loss<'t, F: Real>(
    [place, true_place]: [Var<'t, F>; 2],
    [rotation, true_rotation]: [Var<'t, F>; 2],
) -> Var<'t, F> {
    rotation_loss(rotation, true_rotation).add(l2(place, true_place, None))
}

/// How far quaternions are from length one before they are normalised, `mean (‖q‖² - 1)²`.
///
/// # Shapes
/// `rotation [N, 4]` → a scalar.
/// # Panics
/// If the shape is another.
/// # References
/// The regulariser of Simoni et al. 2021.
#[track_caller]
pub fn quaternion_length<F: Real>(rotation: Var<'_, F>) -> Var<'_, F> {
    quaternions("quaternion_length", rotation);
    rotation.square().sum_axis(1).add_scalar(-F::one()).square().mean()
}

#[track_caller]
fn quaternions<F: Real>(name: &'static str, rotation: Var<'_, F>) {
    let shape = rotation.shape();
    if !matches!(shape[..], [_, 4]) {
        rotation.tape().refuse(name, "quaternions expected", &[("rotation", &shape, "N, 4")]);
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use autodiff_lite::Tape;
    use ndarray::arr2;
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    proptest! {
        #[test]
        fn gradients(n in 1usize..5, seed: u64) {
            // Products of both signs and sums above one: kinks of both.
            let options = testing::options(seed);
            let f = testing::function(|x| {
                let camera = camera_loss([x[0], x[1]], [x[2], x[3]]);
                let sine = rotation_sine(x[2], x[3]).scale(0.5);
                camera.add(sine).add(quaternion_length(x[2]).scale(0.1))
            });
            testing::checked(&f, &[vec![n, 3], vec![n, 3], vec![n, 4], vec![n, 4]], &options.range(-0.7, 0.7))?;
        }

        /// Turning both by the same rotation changes nothing, and the sign never counts.
        #[test]
        fn rotations(half in 0.0f64..1.57, angle in -3.0f64..3.0) {
            let tape = Tape::<f64>::eval();
            let about_z = |h: f64| arr2(&[[h.cos(), 0.0, 0.0, h.sin()]]);
            let of = |a: f64, b: f64, sign: f64| {
                rotation_loss(tape.constant(about_z(a) * sign), tape.constant(about_z(b))).item()
            };
            prop_assert!((of(angle + half, angle, 1.0) - (1.0 - half.cos())).abs() < 1e-12);
            prop_assert!((of(angle + half, angle, -1.0) - (1.0 - half.cos())).abs() < 1e-12);
            let q = [angle + half, angle].map(|a| tape.constant(about_z(a)));
            let sine = rotation_sine(q[0].neg(), q[1]).item();
            prop_assert!((sine - (half.sin().powi(2) + 1e-6).sqrt()).abs() < 1e-12);
        }
    }

    #[test]
    fn by_hand() {
        let tape = Tape::<f64>::eval();
        let place = [arr2(&[[1.0, 0.5, 0.0]]), arr2(&[[1.0, 0.2, 0.6]])];
        let rotation = [arr2(&[[1.0, 0.0, 0.0, 0.0]]), arr2(&[[0.0, 1.0, 0.0, 0.0]])];
        let loss = camera_loss(
            place.map(|p| tape.constant(p)),
            rotation.clone().map(|q| tape.constant(q)),
        );
        assert_relative_eq!(loss.item(), 1.0 + (0.09 + 0.36) / 3.0, epsilon = 1e-12);
        let twice = tape.constant(&rotation[0] * 2.0);
        assert_relative_eq!(quaternion_length(twice).item(), 9.0, epsilon = 1e-12);
    }

    #[test]
    #[should_panic(expected = "quaternions expected")]
    fn three_numbers_are_no_rotation() {
        let tape = Tape::<f32>::eval();
        let _ = quaternion_length(tape.constant(arr2(&[[1.0, 0.0, 0.0]])));
    }
}
