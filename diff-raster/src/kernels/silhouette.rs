//! DIB-R's soft silhouette, and the gradient of that.
//!
//! A background pixel `p` is covered by each face whose bounding box, enlarged by `box_length`,
//! holds its centre:
//!
//! ```text
//! s(p) = 1 - Π_f (1 - exp(-sigma_inv d²(p, f)))
//! ```
//!
//! with `d` the distance to the triangle's border; a pixel that shows a face has `s = 1` and no
//! gradient. Most faces are far from any background: they are dropped before anything is computed,
//! by looking at the background bits under their box. The gradient goes face by face and computes
//! everything again: each face reads shared planes and writes its own six numbers.

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};

use crate::faces::{Faces, NONE};
use crate::kernels::bits::Bits;
use crate::kernels::distance::{edge_rows, edges, nearest, squared};
use crate::kernels::lanes::{Job, Lanes, MAX_LANES, dispatch, three};
use crate::kernels::setup::{
    BAND_ROWS, Bands, PixelBox, corner_positions, extent, near, visible_corners,
};
use crate::scratch_pool::ScratchPool;
use crate::{Fragments, Rule, Settings};

/// Faces per parallel task when looking for those near the background.
const CHUNK: usize = 512;
/// Of those, how many per parallel task of the gradient.
const REACH_CHUNK: usize = 32;

/// A pixel that is clear to no more than this is covered: far below the rounding of double precision. Beside a rim, where
/// many faces meet, products would become too small to be normal, which takes a processor a hundred times as long.
const FAINT: f64 = 1e-25;

/// A face that reaches into the background.
#[derive(Clone, Copy, Debug, Default)]
struct Reach<F> {
    /// Corner, and the way to the next corner: `x`, `y`, `dx`, `dy`, `1 / length²`.
    edges: [[F; 5]; 3],
    pixels: PixelBox,
    face: u32,
}

/// What the forward pass over one image finds out, for its gradient.
#[derive(Debug, Default)]
pub struct ImageState<F> {
    background: Bits,
    /// Per face, the pixels that it reaches, none where no background is among them.
    boxes: Vec<PixelBox>,
    /// Per face, its place in `reaches`, or [`NONE`].
    slots: Vec<u32>,
    reaches: Vec<Reach<F>>,
    bands: Bands,
    /// `Π (1 - p)`, padded by [`MAX_LANES`].
    clear: Vec<F>,
    /// The last face that counts at a pixel, if there is a limit; padded.
    last: Vec<u32>,
    /// Per reach: gradient of its corners' positions.
    grads: Vec<[F; 6]>,
}

/// What the forward pass over a batch finds out.
#[derive(Debug, Default)]
pub struct State<F> {
    images: Vec<ImageState<F>>,
    planes: ScratchPool<Planes<F>>,
}

#[derive(Debug, Default)]
struct Planes<F> {
    clear: Vec<F>,
    count: Vec<u32>,
    last: Vec<u32>,
}

/// The soft silhouette `[N, H, W]` of what was drawn; all of `out` is written.
///
/// `projected` is `[N, V, 3]` as it was rasterised; `state` is for [`soft_silhouette_grad`], and
/// may be of any earlier call.
pub fn soft_silhouette<F: Real>(
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
    let planes = &state.planes;
    let positions = 3 * fragments.faces().vertex_count();
    state.images.par_iter_mut().zip(out.par_chunks_mut(pixels)).enumerate().for_each(
        |(n, (state, out))| {
            let projected = &projected[positions * n..positions * (n + 1)];
            let face = &fragments.face[pixels * n..pixels * (n + 1)];
            state.prepare(fragments, n, projected, face);
            let background = &state.background;
            let limit = fragments.settings().max_faces.is_some();
            state.clear.resize(pixels + MAX_LANES, F::one());
            state.last.resize(if limit { pixels + MAX_LANES } else { 0 }, NONE);
            let (reaches, bands) = (&state.reaches, &state.bands);
            let band = |band: usize, out: &mut [F], clear: &mut [F], last: &mut [u32]| {
                planes.with(|planes| {
                    let face = &face[band * BAND_ROWS * width..][..out.len()];
                    let items = bands.items(band);
                    let job = Cover { fragments, background, reaches, items, band, face, planes };
                    dispatch(fragments.settings().instructions.arch(), job);
                    planes.finish(width, out, clear, last);
                });
            };
            let rows = BAND_ROWS * width;
            let out = out.par_chunks_mut(rows);
            let clear = state.clear[..pixels].par_chunks_mut(rows);
            if limit {
                let last = state.last[..pixels].par_chunks_mut(rows);
                out.zip(clear).zip(last).enumerate().for_each(|(k, ((o, c), l))| band(k, o, c, l));
            } else {
                out.zip(clear).enumerate().for_each(|(k, (o, c))| band(k, o, c, &mut []));
            }
        },
    );
}

