//! A face at the pixels of a row: how much it covers, and what it shows.

use autodiff_lite::Real;

use crate::SoftRasSettings;
use crate::kernels::distance::{EdgeRow, edge_rows, edges, squared};
use crate::kernels::lanes::{Lanes, three};
use crate::kernels::setup::{Centers, PixelBox, extent, twice_area};

/// The least sum that cut-off weights are divided by.
const SUM_GUARD: f64 = 1e-5;
/// By so much, in texels, the lower triangles are larger.
pub(crate) const TEXEL_GUARD: f64 = 1e-4;

/// A share of `e` to this is none: it is below the rounding of double precision, and numbers that are too small to be
/// normal take a processor a hundred times as long (softened faces far behind others were most of the time).
const FAINT: f64 = -40.0;

/// `exp(x)` for `x <= 0`, and 0 where that is next to nothing.
#[inline(always)]
pub(super) fn vanishing_exp<L: Lanes>(l: L, x: L::V) -> L::V {
    l.select(l.lt(l.splat(L::F::from_f64(FAINT)), x), l.exp(x), l.zero())
}

/// A face ready to be drawn.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Ready<F> {
    /// Corner, the way to the next one, and `1 / length²`.
    pub(super) edges: [[F; 5]; 3],
    /// Barycentric coordinates as coefficients of `x`, `y` and 1.
    pub(super) weights: [[F; 3]; 3],
    /// `1 / z` of the corners.
    pub(super) per_depth: [F; 3],
    pub(super) pixels: PixelBox,
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
        let per_depth = p.map(|p| F::one() / p[2]);
        let ready = Self { edges: edges(p), weights, per_depth, pixels };
        (!pixels.is_empty()).then_some(ready)
    }

    /// First row and one past the last, within a range.
    pub(super) fn rows_within(&self, [first, last]: [usize; 2]) -> std::ops::Range<usize> {
        let [low, high] = self.pixels.rows.map(|row| row as usize);
        low.max(first)..high.min(last)
    }
}

/// The numbers of the settings, in all lanes.
#[derive(Clone, Copy)]
pub(super) struct Constants<L: Lanes> {
    per_sigma: L::V,
    pub(super) per_gamma: L::V,
    near: L::V,
    far: L::V,
    pub(super) per_range: L::V,
    threshold: L::V,
    guard: L::V,
    pub(super) perspective: bool,
}

impl<L: Lanes> Constants<L> {
    #[inline(always)]
    pub(super) fn of(l: L, s: &SoftRasSettings) -> Self {
        Self {
            per_sigma: l.splat(L::F::from_f64(1.0 / s.sigma)),
            per_gamma: l.splat(L::F::from_f64(1.0 / s.gamma)),
            near: l.splat(L::F::from_f64(s.near)),
            far: l.splat(L::F::from_f64(s.far)),
            per_range: l.splat(L::F::from_f64(1.0 / (s.far - s.near))),
            threshold: l.splat(L::F::from_f64(s.reach().powi(2))),
            guard: l.splat(L::F::from_f64(SUM_GUARD)),
            perspective: s.perspective,
        }
    }
}

/// A face along a row of pixels.
#[derive(Clone, Copy)]
pub(super) struct FaceRow<L: Lanes> {
    pub(super) edges: [EdgeRow<L>; 3],
    /// How the barycentric coordinates grow with `x`, and what they are at its zero.
    along_x: [L::V; 3],
    start: [L::V; 3],
    per_depth: [L::V; 3],
}

/// A face at pixels of which it reaches one at least.
#[derive(Clone, Copy)]
pub(super) struct Touch<L: Lanes> {
    /// Where it reaches a pixel, and where that lies inside it.
    pub(super) reached: L::M,
    inside: L::M,
    /// `D`, and `1 - D` without cancellation.
    pub(super) covered: L::V,
    pub(super) clear: L::V,
    /// Barycentric coordinates of the pixels.
    raw: [L::V; 3],
}

impl<L: Lanes> Touch<L> {
    /// `∂(± d² / σ) / ∂ d²`
    #[inline(always)]
    pub(super) fn derivative(&self, l: L, k: &Constants<L>) -> L::V {
        l.select(self.inside, k.per_sigma, l.sub(l.zero(), k.per_sigma))
    }
}

