//! PyTorch3D's blend of the faces of a pixel, and its gradient.
//!
//! ```text
//! D_k = sigmoid(-d_k / σ)        A = 1 - Π (1 - D_k)
//! ζ_k = (far - z_k) / (far - near)        m = max(max ζ, ε)
//! W_k = D_k exp((ζ_k - m) / γ)            W_b = max(exp((ε - m) / γ), ε)        ε = 1e-10
//! C = (Σ W_k colour_k + W_b background) / (Σ W_k + W_b)
//! ```

use autodiff_lite::Real;
use autodiff_lite::kernels::transcendental::sigmoid;

use crate::NONE;

const EPSILON: f64 = 1e-10;

/// The numbers of the blend.
#[derive(Clone, Copy, Debug)]
pub struct Blend<'a, F> {
    /// `σ`
    pub sigma: F,
    /// `γ`
    pub gamma: F,
    /// The range of depths.
    pub near: F,
    /// Its end.
    pub far: F,
    /// One number a channel.
    pub background: &'a [F],
}

/// The faces of one pixel.
#[derive(Clone, Copy, Debug)]
pub struct Pixel<'a, F> {
    /// `[K]`
    pub face: &'a [u32],
    /// `[K, C]`
    pub colors: &'a [F],
    /// `[K]`
    pub depth: &'a [F],
    /// `[K]`, squared, negative inside.
    pub distance: &'a [F],
}

/// Where gradients of one pixel go; empty where nobody wants one.
#[derive(Debug)]
pub struct Grads<'a, F> {
    /// `[K, C]`
    pub colors: &'a mut [F],
    /// `[K]`
    pub depth: &'a mut [F],
    /// `[K]`
    pub distance: &'a mut [F],
}

/// `sigmoid(-distance / sigma)`, 0 where there is no face.
#[inline]
pub fn coverage<F: Real>(face: u32, distance: F, sigma: F) -> F {
    if face == NONE { F::zero() } else { sigmoid(-distance / sigma) }
}

/// The product of `1 - D` over all faces but each, in `rest`; over all of them as the result.
pub fn clear_but_one<F: Real>(covered: impl Fn(usize) -> F, rest: &mut [F]) -> F {
    let mut product = F::one();
    for (k, rest) in rest.iter_mut().enumerate() {
        *rest = product;
        product *= F::one() - covered(k);
    }
    let mut after = F::one();
    for (k, rest) in rest.iter_mut().enumerate().rev() {
        *rest *= after;
        after *= F::one() - covered(k);
    }
    product
}

/// What the faces of a pixel weigh.
struct Weights<F> {
    /// The nearest `ζ`, and which face has it, if any is beyond ε.
    peak: F,
    nearest: Option<usize>,
    background: F,
    /// Whether the background's is its least.
    least: bool,
    total: F,
}

impl<F: Real> Blend<'_, F> {
    fn height(&self, pixel: &Pixel<'_, F>, k: usize) -> F {
        if pixel.face[k] == NONE {
            F::zero()
        } else {
            (self.far - pixel.depth[k]) / (self.far - self.near)
        }
    }

    fn weight(&self, pixel: &Pixel<'_, F>, k: usize, peak: F) -> [F; 2] {
        let covered = coverage(pixel.face[k], pixel.distance[k], self.sigma);
        [covered, ((self.height(pixel, k) - peak) / self.gamma).exp()]
    }

    fn weights(&self, pixel: &Pixel<'_, F>) -> Weights<F> {
        let epsilon = F::from_f64(EPSILON);
        let (mut peak, mut nearest) = (epsilon, None);
        for k in 0..pixel.face.len() {
            let height = self.height(pixel, k);
            if height > peak {
                (peak, nearest) = (height, Some(k));
            }
        }
        let behind = ((epsilon - peak) / self.gamma).exp();
        let least = behind < epsilon;
        let background = if least { epsilon } else { behind };
        let mut total = background;
        for k in 0..pixel.face.len() {
            let [covered, along] = self.weight(pixel, k, peak);
            total += covered * along;
        }
        Weights { peak, nearest, background, least, total }
    }

    /// Writes the colours and alpha of a pixel, `[C + 1]`.
    pub fn pixel(&self, pixel: &Pixel<'_, F>, out: &mut [F]) {
        let channels = self.background.len();
        let weights = self.weights(pixel);
        for (out, &color) in out.iter_mut().zip(self.background) {
            *out = weights.background * color;
        }
        let mut clear = F::one();
        for k in 0..pixel.face.len() {
            let [covered, along] = self.weight(pixel, k, weights.peak);
            clear *= F::one() - covered;
            let weight = covered * along;
            let colors = &pixel.colors[k * channels..(k + 1) * channels];
            out.iter_mut().zip(colors).for_each(|(out, &color)| *out += weight * color);
        }
        out[..channels].iter_mut().for_each(|out| *out /= weights.total);
        out[channels] = F::one() - clear;
    }

    /// Adds the gradient `g` of the pixel, whose colours are `image`, to those of its faces; `rest` has room for K numbers.
    pub fn pull(
        &self,
        pixel: &Pixel<'_, F>,
        [image, g]: [&[F]; 2],
        rest: &mut [F],
        out: &mut Grads<'_, F>,
    ) {
        let channels = self.background.len();
        let weights = self.weights(pixel);
        let along = |color: &[F]| -> F {
            let pairs = color.iter().zip(image).zip(g);
            pairs.take(channels).map(|((&c, &shown), &g)| g * (c - shown)).sum()
        };
        let covered = |k: usize| coverage(pixel.face[k], pixel.distance[k], self.sigma);
        clear_but_one(covered, rest);
        // The peak is subtracted in every exponent, and shows only where the background's weight does not follow.
        let mut of_peak = F::zero();
        for k in 0..pixel.face.len() {
            if pixel.face[k] == NONE {
                continue;
            }
            let [covered, exponential] = self.weight(pixel, k, weights.peak);
            let share = covered * exponential / weights.total;
            let colors = &pixel.colors[k * channels..(k + 1) * channels];
            let pull = along(colors);
            for (c, out) in out.colors.iter_mut().skip(k * channels).take(channels).enumerate() {
                *out += g[c] * share;
            }
            let of_height = pull * share / self.gamma;
            of_peak -= of_height;
            if let Some(out) = out.depth.get_mut(k) {
                *out -= of_height / (self.far - self.near);
            }
            if let Some(out) = out.distance.get_mut(k) {
                let of_covered = pull * exponential / weights.total + g[channels] * rest[k];
                *out -= of_covered * covered * (F::one() - covered) / self.sigma;
            }
        }
        if !weights.least {
            of_peak -= along(self.background) * weights.background / weights.total / self.gamma;
        }
        if let Some(k) = weights.nearest
            && let Some(out) = out.depth.get_mut(k)
        {
            *out -= of_peak / (self.far - self.near);
        }
    }
}
