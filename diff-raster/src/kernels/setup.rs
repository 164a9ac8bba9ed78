//! What the passes over pixels need to know of each face, computed once.
//!
//! With corners `a`, `b`, `c` on the screen and `×` the cross product, a pixel `p` has the edge
//! values `e0 = (b-p)×(c-p)`, `e1 = (c-p)×(a-p)`, `e2 = (a-p)×(b-p)`, each affine in `p`, all of
//! one sign inside. Their coefficients change sign exactly, not nearly, when an edge is walked the
//! other way, so that two faces that share an edge leave no pixel out.

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};

use crate::kernels::lanes::MAX_LANES;
use crate::{Rule, Settings};

/// Rows of a band: the planes of a band stay in the cache while its faces are drawn.
pub const BAND_ROWS: usize = 16;

/// Faces per parallel task.
const CHUNK: usize = 512;

/// Coordinates of pixel centres, ascending.
#[derive(Clone, Debug, Default)]
pub struct Centers<F> {
    /// `(2j + 1 - W) / W` for each column, and [`MAX_LANES`] more.
    pub x: Vec<F>,
    /// `(2k + 1 - H) / H`: row `i` is entry `H - 1 - i`.
    pub y: Vec<F>,
}

impl<F: Real> Centers<F> {
    /// Fills the tables for an image size.
    pub fn prepare(&mut self, height: usize, width: usize) {
        fill(&mut self.x, width, width + MAX_LANES);
        fill(&mut self.y, height, height);
    }

    /// Rows and columns, both inclusive, that hold all centres in the given ranges and perhaps a
    /// few more: cheap.
    #[inline(always)]
    pub fn around(&self, x: [F; 2], y: [F; 2]) -> [[i32; 2]; 2] {
        let (height, width) = (self.y.len() as f64, (self.x.len() - MAX_LANES) as f64);
        // Casts saturate.
        let place = |at: F, size: f64| ((at.to_f64() + 1.0) * 0.5 * size) as i32;
        let flip = |row: i32| (height as i32 - 1).saturating_sub(row);
        let rows = [flip(place(y[1], height)), flip(place(y[0], height))];
        let columns = [place(x[0], width), place(x[1], width)];
        [rows, columns].map(|[low, high]| [low.saturating_sub(1), high.saturating_add(1)])
    }

    /// Rows and columns within a distance, and one more for rounding.
    pub fn pixels_within(&self, distance: F) -> [i32; 2] {
        let (height, width) = (self.y.len() as f64, (self.x.len() - MAX_LANES) as f64);
        // Casts saturate.
        [height, width].map(|size| ((distance.to_f64() * 0.5 * size) as i32).saturating_add(2))
    }

    /// The `y` of a row.
    #[inline(always)]
    pub fn row(&self, row: usize) -> F {
        self.y[self.y.len() - 1 - row]
    }

    /// Columns of centres in `[low, high]`, or `[low, high)`, as a half-open range.
    #[inline(always)]
    pub fn columns(&self, low: F, high: F, half_open: bool) -> [u32; 2] {
        range(&self.x[..self.x.len() - MAX_LANES], low, high, half_open)
    }

    /// Where the centre of a pixel of a batch of images is, counted through all of them.
    #[inline]
    pub fn at(&self, pixel: usize, [height, width]: [usize; 2]) -> [F; 2] {
        let place = pixel % (height * width);
        [self.x[place % width], self.row(place / width)]
    }

    /// Rows of centres in `[low, high]`, or `[low, high)`, as a half-open range.
    #[inline(always)]
    pub fn rows(&self, low: F, high: F, half_open: bool) -> [u32; 2] {
        let [start, end] = range(&self.y, low, high, half_open);
        let height = self.y.len() as u32;
        [height - end, height - start]
    }
}

fn fill<F: Real>(table: &mut Vec<F>, n: usize, len: usize) {
    let size = F::from_f64(n as f64);
    table.clear();
    table.extend((0..len).map(|k| F::from_f64((2 * k + 1) as f64 - n as f64) / size));
}

#[inline(always)]
fn range<F: Real>(table: &[F], low: F, high: F, half_open: bool) -> [u32; 2] {
    let start = first(table, low, |x| x >= low);
    let end = if half_open {
        first(table, high, |x| x >= high)
    } else {
        first(table, high, |x| x > high)
    };
    [start as u32, end.max(start) as u32]
}

/// The first entry for which `reached` holds; `near` says where about.
#[inline(always)]
fn first<F: Real>(table: &[F], near: F, reached: impl Fn(F) -> bool) -> usize {
    let n = table.len() as f64;
    // Mostly right at once; the cast saturates, so that anything may come in.
    let mut k = (((near.to_f64() + 1.0) * n * 0.5 + 0.5) as i64).clamp(0, n as i64) as usize;
    while k > 0 && reached(table[k - 1]) {
        k -= 1;
    }
    while k < table.len() && !reached(table[k]) {
        k += 1;
    }
    k
}

