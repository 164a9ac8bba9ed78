//! How many views speak against a place: the visual hull, with as much tolerance as is wanted.
//!
//! Laurentini's hull ("The visual hull concept for silhouette-based image understanding", TPAMI 16(2), 1994) is where no
//! view speaks against. One wrong mask then takes away from the object for all; so views are counted instead.

use mesh_core::vector::affine;
use mesh_core::{Camera, Mask};
use rayon::prelude::*;

use super::region::Region;

/// No part of the object, whatever masks say.
pub(super) const NOWHERE: u16 = u16::MAX;
/// As many views as may be wrong at most: more are counted than that, or it would be all of them.
pub(super) const MOST: u16 = NOWHERE - 2;
/// Steps along a ray for each cell that it crosses.
const STEPS: f64 = 1.5;

/// What one view shows, pixel by pixel.
#[derive(Clone, Debug)]
pub(super) struct Silhouette {
    pub(super) camera: Camera,
    pub(super) mask: Mask,
}

/// A grid of cells over a region, and for each how many views see it beside their mask.
#[derive(Clone, Debug)]
pub(super) struct Dissent {
    dims: [usize; 3],
    low: [f64; 3],
    cell: f64,
    against: Vec<u16>,
}

impl Dissent {
    /// Counts on `side` cells along the longest side; a place that less than half of the views have in their image is
    /// [`NOWHERE`]. A cell's middle decides, with a pixel to spare.
    pub(super) fn count(views: &[Silhouette], region: &Region, side: usize) -> Self {
        let longest = region.half.iter().copied().fold(0.0, f64::max);
        let cell = 2.0 * longest / side as f64;
        let dims = region.half.map(|h| ((2.0 * h / cell).ceil() as usize).clamp(1, side));
        let low: [f64; 3] = std::array::from_fn(|k| region.center[k] - 0.5 * cell * dims[k] as f64);
        // What rounding may have taken away is given back.
        let grown: Vec<Mask> = views.par_iter().map(|view| view.mask.dilated()).collect();
        let rows: Vec<[[f64; 4]; 3]> = views.iter().map(|view| view.camera.projection()).collect();
        let slab = dims[0] * dims[1];
        let mut against = vec![NOWHERE; slab * dims[2]];
        against.par_chunks_mut(slab).enumerate().for_each(|(z, slab)| {
            for (k, out) in slab.iter_mut().enumerate() {
                let at = [k % dims[0], k / dims[0], z];
                let mut p = low;
                for a in 0..3 {
                    p[a] += cell * (at[a] as f64 + 0.5);
                }
                if !region.holds(p) {
                    continue;
                }
                let (mut seen, mut beside) = (0, 0);
                for ((view, grown), rows) in views.iter().zip(&grown).zip(&rows) {
                    if let Some(pixel) = pixel_of(&view.camera, rows, p) {
                        seen += 1;
                        beside += usize::from(!grown.data[pixel]);
                    }
                }
                if 2 * seen >= views.len() {
                    *out = beside.min(usize::from(NOWHERE) - 1) as u16;
                }
            }
        });
        Self { dims, low, cell, against }
    }

    /// The box around all cells that at most so many views speak against, with a tenth to spare on each side.
    pub(super) fn bounds(&self, tolerance: u16) -> Option<Region> {
        let mut bounds: Option<([usize; 3], [usize; 3])> = None;
        for (k, _) in self.against.iter().enumerate().filter(|(_, n)| **n <= tolerance) {
            let at = [
                k % self.dims[0],
                k / self.dims[0] % self.dims[1],
                k / self.dims[0] / self.dims[1],
            ];
            let (low, high) = bounds.get_or_insert((at, at));
            for a in 0..3 {
                low[a] = low[a].min(at[a]);
                high[a] = high[a].max(at[a]);
            }
        }
        let (low, high) = bounds?;
        let spare = |a: usize| 1.0 + 0.1 * (high[a] - low[a]) as f64;
        Some(Region::cuboid(
            std::array::from_fn(|a| self.low[a] + self.cell * (low[a] as f64 - spare(a))),
            std::array::from_fn(|a| self.low[a] + self.cell * (high[a] as f64 + 1.0 + spare(a))),
        ))
    }

    /// For each pixel of a camera's image the fewest views against any place on its ray; [`NOWHERE`] beside the region.
    pub(super) fn seen_by(&self, camera: &Camera) -> Vec<u16> {
        let width = camera.width;
        let mut image = vec![NOWHERE; camera.height * width];
        image.par_chunks_mut(width).enumerate().for_each(|(i, row)| {
            for (j, out) in row.iter_mut().enumerate() {
                *out = self.along(camera, [j as f64 + 0.5, i as f64 + 0.5]);
            }
        });
        image
    }

