//! Attributes of faces at pixels, and the gradient of that.
//!
//! With barycentrics `w_k` on the screen, `f = Σ w_k f_k`; with perspective
//!
//! ```text
//! b_k = w_k / z_k / D,   D = Σ w_k / z_k = 1 / z,   f = Σ b_k f_k
//! ```
//!
//! The pixel stays where it is while a corner moves, so `∂w_k/∂v_j = -w_j ∇w_k`, and with the sums
//! over the pixels of a face `A_j = Σ b_j g` and `Q_j = Σ b_j g·f`
//!
//! ```text
//! ∂L/∂f_j = A_j
//! ∂L/∂v_j = -Σ_k (z_j / z_k) (f_k·A_j - Q_j) ∇w_k          screen position
//! ∂L/∂z_j = -(f_j·A_j - Q_j) / z_j                         depth
//! ```
//!
//! Without perspective the ratios of depths are 1, `Q` drops out since `Σ ∇w_k = 0`, and depth has
//! no gradient: this is DIB-R's rule. The sums are taken band by band of rows, in the order of memory
//! (looking for the pixels of each face in turn took three times as long at 512 x 512), each band
//! into places of its own; then each face adds up its bands in order. No two tasks write the same
//! number, so nothing depends on the number of threads.

use std::ops::Range;

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};
use autodiff_lite::kernels::threads::join;

use crate::faces::NONE;
use crate::kernels::lanes::{Job, Lanes, dispatch};
use crate::kernels::setup::{BAND_ROWS, corner_positions, twice_area};
use crate::{Fragments, Scratch};

/// Faces per parallel task of the gradient.
const CHUNK: usize = 512;

/// How attributes are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// `[V, C]`, the same for all images.
    Shared,
    /// `[N, V, C]`
    Batched,
    /// `[F, 3, C]`: per face corner, the same for all images.
    Corners,
}

/// Attributes of vertices or corners.
#[derive(Clone, Copy, Debug)]
pub struct Attributes<'a, F> {
    /// The numbers.
    pub data: &'a [F],
    /// `C`
    pub channels: usize,
    /// How they are stored.
    pub layout: Layout,
}

impl<'a, F: Real> Attributes<'a, F> {
    #[inline(always)]
    fn of_face(&self, image: usize, vertices: usize, face: u32, corners: [u32; 3]) -> [&'a [F]; 3] {
        let row = |row: usize| &self.data[row * self.channels..(row + 1) * self.channels];
        match self.layout {
            Layout::Shared => corners.map(|v| row(v as usize)),
            Layout::Batched => corners.map(|v| row(image * vertices + v as usize)),
            Layout::Corners => [0, 1, 2].map(|k| row(3 * face as usize + k)),
        }
    }
}

/// Interpolates attributes: `out` is `[N, H, W, C]`, all of it written, zero at background.
pub fn interpolate<F: Real>(
    fragments: &Fragments<F>,
    attributes: Attributes<'_, F>,
    out: &mut [F],
) {
    let [_, height, width] = fragments.shape();
    let (pixels, channels) = (height * width, attributes.channels);
    if pixels * channels == 0 {
        return;
    }
    let arch = fragments.settings().instructions.arch();
    out.par_chunks_mut(pixels * channels).enumerate().for_each(|(image, out)| {
        let block = BAND_ROWS * width;
        out.par_chunks_mut(block * channels).enumerate().for_each(|(k, out)| {
            let first = image * pixels + k * block;
            let job = Forward { fragments, attributes, image, first, out };
            match channels {
                1 => dispatch(arch, Channels::<_, 1, 2>(job)),
                2 => dispatch(arch, Channels::<_, 2, 4>(job)),
                3 => dispatch(arch, Channels::<_, 3, 4>(job)),
                4 => dispatch(arch, Channels::<_, 4, 8>(job)),
                _ => dispatch(arch, Channels::<_, 0, 1>(job)),
            }
        });
    });
}

/// A job for a number of channels `C` that the compiler knows, or for any if that is 0. `P > C` is
/// the width of the sums of the gradient: `C` channels and `g·f`.
struct Channels<J, const C: usize, const P: usize>(J);

