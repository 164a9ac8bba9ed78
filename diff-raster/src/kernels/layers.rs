//! Several faces a pixel: what each shows there, and the gradient of that.
//!
//! With `E_k` the edge values of a pixel `p` and `A` twice the area of the face on the screen:
//!
//! ```text
//! w_k = E_k / (A + 1e-8)                                       on the screen
//! w_k ← w_k z_(k+1) z_(k+2) / max(Σ .., 1e-8)                  in space, with perspective
//! w_k ← max(w_k, 0) / max(Σ max(w, 0), 1e-5)                   cut off
//! z = Σ w_k z_k        d = ± min over edges |p - edge|², - inside
//! ```
//!
//! The order of these and their guards are those of PyTorch3D's `rasterize_meshes`.

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};

use crate::kernels::setup::{Centers, extent, twice_area, visible_corners};
use crate::{LayerSettings, NONE};

/// Added to areas, the least divisor of the perspective, and the square of the shortest edge.
const GUARD: f64 = 1e-8;
/// The least sum of cut-off weights.
const LEAST_SUM: f64 = 1e-5;
/// Faces of one task.
const CHUNK: usize = 512;
/// Rows of one task.
const ROWS: usize = 8;
/// Partial sums of gradients of one image.
const PARTS: usize = 8;

/// A face at a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Layer<F> {
    /// Barycentric coordinates, as the settings ask for them.
    pub shown: [F; 3],
    /// Planar depth.
    pub depth: F,
    /// Squared distance from the border, negative inside.
    pub signed: F,
    /// Whether the pixel lies inside.
    pub inside: bool,
    /// On the screen, and with perspective.
    flat: [F; 3],
    spatial: [F; 3],
    /// Divisors of the three steps, and whether the last two are no guards.
    area: F,
    depth_sum: F,
    sum: F,
    guards: [bool; 2],
    /// From the nearest point of the border to the pixel, and that point as weights of the corners.
    away: [F; 2],
    nearest: [F; 3],
}

type Flat<F> = [F; 2];

fn minus<F: Real>(a: Flat<F>, b: Flat<F>) -> Flat<F> {
    [a[0] - b[0], a[1] - b[1]]
}

fn cross<F: Real>(a: Flat<F>, b: Flat<F>) -> F {
    a[0] * b[1] - a[1] * b[0]
}

/// What a face shows at a pixel.
pub fn measure<F: Real>(p: Flat<F>, corners: &[[F; 3]; 3], settings: &LayerSettings) -> Layer<F> {
    let (zero, one) = (F::zero(), F::one());
    let guard = F::from_f64(GUARD);
    let s = corners.map(|[x, y, _]| [x, y]);
    let z = corners.map(|[_, _, z]| z);
    let area = twice_area(s[0], s[1], s[2]) + guard;
    let edge = |k: usize| cross(minus(s[(k + 1) % 3], p), minus(s[(k + 2) % 3], p));
    let flat = [0, 1, 2].map(|k| edge(k) / area);
    let (mut spatial, mut depth_sum) = (flat, one);
    let mut guards = [false; 2];
    if settings.perspective {
        let tops = [0, 1, 2].map(|k| flat[k] * z[(k + 1) % 3] * z[(k + 2) % 3]);
        let total = tops[0] + tops[1] + tops[2];
        guards[0] = total > guard;
        depth_sum = if guards[0] { total } else { guard };
        spatial = tops.map(|top| top / depth_sum);
    }
    let (mut shown, mut sum) = (spatial, one);
    if settings.clip_barycentric {
        let cut = spatial.map(|w| w.max(zero));
        let total = cut[0] + cut[1] + cut[2];
        let least = F::from_f64(LEAST_SUM);
        guards[1] = total > least;
        sum = if guards[1] { total } else { least };
        shown = cut.map(|w| w / sum);
    }
    let depth = shown[0] * z[0] + shown[1] * z[1] + shown[2] * z[2];
    let inside = spatial.iter().all(|&w| w > zero);
    let (mut square, mut away, mut nearest) = (F::infinity(), [zero; 2], [zero; 3]);
    for (from, to) in [(0, 1), (0, 2), (1, 2)] {
        let (along, offset) = (minus(s[to], s[from]), minus(p, s[from]));
        let length = along[0] * along[0] + along[1] * along[1];
        // An edge without length is its second corner.
        let t = if length <= guard {
            one
        } else {
            ((along[0] * offset[0] + along[1] * offset[1]) / length).max(zero).min(one)
        };
        let on = [s[from][0] + t * along[0], s[from][1] + t * along[1]];
        let rest = minus(p, on);
        let found = rest[0] * rest[0] + rest[1] * rest[1];
        if found < square {
            (square, away, nearest) = (found, rest, [zero; 3]);
            (nearest[from], nearest[to]) = (one - t, t);
        }
    }
    let signed = if inside { -square } else { square };
    Layer {
        shown,
        depth,
        signed,
        inside,
        flat,
        spatial,
        area,
        depth_sum,
        sum,
        guards,
        away,
        nearest,
    }
}

