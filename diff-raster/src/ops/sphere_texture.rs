//! Textures around a sphere. The rule stands in [`kernels::sphere`](crate::kernels::sphere).

use autodiff_lite::kernels::parallel::{InParts, Parts};
use autodiff_lite::{Backward, Real, Tensor, Var};

use crate::kernels::sphere::{
    sphere_texture as forward, sphere_texture_grad_directions, sphere_texture_grad_texels,
};
use crate::kernels::texture::Texture;

/// Colours of a texture that is wrapped around a sphere, bilinear, one texture for each image: for meshes
/// that were spheres once, with the place on the sphere [interpolated](crate::interpolate) over each face.
/// There is no edge: columns go on around, and if all texels of the first row are alike, and all of the
/// last, the poles show no star either.
///
/// ```
/// use autodiff_lite::Tape;
/// use diff_raster::sphere_texture;
///
/// let tape = Tape::<f64>::eval();
/// // Three rows (a pole, the equator, a pole) of four columns: +z lies between the second and the third.
/// let image = ndarray::Array4::from_shape_fn((1, 3, 4, 1), |(_, row, column, _)| (row * column) as f64);
/// let front = tape.constant(ndarray::arr3(&[[[0.0, 0.0, 2.0]]]));
/// let back = tape.constant(ndarray::arr3(&[[[0.0, 0.0, -1.0]]]));
/// let image = tape.constant(image);
/// assert!((sphere_texture(front, image).item() - 1.5).abs() < 1e-12);
/// assert!((sphere_texture(back, image).item() - 1.5).abs() < 1e-12); // between the last and the first
/// ```
///
/// # Shapes
/// `directions [N, .., 3]` of any length, zero at background; `image [N, Ht, Wt, C]`, at least two rows.
/// Result `[N, .., C]`, zero at background.
/// # Gradient
/// To directions (with kinks between texels; none at a pole) and texels.
/// # Cost
/// `O(N P C)` and two arc tangents a pixel, in each pass; images are done at the same time.
/// # Panics
/// If the shapes do not fit.
#[track_caller]
#[inline(never)]
pub fn sphere_texture<'t, F: Real>(directions: Var<'t, F>, image: Var<'t, F>) -> Var<'t, F> {
    let (shape, texels) = (directions.shape(), image.shape());
    let fits = shape.len() >= 2
        && shape.last() == Some(&3)
        && matches!(*texels, [n, rows, _, _] if n == shape[0] && rows >= 2);
    if !fits {
        let message = "directions and a texture for each image expected";
        let operands = [("directions", &shape[..], "N, .., 3"), ("image", &texels, "N, Ht, Wt, C")];
        directions.tape().refuse("sphere_texture", message, &operands);
    }
    let mut result = shape;
    let last = result.len() - 1;
    result[last] = texels[3];
    let mut out = directions.tape().array(&result);
    let (d, x) = (directions.value(), image.value());
    let [d, x] = [&d, &x].map(Tensor::as_slice);
    let sizes = Sizes::of(texels[0], d.len(), &texels);
    let images = out.as_slice_mut().par_chunks_mut(sizes.out.max(1));
    images.enumerate().for_each(|(i, out)| {
        forward(sizes.texture(x, i), sizes.directions(d, i), out);
    });
    let (tape, inputs) = (directions.tape(), [directions, image]);
    tape.record_fn("sphere_texture", &inputs, out, move |cx: &mut Backward<'_, F>| {
        let (d, x, grad) = (cx.input(0), cx.input(1), cx.grad_out());
        let [d, x, grad] = [&d, &x, &grad].map(Tensor::as_slice);
        let grads = |i: usize| &grad[i * sizes.out..][..sizes.out];
        if cx.needs(0) {
            let all = cx.grad_slice_mut(0).par_chunks_mut(sizes.directions.max(1));
            all.enumerate().for_each(|(i, out)| {
                let texture = sizes.texture(x, i);
                let directions = sizes.directions(d, i);
                sphere_texture_grad_directions(texture, directions, grads(i), out);
            });
        }
        if cx.needs(1) {
            let all = cx.grad_slice_mut(1).par_chunks_mut(sizes.texels().max(1));
            all.enumerate().for_each(|(i, out)| {
                let texture = sizes.texture(x, i);
                sphere_texture_grad_texels(texture, sizes.directions(d, i), grads(i), out);
            });
        }
    })
}

/// How much of each array belongs to one image.
#[derive(Clone, Copy)]
struct Sizes {
    directions: usize,
    out: usize,
    height: usize,
    width: usize,
    channels: usize,
}

impl Sizes {
    fn of(batch: usize, directions: usize, texels: &[usize]) -> Self {
        let directions = directions.checked_div(batch).unwrap_or(0);
        let [height, width, channels] = [texels[1], texels[2], texels[3]];
        Self { directions, out: directions / 3 * channels, height, width, channels }
    }