impl<F: Real> ImageState<F> {
    /// Finds the faces that reach into the background.
    fn prepare(&mut self, fragments: &Fragments<F>, image: usize, projected: &[F], face: &[u32]) {
        let settings = fragments.settings();
        let (centers, corners) = (fragments.centers(), fragments.faces().corners());
        self.background.fill(settings.height, settings.width, face);
        let background = &self.background;
        let (near, length) = (near::<F>(settings), F::from_f64(settings.box_length));
        let drawn = &fragments.setup(image).boxes;
        let margin = centers.pixels_within(length);
        let reached = |face: usize| {
            // Of most faces what was drawn of them tells.
            if !drawn[face].is_empty() && !background.any_tile_around(drawn[face], margin) {
                return None;
            }
            let p = visible_corners(projected, corners[face], near)?;
            let [x, y] = enlarged(&p, length);
            let [rows, columns] = centers.around(x, y);
            if !background.any_tile(rows, columns) {
                return None;
            }
            let pixels = PixelBox {
                columns: centers.columns(x[0], x[1], true),
                rows: centers.rows(y[0], y[1], true),
            };
            (!pixels.is_empty() && background.any(pixels)).then_some(pixels)
        };
        self.boxes.resize(corners.len(), PixelBox::default());
        let faces = self.boxes.par_chunks_mut(CHUNK).enumerate();
        faces.for_each(|(chunk, boxes)| {
            for (i, pixels) in boxes.iter_mut().enumerate() {
                *pixels = reached(chunk * CHUNK + i).unwrap_or_default();
            }
        });

        self.slots.resize(corners.len(), NONE);
        self.reaches.clear();
        for (face, (&pixels, slot)) in self.boxes.iter().zip(&mut self.slots).enumerate() {
            *slot = NONE;
            if !pixels.is_empty() {
                *slot = self.reaches.len() as u32;
                self.reaches.push(Reach { face: face as u32, pixels, ..Reach::default() });
            }
        }
        self.reaches.par_iter_mut().with_min_len(CHUNK).for_each(|reach| {
            reach.edges = edges(corner_positions(projected, corners[reach.face as usize]));
        });
        self.bands.sort(settings.height, self.reaches.iter().map(|r| r.pixels.rows));
    }
}

/// Ranges of `x` and `y` that a face reaches.
#[inline(always)]
fn enlarged<F: Real>(p: &[[F; 3]; 3], length: F) -> [[F; 2]; 2] {
    [0, 1].map(|k| {
        let [low, high] = extent(p[0][k], p[1][k], p[2][k]);
        [low - length, high + length]
    })
}

impl<F: Real> Planes<F> {
    fn clear(&mut self, stride: usize, width: usize, face: &[u32], limit: bool) {
        let rows = face.len() / width;
        self.clear.resize(rows * stride, F::one());
        for (clear, face) in self.clear.chunks_exact_mut(stride).zip(face.chunks_exact(width)) {
            // Zero stays zero: covered pixels take part in the loops without harm.
            let value = |face| if face == NONE { F::one() } else { F::zero() };
            clear.iter_mut().zip(face).for_each(|(clear, &face)| *clear = value(face));
        }
        let len = if limit { rows * stride } else { 0 };
        for (plane, value) in [(&mut self.count, 0), (&mut self.last, NONE)] {
            plane.clear();
            plane.resize(len, value);
        }
    }

    fn finish(&self, width: usize, out: &mut [F], clear: &mut [F], last: &mut [u32]) {
        let stride = width + MAX_LANES;
        let rows = out.chunks_exact_mut(width).zip(clear.chunks_exact_mut(width));
        for ((out, clear), plane) in rows.zip(self.clear.chunks_exact(stride)) {
            clear.copy_from_slice(&plane[..width]);
            out.iter_mut().zip(plane).for_each(|(out, &clear)| *out = F::one() - clear);
        }
        for (last, plane) in last.chunks_exact_mut(width).zip(self.last.chunks_exact(stride)) {
            last.copy_from_slice(&plane[..width]);
        }
    }
}