/// A range of rows and columns, half-open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelBox {
    /// First row, and one past the last.
    pub rows: [u32; 2],
    /// First column, and one past the last.
    pub columns: [u32; 2],
}

impl PixelBox {
    /// Whether it holds no pixel.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.rows[0] >= self.rows[1] || self.columns[0] >= self.columns[1]
    }
}

/// The corners of a face, if it can be drawn: all numbers finite, all depths beyond `near`.
#[inline(always)]
pub fn visible_corners<F: Real>(
    projected: &[F],
    corners: [u32; 3],
    near: F,
) -> Option<[[F; 3]; 3]> {
    let p = corner_positions(projected, corners);
    // A sum is finite only if all its parts are (or it overflows: as useless as a position).
    let fine = |p: &[F; 3]| (p[0].abs() + p[1].abs() + p[2].abs()).is_finite() && p[2] > near;
    (fine(&p[0]) && fine(&p[1]) && fine(&p[2])).then_some(p)
}

/// The corners of a face.
#[inline(always)]
pub fn corner_positions<F: Real>(projected: &[F], corners: [u32; 3]) -> [[F; 3]; 3] {
    corners.map(|v| {
        let at = &projected[3 * v as usize..3 * v as usize + 3];
        [at[0], at[1], at[2]]
    })
}

