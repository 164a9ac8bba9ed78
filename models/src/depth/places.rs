//! Where vertices are, as Mesh R-CNN's code tells its refinement.

use autodiff_lite::{Real, Var};

/// Depths from the camera's plane count as this at least, on either side of it.
const LEAST: f64 = 0.1;
/// Blender's matrix for depth between 0.1 and 100: what multiplies it, and what is added.
const DEPTH: [f64; 2] = [1.002_002, -0.200_200_2];

/// What the code's `project_verts` makes of points `[N, V, 3]`, by cameras `[N, 3, 4]`: right and up over the image, then the
/// device's depth, 0.67 to 0.92 for 3D-R2N2's objects.
pub(super) fn published_places<'t, F: Real>(points: Var<'t, F>, cameras: Var<'t, F>) -> Var<'t, F> {
    let seen = points.project_affine(cameras);
    let depth = seen.slice_axis(2, 2..3);
    let [least, factor, summand] = [LEAST, DEPTH[0], DEPTH[1]].map(F::from_f64);
    let near = move |w: F| w.abs() < least;
    let over = depth.map(
        |w| match (near(w), w < F::zero()) {
            (false, _) => w,
            (_, true) => -least,
            (_, false) => least,
        },
        move |w, _| if near(w) { F::zero() } else { F::one() },
    );
    let device = depth.scale(factor).add_scalar(summand);
    points.tape().concat(&[seen.slice_axis(2, 0..2), device], 2).div(over)
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use autodiff_lite::testkit::{Options, assert_gradients, function};
    use ndarray::{Array3, arr3};

    use super::*;

    #[test]
    fn gradients() {
        // Kinks a tenth before and behind the camera's plane.
        let options = Options::default().pieces();
        let places = function(|x| published_places(x[0], x[1]));
        assert_gradients(&places, &[vec![2, 5, 3], vec![2, 3, 4]], &options);
    }

    /// By hand, before the camera, in its plane, and behind it.
    #[test]
    fn depths_keep_their_sign() {
        let tape = Tape::<f32>::train(0);
        let rows = [[2.1875, 0.0, 0.0, 0.0], [0.0, 2.1875, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]];
        let cameras = tape.constant(Array3::from_shape_fn((1, 3, 4), |(_, i, j)| rows[i][j]));
        let points = tape.leaf(arr3(&[[
            [0.4, -0.2, -1.4],
            [0.4, -0.2, 0.0],
            [0.4, -0.2, 0.05],
            [0.4, -0.2, 0.5],
        ]]));
        let places = published_places(points, cameras);
        let found = places.value();
        let zz = |w: f32, over: f32| (1.002_002 * w - 0.200_200_2) / over;
        for (i, (w, over)) in
            [(1.4, 1.4), (0.0, 0.1), (-0.05, -0.1), (-0.5, -0.5)].into_iter().enumerate()
        {
            let expected = [2.1875 * 0.4 / over, 2.1875 * -0.2 / over, zz(w, over)];
            for k in 0..3 {
                assert!((found[[0, i, k]] - expected[k]).abs() < 1e-5, "{i} {k}: {found:?}");
            }
        }
        assert!(places.square().sum().backward().is_finite());
    }
}