struct Forward<'a, F: Real> {
    fragments: &'a Fragments<F>,
    attributes: Attributes<'a, F>,
    image: usize,
    first: usize,
    out: &'a mut [F],
}

impl<F: Real, const C: usize, const P: usize> Job<F> for Channels<Forward<'_, F>, C, P> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes<F = F>>(self, _: L) {
        let Forward { fragments, attributes, image, first, out } = self.0;
        let faces = fragments.faces();
        let of_face = |id: u32| {
            let corners = faces.corners()[id as usize];
            attributes.of_face(image, faces.vertex_count(), id, corners)
        };
        let channels = attributes.channels;
        let count = out.len() / channels;
        let ids = &fragments.face[first..first + count];
        let weights = &fragments.barycentric[3 * first..3 * (first + count)];
        let weights = weights.as_chunks::<3>().0;
        if C == 0 {
            for ((&id, w), out) in ids.iter().zip(weights).zip(out.chunks_exact_mut(channels)) {
                if id == NONE {
                    out.fill(F::zero());
                    continue;
                }
                let [a, b, c] = of_face(id).map(|row| &row[..channels]);
                for (k, out) in out.iter_mut().enumerate() {
                    *out = w[0] * a[k] + w[1] * b[k] + w[2] * c[k];
                }
            }
            return;
        }
        // Neighbouring pixels mostly show the same face.
        let (mut seen, mut corners) = (NONE, [[F::zero(); C]; 3]);
        for ((&id, w), out) in ids.iter().zip(weights).zip(out.chunks_exact_mut(C.max(1))) {
            if id == NONE {
                out.fill(F::zero());
                continue;
            }
            if id != seen {
                seen = id;
                corners = of_face(id).map(|row| {
                    let mut own = [F::zero(); C];
                    own.copy_from_slice(&row[..C]);
                    own
                });
            }
            for k in 0..C {
                out[k] = w[0] * corners[0][k] + w[1] * corners[1][k] + w[2] * corners[2][k];
            }
        }
    }
}

/// What the gradient of [`interpolate`] reads.
#[derive(Clone, Copy, Debug)]
pub struct Incoming<'a, F: Real> {
    /// What was drawn.
    pub fragments: &'a Fragments<F>,
    /// The positions that were drawn, `[N, V, 3]`.
    pub projected: &'a [F],
    /// The attributes.
    pub attributes: Attributes<'a, F>,
    /// The result of the forward pass, `[N, H, W, C]`.
    pub output: &'a [F],
    /// Its gradient, `[N, H, W, C]`.
    pub grad: &'a [F],
}

/// The gradient of [`interpolate`] per face corner.
///
/// `of_attributes` is `[N, F, 3, C]` and `of_positions`, if wanted, `[N, F, 3, 3]`; all of them
/// written.
pub fn interpolate_grad<F: Real>(
    incoming: Incoming<'_, F>,
    scratch: &Scratch<F>,
    of_attributes: &mut [F],
    of_positions: Option<&mut [F]>,
) {
    let fragments = incoming.fragments;
    let (faces, channels) = (fragments.faces().len(), incoming.attributes.channels);
    if faces * channels * fragments.settings().pixels() == 0 {
        of_attributes.fill(F::zero());
        if let Some(positions) = of_positions {
            positions.fill(F::zero());
        }
        return;
    }
    let image = |image: usize, attributes: &mut [F], positions: Option<&mut [F]>| {
        scratch.partials.with(|partials| {
            let bands = &fragments.setup(image).bands;
            let settings = fragments.settings();
            partials.resize(bands.places() * 3 * (channels + 1), F::zero());
            let count = settings.height.div_ceil(BAND_ROWS);
            sum_bands(incoming, image, 0..count, partials);
            sum_faces(incoming, image, partials, attributes, positions);
        });
    };
    let of_attributes = of_attributes.par_chunks_mut(3 * channels * faces);
    match of_positions {
        Some(of_positions) => of_attributes
            .zip(of_positions.par_chunks_mut(9 * faces))
            .enumerate()
            .for_each(|(n, (attributes, positions))| image(n, attributes, Some(positions))),
        None => of_attributes.enumerate().for_each(|(n, attributes)| image(n, attributes, None)),
    }
}

