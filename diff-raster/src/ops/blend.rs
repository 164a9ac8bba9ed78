//! Layers of faces blended into images, as PyTorch3D's shaders do it.

use std::sync::Arc;

use autodiff_lite::kernels::parallel::{InParts, Parts};
use autodiff_lite::{Backward, Real, Tensor, Var};

use crate::Layers;
use crate::kernels::blend::{Blend, Grads, Pixel, clear_but_one, coverage};

/// How [`Layers::softmax_blend`] blends: PyTorch3D's `BlendParams`, and its range of depths.
///
/// ```
/// let black = diff_raster::BlendSettings { background: vec![0.0; 3], ..Default::default() };
/// assert_eq!(black.sigma, 1e-4);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct BlendSettings {
    /// How far a face spreads: it covers a pixel at the signed squared distance `d` by `sigmoid(-d / sigma)`.
    pub sigma: f64,
    /// How soft the decision between depths is, in units of `far - near`.
    pub gamma: f64,
    /// What shows where nothing is, one number for each channel.
    pub background: Vec<f64>,
    /// The range of depths.
    pub near: f64,
    /// Its end.
    pub far: f64,
}

impl Default for BlendSettings {
    /// PyTorch3D's: both temperatures 1e-4, white behind three channels, depths 1 to 100.
    fn default() -> Self {
        Self { sigma: 1e-4, gamma: 1e-4, background: vec![1.0; 3], near: 1.0, far: 100.0 }
    }
}

impl BlendSettings {
    /// Sigma, gamma, and the least and the greatest depth.
    fn checked(&self) -> [f64; 4] {
        let &Self { sigma, gamma, near, far, .. } = self;
        assert!(
            sigma > 0.0 && gamma > 0.0 && far > near,
            "softmax_blend: sigma {sigma}, gamma {gamma} and depths {near} to {far} must be positive"
        );
        [sigma, gamma, near, far]
    }
}

