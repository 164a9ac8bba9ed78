//! A silhouette whose border pixels carry the sub-pixel position of the border.
//!
//! Take two pixels side by side, `p` covered and `q` background. On the way from centre to centre
//! the surface ends at a silhouette edge, at the fraction `s` of the way, and `s` is affine in
//! that edge's position across. With
//!
//! ```text
//! p loses  max(0, 1/2 - s)         q gains  max(0, s - 1/2)
//! ```
//!
//! the coverage of a row sums up to the length of the chord on its centre line: nothing is
//! blurred, nothing is biased, and the border lies where coverage is one half. Edges steeper than
//! the diagonal act on pairs in a row, the others on pairs in a column, so that no edge counts
//! twice. A pixel cut in both directions multiplies what is left in each: exact for corners of
//! axis-aligned boxes.
//!
//! The edge is found by walking from the face seen at `p` over its neighbours towards `q` until
//! the surface turns back or ends: a face too thin to cover any pixel is crossed on the way.
//!
//! After Laine et al. 2020, *Modular Primitives for High-Performance Differentiable Rendering*,
//! section 3.4.

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};

use crate::faces::NONE;
use crate::fragments::Fragments;
use crate::kernels::bits::Bits;
use crate::kernels::setup::{near, twice_area, visible_corners};

/// A silhouette edge between two neighbouring pixels.
#[derive(Clone, Copy, Debug)]
struct Crossing<F> {
    /// The pixel whose coverage it changes.
    pixel: u32,
    /// The vertices of the edge.
    vertices: [u32; 2],
    /// How much of the pixel it gives to the other side, in `[0, 1/2]`.
    share: F,
    /// Derivative of the pixel's coverage by `x` and `y` of the two vertices, times what is left
    /// of the pixel in the other direction.
    derivatives: [[F; 2]; 2],
    /// Whether the pixels of the pair are in a column.
    column: bool,
}

/// What the forward pass finds out, for its gradient.
#[derive(Debug, Default)]
pub struct State<F> {
    images: Vec<ImageState<F>>,
}

#[derive(Debug, Default)]
struct ImageState<F> {
    background: Bits,
    crossings: Vec<Crossing<F>>,
    /// What is left of each pixel by pairs in rows, and by pairs in columns.
    left: [Vec<F>; 2],
}

/// The antialiased silhouette `[N, H, W]` of what was drawn; all of `out` is written.
///
/// `projected` is `[N, V, 3]` as it was rasterised; `state` is for
/// [`antialiased_silhouette_grad`], and may be of any earlier call.
pub fn antialiased_silhouette<F: Real>(
    fragments: &Fragments<F>,
    projected: &[F],
    state: &mut State<F>,
    out: &mut [F],
) {
    let [batch, height, width] = fragments.shape();
    let pixels = height * width;
    state.images.resize_with(batch, ImageState::default);
    if pixels * batch == 0 {
        return;
    }
    let positions = 3 * fragments.faces().vertex_count();
    let neighbors = fragments.faces().neighbors();
    let near = near::<F>(fragments.settings());
    state.images.par_iter_mut().zip(out.par_chunks_mut(pixels)).enumerate().for_each(
        |(n, (state, out))| {
            let face = &fragments.face[pixels * n..pixels * (n + 1)];
            let projected = &projected[positions * n..positions * (n + 1)];
            let walk = Walk { fragments, projected, neighbors, face, near };
            state.background.fill(height, width, face);
            state.crossings.clear();
            for left in &mut state.left {
                left.clear();
                left.resize(pixels, F::one());
            }
            for_each_border(&state.background, height, width, |covered, open| {
                if let Some(crossing) = walk.crossing(covered, open) {
                    state.left[crossing.column as usize][crossing.pixel as usize] -= crossing.share;
                    state.crossings.push(crossing);
                }
            });
            let [rows, columns] = &state.left;
            for (((out, &face), &r), &c) in out.iter_mut().zip(face).zip(rows).zip(columns) {
                *out = if face == NONE { F::one() - r * c } else { r * c };
            }
        },
    );
}

/// The gradient of [`antialiased_silhouette`] to screen positions, added to
/// `of_projected [N, V, 3]`.
///
/// `grad` is `[N, H, W]`, and `state` of the call for the same fragments.
pub fn antialiased_silhouette_grad<F: Real>(
    fragments: &Fragments<F>,
    state: &State<F>,
    grad: &[F],
    of_projected: &mut [F],
) {
    let [_, height, width] = fragments.shape();
    let (pixels, vertices) = (height * width, fragments.faces().vertex_count());
    if pixels * vertices == 0 {
        return;
    }
    let images = state.images.par_iter().zip(grad.par_chunks(pixels));
    images.zip(of_projected.par_chunks_mut(3 * vertices)).for_each(|((state, grad), out)| {
        // In the order of pixels: the sums do not depend on the number of threads.
        for crossing in &state.crossings {
            let pixel = crossing.pixel as usize;
            let pull = grad[pixel] * state.left[usize::from(!crossing.column)][pixel];
            for (&vertex, derivatives) in crossing.vertices.iter().zip(crossing.derivatives) {
                let out = &mut out[3 * vertex as usize..][..2];
                out[0] += pull * derivatives[0];
                out[1] += pull * derivatives[1];
            }
        }
    });
}