/// What comes back to a face at a pixel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pull<F> {
    /// To the barycentric coordinates.
    pub shown: [F; 3],
    /// To the depth.
    pub depth: F,
    /// To the signed distance.
    pub signed: F,
}

/// The gradient of the corners `x y z x y z x y z`.
pub fn pull<F: Real>(
    layer: &Layer<F>,
    p: Flat<F>,
    corners: &[[F; 3]; 3],
    settings: &LayerSettings,
    pull: Pull<F>,
) -> [F; 9] {
    let zero = F::zero();
    let s = corners.map(|[x, y, _]| [x, y]);
    let z = corners.map(|[_, _, z]| z);
    let mut out = [zero; 9];
    let mut g = pull.shown;
    for k in 0..3 {
        g[k] += pull.depth * z[k];
        out[3 * k + 2] += pull.depth * layer.shown[k];
    }
    if settings.clip_barycentric {
        let mean = if layer.guards[1] {
            g[0] * layer.shown[0] + g[1] * layer.shown[1] + g[2] * layer.shown[2]
        } else {
            zero
        };
        g = [0, 1, 2].map(
            |k| {
                if layer.spatial[k] > zero { (g[k] - mean) / layer.sum } else { zero }
            },
        );
    }
    if settings.perspective {
        let mean = if layer.guards[0] {
            g[0] * layer.spatial[0] + g[1] * layer.spatial[1] + g[2] * layer.spatial[2]
        } else {
            zero
        };
        let tops = g.map(|g| (g - mean) / layer.depth_sum);
        for k in 0..3 {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            g[k] = tops[k] * z[i] * z[j];
            out[3 * i + 2] += tops[k] * layer.flat[k] * z[j];
            out[3 * j + 2] += tops[k] * layer.flat[k] * z[i];
        }
    }
    let mut add = |corner: usize, by: Flat<F>| {
        out[3 * corner] += by[0];
        out[3 * corner + 1] += by[1];
    };
    // w = E / A with E = a × b: its derivative by a is (b_y, -b_x), by b (-a_y, a_x).
    let by_cross =
        |a: Flat<F>, b: Flat<F>, g: F| ([g * b[1], -(g * b[0])], [-(g * a[1]), g * a[0]]);
    let mut of_area = zero;
    for k in 0..3 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let (of_i, of_j) = by_cross(minus(s[i], p), minus(s[j], p), g[k] / layer.area);
        add(i, of_i);
        add(j, of_j);
        of_area += -(g[k] * layer.flat[k] / layer.area);
    }
    let (of_b, of_c) = by_cross(minus(s[1], s[0]), minus(s[2], s[0]), of_area);
    add(1, of_b);
    add(2, of_c);
    add(0, [-(of_b[0] + of_c[0]), -(of_b[1] + of_c[1])]);
    let sign = if layer.inside { pull.signed } else { -pull.signed };
    for k in 0..3 {
        let factor = F::from_f64(2.0) * sign * layer.nearest[k];
        add(k, layer.away.map(|x| factor * x));
    }
    out
}