/// Twice the area on the screen, positive where the corners turn counter-clockwise; what is behind x and y does not count.
#[inline(always)]
pub fn twice_area<F: Real, const A: usize, const C: usize>(a: [F; A], b: [F; A], c: [F; C]) -> F {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Depth nearer than which faces are dropped; behind the camera there is no perspective.
pub fn near<F: Real>(settings: &Settings) -> F {
    F::from_f64(if settings.perspective { settings.near.max(0.0) } else { settings.near })
}

/// A face ready to be drawn.
#[derive(Clone, Copy, Debug, Default)]
pub struct Triangle<F> {
    /// Coefficients of `x`, `y` and 1 of the three edge values, positive inside.
    pub edges: [[F; 3]; 3],
    /// The key of corner 0; the largest key is nearest. `1/z` with perspective, else `-z`.
    pub key: F,
    /// How the key grows with `e1` and `e2`.
    pub derivatives: [F; 2],
    /// Smallest and largest key of a corner: rounding on slivers must not leave them.
    pub bounds: [F; 2],
    /// Multiply `e1` and `e2` to give the second and third barycentric, over the key if perspective.
    pub scales: [F; 2],
}

/// The faces of one image, ready to be drawn.
#[derive(Clone, Debug, Default)]
pub struct Setup<F> {
    /// Per face; stale where the box is empty.
    pub triangles: Vec<Triangle<F>>,
    /// Per face, the pixels that it may cover.
    pub boxes: Vec<PixelBox>,
    /// Faces by band.
    pub bands: Bands,
}

impl<F: Real> Setup<F> {
    /// Prepares all faces. `projected` is `[V, 3]`.
    pub fn prepare(
        &mut self,
        projected: &[F],
        corners: &[[u32; 3]],
        centers: &Centers<F>,
        settings: &Settings,
    ) {
        self.triangles.resize(corners.len(), Triangle::default());
        self.boxes.resize(corners.len(), PixelBox::default());
        let near = near::<F>(settings);
        let faces = self.triangles.par_iter_mut().zip(self.boxes.par_iter_mut());
        faces.zip(corners.par_iter()).with_min_len(CHUNK).for_each(
            |((triangle, pixels), &corners)| {
                *pixels = visible_corners(projected, corners, near)
                    .and_then(|p| prepare_face(p, centers, settings, triangle))
                    .unwrap_or_default();
            },
        );
        self.bands.sort(settings.height, self.boxes.iter().map(|b| b.rows));
    }
}

#[inline(always)]
fn prepare_face<F: Real>(
    [a, b, c]: [[F; 3]; 3],
    centers: &Centers<F>,
    settings: &Settings,
    triangle: &mut Triangle<F>,
) -> Option<PixelBox> {
    let area = twice_area(a, b, c);
    let sign = area.signum();
    let inverse = sign / area;
    if !area.is_finite() || !inverse.is_finite() || (settings.cull_back_faces && area < F::zero()) {
        return None;
    }
    let half_open = settings.rule == Rule::Published;
    let [x, y] = [0, 1].map(|k| extent(a[k], b[k], c[k]));
    let columns = centers.columns(x[0], x[1], half_open);
    if columns[0] >= columns[1] {
        return None;
    }
    let rows = centers.rows(y[0], y[1], half_open);
    if rows[0] >= rows[1] {
        return None;
    }
    let edge = |p: [F; 3], q: [F; 3]| {
        [(p[1] - q[1]) * sign, (q[0] - p[0]) * sign, (p[0] * q[1] - q[0] * p[1]) * sign]
    };
    let key = |p: [F; 3]| if settings.perspective { F::one() / p[2] } else { -p[2] };
    let keys = [key(a), key(b), key(c)];
    let scale = |k: F| if settings.perspective { k * inverse } else { inverse };
    *triangle = Triangle {
        edges: [edge(b, c), edge(c, a), edge(a, b)],
        key: keys[0],
        derivatives: [(keys[1] - keys[0]) * inverse, (keys[2] - keys[0]) * inverse],
        bounds: extent(keys[0], keys[1], keys[2]),
        scales: [scale(keys[1]), scale(keys[2])],
    };
    Some(PixelBox { rows, columns })
}

#[inline(always)]
fn min3<F: Real>(a: F, b: F, c: F) -> F {
    let ab = if b < a { b } else { a };
    if c < ab { c } else { ab }
}

/// The smallest and largest of three values.
#[inline(always)]
pub fn extent<F: Real>(a: F, b: F, c: F) -> [F; 2] {
    [min3(a, b, c), -min3(-a, -b, -c)]
}

/// Items by the bands of rows that they touch, in their own order within each band.
#[derive(Clone, Debug, Default)]
pub struct Bands {
    offsets: Vec<u32>,
    next: Vec<u32>,
    items: Vec<u32>,
    /// Per item, its place in each of its bands, one after the other.
    slots: Vec<u32>,
    starts: Vec<u32>,
}

impl Bands {
    /// A counting sort of ranges of rows.
    pub fn sort(&mut self, height: usize, rows: impl Iterator<Item = [u32; 2]> + Clone) {
        let count = height.div_ceil(BAND_ROWS);
        let band = |row: u32| row as usize / BAND_ROWS;
        let touched = |r: [u32; 2]| {
            if r[0] < r[1] { band(r[0])..band(r[1] - 1) + 1 } else { 0..0 }
        };
        self.offsets.clear();
        self.offsets.resize(count + 1, 0);
        for r in rows.clone() {
            for band in touched(r) {
                self.offsets[band + 1] += 1;
            }
        }
        for band in 0..count {
            self.offsets[band + 1] += self.offsets[band];
        }
        self.next.clear();
        self.next.extend_from_slice(&self.offsets);
        self.items.resize(self.offsets[count] as usize, 0);
        self.slots.clear();
        self.starts.clear();
        for (item, r) in rows.enumerate() {
            self.starts.push(self.slots.len() as u32);
            for band in touched(r) {
                self.items[self.next[band] as usize] = item as u32;
                self.slots.push(self.next[band]);
                self.next[band] += 1;
            }
        }
        self.starts.push(self.slots.len() as u32);
    }

    /// Number of places, over all bands.
    pub fn places(&self) -> usize {
        self.items.len()
    }

    /// The places that belong to bands from `first` on begin here.
    pub fn offset(&self, first: usize) -> usize {
        self.offsets[first] as usize
    }

    /// The places of an item, one for each band that it touches, the first band first.
    #[inline(always)]
    pub fn places_of(&self, item: usize) -> &[u32] {
        &self.slots[self.starts[item] as usize..self.starts[item + 1] as usize]
    }

    /// The items of a band.
    pub fn items(&self, band: usize) -> &[u32] {
        &self.items[self.offsets[band] as usize..self.offsets[band + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_hold_exactly_the_centers_inside() {
        let mut centers = Centers::<f32>::default();
        centers.prepare(7, 10);
        for low in -25..25 {
            for high in low..25 {
                // Multiples of 0.05 and 0.1: many bounds are centres.
                let (l, h) = (low as f32 * 0.1, high as f32 * 0.1);
                for half_open in [false, true] {
                    let [start, end] = centers.columns(l, h, half_open);
                    let inside = |&j: &u32| {
                        let x = centers.x[j as usize];
                        x >= l && if half_open { x < h } else { x <= h }
                    };
                    let expected: Vec<u32> = (0..10).filter(inside).collect();
                    assert_eq!((start..end).collect::<Vec<_>>(), expected, "{l} {h}");
                }
            }
        }
        for wild in [f32::NAN, f32::INFINITY, f32::MAX, f32::NEG_INFINITY] {
            let [start, end] = centers.rows(-wild, wild, false);
            assert!(start <= end && end <= 7);
        }
    }

    #[test]
    fn bands_keep_the_order_of_items() {
        let mut bands = Bands::default();
        bands.sort(40, [[0, 40], [3, 3], [16, 17], [15, 17]].into_iter());
        assert_eq!(bands.items(0), [0, 3]);
        assert_eq!(bands.items(1), [0, 2, 3]);
        assert_eq!(bands.items(2), [0]);
        // Items 0, 3 | 0, 2, 3 | 0.
        assert_eq!(bands.places_of(0), [0, 2, 5]);
        assert!(bands.places_of(1).is_empty());
        assert_eq!(bands.places_of(3), [1, 4]);
    }
}
