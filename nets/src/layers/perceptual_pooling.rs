//! What feature maps say about points.

use autodiff_lite::{Activation, Padding, Real, Var};

use crate::Linear;

/// How a map is read between its pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum MapSampling {
    /// Bilinear between pixel centres, the border repeated outwards; gradients to maps and points.
    #[default]
    Bilinear,
    /// The pixel that a point lies in, whose centre is the nearest; gradients to maps alone. Equation 1 of the paper on
    /// neural ODEs for Pixel2Mesh.
    #[cfg_attr(feature = "serde", serde(alias = "floor"))]
    Nearest,
    /// Bilinear between the top left *corners* of pixels, as Pixel2Mesh's first version reads (`p2m/layers.py`): half a
    /// pixel away from [`Bilinear`](Self::Bilinear); beyond the last corners the map fades to zero, and where a
    /// coordinate falls on a corner, as those outside of the image do at the left and the top, all four weights vanish and
    /// the feature is 0. Gradients to maps and points.
    Corners,
    /// The pixel that a point lies in, and 0 in the last column and row, on the corners of pixels and outside of the image:
    /// what Pixel2Mesh's PyTorch version computes (`gcn_layers.py`), which rounds before it forms the four weights of
    /// [`Corners`](Self::Corners). Gradients to maps alone.
    Truncated,
    /// Bilinear, with (-1, -1) and (1, 1) the *centres* of the corner pixels; beyond the outermost centres the map
    /// fades to zero within a pixel. Gradients to maps and points. PyTorch3D's `vert_align`, as in Mesh R-CNN.
    Centers,
}

/// Features of points from several maps of one image, side by side.
///
/// A point is (x, y) with x to the right and y *down*, (-1, -1) the image's top left corner and
/// (1, 1) its bottom right one, but for [`MapSampling::Centers`]. Points outside take what is at the border, with
/// [`MapSampling::Bilinear`] and [`MapSampling::Nearest`].
///
/// Bilinear pooling is linear in the maps: a linear layer that follows can be applied to them once
/// an image, instead of to each point's features at each evaluation; [`pool_linear`] does that.
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{MapSampling, pool_features};
///
/// let tape = Tape::<f32>::eval();
/// let fine = tape.constant(ndarray::Array4::ones((1, 8, 8, 3)));
/// let coarse = tape.constant(ndarray::Array4::zeros((1, 2, 2, 5)));
/// let points = tape.constant(ndarray::arr3(&[[[0.0, 0.0], [0.5, -2.0]]]));
/// let features = pool_features(&[fine, coarse], points, MapSampling::Bilinear);
/// assert_eq!(features.shape(), [1, 2, 8]);
/// ```
///
/// # Shapes
/// `maps [N, H, W, C]` of any sizes, `points [N, P, 2]` → `[N, P, ΣC]`.
///
/// # Panics
/// If there is no map, or numbers of images differ.
///
/// # References
/// Wang et al. 2018, *Pixel2Mesh*, section 3.3, "perceptual feature pooling".
#[track_caller]
pub fn pool_features<'t, F: Real>(
    maps: &[Var<'t, F>],
    points: Var<'t, F>,
    sampling: MapSampling,
) -> Var<'t, F> {
    let read = |&map: &Var<'t, F>| match sampling {
        MapSampling::Bilinear => map.bilinear_sample(points, Padding::Border, false),
        MapSampling::Centers => map.bilinear_sample(points, Padding::Zeros, true),
        MapSampling::Nearest => floored(map, points),
        MapSampling::Corners => cornered(map, points),
        MapSampling::Truncated => {
            let inside = points.clamp(-F::one(), F::from_f64(LAST));
            floored(map, inside).mul(off_corners(map, inside, true))
        }
    };
    let read: Vec<Var<'t, F>> = maps.iter().map(read).collect();
    points.tape().concat(&read, 2)
}

