//! The visual hull as a function: how far each point of a lattice lies outside of what the masks allow.

use std::ops::Range;

use mesh_core::bounds::longest_side;
use rayon::prelude::*;

use super::{kuhn::STEPS, placement::Placement, target::Target};

/// Points along a side of the blocks that are looked at as a whole first, then by halves.
const BLOCK: usize = 8;
/// Nobody asks how much further outside than this, in steps, a point is, nor how much further inside: what may be a tunnel is nearer, and
/// so is what has the surface beside it.
const NEAR: [f32; 2] = [3.0, 1.5];
/// Points along the longest side of the first, coarse look, which finds the box.
const COARSE: usize = 48;
/// Points of air around the object.
const AIR: usize = 4;
/// Distances in perspective change by a little more than the way: distances are in units of the middle's pixels.
const SLACK: f32 = 1.3;
/// Points no further outside of the hull than this, in steps, may hold some of the object.
const ALLOWED: f32 = 0.3;
/// How much further from a mask's edge a point must be seen by one view alone than by two to be as far outside, in points.
const ALONE: f32 = 1.5;

/// A box of points around the object, with two distances from the hull at each, in steps of the lattice: negative inside.
#[derive(Clone, Debug)]
pub(super) struct Lattice {
    /// Points along each axis.
    pub(super) dims: [usize; 3],
    /// Place of the first point, in the frame of the targets.
    pub(super) origin: [f32; 3],
    /// Length of a step.
    pub(super) step: f32,
    /// Width of a pixel at the middle, in the mean over the views.
    pub(super) pixel: f32,
    /// Distance to the hull's surface: the largest over the views; farther off than [`NEAR`] some number beyond that.
    pub(super) distance: Vec<f32>,
    /// The same, where what one view sees alone counts less: what tunnels are judged by.
    pub(super) agreed: Vec<f32>,
}

impl Lattice {
    /// Measures the hull on a lattice of at most `longest` points along a side, which are at least `finest` pixels apart.
    ///
    /// As many views may see a point outside of their mask as see the best point so. The frame of `targets` is left as that of `placement`, in
    /// which lengths are radii. `None` where nothing is inside.
    ///
    /// # Cost
    /// Of the points of the box those near the surface are looked at in every view; the others block by block.
    pub(super) fn of(
        targets: &mut [Target],
        placement: &Placement,
        longest: usize,
        finest: f32,
    ) -> Option<Self> {
        for target in targets.iter_mut() {
            target.place(placement.center, placement.radius);
        }
        let targets = &*targets;
        let half = (placement.half_extent / placement.radius) as f32 * 1.05;
        let step = 2.0 * half / (COARSE - 1) as f32;
        let tolerated = tolerated(targets, half);
        let coarse = Self::measured(targets, [COARSE; 3], [-half; 3], step, tolerated);
        // All that may be inside, a step around.
        let mut low = [f32::INFINITY; 3];
        let mut high = [f32::NEG_INFINITY; 3];
        for (slot, _) in coarse.distance.iter().enumerate().filter(|(_, d)| **d < 1.0) {
            let p = coarse.place(slot);
            for k in 0..3 {
                low[k] = low[k].min(p[k] - step);
                high[k] = high[k].max(p[k] + step);
            }
        }
        let side = longest_side((low, high));
        if !(side.is_finite() && side > 0.0) {
            return None;
        }
        let step = (side / (longest - 2 * AIR) as f32).max(finest * pixel(targets));
        let dims = std::array::from_fn(|k| ((high[k] - low[k]) / step).ceil() as usize + 2 * AIR);
        let origin = std::array::from_fn(|k| low[k] - AIR as f32 * step);
        Some(Self::measured(targets, dims, origin, step, tolerated))
    }

    fn measured(
        targets: &[Target],
        dims: [usize; 3],
        origin: [f32; 3],
        step: f32,
        tolerated: usize,
    ) -> Self {
        let count = dims.iter().product();
        let mut lattice = Self {
            dims,
            origin,
            step,
            pixel: pixel(targets),
            distance: vec![0.0; count],
            agreed: vec![0.0; count],
        };
        let layer = dims[0] * dims[1];
        let hull = HullDistance { targets, tolerated, step };
        let (mut distance, mut agreed) =
            (std::mem::take(&mut lattice.distance), std::mem::take(&mut lattice.agreed));
        distance
            .par_chunks_mut(layer * BLOCK)
            .zip(agreed.par_chunks_mut(layer * BLOCK))
            .enumerate()
            .for_each(|(slab, (distance, agreed))| {
                lattice.slab(&hull, slab * BLOCK, distance, agreed);
            });
        Self { distance, agreed, ..lattice }
    }