impl<'t, F: Real> Layers<'t, F> {
    /// Images in which the faces of a pixel are blended by coverage and depth, alpha last: PyTorch3D's
    /// `softmax_rgb_blend`.
    ///
    /// Beside [`softras`](fn@crate::softras) this has at most K faces a pixel, weights cut off after the perspective and
    /// below alone, depths linear in them, and a background that weighs at least 1e-10.
    ///
    /// # Shapes
    /// `colors [N, H, W, K, C]` with C as in the settings' background → `[N, H, W, C + 1]`.
    /// # Gradient
    /// To colours, and through [`depth`](Self::depth) and [`distance`](Self::distance) to positions.
    /// # Cost
    /// `O(N H W K C)` forward and backward.
    /// # Panics
    /// If the shape does not fit, or a temperature or the range of depths is not positive.
    /// # References
    /// `pytorch3d.renderer.blending`; Liu et al. 2019, *Soft Rasterizer*.
    #[track_caller]
    #[inline(never)]
    pub fn softmax_blend(&self, colors: Var<'t, F>, settings: &BlendSettings) -> Var<'t, F> {
        let (name, tape) = ("softmax_blend", colors.tape());
        let (channels, sizes) = (settings.background.len(), self.fragments.shape());
        let mut expected = sizes.to_vec();
        expected.push(channels);
        if colors.shape() != expected {
            let message = format!("colours {expected:?} expected");
            tape.refuse(name, message, &[("colors", &colors.shape(), "N, H, W, K, C")]);
        }
        let [n, h, w, k] = sizes;
        let numbers: [F; 4] = settings.checked().map(F::from_f64);
        let background: Vec<F> = settings.background.iter().map(|&x| F::from_f64(x)).collect();
        let (depth, distance) = (self.depth(), self.distance());
        let faces = Arc::clone(&self.fragments);
        let mut out = tape.array(&[n, h, w, channels + 1]);
        {
            let [c, z, d] = [colors.value(), depth.value(), distance.value()];
            let [c, z, d] = [&c, &z, &d].map(Tensor::as_slice);
            let blend = blend_of(numbers, &background);
            let pixels = out.as_slice_mut().par_chunks_mut(channels + 1).enumerate();
            pixels.with_min_len(256).for_each(|(at, out)| {
                blend.pixel(&pixel_of(at, k, channels, &faces.face, [c, z, d]), out);
            });
        }
        let inputs = [colors, depth, distance];
        tape.record_fn(name, &inputs, out, move |cx: &mut Backward<'_, F>| {
            let values = [0, 1, 2].map(|i| cx.input(i));
            let [c, z, d] = values.each_ref().map(Tensor::as_slice);
            let (image, grad) = (cx.output(), cx.grad_out());
            let (image, grad) = (image.as_slice(), grad.as_slice());
            let blend = blend_of(numbers, &background);
            let zeros = |i: usize| cx.pool().filled(cx.input(i).shape(), F::zero());
            let mut grads = [zeros(0), zeros(1), zeros(2)];
            let [of_colors, of_depth, of_distance] = grads.each_mut().map(Tensor::as_slice_mut);
            let rest = || vec![F::zero(); k];
            let pull = |rest: &mut Vec<F>, at: usize, mut out: Grads<'_, F>| {
                let pixel = pixel_of(at, k, channels, &faces.face, [c, z, d]);
                let own = at * (channels + 1)..(at + 1) * (channels + 1);
                blend.pull(&pixel, [&image[own.clone()], &grad[own]], rest, &mut out);
            };
            let layers =
                of_depth.par_chunks_mut(k.max(1)).zip(of_distance.par_chunks_mut(k.max(1)));
            // Without channels there is coverage alone, and no colours to cut into parts.
            if channels > 0 {
                let pixels =
                    layers.zip(of_colors.par_chunks_mut((k * channels).max(1))).enumerate();
                pixels.with_min_len(256).for_each_init(
                    rest,
                    |rest, (at, ((depth, distance), colors))| {
                        pull(rest, at, Grads { colors, depth, distance });
                    },
                );
            } else {
                let pixels = layers.enumerate();
                pixels.with_min_len(256).for_each_init(rest, |rest, (at, (depth, distance))| {
                    pull(rest, at, Grads { colors: &mut [], depth, distance });
                });
            }
            for (i, gradient) in grads.into_iter().enumerate() {
                cx.give(i, gradient);
            }
        })
    }

    /// How much of each pixel is covered: PyTorch3D's `sigmoid_alpha_blend`, `1 - Π (1 - sigmoid(-d / sigma))`.
    ///
    /// # Shapes
    /// Result `[N, H, W]`.
    /// # Gradient
    /// Through [`distance`](Self::distance) to positions.
    /// # Cost
    /// `O(N H W K)`.
    /// # Panics
    /// If `sigma` is not positive.
    #[track_caller]
    #[inline(never)]
    pub fn alpha(&self, sigma: f64) -> Var<'t, F> {
        assert!(sigma > 0.0, "alpha: sigma {sigma} must be positive");
        let distance = self.distance();
        let (tape, fragments) = (distance.tape(), Arc::clone(&self.fragments));
        let ([n, h, w, k], sigma) = (fragments.shape(), F::from_f64(sigma));
        let d = distance.value();
        let mut out = tape.array(&[n, h, w]);
        for (at, out) in out.as_slice_mut().iter_mut().enumerate() {
            let own = at * k..(at + 1) * k;
            let pairs = fragments.face[own.clone()].iter().zip(&d.as_slice()[own]);
            let clear = pairs.map(|(&face, &d)| F::one() - coverage(face, d, sigma));
            *out = F::one() - clear.fold(F::one(), |all, one| all * one);
        }
        tape.record_fn("alpha", &[distance], out, move |cx: &mut Backward<'_, F>| {
            let (d, grad) = (cx.input(0), cx.grad_out());
            let d = d.as_slice();
            let mut rest = cx.scratch(k);
            let out = cx.grad_slice_mut(0);
            for (at, &g) in grad.as_slice().iter().enumerate() {
                let covered = |i: usize| coverage(fragments.face[at * k + i], d[at * k + i], sigma);
                clear_but_one(covered, &mut rest);
                for i in 0..k {
                    let own = covered(i);
                    out[at * k + i] -= g * rest[i] * own * (F::one() - own) / sigma;
                }
            }
        })
    }
}

fn blend_of<F: Real>([sigma, gamma, near, far]: [F; 4], background: &[F]) -> Blend<'_, F> {
    Blend { sigma, gamma, near, far, background }
}

fn pixel_of<'a, F: Real>(
    at: usize,
    k: usize,
    channels: usize,
    face: &'a [u32],
    [colors, depth, distance]: [&'a [F]; 3],
) -> Pixel<'a, F> {
    let own = at * k..(at + 1) * k;
    Pixel {
        face: &face[own.clone()],
        colors: &colors[at * k * channels..(at + 1) * k * channels],
        depth: &depth[own.clone()],
        distance: &distance[own],
    }
}