struct Cover<'a, F: Real> {
    fragments: &'a Fragments<F>,
    background: &'a Bits,
    reaches: &'a [Reach<F>],
    items: &'a [u32],
    band: usize,
    face: &'a [u32],
    planes: &'a mut Planes<F>,
}

impl<F: Real> Job<F> for Cover<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes<F = F>>(self, l: L) {
        let Self { fragments, background, reaches, items, band, face, planes } = self;
        let settings = fragments.settings();
        let centers = fragments.centers();
        let stride = settings.width + MAX_LANES;
        let first = band * BAND_ROWS;
        let last = (first + BAND_ROWS).min(settings.height);
        planes.clear(stride, settings.width, face, settings.max_faces.is_some());
        let sharpness = l.splat(F::from_f64(-settings.sigma_inv));
        let one = l.one();
        let faint = l.splat(F::from_f64(FAINT));
        let limit = settings.max_faces.map(|k| k.min(u32::MAX as usize) as u32);
        for &item in items {
            let reach = &reaches[item as usize];
            let columns = reach.pixels.columns.map(|c| c as usize);
            let rows = reach.pixels.rows.map(|r| r as usize);
            for row in rows[0].max(first)..rows[1].min(last) {
                let columns = background.span(row, columns);
                if columns[0] == columns[1] {
                    continue;
                }
                let edges = edge_rows(l, &reach.edges, centers.row(row));
                for column in (columns[0]..columns[1]).step_by(L::N) {
                    let count = (columns[1] - column).min(L::N);
                    let at = (row - first) * stride + column;
                    let mut inside = l.first(count);
                    let clear = l.load(&planes.clear[at..]);
                    if !l.any(l.and(inside, l.lt(l.zero(), clear))) {
                        continue;
                    }
                    let x = l.load(&centers.x[column..]);
                    let d = three!(k => squared(l, edges[k].nearest(l, x).1));
                    let d = l.min(l.min(d[0], d[1]), d[2]);
                    if let Some(limit) = limit {
                        inside = planes.count(l, at, inside, limit, reach.face);
                    }
                    let p = l.exp(l.mul(sharpness, d));
                    let left = l.mul(clear, l.sub(one, p));
                    let left = l.select(l.lt(faint, left), left, l.zero());
                    l.store(&mut planes.clear[at..], l.select(inside, left, clear));
                }
            }
        }
    }
}

impl<F: Real> Planes<F> {
    /// Counts a face at pixels; returns where it is still among the first `limit`.
    #[inline(always)]
    fn count<L: Lanes<F = F>>(
        &mut self,
        l: L,
        at: usize,
        inside: L::M,
        limit: u32,
        face: u32,
    ) -> L::M {
        let count = l.load_u(&self.count[at..]);
        // `count + 1 <= limit`, and the last one that fits leaves its name.
        let more = l.add_u(count, l.splat_u(1));
        let fits = l.and(inside, l.le_u(more, l.splat_u(limit)));
        l.store_u(&mut self.count[at..], l.select_u(fits, more, count));
        let last = l.load_u(&self.last[at..]);
        let full = l.and(fits, l.eq_u(more, l.splat_u(limit)));
        l.store_u(&mut self.last[at..], l.select_u(full, l.splat_u(face), last));
        fits
    }
}

/// The gradient of [`soft_silhouette`] to screen positions, added to `of_projected [N, V, 3]`.
///
/// `grad` is `[N, H, W]`, and `state` of the call for the same fragments.
pub fn soft_silhouette_grad<F: Real>(
    fragments: &Fragments<F>,
    state: &mut State<F>,
    grad: &[F],
    of_projected: &mut [F],
) {
    let [batch, height, width] = fragments.shape();
    let (pixels, vertices) = (height * width, fragments.faces().vertex_count());
    if pixels * batch * vertices == 0 {
        return;
    }
    state
        .images
        .par_iter_mut()
        .zip(of_projected.par_chunks_mut(3 * vertices))
        .enumerate()
        .for_each(|(n, (state, out))| {
            let grad = &grad[pixels * n..pixels * (n + 1)];
            let mut grads = std::mem::take(&mut state.grads);
            grads.resize(state.reaches.len(), [F::zero(); 6]);
            let arch = fragments.settings().instructions.arch();
            grads.par_chunks_mut(REACH_CHUNK).enumerate().for_each(|(chunk, out)| {
                let reaches = &state.reaches[chunk * REACH_CHUNK..][..out.len()];
                dispatch(arch, Pull { fragments, state, reaches, grad, out });
            });
            add_to_vertices(fragments.faces(), &state.slots, &grads, out);
            state.grads = grads;
        });
}