/// Sums over the pixels of bands into the places of these bands, `[places, 3, C + 1]`: for each
/// corner its weight times the gradient of each channel, and times `g·f`.
fn sum_bands<F: Real>(
    incoming: Incoming<'_, F>,
    image: usize,
    range: Range<usize>,
    sums: &mut [F],
) {
    let fragments = incoming.fragments;
    let (first, channels) = (range.start, incoming.attributes.channels);
    if range.len() > 1 {
        let middle = usize::midpoint(range.start, range.end);
        let bands = &fragments.setup(image).bands;
        let places = bands.offset(middle) - bands.offset(first);
        let (left, right) = sums.split_at_mut(places * 3 * (channels + 1));
        join(
            || sum_bands(incoming, image, first..middle, left),
            || sum_bands(incoming, image, middle..range.end, right),
        );
        return;
    }
    let job = BandSums { incoming, image, band: first, sums };
    let arch = fragments.settings().instructions.arch();
    match channels {
        1 => dispatch(arch, Channels::<_, 1, 2>(job)),
        2 => dispatch(arch, Channels::<_, 2, 4>(job)),
        3 => dispatch(arch, Channels::<_, 3, 4>(job)),
        4 => dispatch(arch, Channels::<_, 4, 8>(job)),
        _ => dispatch(arch, Channels::<_, 0, 1>(job)),
    }
}

struct BandSums<'a, F: Real> {
    incoming: Incoming<'a, F>,
    image: usize,
    band: usize,
    sums: &'a mut [F],
}

impl<F: Real, const C: usize, const P: usize> Job<F> for Channels<BandSums<'_, F>, C, P> {
    type Output = ();

    /// Pixels are read in the order of memory; what neighbours with the same face add is summed in
    /// registers first.
    #[inline(always)]
    fn run<L: Lanes<F = F>>(self, _: L) {
        let BandSums { incoming, image, band, sums } = self.0;
        let fragments = incoming.fragments;
        let [_, height, width] = fragments.shape();
        let channels = incoming.attributes.channels;
        let setup = fragments.setup(image);
        let base = setup.bands.offset(band);
        sums.fill(F::zero());
        for row in band * BAND_ROWS..((band + 1) * BAND_ROWS).min(height) {
            let pixels = (image * height + row) * width..(image * height + row + 1) * width;
            let ids = &fragments.face[pixels.clone()];
            let weights = &fragments.barycentric[3 * pixels.start..3 * pixels.end];
            let weights = weights.as_chunks::<3>().0;
            let output = &incoming.output[pixels.start * channels..pixels.end * channels];
            let grad = &incoming.grad[pixels.start * channels..pixels.end * channels];
            let mut j = 0;
            while j < width {
                let id = ids[j];
                if id == NONE {
                    j += 1;
                    continue;
                }
                let first_band = setup.boxes[id as usize].rows[0] as usize / BAND_ROWS;
                let place = setup.bands.places_of(id as usize)[band - first_band] as usize - base;
                let size = 3 * (channels + 1);
                let sums = &mut sums[place * size..(place + 1) * size];
                // The gradient of each channel, and last `g·f`.
                let mut totals = [[F::zero(); P]; 3];
                while j < width && ids[j] == id {
                    let w = weights[j];
                    let range = j * channels..(j + 1) * channels;
                    let (g, f) = (&grad[range.clone()], &output[range]);
                    let mut part = [F::zero(); P];
                    if C == 0 {
                        for (k, sums) in sums.chunks_exact_mut(channels + 1).enumerate() {
                            sums.iter_mut().zip(g).for_each(|(s, &g)| *s += w[k] * g);
                        }
                        g.iter().zip(f).for_each(|(&g, &f)| part[P - 1] += g * f);
                    } else {
                        let (g, f) = (&g[..C], &f[..C]);
                        part[..C].copy_from_slice(g);
                        for c in 0..C {
                            part[P - 1] += g[c] * f[c];
                        }
                    }
                    for k in 0..3 {
                        for c in 0..P {
                            totals[k][c] += w[k] * part[c];
                        }
                    }
                    j += 1;
                }
                for (sums, totals) in sums.chunks_exact_mut(channels + 1).zip(&totals) {
                    for c in 0..C {
                        sums[c] += totals[c];
                    }
                    sums[channels] += totals[P - 1];
                }
            }
        }
    }
}

