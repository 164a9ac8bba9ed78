//! A face at a pixel: how much it covers, and what it shows.

use autodiff_lite::Real;

use crate::SoftRasSettings;
use crate::kernels::distance::edges;
use crate::kernels::setup::{Centers, PixelBox, extent, twice_area};

/// The least sum that cut-off weights are divided by.
pub(super) const SUM_GUARD: f64 = 1e-5;
/// By so much, in texels, the lower triangles are larger.
pub(crate) const TEXEL_GUARD: f64 = 1e-4;

/// A face ready to be drawn.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Ready<F> {
    /// Corner, the way to the next one, and `1 / length²`.
    pub(super) edges: [[F; 5]; 3],
    /// Barycentric coordinates as coefficients of `x`, `y` and 1.
    pub(super) weights: [[F; 3]; 3],
    pub(super) depths: [F; 3],
    pub(super) pixels: PixelBox,
}

/// The numbers of the settings.
#[derive(Clone, Copy)]
pub(super) struct Constants<F> {
    pub(super) per_sigma: F,
    pub(super) per_gamma: F,
    pub(super) near: F,
    pub(super) far: F,
    pub(super) per_range: F,
    pub(super) threshold: F,
    pub(super) perspective: bool,
}

impl<F: Real> Constants<F> {
    pub(super) fn of(s: &SoftRasSettings) -> Self {
        let c = F::from_f64;
        Self {
            per_sigma: c(1.0 / s.sigma),
            per_gamma: c(1.0 / s.gamma),
            near: c(s.near),
            far: c(s.far),
            per_range: c(1.0 / (s.far - s.near)),
            threshold: c(s.reach().powi(2)),
            perspective: s.perspective,
        }
    }
}

/// A face at a pixel that it reaches.
pub(super) struct Touch<F> {
    /// `D`, and `1 - D` without cancellation.
    pub(super) covered: F,
    pub(super) clear: F,
    /// `± 1 / σ`
    pub(super) derivative: F,
    /// From the nearest point of the border to the pixel, and that point as weights of the corners.
    pub(super) away: [F; 2],
    pub(super) nearest: [F; 3],
    /// Barycentric coordinates of the pixel.
    pub(super) raw: [F; 3],
}

/// What the face shows there.
pub(super) struct Shown<F> {
    /// Weights cut off, and what their sum was.
    pub(super) cut: [F; 3],
    pub(super) sum: F,
    pub(super) depth: F,
    /// `ζ`
    pub(super) height: F,
}

#[inline]
pub(super) fn unit<F: Real>(x: F) -> F {
    let x = if x > F::zero() { x } else { F::zero() };
    if x < F::one() { x } else { F::one() }
}

impl<F: Real> Ready<F> {
    pub(super) fn new(p: [[F; 3]; 3], centers: &Centers<F>, reach: F) -> Option<Self> {
        let [a, b, c] = p;
        let area = twice_area(a, b, c);
        let inverse = F::one() / area;
        if !area.is_finite() || !inverse.is_finite() {
            return None;
        }
        let [x, y] = [0, 1].map(|k| {
            let [low, high] = extent(a[k], b[k], c[k]);
            [low - reach, high + reach]
        });
        let pixels = PixelBox {
            columns: centers.columns(x[0], x[1], false),
            rows: centers.rows(y[0], y[1], false),
        };
        let opposite = |p: [F; 3], q: [F; 3]| {
            [p[1] - q[1], q[0] - p[0], p[0] * q[1] - q[0] * p[1]].map(|v| v * inverse)
        };
        let weights = [opposite(b, c), opposite(c, a), opposite(a, b)];
        let ready = Self { edges: edges(p), weights, depths: p.map(|p| p[2]), pixels };
        (!pixels.is_empty()).then_some(ready)
    }

    #[inline]
    pub(super) fn touch(&self, k: &Constants<F>, x: F, y: F) -> Option<Touch<F>> {
        let (zero, one) = (F::zero(), F::one());
        let raw = self.weights.map(|[a, b, c]| a * x + b * y + c);
        let inside = raw.iter().all(|&w| w > zero);
        let mut best = F::infinity();
        let (mut away, mut nearest) = ([zero; 2], [zero; 3]);
        for (edge, &[x0, y0, dx, dy, inverse]) in self.edges.iter().enumerate() {
            let (ex, ey) = (x - x0, y - y0);
            let t = unit((ex * dx + ey * dy) * inverse);
            let to = [ex - t * dx, ey - t * dy];
            let square = to[0] * to[0] + to[1] * to[1];
            if square < best {
                (best, away, nearest) = (square, to, [zero; 3]);
                (nearest[edge], nearest[(edge + 1) % 3]) = (one - t, t);
            }
        }
        if !inside && best >= k.threshold {
            return None;
        }
        let derivative = if inside { k.per_sigma } else { -k.per_sigma };
        let (covered, clear) =
            ((derivative * best).fast_sigmoid(), (-derivative * best).fast_sigmoid());
        Some(Touch { covered, clear, derivative, away, nearest, raw })
    }

    /// None where the depth is out of range.
    #[inline]
    pub(super) fn shown(&self, k: &Constants<F>, raw: [F; 3]) -> Option<Shown<F>> {
        let cut = raw.map(unit);
        let guard = F::from_f64(SUM_GUARD);
        let sum = cut[0] + cut[1] + cut[2];
        let sum = if sum > guard { sum } else { guard };
        let cut = cut.map(|w| w / sum);
        let z = &self.depths;
        let depth = F::one() / (cut[0] / z[0] + cut[1] / z[1] + cut[2] / z[2]);
        let seen = depth >= k.near && depth <= k.far;
        seen.then(|| Shown { cut, sum, depth, height: (k.far - depth) * k.per_range })
    }

    /// Weights of the colours of the corners.
    #[inline]
    pub(super) fn blend(&self, k: &Constants<F>, shown: &Shown<F>) -> [F; 3] {
        if k.perspective {
            [0, 1, 2].map(|i| shown.cut[i] * shown.depth / self.depths[i])
        } else {
            shown.cut
        }
    }
}

/// The texel that weights fall on.
///
/// Beyond the side opposite to corner 2 the first two weights add up to 1, and rounding must not say on
/// which side of a diagonal that is.
#[inline]
pub(super) fn texel<F: Real>(cut: [F; 3], side: usize) -> usize {
    let size = side as f64;
    let [x, y] = [cut[0], cut[1]].map(|w| Real::to_f64(w) * size);
    let place = |v: f64| (v as usize).min(side - 1);
    let (column, row) = (place(x), place(y));
    if x + y - (column + row) as f64 <= 1.0 + TEXEL_GUARD {
        row * side + column
    } else {
        (side - 1 - row) * side + (side - 1 - column)
    }
}