fn add_to_vertices<F: Real>(faces: &Faces, slots: &[u32], grads: &[[F; 6]], out: &mut [F]) {
    out.par_chunks_mut(3 * CHUNK).enumerate().for_each(|(chunk, out)| {
        for (vertex, out) in out.chunks_exact_mut(3).enumerate() {
            for &corner in faces.corners_of(CHUNK * chunk + vertex) {
                let slot = slots[corner as usize / 3];
                if slot != NONE {
                    let k = 2 * (corner as usize % 3);
                    out[0] += grads[slot as usize][k];
                    out[1] += grads[slot as usize][k + 1];
                }
            }
        }
    });
}

struct Pull<'a, F: Real> {
    fragments: &'a Fragments<F>,
    state: &'a ImageState<F>,
    reaches: &'a [Reach<F>],
    grad: &'a [F],
    out: &'a mut [[F; 6]],
}

impl<F: Real> Job<F> for Pull<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes<F = F>>(self, l: L) {
        let Self { fragments, state, reaches, grad, out } = self;
        let settings = fragments.settings();
        let centers = fragments.centers();
        let width = settings.width;
        let sharpness = l.splat(F::from_f64(-settings.sigma_inv));
        let twice = l.splat(F::from_f64(2.0 * settings.sigma_inv));
        let (zero, one) = (l.zero(), l.one());
        let guard = Guard::of(l, settings, F::epsilon());
        let limited = settings.max_faces.is_some();
        if settings.max_faces == Some(0) {
            // No face has drawn anything.
            out.fill([F::zero(); 6]);
            return;
        }
        for (reach, out) in reaches.iter().zip(out) {
            let columns = reach.pixels.columns.map(|c| c as usize);
            let mut sums = [zero; 6];
            for row in reach.pixels.rows[0] as usize..reach.pixels.rows[1] as usize {
                let columns = state.background.span(row, columns);
                if columns[0] == columns[1] {
                    continue;
                }
                let edges = edge_rows(l, &reach.edges, centers.row(row));
                for column in (columns[0]..columns[1]).step_by(L::N) {
                    let count = (columns[1] - column).min(L::N);
                    let at = row * width + column;
                    let clear = l.load(&state.clear[at..]);
                    let mut inside = l.first(count);
                    if !l.any(l.and(inside, l.lt(zero, clear))) {
                        continue;
                    }
                    if limited {
                        let last = l.load_u(&state.last[at..]);
                        inside = l.and(inside, l.le_u(l.splat_u(reach.face), last));
                    }
                    let x = l.load(&centers.x[column..]);
                    let near = nearest(l, &edges, x);
                    let p = l.exp(l.mul(sharpness, near.squared));
                    let others = l.div(clear, guard.apply(l, l.sub(one, p)));
                    let g = if at + L::N <= grad.len() {
                        l.load(&grad[at..])
                    } else {
                        l.load_part(&grad[at..])
                    };
                    // -dL/d(d²) twice; covered pixels have `clear = 0`.
                    let pull = l.mul(l.mul(l.mul(twice, p), others), g);
                    let pull = l.select(inside, pull, zero);
                    let pull = [l.mul(pull, near.away[0]), l.mul(pull, near.away[1])];
                    for k in 0..3 {
                        for axis in 0..2 {
                            let sum = &mut sums[2 * k + axis];
                            *sum = l.fma(near.weights[k], pull[axis], *sum);
                        }
                    }
                }
            }
            for (out, sum) in out.iter_mut().zip(sums) {
                *out = l.sum(sum);
            }
        }
    }
}

/// What keeps `1 - p` from zero, where the gradient divides by it.
#[derive(Clone, Copy)]
enum Guard<L: Lanes> {
    Add(L::V),
    Max(L::V),
}

impl<L: Lanes> Guard<L> {
    #[inline(always)]
    fn of(l: L, settings: &Settings, epsilon: L::F) -> Self {
        match settings.rule {
            Rule::Published => Self::Add(l.splat(L::F::from_f64(1e-7))),
            Rule::Closed => Self::Max(l.splat(epsilon)),
        }
    }

    #[inline(always)]
    fn apply(self, l: L, x: L::V) -> L::V {
        match self {
            Self::Add(e) => l.add(x, e),
            Self::Max(e) => l.max(x, e),
        }
    }
}
