//! Upright cameras on the tape.

use autodiff_lite::Var;

use super::pose::CommonLens;

/// Projections of cameras that look at the origin with +Y up: with `e`, `a` the elevation and the azimuth, `f` and `d` the focal
/// length and the distance of the lens,
///
/// ```text
/// x = (sin a, 0, -cos a)      y = (-sin e cos a, cos e, -sin e sin a)      z = (cos e cos a, sin e, cos e sin a)
/// s = d / (f exp(log distance))
/// M = [s (f x - cx z), cx d]   [s (f y - cy z), cy d]   [-s z, d]
/// ```
///
/// which is [`Pose::projection`](super::Pose::projection) of such poses, with gradients.
///
/// # Shapes
/// Azimuth, elevation, logarithm of the distance, and the place `cx`, `cy` of the origin in the image, `[N]` each → `[N, 3, 4]`.
pub(super) fn upright<'t>(numbers: [Var<'t>; 5], lens: CommonLens) -> Var<'t> {
    let tape = numbers[0].tape();
    let [n] = numbers[0].dims();
    let [azimuth, elevation, log_distance, cx, cy] = numbers.map(|x| x.reshape(&[n, 1]));
    let ([sa, ca], [se, ce]) = ([azimuth.sin(), azimuth.cos()], [elevation.sin(), elevation.cos()]);
    let (focal, distance) = (lens.focal as f32, lens.distance as f32);
    let scale = log_distance.neg().exp().scale(distance / focal);
    let zero = tape.constant(ndarray::Array2::zeros((n, 1)));
    let x = [sa, zero, ca.neg()];
    let y = [(se * ca).neg(), ce, (se * sa).neg()];
    let z = [ce * ca, se, ce * sa];
    let row = |axis: [Var<'t>; 3], place: Var<'t>| {
        let [a, b, c] = [0, 1, 2].map(|k| (axis[k].scale(focal) - place * z[k]) * scale);
        [a, b, c, place.scale(distance)]
    };
    let [a, b, c] = z.map(|z| (z * scale).neg());
    let depth = [a, b, c, zero.add_scalar(distance)];
    let columns = [row(x, cx), row(y, cy), depth].concat();
    tape.concat(&columns, 1).reshape(&[n, 3, 4])
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use autodiff_lite::Tape;
    use ndarray::arr1;
    use proptest::prelude::*;

    use super::super::Pose;
    use super::*;
    use crate::viewpoint::Viewpoint;

    const LENS: CommonLens = CommonLens { focal: 4.5, distance: 2.4 };

    proptest! {
        /// The quaternion's way comes to the same matrix.
        #[test]
        fn it_is_the_poses_projection(azimuth in -3.1f64..3.1, elevation in -1.4f64..1.4, distance in 0.3f64..1.5, cx in -0.4f64..0.4, cy in -0.4f64..0.4) {
            let viewpoint = Viewpoint { azimuth, elevation, distance };
            let expected = Pose::from_viewpoint(&viewpoint, [cx, cy], LENS).projection(LENS);
            let tape = Tape::eval();
            let numbers = [azimuth, elevation, distance.ln(), cx, cy];
            let found = upright(numbers.map(|x| tape.constant(arr1(&[x as f32]))), LENS).value();
            prop_assert_eq!(found.shape(), &[1, 3, 4]);
            for (a, b) in found.iter().zip(expected) {
                prop_assert!((a - b).abs() < 1e-4 * (1.0 + b.abs()), "{:?} {:?}", found, expected);
            }
        }
    }
}
