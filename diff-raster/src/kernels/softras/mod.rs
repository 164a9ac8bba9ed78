//! SoftRas's aggregation, and the gradient of that.
//!
//! At a pixel each face has a coverage and, by its depth, a weight:
//!
//! ```text
//! D = sigmoid(± d² / σ)            d the distance from the border, + inside, left out below `least`
//! A = 1 - Π (1 - D)                alpha, over all faces
//! ζ = (far - z) / (far - near)     z = 1 / Σ c_k / z_k at the nearest weights c of the face
//! W = D exp((ζ - max ζ) / γ)       and that of the background exp((ε - max ζ) / γ), whose colour is set
//! C = Σ W colour / Σ W
//! ```
//!
//! `c` are the barycentric coordinates of the pixel, cut off to `[0, 1]` and divided by their sum.
//! Forward goes band by band, through the faces of a band in their order, and scales the sums down
//! when a nearer face appears. Backward goes face by face and computes everything again from the
//! sums, so that no list is kept and no order depends on threads. Both take the pixels of a row in vectors.

mod face;
mod pull;
mod source;
mod state;

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};

use crate::SoftRas;
use crate::kernels::lanes::{Job, Lanes, dispatch};
use crate::kernels::setup::{BAND_ROWS, visible_corners};
pub(crate) use face::TEXEL_GUARD;
use face::{Constants, FaceRow, Ready, Shown, Touch, vanishing_exp};
pub use pull::softras_grad;
pub use source::Colors;
use source::Source;
pub use state::State;
use state::{ImageState, Layout};

/// Faces per parallel task.
const CHUNK: usize = 32;
/// The first planes of the sums, before those of the channels.
const CLEAR: usize = 0;
const PEAK: usize = 1;
const TOTAL: usize = 2;
const SUMS: usize = 3;

/// What all passes know of the batch.
#[derive(Clone, Copy)]
struct Scene<'a, F: Real> {
    renderer: &'a SoftRas<F>,
    colors: Colors<'a, F>,
    channels: usize,
}

impl<'a, F: Real> Scene<'a, F> {
    /// Numbers of an image's colours.
    fn stride(&self) -> usize {
        let faces = &self.renderer.faces;
        self.channels
            * match self.colors {
                Colors::Vertices(_) => faces.vertex_count(),
                Colors::Texels(_, side) => faces.len() * side * side,
            }
    }

    fn colors_of(&self, image: usize) -> &'a [F] {
        &self.colors.all()[self.stride() * image..self.stride() * (image + 1)]
    }

    /// The planes that the forward pass fills.
    fn sums(&self) -> Layout {
        Layout::new(SUMS + self.channels, self.renderer.settings.width)
    }

    /// Where a face's colours at some pixels come from.
    #[inline(always)]
    fn source<L: Lanes<F = F>>(
        &self,
        l: L,
        k: &Constants<L>,
        face: usize,
        row: &FaceRow<L>,
        shown: &Shown<L>,
    ) -> Source<L> {
        let c = self.channels;
        match self.colors {
            Colors::Vertices(_) => {
                let corners = self.renderer.faces.corners()[face];
                let from = [corners[0], corners[1], corners[2]].map(|v| v as usize * c);
                Source::Corners(from, row.blend(l, k, shown))
            }
            Colors::Texels(_, side) => {
                Source::texels(l, &shown.cut, side, [face * side * side * c, c])
            }
        }
    }
}

/// Images `[N, H, W, C + 1]` of `projected [N, V, 3]`, alpha last; all of `out` is written.
///
/// `channels` is C, and may be 0. `state` is for [`softras_grad`], and may be of any earlier call.
///
/// # Panics
/// If a slice is too short.
pub fn softras<F: Real>(
    renderer: &SoftRas<F>,
    projected: &[F],
    colors: Colors<'_, F>,
    channels: usize,
    state: &mut State<F>,
    out: &mut [F],
) {
    let scene = Scene { renderer, colors, channels };
    let settings = &renderer.settings;
    let pixels = settings.height * settings.width;
    let positions = 3 * renderer.faces.vertex_count();
    let batch = out.len().checked_div(pixels * (channels + 1)).unwrap_or(0);
    state.images.resize_with(batch, ImageState::default);
    let images =
        state.images.par_iter_mut().zip(out.par_chunks_mut((pixels * (channels + 1)).max(1)));
    images.enumerate().for_each(|(n, (state, out))| {
        state.prepare(renderer, &projected[positions * n..positions * (n + 1)]);
        let layout = scene.sums();
        state.sums.resize(layout.len(settings.height), F::zero());
        let (faces, bands) = (&state.faces[..], &state.bands);
        let colors = scene.colors_of(n);
        let rows = BAND_ROWS * settings.width * (channels + 1);
        let parts = state.sums.par_chunks_mut(layout.band()).zip(out.par_chunks_mut(rows));
        parts.enumerate().for_each(|(band, (sums, out))| {
            background(&scene, sums);
            let items = bands.items(band);
            let job = Draw { scene: &scene, colors, faces, items, band, sums: &mut *sums };
            dispatch(settings.instructions.arch(), job);
            finish(&scene, sums, out);
        });
    });
}