/// Finds the nearest faces of the pixels of one image; `face` is all [`NONE`], `depth` all -1.
///
/// # Panics
/// If a slice is too short.
pub fn draw_layers<F: Real>(
    projected: &[F],
    corners: &[[u32; 3]],
    settings: &LayerSettings,
    centers: &Centers<F>,
    face: &mut [u32],
    depth: &mut [F],
) {
    let (width, k) = (settings.width, settings.faces_per_pixel);
    let (blur, guard) = (F::from_f64(settings.blur_radius), F::from_f64(GUARD));
    let reach = blur.max(F::zero()).sqrt();
    let prepared = |corners: [u32; 3]| {
        let [a, b, c] = visible_corners(projected, corners, F::zero())?;
        let area = twice_area(a, b, c);
        if area.abs() <= guard || (settings.cull_back_faces && area < F::zero()) {
            return None;
        }
        let [x, y] = [0, 1].map(|axis| {
            let [low, high] = extent(a[axis], b[axis], c[axis]);
            [low - reach, high + reach]
        });
        let columns = centers.columns(x[0], x[1], false).map(|c| c as usize);
        let rows = centers.rows(y[0], y[1], false).map(|r| r as usize);
        Some(([a, b, c], rows, columns))
    };
    let mut ready = vec![None; corners.len()];
    let faces = ready.par_iter_mut().zip(corners.par_iter()).with_min_len(CHUNK);
    faces.for_each(|(ready, &corners)| *ready = prepared(corners));
    // The faces of each band, in their order: a band does not look at the others.
    let mut listed: Vec<Vec<u32>> = vec![Vec::new(); settings.height.div_ceil(ROWS)];
    for (index, ready) in ready.iter().enumerate() {
        let Some((_, [first, end], _)) = ready.as_ref().filter(|(_, rows, _)| rows[0] < rows[1])
        else {
            continue;
        };
        let bands = first / ROWS..end.div_ceil(ROWS);
        listed[bands].iter_mut().for_each(|band| band.push(index as u32));
    }
    let bands = face.par_chunks_mut(ROWS * width * k).zip(depth.par_chunks_mut(ROWS * width * k));
    bands.zip(listed.par_iter()).enumerate().for_each(|(band, ((face, depth), listed))| {
        let first = band * ROWS;
        let last = first + face.len() / (width * k);
        for &index in listed {
            let Some((corners, rows, columns)) = &ready[index as usize] else { continue };
            for row in rows[0].max(first)..rows[1].min(last) {
                for column in columns[0]..columns[1] {
                    let p = [centers.x[column], centers.row(row)];
                    let layer = measure(p, corners, settings);
                    let beside = !layer.inside && layer.signed >= blur;
                    if beside || layer.depth < F::zero() || !layer.depth.is_finite() {
                        continue;
                    }
                    let at = ((row - first) * width + column) * k;
                    let (face, depth) = (&mut face[at..at + k], &mut depth[at..at + k]);
                    insert(index, layer.depth, face, depth);
                }
            }
        }
    });
}

/// Into its place among the nearest; faces come in ascending order, so equally near ones stay so.
fn insert<F: Real>(index: u32, z: F, face: &mut [u32], depth: &mut [F]) {
    let place = (0..face.len()).find(|&i| face[i] == NONE || depth[i] > z);
    if let Some(place) = place {
        face[place..].rotate_right(1);
        depth[place..].rotate_right(1);
        (face[place], depth[place]) = (index, z);
    }
}

/// Adds to `out [V, 3]` what `of(slot)` pulls at each face of the pixels of one image.
///
/// Sums are taken in fixed parts of the image, then in their order; `parts` has room for as many copies of `out` as
/// [`parts`] says.
pub fn scatter<F: Real>(
    corners: &[[u32; 3]],
    face: &[u32],
    of: impl Fn(usize, [u32; 3]) -> [F; 9] + Sync,
    parts: &mut [F],
    out: &mut [F],
) {
    if out.is_empty() || face.is_empty() {
        return;
    }
    let chunk = face.len().div_ceil(PARTS);
    parts.par_chunks_mut(out.len()).enumerate().for_each(|(part, sums)| {
        sums.fill(F::zero());
        let last = ((part + 1) * chunk).min(face.len());
        for slot in (part * chunk).min(last)..last {
            if face[slot] == NONE {
                continue;
            }
            let corners = corners[face[slot] as usize];
            let pull = of(slot, corners);
            for (corner, pull) in corners.into_iter().zip(pull.as_chunks::<3>().0) {
                let sums = &mut sums[3 * corner as usize..][..3];
                sums.iter_mut().zip(pull).for_each(|(sum, &g)| *sum += g);
            }
        }
    });
    for sums in parts.chunks(out.len()) {
        out.iter_mut().zip(sums).for_each(|(out, &sum)| *out += sum);
    }
}

/// How many numbers of working memory [`scatter`] needs for an `out` of this length.
pub fn parts(len: usize) -> usize {
    PARTS * len
}