    fn along(&self, camera: &Camera, [column, row]: [f64; 2]) -> u16 {
        let ray = camera.ray(column, row);
        let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
        if camera.is_perspective() {
            near = 0.0;
        }
        for a in 0..3 {
            let ends = [0.0, self.cell * self.dims[a] as f64]
                .map(|side| (self.low[a] + side - ray.origin[a]) / ray.direction[a]);
            if ray.direction[a].abs() > 1e-12 {
                near = near.max(ends[0].min(ends[1]));
                far = far.min(ends[0].max(ends[1]));
            } else if !(self.low[a]..self.low[a] + self.cell * self.dims[a] as f64)
                .contains(&ray.origin[a])
            {
                return NOWHERE;
            }
        }
        if !(near < far && near.is_finite() && far.is_finite()) {
            return NOWHERE;
        }
        let count = ((far - near) / self.cell * STEPS).ceil().max(1.0) as usize;
        let mut fewest = NOWHERE;
        for k in 0..count {
            let t = near + (far - near) * (k as f64 + 0.5) / count as f64;
            let mut at = [0; 3];
            for a in 0..3 {
                let x = (ray.origin[a] + t * ray.direction[a] - self.low[a]) / self.cell;
                at[a] = (x.max(0.0) as usize).min(self.dims[a] - 1);
            }
            let found = self.against[(at[2] * self.dims[1] + at[1]) * self.dims[0] + at[0]];
            if found < fewest {
                fewest = found;
                if fewest == 0 {
                    break;
                }
            }
        }
        fewest
    }
}

/// The pixel that shows a point, where there is one.
pub(super) fn pixel_of(camera: &Camera, rows: &[[f64; 4]; 3], p: [f64; 3]) -> Option<usize> {
    let [x, y, depth] = affine(rows, p);
    let over = if camera.is_perspective() { depth } else { 1.0 };
    if over <= 0.0 {
        return None;
    }
    let (w, h) = (camera.width as f64, camera.height as f64);
    let (column, row) = ((1.0 + x / over) * 0.5 * w, (1.0 - y / over) * 0.5 * h);
    let inside = column >= 0.0 && row >= 0.0 && column < w && row < h;
    inside.then(|| row as usize * camera.width + column as usize)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    /// Balls of radius 0.7 as seen from around, with a dent in view 0.
    fn views(count: usize) -> Vec<Silhouette> {
        (0..count)
            .map(|i| {
                let (sin, cos) = (i as f64 * std::f64::consts::TAU / count as f64).sin_cos();
                let eye = [4.0 * sin, if i % 2 == 0 { 1.5 } else { -1.5 }, 4.0 * cos];
                let camera = Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.6, 60, 50);
                let inside = |k: usize| {
                    let ray = camera.ray((k % 60) as f64 + 0.5, (k / 60) as f64 + 0.5);
                    let along: f64 = (0..3).map(|a| -ray.origin[a] * ray.direction[a]).sum();
                    let apart = ray.origin.iter().map(|o| o * o).sum::<f64>() - along * along;
                    apart < 0.49 && (i > 0 || k % 60 > 22)
                };
                let mask = Mask::from_fn(50, 60, |i, j| inside(i * 60 + j));
                Silhouette { camera, mask }
            })
            .collect()
    }

    #[test]
    fn one_wrong_view_is_outvoted_and_still_counted() {
        let views = views(12);
        let region = Region { center: [0.0; 3], half: [1.1; 3], round: true };
        let dissent = Dissent::count(&views, &region, 48);
        let seen = dissent.seen_by(&views[0].camera);
        let dent: Vec<usize> = (0..60 * 50).filter(|k| k % 60 <= 20 && k / 60 == 25).collect();
        let hidden: Vec<u16> = dent.iter().map(|&k| seen[k]).filter(|&n| n <= 1).collect();
        // The disc reaches from column 15 to 45; what view 0 misses of it only view 0 is against.
        assert!((4..=7).contains(&hidden.len()) && hidden.iter().all(|&n| n == 1), "{hidden:?}");
        for (k, &n) in seen.iter().enumerate() {
            assert!(!views[0].mask.data[k] || n == 0, "pixel {k}: {n}");
        }
        assert_eq!(seen[0], NOWHERE);
        let bounds = dissent.bounds(1).unwrap();
        assert!(bounds.half.iter().all(|h| (0.75..1.0).contains(h)), "{bounds:?}");
        assert!(Dissent::count(&views, &region, 8).bounds(0).is_some());
    }

    /// A count of 8 bits ended at 254, and a quarter of so many views was all of them.
    #[test]
    fn so_many_views_are_counted_as_there_are() {
        let views: Vec<Silhouette> = views(10).into_iter().cycle().take(2000).collect();
        let region = Region { center: [0.0; 3], half: [1.1; 3], round: true };
        let dissent = Dissent::count(&views, &region, 16);
        let most = dissent.against.iter().filter(|n| **n != NOWHERE).max().unwrap();
        assert_eq!(*most, 2000);
        assert!(dissent.against.iter().any(|n| (501..NOWHERE).contains(n)));
    }
}