    fn directions<'a, F>(&self, all: &'a [F], image: usize) -> &'a [F] {
        &all[image * self.directions..][..self.directions]
    }

    fn texels(&self) -> usize {
        self.height * self.width * self.channels
    }

    fn texture<'a, F>(&self, all: &'a [F], image: usize) -> Texture<'a, F> {
        let data = &all[image * self.texels()..][..self.texels()];
        Texture { data, height: self.height, width: self.width, channels: self.channels }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use autodiff_lite::Tape;
    use autodiff_lite::testkit::{Options, check, function};
    use ndarray::{Array3, Array4, ArrayD};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn gradients(n in 1usize..3, p in 1usize..6, h in 2usize..6, w in 1usize..6, c in 1usize..4, seed: u64) {
            let f = function(|x| sphere_texture(x[0], x[1]));
            let options = Options { seed, ..Options::default().pieces() };
            let inputs = options.draw(&[vec![n, p, 3], vec![n, h, w, c]]);
            check(&f, &inputs, &options).map_err(|e| TestCaseError::fail(format!("{e:?}")))?;
        }
    }

    /// Directions count, not lengths, also where squares are no numbers.
    #[test]
    fn lengths_do_not_matter() {
        let tape = Tape::<f32>::eval();
        let image = Array4::from_shape_fn((1, 9, 8, 1), |(_, r, c, _)| (10 * r + c) as f32);
        let image = tape.constant(image);
        let at = |length: f32| {
            let direction = Array3::from_shape_vec((1, 1, 3), vec![length, length, 0.0]);
            sphere_texture(tape.constant(direction.expect("three")), image).item()
        };
        for length in [1e-25, 1e20, 1e-40] {
            assert!((at(length) - at(1.0)).abs() < 1e-4, "{length}: {}, {}", at(length), at(1.0));
        }
    }

    /// A function on the sphere that is smooth everywhere, the poles and the back meridian included, comes back.
    #[test]
    fn no_edge_and_no_star() {
        let (h, w) = (65, 128);
        let smooth = |d: [f64; 3]| 0.3 * d[0] + 0.5 * d[1] - 0.2 * d[2];
        let image = Array4::from_shape_fn((1, h, w, 1), |(_, r, c, _)| {
            let phi = std::f64::consts::TAU * ((c as f64 + 0.5) / w as f64 - 0.5);
            let theta = std::f64::consts::PI * r as f64 / (h - 1) as f64;
            smooth([theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos()])
        });
        let tape = Tape::<f64>::eval();
        let image = tape.constant(image);
        let at = |d: [f64; 3]| sphere_texture(tape.constant(ndarray::arr2(&[d])), image).item();
        let mut worst: f64 = 0.0;
        for k in 0..400 {
            let (a, b) = (f64::from(k) * 0.31, f64::from(k) * 0.0157 - 3.1);
            let d = [b.sin() * a.sin(), b.cos(), b.sin() * a.cos()];
            worst = worst.max((at(d) - smooth(d)).abs());
        }
        assert!(worst < 2e-3, "{worst}");
        // Across the back meridian and over a pole, by a hair.
        for (a, b) in
            [([1e-9, 0.2, -1.0], [-1e-9, 0.2, -1.0]), ([1e-9, 1.0, 0.0], [0.0, 1.0, -1e-9])]
        {
            assert!((at(a) - at(b)).abs() < 1e-6, "{} {}", at(a), at(b));
        }
        assert_eq!(at([0.0; 3]), 0.0);
    }

    /// From outside and upright: what is on the right of the image is on the viewer's right, what is above is up.
    #[test]
    fn it_is_upright_and_not_mirrored() {
        let image = Array4::from_shape_fn((1, 9, 8, 2), |(_, r, c, k)| [c as f64, r as f64][k]);
        let tape = Tape::<f64>::eval();
        let d = ndarray::arr3(&[[[0.3, 0.3, 1.0], [-0.3, -0.3, 1.0]]]);
        let y = sphere_texture(tape.constant(d), tape.constant(image)).value();
        assert!(y[[0, 0, 0]] > y[[0, 1, 0]] && y[[0, 0, 1]] < y[[0, 1, 1]]);
    }

    #[test]
    fn each_image_has_its_own_texture() {
        let tape = Tape::<f64>::train(0);
        let image = Array4::from_shape_fn((2, 3, 4, 1), |(n, ..)| n as f64);
        let d = tape.constant(Array3::from_elem((2, 5, 3), 0.4));
        let image = tape.leaf(image);
        let y = sphere_texture(d, image);
        let value: ArrayD<f64> = y.value().to_owned();
        assert!(
            value.iter().enumerate().all(|(i, &v)| (v - f64::from(u8::from(i >= 5))).abs() < 1e-12)
        );
        let gradients = y.slice_axis(0, 0..1).sum().backward();
        let gradient = gradients.wrt(image).unwrap();
        let sum = |n: usize| gradient.index_axis(ndarray::Axis(0), n).sum();
        assert!((sum(0) - 5.0).abs() < 1e-12 && sum(1) == 0.0);
    }
}