/// Calls `f` with each pair of pixels side by side of which one is covered (given first) and the
/// other is background.
fn for_each_border(background: &Bits, height: usize, width: usize, mut f: impl FnMut(u32, u32)) {
    let mut pair = |background: bool, pixel: usize, next: usize| {
        if background { f(next as u32, pixel as u32) } else { f(pixel as u32, next as u32) }
    };
    for row in 0..height {
        let words = background.row(row);
        for (k, &word) in words.iter().enumerate() {
            let at = row * width + 64 * k;
            let following = words.get(k + 1).map_or(0, |next| next << 63);
            let mut changes = word ^ (word >> 1 | following);
            while changes != 0 {
                let bit = changes.trailing_zeros() as usize;
                changes &= changes - 1;
                if 64 * k + bit + 1 < width {
                    pair(word >> bit & 1 == 1, at + bit, at + bit + 1);
                }
            }
            if row + 1 < height {
                let mut changes = word ^ background.row(row + 1)[k];
                while changes != 0 {
                    let bit = changes.trailing_zeros() as usize;
                    changes &= changes - 1;
                    pair(word >> bit & 1 == 1, at + bit, at + bit + width);
                }
            }
        }
    }
}

struct Walk<'a, F: Real> {
    fragments: &'a Fragments<F>,
    projected: &'a [F],
    neighbors: &'a [[u32; 3]],
    face: &'a [u32],
    near: F,
}

impl<F: Real> Walk<'_, F> {
    fn center(&self, pixel: u32) -> [F; 2] {
        let (width, centers) = (self.fragments.settings().width, self.fragments.centers());
        [centers.x[pixel as usize % width], centers.row(pixel as usize / width)]
    }

    fn corners(&self, face: u32) -> Option<([u32; 3], [[F; 3]; 3])> {
        let corners = self.fragments.faces().corners()[face as usize];
        Some((corners, visible_corners(self.projected, corners, self.near)?))
    }

    /// The silhouette edge between a covered pixel and its background neighbour, if there is one
    /// that acts in this direction.
    fn crossing(&self, covered: u32, open: u32) -> Option<Crossing<F>> {
        let (p, q) = (self.center(covered), self.center(open));
        let [a, b] = self.silhouette_edge(self.face[covered as usize], p, q)?;
        let position = |v: u32| {
            let at = 3 * v as usize;
            [self.projected[at], self.projected[at + 1]]
        };
        let (va, vb) = (position(a), position(b));

        // `across` is the axis of the pair, `along` the other one.
        let settings = self.fragments.settings();
        let column = covered.abs_diff(open) as usize == settings.width && p[0] == q[0];
        let (across, along) = if column { (1, 0) } else { (0, 1) };
        let size = [settings.width, settings.height].map(|n| F::from_f64(n as f64));
        let run = [0, 1].map(|k| ((vb[k] - va[k]) * size[k]).abs());
        if run[along] < run[across] || (column && run[along] == run[across]) {
            return None;
        }
        let t = (p[along] - va[along]) / (vb[along] - va[along]);
        let shear = (vb[across] - va[across]) / (vb[along] - va[along]);
        let step = F::one() / (q[across] - p[across]);
        let half = F::from_f64(0.5);
        let s = (va[across] + (p[along] - va[along]) * shear - p[across]) * step;
        if !s.is_finite() {
            return None;
        }
        let s = s.max(F::zero()).min(F::one());
        let weights = [F::one() - t, t];
        let derivatives = weights.map(|weight| {
            let mut derivative = [F::zero(); 2];
            derivative[across] = weight * step;
            derivative[along] = -weight * shear * step;
            derivative
        });
        let (pixel, share) = if s < half { (covered, half - s) } else { (open, s - half) };
        Some(Crossing { pixel, vertices: [a, b], share, derivatives, column })
    }

    /// Walks from the face seen at `p` over the surface towards `q`, until it turns back or ends.
    fn silhouette_edge(&self, mut face: u32, p: [F; 2], q: [F; 2]) -> Option<[u32; 2]> {
        let mut entry = None;
        let mut sign = F::one();
        let (mut corners, mut at) = self.corners(face)?;
        // Every face is left once at most, unless rounding leads in a circle.
        for _ in 0..self.neighbors.len() {
            let area = twice_area(at[0], at[1], at[2]);
            if area != F::zero() {
                sign = area.signum();
            }
            let mut exit = None;
            for k in (0..3).filter(|&k| Some(k) != entry) {
                let (from, to) = (at[(k + 1) % 3], at[(k + 2) % 3]);
                let (ep, eq) = (sign * twice_area(from, to, p), sign * twice_area(from, to, q));
                if eq < F::zero() {
                    let t = if ep > F::zero() { ep / (ep - eq) } else { F::zero() };
                    if exit.is_none_or(|(_, best)| t < best) {
                        exit = Some((k, t));
                    }
                }
            }
            let (k, _) = exit?;
            let edge = [corners[(k + 1) % 3], corners[(k + 2) % 3]];
            let next = self.neighbors[face as usize][k];
            if next == NONE {
                return Some(edge);
            }
            let Some((next_corners, next_at)) = self.corners(next) else {
                return Some(edge);
            };
            let opposite = (0..3).find(|&k| !edge.contains(&next_corners[k]))?;
            let [x, y, _] = next_at[opposite];
            if sign * twice_area(at[(k + 1) % 3], at[(k + 2) % 3], [x, y]) > F::zero() {
                return Some(edge);
            }
            (face, corners, at, entry) = (next, next_corners, next_at, Some(opposite));
        }
        None
    }
}