impl<F: Real> ImageState<F> {
    fn prepare(&mut self, renderer: &SoftRas<F>, projected: &[F]) {
        let reach = F::from_f64(renderer.settings.reach());
        self.faces.resize(renderer.faces.len(), Ready::default());
        let faces = self.faces.par_iter_mut().zip(renderer.faces.corners().par_iter());
        faces.with_min_len(CHUNK).for_each(|(ready, &corners)| {
            let corners = visible_corners(projected, corners, F::zero());
            let found = corners.and_then(|p| Ready::new(p, &renderer.centers, reach));
            *ready = found.unwrap_or_default();
        });
        self.bands.sort(renderer.settings.height, self.faces.iter().map(|f| f.pixels.rows));
    }
}

/// A band before any face: the background is what weighs 1.
fn background<F: Real>(scene: &Scene<'_, F>, sums: &mut [F]) {
    let settings = &scene.renderer.settings;
    let behind = |channel: usize| settings.background_color.get(channel).copied().unwrap_or(0.0);
    for (plane, sums) in sums.chunks_exact_mut(scene.sums().plane()).enumerate() {
        let value = match plane {
            CLEAR | TOTAL => 1.0,
            PEAK => settings.background,
            channel => behind(channel - SUMS),
        };
        sums.fill(F::from_f64(value));
    }
}

/// The pixels of a band from its sums.
fn finish<F: Real>(scene: &Scene<'_, F>, sums: &[F], out: &mut [F]) {
    let (layout, c) = (scene.sums(), scene.channels);
    let width = scene.renderer.settings.width;
    let (stride, plane) = (layout.stride(), layout.plane());
    for (row, out) in out.chunks_exact_mut(width * (c + 1)).enumerate() {
        for (column, pixel) in out.chunks_exact_mut(c + 1).enumerate() {
            let sums = &sums[row * stride + column..];
            let scale = F::one() / sums[TOTAL * plane];
            for (channel, v) in pixel[..c].iter_mut().enumerate() {
                *v = sums[(SUMS + channel) * plane] * scale;
            }
            pixel[c] = F::one() - sums[CLEAR * plane];
        }
    }
}

/// Draws the faces of a band.
struct Draw<'a, F: Real> {
    scene: &'a Scene<'a, F>,
    colors: &'a [F],
    faces: &'a [Ready<F>],
    items: &'a [u32],
    band: usize,
    sums: &'a mut [F],
}

impl<F: Real> Job<F> for Draw<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes<F = F>>(mut self, l: L) {
        let renderer = self.scene.renderer;
        let (settings, centers) = (&renderer.settings, &renderer.centers);
        let k = Constants::of(l, settings);
        let first = self.band * BAND_ROWS;
        let last = (first + BAND_ROWS).min(settings.height);
        let stride = self.scene.sums().stride();
        for &item in self.items {
            let ready = &self.faces[item as usize];
            let columns = ready.pixels.columns.map(|c| c as usize);
            for row in ready.rows_within([first, last]) {
                let line = FaceRow::new(l, ready, centers.row(row));
                for column in (columns[0]..columns[1]).step_by(L::N) {
                    let count = (columns[1] - column).min(L::N);
                    let within = l.first(count);
                    let x = l.load(&centers.x[column..]);
                    let Some(touch) = line.touch(l, &k, x, within) else { continue };
                    let at = (row - first) * stride + column;
                    let clear = l.load(&self.sums[at..]);
                    let left = l.mul(clear, touch.clear);
                    l.store(&mut self.sums[at..], l.select(touch.reached, left, clear));
                    if self.scene.channels > 0 {
                        self.paint(l, &k, item as usize, &line, &touch, at);
                    }
                }
            }
        }
    }
}

impl<F: Real> Draw<'_, F> {
    /// Adds a face's colours to the sums from `at` on, scaled down where it is nearer than all before it.
    #[inline(always)]
    fn paint<L: Lanes<F = F>>(
        &mut self,
        l: L,
        k: &Constants<L>,
        face: usize,
        line: &FaceRow<L>,
        touch: &Touch<L>,
        at: usize,
    ) {
        let plane = self.scene.sums().plane();
        let shown = line.shown(l, k, touch);
        if !l.any(shown.seen) {
            return;
        }
        let peak = l.load(&self.sums[at + PEAK * plane..]);
        let nearer = l.lt(peak, shown.height);
        let difference = l.sub(peak, shown.height);
        let difference = l.min(difference, l.sub(l.zero(), difference));
        let fall = vanishing_exp(l, l.mul(difference, k.per_gamma));
        let factor = l.select(nearer, fall, l.one());
        let weight = l.mul(touch.covered, l.select(nearer, l.one(), fall));
        let source = self.scene.source(l, k, face, line, &shown);
        let total = at + TOTAL * plane;
        self.add(l, total, shown.seen, factor, weight);
        for channel in 0..self.scene.channels {
            let color = source.color(l, self.colors, channel);
            self.add(l, at + (SUMS + channel) * plane, shown.seen, factor, l.mul(weight, color));
        }
        let higher = l.select(shown.seen, l.max(peak, shown.height), peak);
        l.store(&mut self.sums[at + PEAK * plane..], higher);
    }
    /// Adds to a sum that is scaled down first.
    #[inline(always)]
    fn add<L: Lanes<F = F>>(&mut self, l: L, at: usize, seen: L::M, factor: L::V, more: L::V) {
        let sum = l.load(&self.sums[at..]);
        let more = l.fma(sum, factor, more);
        l.store(&mut self.sums[at..], l.select(seen, more, sum));
    }
}