/// What the face shows there.
#[derive(Clone, Copy)]
pub(super) struct Shown<L: Lanes> {
    /// Where its depth is within the range too.
    pub(super) seen: L::M,
    /// Barycentric coordinates of the pixels; where nothing is seen, those of the middle.
    pub(super) raw: [L::V; 3],
    /// Cut off to `[0, 1]` and divided by their sum; one over that, and where it was not too small.
    pub(super) cut: [L::V; 3],
    pub(super) per_sum: L::V,
    pub(super) summed: L::M,
    pub(super) depth: L::V,
    /// `ζ`
    pub(super) height: L::V,
}

impl<L: Lanes> FaceRow<L> {
    #[inline(always)]
    pub(super) fn new(l: L, ready: &Ready<L::F>, y: L::F) -> Self {
        let row = l.splat(y);
        let weights = &ready.weights;
        Self {
            edges: edge_rows(l, &ready.edges, y),
            along_x: three!(k => l.splat(weights[k][0])),
            start: three!(k => l.fma(l.splat(weights[k][1]), row, l.splat(weights[k][2]))),
            per_depth: three!(k => l.splat(ready.per_depth[k])),
        }
    }

    /// None where no pixel of those in `within`, at `x`, is reached.
    #[inline(always)]
    pub(super) fn touch(&self, l: L, k: &Constants<L>, x: L::V, within: L::M) -> Option<Touch<L>> {
        let (zero, one) = (l.zero(), l.one());
        let raw = three!(i => l.fma(self.along_x[i], x, self.start[i]));
        let inside = l.lt(zero, l.min(l.min(raw[0], raw[1]), raw[2]));
        let d = three!(i => squared(l, self.edges[i].nearest(l, x).1));
        let d = l.min(l.min(d[0], d[1]), d[2]);
        let reached = l.lt(l.select(inside, l.sub(zero, one), d), k.threshold);
        let reached = l.and(within, reached);
        if !l.any(reached) {
            return None;
        }
        // The sigmoid of both signs by one exponential that cannot overflow.
        let small = vanishing_exp(l, l.sub(zero, l.mul(d, k.per_sigma)));
        let large = l.div(one, l.add(one, small));
        let small = l.mul(small, large);
        let covered = l.select(inside, large, small);
        let clear = l.select(inside, small, large);
        Some(Touch { reached, inside, covered, clear, raw })
    }

    #[inline(always)]
    pub(super) fn shown(&self, l: L, k: &Constants<L>, touch: &Touch<L>) -> Shown<L> {
        let (zero, one) = (l.zero(), l.one());
        let cut = three!(i => l.max(l.min(touch.raw[i], one), zero));
        let sum = l.add(l.add(cut[0], cut[1]), cut[2]);
        let summed = l.lt(k.guard, sum);
        let per_sum = l.div(one, l.max(sum, k.guard));
        let cut = three!(i => l.mul(cut[i], per_sum));
        let z = &self.per_depth;
        let per_depth = l.fma(cut[0], z[0], l.fma(cut[1], z[1], l.mul(cut[2], z[2])));
        let depth = l.div(one, per_depth);
        let seen = l.and(l.le(k.near, depth), l.le(depth, k.far));
        let seen = l.and(touch.reached, seen);
        // Numbers that nothing is seen of must not become infinite: they are multiplied by zero.
        let depth = l.select(seen, depth, k.far);
        let third = l.splat(L::F::from_f64(1.0 / 3.0));
        let raw = three!(i => l.select(seen, touch.raw[i], third));
        let height = l.mul(l.sub(k.far, depth), k.per_range);
        Shown { seen, raw, cut, per_sum, summed, depth, height }
    }

    /// Weights of the colours of the corners.
    #[inline(always)]
    pub(super) fn blend(&self, l: L, k: &Constants<L>, shown: &Shown<L>) -> [L::V; 3] {
        if k.perspective {
            three!(i => l.mul(l.mul(shown.cut[i], shown.depth), self.per_depth[i]))
        } else {
            shown.cut
        }
    }

    /// `1 / z` of the corners.
    #[inline(always)]
    pub(super) fn per_depth(&self) -> [L::V; 3] {
        self.per_depth
    }
}