/// [`pool_features`], a linear layer, and an activation.
///
/// Sampling is linear in the maps and a point's features are four pixels' at most, so where there are more points
/// than pixels (a mesh of 2562 vertices over the last maps of a ResNet) the layer is applied to the maps, with the
/// part of its weight for each, and the results are read and added: the same to rounding, at a fraction of the cost.
///
/// # Shapes
/// `maps [N, H, W, C]` of any sizes, `points [N, P, 2]`, `layer` from `ΣC` to `O` → `[N, P, O]`.
///
/// # Panics
/// As [`pool_features`], or if the layer is not of as many inputs as the maps have channels together.
#[track_caller]
pub fn pool_linear<'t, F: Real>(
    maps: &[Var<'t, F>],
    points: Var<'t, F>,
    sampling: MapSampling,
    layer: &Linear<F>,
    activation: Activation,
) -> Var<'t, F> {
    let tape = points.tape();
    let cost = |map: &Var<'t, F>| {
        let [_, h, w, c] = map.dims();
        [h * w * c, c]
    };
    let [at_pixels, channels] = maps.iter().map(cost).fold([0; 2], |[a, b], [c, d]| [a + c, b + d]);
    let [_, count, _] = points.dims();
    if count * channels <= at_pixels {
        return layer.forward_then(pool_features(maps, points, sampling), activation);
    }
    let inputs = layer.weight.shape()[1];
    assert_eq!(inputs, channels, "pool_linear: a layer of {inputs} inputs, {channels} channels");
    let weight = tape.param(&layer.weight);
    let mut first = 0;
    let read = maps.iter().map(|&map| {
        let [_, _, _, c] = map.dims();
        let part = weight.slice_axis(1, first..first + c);
        first += c;
        pool_features(&[map.linear(part, None, Activation::None)], points, sampling)
    });
    let terms: Vec<_> = read.map(|read| (F::one(), read)).collect();
    let sum = tape.lincomb(&terms);
    let sum = layer.bias.as_ref().map_or(sum, |bias| sum.add(tape.param(bias)));
    crate::activate(sum, activation)
}

/// Where Pixel2Mesh's versions hold points that are beyond the image: at 223 of 224 pixels, 1 being all of them.
const LAST: f64 = 2.0 * 223.0 / 224.0 - 1.0;

/// [`MapSampling::Corners`].
fn cornered<'t, F: Real>(map: Var<'t, F>, points: Var<'t, F>) -> Var<'t, F> {
    let [_, h, w, _] = map.dims();
    let inside = points.clamp(-F::one(), F::from_f64(LAST));
    // Half a pixel, from corners to centres.
    let half = [w, h].map(|size| F::from_f64(1.0 / size as f64));
    let centers = inside.add(points.tape().constant(ndarray::arr1(&half)));
    let read = map.bilinear_sample(centers, Padding::Zeros, false);
    read.mul(off_corners(map, inside, false))
}

/// 0 where a coordinate falls on the corner of a pixel, and in the last column and row if `last`, else 1: `[N, P, 1]`.
fn off_corners<'t, F: Real>(map: Var<'t, F>, points: Var<'t, F>, last: bool) -> Var<'t, F> {
    let ([_, h, w, _], [n, p, _]) = (map.dims(), points.dims());
    let counts = |x: F, size: usize| {
        let at = (x.to_f64() + 1.0) * 0.5 * size as f64;
        at.fract() != 0.0 && !(last && at >= (size - 1) as f64)
    };
    let value = points.value();
    let pairs = value.as_slice().chunks_exact(2);
    let one =
        |point: &[F]| if counts(point[0], w) && counts(point[1], h) { F::one() } else { F::zero() };
    let ones: Vec<F> = pairs.map(one).collect();
    let ones = ndarray::Array3::from_shape_vec((n, p, 1), ones);
    points.tape().constant(ones.expect("a number for each point"))
}

