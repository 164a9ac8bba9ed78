//! Which face is nearest at each pixel: a z-buffer over bands of rows.

use autodiff_lite::Real;

use crate::Settings;
use crate::faces::NONE;
use crate::kernels::lanes::{Job, Lanes, MAX_LANES, dispatch, three};
use crate::kernels::setup::{BAND_ROWS, Centers, Setup};

/// The planes of a band while its faces are drawn.
#[derive(Debug, Default)]
pub struct Planes<F> {
    key: Vec<F>,
    second: Vec<F>,
    third: Vec<F>,
    face: Vec<u32>,
}

impl<F: Real> Planes<F> {
    fn clear(&mut self, len: usize) {
        for plane in [&mut self.second, &mut self.third] {
            plane.resize(len, F::zero());
        }
        self.key.clear();
        self.key.resize(len, F::neg_infinity());
        self.face.clear();
        self.face.resize(len, NONE);
    }
}

/// Where the results of a band go: slices of its rows.
#[derive(Debug)]
pub struct BandOutput<'a, F> {
    /// `[rows, W]`
    pub face: &'a mut [u32],
    /// `[rows, W, 3]`
    pub barycentric: &'a mut [F],
    /// `[rows, W]`
    pub depth: &'a mut [F],
}

/// Draws one band: for each pixel the nearest face, its barycentric coordinates and depth there.
///
/// A face later in the list wins only if it is strictly nearer. Background is [`NONE`], zero and
/// `+∞`. Everything of `output` is written.
pub fn draw_band<F: Real>(
    setup: &Setup<F>,
    centers: &Centers<F>,
    settings: &Settings,
    band: usize,
    planes: &mut Planes<F>,
    output: BandOutput<'_, F>,
) {
    let job = Draw { setup, centers, settings, band, planes, output };
    dispatch(settings.instructions.arch(), job);
}

struct Draw<'a, F> {
    setup: &'a Setup<F>,
    centers: &'a Centers<F>,
    settings: &'a Settings,
    band: usize,
    planes: &'a mut Planes<F>,
    output: BandOutput<'a, F>,
}

impl<F: Real> Job<F> for Draw<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes<F = F>>(self, l: L) {
        let Self { setup, centers, settings, band, planes, output } = self;
        let width = settings.width;
        let stride = width + MAX_LANES;
        let first = band * BAND_ROWS;
        let last = (first + BAND_ROWS).min(settings.height);
        planes.clear((last - first) * stride);

        let zero = l.splat(F::zero());
        for &face in setup.bands.items(band) {
            let t = &setup.triangles[face as usize];
            let pixels = setup.boxes[face as usize];
            let along_x = three!(k => l.splat(t.edges[k][0]));
            let key = l.splat(t.key);
            let derivatives = [l.splat(t.derivatives[0]), l.splat(t.derivatives[1])];
            let bounds = [l.splat(t.bounds[0]), l.splat(t.bounds[1])];
            let scales = [l.splat(t.scales[0]), l.splat(t.scales[1])];
            let id = l.splat_u(face);
            let columns = pixels.columns.map(|c| c as usize);
            let rows = (pixels.rows[0] as usize).max(first)..(pixels.rows[1] as usize).min(last);
            for row in rows {
                let y = centers.row(row);
                let y = l.splat(y);
                let start = three!(k => l.fma(l.splat(t.edges[k][1]), y, l.splat(t.edges[k][2])));
                let base = (row - first) * stride;
                for column in (columns[0]..columns[1]).step_by(L::N) {
                    let x = l.load(&centers.x[column..]);
                    let e = three!(k => l.fma(along_x[k], x, start[k]));
                    let inside = l.le(zero, l.min(l.min(e[0], e[1]), e[2]));
                    let k = l.fma(e[1], derivatives[0], l.fma(e[2], derivatives[1], zero));
                    let k = l.max(l.min(l.add(key, k), bounds[1]), bounds[0]);
                    let at = base + column;
                    let nearest = l.load(&planes.key[at..]);
                    let count = (columns[1] - column).min(L::N);
                    let wins = l.and(l.lt(nearest, k), inside);
                    let wins = if count < L::N { l.and(wins, l.first(count)) } else { wins };
                    if !l.any(wins) {
                        continue;
                    }
                    l.store(&mut planes.key[at..], l.select(wins, k, nearest));
                    let ids = l.load_u(&planes.face[at..]);
                    l.store_u(&mut planes.face[at..], l.select_u(wins, id, ids));
                    let second = l.load(&planes.second[at..]);
                    let second = l.select(wins, l.mul(e[1], scales[0]), second);
                    l.store(&mut planes.second[at..], second);
                    let third = l.load(&planes.third[at..]);
                    let third = l.select(wins, l.mul(e[2], scales[1]), third);
                    l.store(&mut planes.third[at..], third);
                }
            }
        }

        for row in 0..last - first {
            let from = row * stride..row * stride + width;
            let to = row * width..(row + 1) * width;
            let planes = (
                &planes.key[from.clone()],
                &planes.second[from.clone()],
                &planes.third[from.clone()],
                &planes.face[from],
            );
            output.face[to.clone()].copy_from_slice(planes.3);
            let barycentric = &mut output.barycentric[3 * to.start..3 * to.end];
            let depth = &mut output.depth[to];
            if settings.perspective {
                resolve(planes, barycentric, depth, |key| (F::one() / key, F::one() / key));
            } else {
                resolve(planes, barycentric, depth, |key| (-key, F::one()));
            }
        }
    }
}

/// From keys and scaled edge values to depth and barycentrics. `of_key` gives depth, and the
/// factor that the planes still lack.
#[inline(always)]
fn resolve<F: Real>(
    (key, second, third, face): (&[F], &[F], &[F], &[u32]),
    barycentric: &mut [F],
    depth: &mut [F],
    of_key: impl Fn(F) -> (F, F),
) {
    let n = depth.len();
    let (key, second, third, face) = (&key[..n], &second[..n], &third[..n], &face[..n]);
    let barycentric = barycentric.as_chunks_mut::<3>().0;
    let barycentric = &mut barycentric[..n];
    let clamp = |x: F, high: F| {
        let x = if x > F::zero() { x } else { F::zero() };
        if x < high { x } else { high }
    };
    for j in 0..n {
        let covered = face[j] != NONE;
        let (z, factor) = of_key(key[j]);
        let b = clamp(second[j] * factor, F::one());
        let c = clamp(third[j] * factor, F::one() - b);
        depth[j] = if covered { z } else { F::infinity() };
        barycentric[j] =
            if covered { [F::one() - b - c, b, c] } else { [F::zero(), F::zero(), F::zero()] };
    }
}
