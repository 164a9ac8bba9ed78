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
//! sums, so that no list is kept and no order depends on threads.

mod face;
mod pull;
mod state;

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};

use crate::SoftRas;
use crate::kernels::setup::{BAND_ROWS, visible_corners};
pub(crate) use face::TEXEL_GUARD;
use face::{Constants, Ready, Shown, texel};
pub use pull::softras_grad;
use state::ImageState;
pub use state::State;

/// Faces per parallel task.
const CHUNK: usize = 32;

/// Colours of faces.
#[derive(Clone, Copy, Debug)]
pub enum Colors<'a, F> {
    /// Of vertices, `[N, V, C]`, interpolated.
    Vertices(&'a [F]),
    /// Of `side²` texels of each face, `[N, F, side², C]`; the nearest counts.
    Texels(&'a [F], usize),
}

impl<'a, F> Colors<'a, F> {
    fn all(self) -> &'a [F] {
        match self {
            Self::Vertices(all) | Self::Texels(all, _) => all,
        }
    }
}

/// Where the colour of a face at a pixel comes from.
#[derive(Clone, Copy)]
struct Sources<F> {
    /// Offsets into the colours of an image, with weights.
    parts: [(usize, F); 3],
    count: usize,
}

impl<F: Real> Sources<F> {
    #[inline]
    fn of(scene: &Scene<'_, F>, face: usize, ready: &Ready<F>, shown: &Shown<F>) -> Self {
        let c = scene.channels;
        match scene.colors {
            Colors::Vertices(_) => {
                let corners = scene.renderer.faces.corners()[face];
                let blend = ready.blend(&scene.constants, shown);
                let parts = [0, 1, 2].map(|i| (corners[i] as usize * c, blend[i]));
                Self { parts, count: 3 }
            }
            Colors::Texels(_, side) => {
                let at = (face * side * side + texel(shown.cut, side)) * c;
                Self { parts: [(at, F::one()); 3], count: 1 }
            }
        }
    }

    #[inline]
    fn color(&self, colors: &[F], channel: usize) -> F {
        let parts = self.parts[..self.count].iter();
        parts.fold(F::zero(), |sum, &(at, w)| sum + w * colors[at + channel])
    }
}

/// What all passes know of the batch.
#[derive(Clone, Copy)]
struct Scene<'a, F: Real> {
    renderer: &'a SoftRas<F>,
    constants: Constants<F>,
    colors: Colors<'a, F>,
    channels: usize,
}

impl<'a, F: Real> Scene<'a, F> {
    fn new(renderer: &'a SoftRas<F>, colors: Colors<'a, F>, channels: usize) -> Self {
        Self { renderer, constants: Constants::of(&renderer.settings), colors, channels }
    }

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
    let scene = Scene::new(renderer, colors, channels);
    let settings = &renderer.settings;
    let (pixels, width) = (settings.height * settings.width, settings.width);
    let positions = 3 * renderer.faces.vertex_count();
    let batch = out.len().checked_div(pixels * (channels + 1)).unwrap_or(0);
    state.images.resize_with(batch, ImageState::default);
    let images =
        state.images.par_iter_mut().zip(out.par_chunks_mut((pixels * (channels + 1)).max(1)));
    images.enumerate().for_each(|(n, (state, out))| {
        state.prepare(renderer, &projected[positions * n..positions * (n + 1)]);
        state.sums.resize(pixels, [F::zero(); 3]);
        let (faces, bands) = (&state.faces, &state.bands);
        let colors = scene.colors_of(n);
        let rows = BAND_ROWS * width;
        let parts = state.sums.par_chunks_mut(rows).zip(out.par_chunks_mut(rows * (channels + 1)));
        parts.enumerate().for_each(|(band, (sums, out))| {
            draw(&scene, colors, faces, bands.items(band), band * BAND_ROWS, sums, out);
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

/// Draws the faces of a band from row `first` on.
fn draw<F: Real>(
    scene: &Scene<'_, F>,
    colors: &[F],
    faces: &[Ready<F>],
    items: &[u32],
    first: usize,
    sums: &mut [[F; 3]],
    out: &mut [F],
) {
    let (k, c) = (&scene.constants, scene.channels);
    let (width, centers) = (scene.renderer.settings.width, &scene.renderer.centers);
    let background = F::from_f64(scene.renderer.settings.background);
    sums.fill([F::one(), background, F::one()]);
    // The background is what weighs 1 at first.
    let behind = &scene.renderer.settings.background_color;
    for pixel in out.chunks_exact_mut(c + 1) {
        for (channel, v) in pixel.iter_mut().enumerate() {
            let color = if channel < c { behind.get(channel).copied() } else { None };
            *v = F::from_f64(color.unwrap_or(0.0));
        }
    }
    let last = first + sums.len() / width;
    for &item in items {
        let (face, ready) = (item as usize, &faces[item as usize]);
        let rows = ready.pixels.rows.map(|r| r as usize);
        let columns = ready.pixels.columns.map(|c| c as usize);
        for row in rows[0].max(first)..rows[1].min(last) {
            let y = centers.row(row);
            for column in columns[0]..columns[1] {
                let Some(touch) = ready.touch(k, centers.x[column], y) else { continue };
                let at = (row - first) * width + column;
                let [clear, peak, total] = &mut sums[at];
                *clear *= touch.clear;
                if c == 0 {
                    continue;
                }
                let Some(shown) = ready.shown(k, touch.raw) else { continue };
                let pixel = &mut out[at * (c + 1)..at * (c + 1) + c];
                if shown.height > *peak {
                    let factor = ((*peak - shown.height) * k.per_gamma).fast_exp();
                    *total *= factor;
                    for v in pixel.iter_mut() {
                        *v *= factor;
                    }
                    *peak = shown.height;
                }
                let weight = touch.covered * ((shown.height - *peak) * k.per_gamma).fast_exp();
                *total += weight;
                let sources = Sources::of(scene, face, ready, &shown);
                for (channel, v) in pixel.iter_mut().enumerate() {
                    *v += weight * sources.color(colors, channel);
                }
            }
        }
    }
    for (pixel, [clear, _, total]) in out.chunks_exact_mut(c + 1).zip(sums) {
        let scale = F::one() / *total;
        pixel[..c].iter_mut().for_each(|v| *v *= scale);
        pixel[c] = F::one() - *clear;
    }
}