    /// A few layers, from `bottom` on, block by block.
    fn slab(
        &self,
        hull: &HullDistance<'_>,
        bottom: usize,
        distance: &mut [f32],
        agreed: &mut [f32],
    ) {
        let [nx, ny, _] = self.dims;
        let layers = distance.len() / (nx * ny);
        let mut slab = Slab { lattice: self, hull, bottom, distance, agreed, found: Vec::new() };
        for y in (0..ny).step_by(BLOCK) {
            for x in (0..nx).step_by(BLOCK) {
                slab.measure([x, y, bottom], [BLOCK.min(nx - x), BLOCK.min(ny - y), layers]);
            }
        }
    }

    /// Where a point is.
    pub(super) fn place(&self, slot: usize) -> [f32; 3] {
        let [nx, ny, _] = self.dims;
        self.at([slot % nx, slot / nx % ny, slot / (nx * ny)])
    }

    fn at(&self, point: [usize; 3]) -> [f32; 3] {
        std::array::from_fn(|k| self.origin[k] + self.step * point[k] as f32)
    }

    /// For pixels of a mask, so many that no point of the lattice is passed by, the points nearest to the pixel's ray that may hold some of the
    /// object: those at most [`ALLOWED`] outside of the hull.
    pub(super) fn cast(
        &self,
        target: &Target,
        placement: &Placement,
        mut visit: impl FnMut(&[usize]),
    ) {
        let pixels = target.pixels_per_unit(target.project([0.0; 3])[2]);
        let stride = ((0.5 * self.step * pixels) as usize).max(1);
        let mut on_ray = Vec::new();
        for y in (0..target.height).step_by(stride) {
            for x in (0..target.width).step_by(stride) {
                if target.in_mask(y * target.width + x) {
                    self.walk(target, placement, [x as f64 + 0.5, y as f64 + 0.5], &mut on_ray);
                    on_ray.retain(|&slot| self.distance[slot] < ALLOWED);
                    visit(&on_ray);
                }
            }
        }
    }

    /// The points nearest to the ray through a place of the box, in order.
    fn walk(
        &self,
        target: &Target,
        placement: &Placement,
        [column, row]: [f64; 2],
        out: &mut Vec<usize>,
    ) {
        out.clear();
        let ray = target.camera().ray(column, row);
        // In steps of the lattice from its first point.
        let scale = 1.0 / (placement.radius * f64::from(self.step));
        let step = f64::from(self.step);
        let origin: [f64; 3] = std::array::from_fn(|k| {
            (ray.origin[k] - placement.center[k]) * scale - f64::from(self.origin[k]) / step
        });
        let norm = (0..3).map(|k| ray.direction[k].powi(2)).sum::<f64>().sqrt();
        let direction: [f64; 3] = std::array::from_fn(|k| ray.direction[k] / norm);
        let (mut near, mut far) = (0.0_f64, f64::INFINITY);
        for k in 0..3 {
            let last = (self.dims[k] - 1) as f64;
            if direction[k].abs() < 1e-12 {
                if !(0.0..=last).contains(&origin[k]) {
                    return;
                }
                continue;
            }
            let [a, b] = [-origin[k] / direction[k], (last - origin[k]) / direction[k]];
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        if !(near.is_finite() && far.is_finite()) {
            return;
        }
        let [nx, ny, _] = self.dims;
        let mut along = near;
        while along <= far {
            let at: [usize; 3] = std::array::from_fn(|k| {
                let x = (origin[k] + along * direction[k]).round().max(0.0) as usize;
                x.min(self.dims[k] - 1)
            });
            let slot = (at[2] * ny + at[1]) * nx + at[0];
            if out.last() != Some(&slot) {
                out.push(slot);
            }
            along += 0.5;
        }
    }

    /// How far apart neighbours are in the arrays.
    pub(super) fn strides(&self) -> [isize; 14] {
        let [nx, ny, _] = self.dims.map(|n| n as isize);
        STEPS.map(|[x, y, z]| x + nx * (y + ny * z))
    }

    /// The points that have all their neighbours, those of a row along the first axis together.
    pub(super) fn inner_rows(&self) -> impl Iterator<Item = Range<usize>> {
        let [nx, ny, nz] = self.dims;
        let rows =
            (1..nz.max(1) - 1).flat_map(move |z| (1..ny.max(1) - 1).map(move |y| z * ny + y));
        rows.map(move |row| row * nx + 1..((row + 1) * nx - 1).max(row * nx + 1))
    }
}

/// Layers that are being measured.
struct Slab<'a> {
    lattice: &'a Lattice,
    hull: &'a HullDistance<'a>,
    bottom: usize,
    distance: &'a mut [f32],
    agreed: &'a mut [f32],
    /// Room for [`HullDistance::at`].
    found: Vec<f32>,
}