/// Adds up the bands of each face, in their order, and turns the sums into gradients.
fn sum_faces<F: Real>(
    incoming: Incoming<'_, F>,
    image: usize,
    partials: &[F],
    of_attributes: &mut [F],
    of_positions: Option<&mut [F]>,
) {
    let fragments = incoming.fragments;
    let (faces, vertices) = (fragments.faces(), fragments.faces().vertex_count());
    let channels = incoming.attributes.channels;
    let (setup, perspective) = (fragments.setup(image), fragments.settings().perspective);
    let projected = &incoming.projected[3 * vertices * image..3 * vertices * (image + 1)];
    let size = 3 * (channels + 1);
    let face = |face: usize, sums: &mut [F], positions: Option<&mut [F]>| {
        sums.fill(F::zero());
        let mut q = [F::zero(); 3];
        for &place in setup.bands.places_of(face) {
            let partial = &partials[place as usize * size..(place as usize + 1) * size];
            let corners = partial.chunks_exact(channels + 1);
            for (k, (sums, partial)) in sums.chunks_exact_mut(channels).zip(corners).enumerate() {
                sums.iter_mut().zip(partial).for_each(|(sum, &x)| *sum += x);
                q[k] += partial[channels];
            }
        }
        let Some(positions) = positions else { return };
        if sums.iter().chain(&q).all(|&sum| sum == F::zero()) {
            positions.fill(F::zero());
            return;
        }
        let corners = faces.corners()[face];
        let f = incoming.attributes.of_face(image, vertices, face as u32, corners);
        let p = corner_positions(projected, corners);
        let q = perspective.then_some(q);
        position_gradient(p, f, sums, q, positions.as_chunks_mut::<3>().0);
    };
    let of_attributes = of_attributes.par_chunks_mut(3 * channels * CHUNK);
    match of_positions {
        Some(of_positions) => of_attributes
            .zip(of_positions.par_chunks_mut(9 * CHUNK))
            .enumerate()
            .for_each(|(chunk, (attributes, positions))| {
                let rows = attributes.chunks_exact_mut(3 * channels);
                for (k, (a, p)) in rows.zip(positions.chunks_exact_mut(9)).enumerate() {
                    face(chunk * CHUNK + k, a, Some(p));
                }
            }),
        None => of_attributes.enumerate().for_each(|(chunk, attributes)| {
            for (k, a) in attributes.chunks_exact_mut(3 * channels).enumerate() {
                face(chunk * CHUNK + k, a, None);
            }
        }),
    }
}

/// The gradient of a face's corner positions from the sums over its pixels: `sums` is `A`, and
/// `q` is there if the interpolation is perspective.
#[inline(always)]
fn position_gradient<F: Real>(
    p: [[F; 3]; 3],
    f: [&[F]; 3],
    sums: &[F],
    q: Option<[F; 3]>,
    out: &mut [[F; 3]],
) {
    let gradient = barycentric_gradients(p);
    for (j, a) in sums.chunks_exact(f[0].len()).enumerate() {
        let mut moved = [F::zero(); 3];
        for k in 0..3 {
            let mut dot = F::zero();
            f[k].iter().zip(a).for_each(|(&f, &a)| dot += f * a);
            if let Some(q) = q {
                dot -= q[j];
                if j == k {
                    moved[2] = -dot / p[j][2];
                }
                dot *= p[j][2] / p[k][2];
            }
            moved[0] -= dot * gradient[k][0];
            moved[1] -= dot * gradient[k][1];
        }
        out[j] = moved;
    }
}

/// `∇w_k` on the screen of the three barycentric coordinates of a triangle.
#[inline(always)]
pub fn barycentric_gradients<F: Real>([a, b, c]: [[F; 3]; 3]) -> [[F; 2]; 3] {
    let area = twice_area(a, b, c);
    let inverse = F::one() / area;
    let edge = |p: [F; 3], q: [F; 3]| [(p[1] - q[1]) * inverse, (q[0] - p[0]) * inverse];
    [edge(b, c), edge(c, a), edge(a, b)]
}