/// The pixels that points lie in.
fn floored<'t, F: Real>(map: Var<'t, F>, points: Var<'t, F>) -> Var<'t, F> {
    let ([n, h, w, c], [m, p, _]) = (map.dims(), points.dims());
    assert_eq!(n, m, "pool_features: {n} maps and points of {m} images");
    let cell = |x: F, size: usize| {
        let at = (x.to_f64() + 1.0) * 0.5 * size as f64;
        // NaN goes to 0: it is found by the loss that it spoils, not here.
        (at.clamp(0.0, (size - 1) as f64) as usize).min(size - 1)
    };
    let values = points.value();
    let pairs = values.as_slice().chunks_exact(2);
    let rows: Vec<u32> = pairs
        .enumerate()
        .map(|(k, point)| (((k / p) * h + cell(point[1], h)) * w + cell(point[0], w)) as u32)
        .collect();
    map.reshape(&[n * h * w, c]).gather_rows(&rows).reshape(&[n, p, c])
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use autodiff_lite::testkit::{Options, assert_gradients, function};
    use ndarray::{Array3, Array4, arr3};

    use super::*;
    use crate::Init;

    /// A map that is linear in place is read exactly between the outermost centres.
    #[test]
    fn bilinear_reads_a_slope_and_nearest_its_steps() {
        let tape = Tape::<f64>::eval();
        let slope = |size: usize| {
            // The value at a pixel's centre is its place in -1 to 1, right and down.
            let place = move |i: usize| (2 * i + 1) as f64 / size as f64 - 1.0;
            tape.constant(Array4::from_shape_fn((2, size, size, 2), |(n, i, j, c)| {
                (n + 1) as f64 * if c == 0 { place(j) } else { place(i) }
            }))
        };
        let points = arr3(&[[[0.3, -0.4], [-0.61, 0.2]], [[0.0, 0.7], [0.5, 0.5]]]);
        let maps = [slope(8), slope(16)];
        let found = pool_features(&maps, tape.constant(points.clone()), MapSampling::Bilinear);
        let found = found.value();
        let nearest = pool_features(&maps, tape.constant(points.clone()), MapSampling::Nearest);
        let nearest = nearest.value();
        for n in 0..2 {
            for p in 0..2 {
                for k in 0..4 {
                    let (size, exact) = ([8.0, 16.0][k / 2], points[[n, p, k % 2]]);
                    let factor = (n + 1) as f64;
                    assert!((found[[n, p, k]] - factor * exact).abs() < 1e-12);
                    let cell = ((exact + 1.0) * 0.5 * size).floor();
                    let center = (2.0 * cell + 1.0) / size - 1.0;
                    assert!((nearest[[n, p, k]] - factor * center).abs() < 1e-12);
                }
            }
        }
    }

    /// Whichever way is cheaper: values and gradients are the same.
    #[test]
    fn a_layer_before_or_after() {
        let options = Options::default().range(-1.3, 1.3);
        let layer = Linear::<f64>::new(&Init::new(0), 5, 3);
        for sampling in [
            MapSampling::Bilinear,
            MapSampling::Nearest,
            MapSampling::Corners,
            MapSampling::Truncated,
            MapSampling::Centers,
        ] {
            // Few points, and more than pixels.
            for count in [2, 30] {
                let shapes = [vec![2, 3, 4, 2], vec![2, 2, 2, 3], vec![2, count, 2]];
                let drawn = options.draw(&shapes);
                let run = |direct: bool| {
                    let tape = Tape::<f64>::train(0);
                    let x: Vec<_> = drawn.iter().map(|x| tape.leaf(x.clone())).collect();
                    let y = if direct {
                        layer.forward(pool_features(&x[..2], x[2], sampling)).relu()
                    } else {
                        pool_linear(&x[..2], x[2], sampling, &layer, Activation::Relu)
                    };
                    let gradients = y.square().sum().backward();
                    let mut all: Vec<f64> = y.value().iter().copied().collect();
                    all.extend(x.iter().filter_map(|x| gradients.wrt(*x)).flatten());
                    all.extend(gradients.of(&layer.weight).expect("in use").iter());
                    all
                };
                let (plain, quick) = (run(true), run(false));
                assert_eq!(plain.len(), quick.len());
                assert!(
                    plain.iter().zip(&quick).all(|(a, b)| (a - b).abs() < 1e-10),
                    "{sampling:?}"
                );
            }
        }
    }

    /// The corners of the square are the centres of the corner pixels, and beyond there is nothing.
    #[test]
    fn centers_read_corner_pixels_at_the_corners() {
        let tape = Tape::<f64>::eval();
        let map = Array4::from_shape_fn((1, 2, 3, 1), |(_, i, j, _)| (3 * i + j + 1) as f64);
        let points = arr3(&[[[-1.0, -1.0], [1.0, 1.0], [0.0, 0.0], [1.5, 1.0], [-9.0, 0.0]]]);
        let read =
            pool_features(&[tape.constant(map)], tape.constant(points), MapSampling::Centers);
        assert_eq!(read.value().as_slice(), [1.0, 6.0, 3.5, 3.0, 0.0]);
    }

    /// A slope, by hand: corners are read exactly, off by half a pixel from centres; the traps of both published versions.
    #[test]
    fn published_versions_read_corners_and_forget_some() {
        let tape = Tape::<f64>::eval();
        // The value of a pixel is its column, on 4 x 4 pixels.
        let map = tape.constant(Array4::from_shape_fn((1, 4, 4, 1), |(_, _, j, _)| (j + 1) as f64));
        let read = |x: f64, y: f64, sampling| {
            let at = |v: f64| v / 2.0 - 1.0;
            let points = tape.constant(arr3(&[[[at(x), at(y)]]]));
            pool_features(&[map], points, sampling).item()
        };
        for (x, y, corners, truncated) in [
            (1.25, 0.5, 2.25, 2.0),
            (2.9, 1.1, 3.9, 3.0),
            // In the last column and row: towards a pixel that there is not, and nothing.
            (3.5, 0.5, 2.0, 0.0),
            (1.25, 3.5, 1.125, 0.0),
            // On a corner in one direction: nothing.
            (2.0, 0.5, 0.0, 0.0),
            (1.5, 2.0, 0.0, 0.0),
            // Outside: on the first corner, or at 223 of 224.
            (-3.0, 0.5, 0.0, 0.0),
            (9.0, 0.5, 4.0 / 56.0, 0.0),
        ] {
            let found = [MapSampling::Corners, MapSampling::Truncated].map(|s| read(x, y, s));
            assert!((found[0] - corners).abs() < 1e-12, "{x} {y}: {found:?}");
            assert!((found[1] - truncated).abs() < 1e-12, "{x} {y}: {found:?}");
        }
    }

    #[test]
    fn gradients_of_reading_corners_and_pixels() {
        let shapes = [vec![2, 4, 5, 2], vec![2, 3, 2]];
        // Kinks where a point passes from pixel to pixel.
        let options = Options::default().pieces().range(-0.9, 0.7);
        let corners = function(|x| pool_features(&x[..1], x[1], MapSampling::Corners));
        assert_gradients(&corners, &shapes, &options);
        // Steps have no gradient to points: to the map alone.
        let points = options.draw(&shapes)[1].clone();
        for sampling in [MapSampling::Nearest, MapSampling::Truncated] {
            let read = function(|x| {
                pool_features(&x[..1], x[0].tape().constant(points.clone()), sampling)
            });
            assert_gradients(&read, &shapes[..1], &options);
        }
    }

    #[test]
    fn points_outside_take_the_border() {
        let tape = Tape::<f32>::train(0);
        let map = tape.leaf(Array4::from_shape_fn((1, 2, 2, 1), |(_, i, j, _)| (2 * i + j) as f32));
        let points = arr3(&[[[-9.0, -9.0], [9.0, 9.0], [f32::INFINITY, -1.0]]]);
        for sampling in [MapSampling::Bilinear, MapSampling::Nearest] {
            let points: Array3<f32> = points.clone();
            let read = pool_features(&[map], tape.constant(points), sampling);
            assert_eq!(read.value().as_slice(), [0.0, 3.0, 1.0], "{sampling:?}");
        }
    }
}
