//! Distance from pixels to the border of a triangle.

use autodiff_lite::Real;

use crate::kernels::lanes::{Lanes, three};

/// Corner `x`, `y` of each edge, the way to the next corner, and `1 / length²`.
#[inline(always)]
pub(crate) fn edges<F: Real>(p: [[F; 3]; 3]) -> [[F; 5]; 3] {
    [0, 1, 2].map(|k| {
        let (a, b) = (p[k], p[(k + 1) % 3]);
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let inverse = F::one() / (dx * dx + dy * dy);
        // An edge without length is its first corner.
        [a[0], a[1], dx, dy, if inverse.is_finite() { inverse } else { F::zero() }]
    })
}

/// The distance of pixels of a row from a triangle's border.
#[derive(Clone, Copy)]
pub(crate) struct Nearest<L: Lanes> {
    pub(crate) squared: L::V,
    /// From the nearest point of the border to the pixel.
    pub(crate) away: [L::V; 2],
    /// That point, as weights of the corners.
    pub(crate) weights: [L::V; 3],
}

/// One edge at a row, in lanes.
#[derive(Clone, Copy)]
pub(crate) struct EdgeRow<L: Lanes> {
    x: L::V,
    dx: L::V,
    dy: L::V,
    inverse: L::V,
    /// `y` of the row from the corner, and that times `dy`.
    ey: L::V,
    along: L::V,
}

#[inline(always)]
pub(crate) fn edge_rows<L: Lanes>(l: L, edges: &[[L::F; 5]; 3], y: L::F) -> [EdgeRow<L>; 3] {
    three!(k => {
        let [x, y0, dx, dy, inverse] = edges[k];
        let ey = y - y0;
        EdgeRow {
            x: l.splat(x),
            dx: l.splat(dx),
            dy: l.splat(dy),
            inverse: l.splat(inverse),
            ey: l.splat(ey),
            along: l.splat(ey * dy),
        }
    })
}

impl<L: Lanes> EdgeRow<L> {
    /// The parameter of the nearest point, and the way from there to the pixels.
    #[inline(always)]
    pub(crate) fn nearest(&self, l: L, x: L::V) -> (L::V, [L::V; 2]) {
        let ex = l.sub(x, self.x);
        let t = l.mul(l.fma(ex, self.dx, self.along), self.inverse);
        let t = l.max(l.min(t, l.one()), l.zero());
        (t, [l.fnma(t, self.dx, ex), l.fnma(t, self.dy, self.ey)])
    }
}

#[inline(always)]
pub(crate) fn squared<L: Lanes>(l: L, [x, y]: [L::V; 2]) -> L::V {
    l.fma(x, x, l.mul(y, y))
}

#[inline(always)]
pub(crate) fn nearest<L: Lanes>(l: L, edges: &[EdgeRow<L>; 3], x: L::V) -> Nearest<L> {
    let (zero, one) = (l.zero(), l.one());
    let (t, away) = edges[0].nearest(l, x);
    let mut best = Nearest { squared: squared(l, away), away, weights: [l.sub(one, t), t, zero] };
    for k in 1..3 {
        let (t, away) = edges[k].nearest(l, x);
        let d = squared(l, away);
        let nearer = l.lt(d, best.squared);
        let s = l.sub(one, t);
        let weights = if k == 1 { [zero, s, t] } else { [t, zero, s] };
        best.squared = l.min(best.squared, d);
        best.away =
            [l.select(nearer, away[0], best.away[0]), l.select(nearer, away[1], best.away[1])];
        best.weights = three!(c => l.select(nearer, weights[c], best.weights[c]));
    }
    best
}