impl Slab<'_> {
    /// A block: as a whole where that is far from the surface, else by its halves.
    fn measure(&mut self, first: [usize; 3], size: [usize; 3]) {
        let Lattice { origin, step, .. } = self.lattice;
        let middle = std::array::from_fn(|k| {
            origin[k] + step * (first[k] as f32 + 0.5 * (size[k] as f32 - 1.0))
        });
        let across = size.iter().map(|&n| (n as f32 - 1.0).powi(2)).sum::<f32>().sqrt();
        let [outside, inside] = NEAR.map(|near| SLACK * 0.5 * across + near);
        let whole = self.hull.at(middle, outside, &mut self.found);
        if whole[1] > outside || whole[0] < -inside || size == [1; 3] {
            self.fill(first, size, whole);
            return;
        }
        let parts = |k: usize| {
            let half = size[k].div_ceil(2);
            let rest = (size[k] > half).then(|| (first[k] + half, size[k] - half));
            std::iter::once((first[k], half)).chain(rest)
        };
        for (z, deep) in parts(2) {
            for (y, high) in parts(1) {
                for (x, wide) in parts(0) {
                    self.measure([x, y, z], [wide, high, deep]);
                }
            }
        }
    }

    fn fill(&mut self, first: [usize; 3], size: [usize; 3], [distance, agreed]: [f32; 2]) {
        let [nx, ny, _] = self.lattice.dims;
        for z in first[2]..first[2] + size[2] {
            for y in first[1]..first[1] + size[1] {
                let row = ((z - self.bottom) * ny + y) * nx + first[0];
                self.distance[row..row + size[0]].fill(distance);
                self.agreed[row..row + size[0]].fill(agreed);
            }
        }
    }
}

/// Width of a pixel at the origin, in the mean over the views.
pub(super) fn pixel(targets: &[Target]) -> f32 {
    let pixels: f32 = targets.iter().map(|t| t.pixels_per_unit(t.project([0.0; 3])[2])).sum();
    targets.len() as f32 / pixels
}

/// How many views see even the best point outside of their mask: 0 where masks and cameras are right.
fn tolerated(targets: &[Target], half: f32) -> usize {
    let side = COARSE / 2;
    let at = |i: usize| half * ((2 * i + 1) as f32 / side as f32 - 1.0);
    let outside = |slot: usize| {
        let point = [slot % side, slot / side % side, slot / (side * side)].map(at);
        let sees = |target: &&Target| {
            let seen @ [column, row, depth] = target.project(point);
            let reach = half / side as f32 * target.pixels_per_unit(depth);
            !(target.is_before(seen) && target.distance(column, row) < reach)
        };
        targets.iter().filter(sees).count()
    };
    (0..side.pow(3)).into_par_iter().map(outside).min().unwrap_or(0)
}

/// How far points are from the visual hull of all views but some, in steps of a lattice.
struct HullDistance<'a> {
    targets: &'a [Target],
    tolerated: usize,
    step: f32,
}

impl HullDistance<'_> {
    /// How far outside the masks a point is: for all views but those tolerated, and for one less. From `enough` on no view is asked any more.
    fn at(&self, point: [f32; 3], enough: f32, largest: &mut Vec<f32>) -> [f32; 2] {
        largest.clear();
        largest.resize(self.tolerated + 2, f32::NEG_INFINITY);
        for target in self.targets {
            let seen @ [column, row, depth] = target.project(point);
            let distance = if target.is_before(seen) {
                target.distance(column, row) / (target.pixels_per_unit(depth) * self.step)
            } else {
                f32::MAX
            };
            // The largest ones, in falling order.
            let mut carried = distance;
            for kept in largest.iter_mut() {
                if carried > *kept {
                    std::mem::swap(&mut carried, kept);
                }
            }
            if largest[self.tolerated + 1] > enough {
                break;
            }
        }
        let [first, second] = [largest[self.tolerated], largest[self.tolerated + 1]];
        [first, second.max(first - ALONE)]
    }
}
