//! The visual hull: the largest body that all masks allow.

use mesh_core::bounds::longest_side;
use mesh_core::{MedianOfEven, Ray, VoxelGrid, median};
use rayon::prelude::*;

use super::mask_view::MaskView;
use super::opposite::center_of_masks;
use super::partners::partners;

/// Steps along a ray through the sphere that holds the object.
const STEPS: usize = 160;
/// Pixels of each mask by which it is told whether cameras are apart.
const SAMPLES: usize = 140;
/// Axes of which each two are asked for their point.
const CONSENSUS: usize = 24;

/// A sphere that holds what the masks show, if the cameras are right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sphere {
    pub(crate) center: [f64; 3],
    pub(crate) radius: f64,
}

/// Cameras are as good as in one place where they are nearer than this share of their distance from the origin, and certainly where
/// they are nearer than the second.
const TOGETHER: [f64; 2] = [1e-6, 1e-12];
/// Masks that agree so well were not seen from one place.
const AGREES: f64 = 0.85;

/// Whether several cameras with perspective all stand in one place: no two of their rays then meet
/// anywhere but there, so the masks fix no body. Far from the origin those may be near each other that still see one.
pub(crate) fn coincide(views: &[MaskView]) -> bool {
    let [first, others @ ..] = views else { return false };
    let place = first.camera.center();
    let within = |share: f64| {
        let near = |view: &MaskView| {
            (view.camera.center() - place).norm() <= share * place.norm().max(f64::EPSILON)
        };
        others.iter().all(near)
    };
    let seen = || {
        let shares = agreement(views, sphere_around(views)?, SAMPLES);
        let shares: Vec<f64> = shares.into_iter().flatten().collect();
        Some(shares.iter().sum::<f64>() / shares.len().max(1) as f64)
    };
    !others.is_empty()
        && views.iter().all(|view| view.camera.is_perspective())
        && within(TOGETHER[0])
        && (within(TOGETHER[1]) || seen().is_none_or(|share| share < AGREES))
}

/// The sphere around the point where the masks' axes meet, or where cones from opposite sides are equally wide, as wide as the
/// widest of them.
///
/// `None` where the axes do not fix a point, all cameras stand there, or most look away from it.
pub(crate) fn bounding_sphere(views: &[MaskView]) -> Option<Sphere> {
    if coincide(views) { None } else { sphere_around(views) }
}

fn sphere_around(views: &[MaskView]) -> Option<Sphere> {
    let boxed = MaskBoxes::of(views);
    let boxes = boxed.boxes.iter().map(|(view, bounds)| (&view.camera, *bounds));
    let center = center_of_masks(boxed.axes.iter().copied(), boxes)?;
    // A single camera that looks elsewhere must not blow the sphere up.
    boxed.around(center, 0.9)
}

/// The same where some of the cameras may be anywhere: around the point of two axes that half of all come nearest to, as wide as the
/// median of the cones with half as much again.
pub(crate) fn consensus_sphere(views: &[MaskView]) -> Option<Sphere> {
    let boxed = MaskBoxes::of(views);
    let step = boxed.axes.len().div_ceil(CONSENSUS).max(1);
    let tried: Vec<Ray> = boxed.axes.iter().copied().step_by(step).collect();
    let pairs = (0..tried.len()).flat_map(|i| (0..i).map(move |j| [i, j]));
    let points = pairs.filter_map(|pair| Ray::nearest_point(pair.map(|k| tried[k])));
    let away = |point: &[f64; 3]| {
        let distances = boxed.axes.iter().map(|axis| axis.distance(*point));
        median(distances, MedianOfEven::Upper).unwrap_or(f64::INFINITY)
    };
    let center = points.map(|point| (away(&point), point)).min_by(|a, b| a.0.total_cmp(&b.0))?.1;
    let sphere = boxed.around(center, 0.5)?;
    Some(Sphere { radius: 1.5 * sphere.radius, ..sphere })
}

/// The boxes of the masks that are not empty, and the rays through their middles.
struct MaskBoxes<'a> {
    boxes: Vec<(&'a MaskView, [f64; 4])>,
    axes: Vec<Ray>,
}

impl<'a> MaskBoxes<'a> {
    fn of(views: &'a [MaskView]) -> Self {
        let boxes: Vec<(&MaskView, [f64; 4])> =
            views.iter().filter_map(|view| Some((view, view.bounds()?))).collect();
        let axis = |(view, [l, t, r, b]): &(&MaskView, [f64; 4])| {
            view.camera.ray((l + r) / 2.0, (t + b) / 2.0)
        };
        Self { axes: boxes.iter().map(axis).collect(), boxes }
    }

    /// The sphere around a point that is as wide as this share of the cones; `None` where most cameras have it behind them.
    fn around(&self, center: [f64; 3], share: f64) -> Option<Sphere> {
        let mut radii = Vec::new();
        for (view, [l, t, r, b]) in &self.boxes {
            if view.camera.is_perspective() && view.camera.project(center).depth <= 0.0 {
                continue;
            }
            let corners = [[*l, *t], [*l, *b], [*r, *t], [*r, *b]];
            let far = corners.map(|[column, row]| view.camera.ray(column, row).distance(center));
            radii.push(far.into_iter().fold(0.0, f64::max));
        }
        if 2 * radii.len() < self.boxes.len() {
            return None;
        }
        radii.sort_by(f64::total_cmp);
        let radius = *radii.get((share * radii.len().saturating_sub(1) as f64) as usize)?;
        (radius.is_finite() && radius > 0.0).then_some(Sphere { center, radius: 1.1 * radius })
    }
}

/// For each view the share of its mask that the hull of all masks covers.
///
/// The hull lies within every mask, so this is the intersection over union of its silhouette with
/// the mask. It is found exactly along the rays of at most `samples` pixels of each mask: a pixel
/// counts where some point on its ray is allowed by every other view. Views with an empty mask
/// have no share.
pub(crate) fn agreement(views: &[MaskView], sphere: Sphere, samples: usize) -> Vec<Option<f64>> {
    views
        .par_iter()
        .enumerate()
        .map(|(k, view)| {
            let pixels = view.pixels(samples);
            if pixels.is_empty() {
                return None;
            }
            let others = Others::of(views, k);
            let covered = pixels.iter().filter(|p| others.allow_some(view, **p, sphere)).count();
            Some(covered as f64 / pixels.len() as f64)
        })
        .collect()
}

/// The [partners] of a view, those first that look from elsewhere: they refuse soonest.
struct Others<'a> {
    order: Vec<&'a MaskView>,
}

impl<'a> Others<'a> {
    fn of(views: &'a [MaskView], k: usize) -> Self {
        let forward = views[k].camera.forward();
        let mut order: Vec<(f64, &MaskView)> = partners(k, views.len())
            .map(|i| &views[i])
            .filter(|view| view.bounds().is_some())
            .map(|view| (forward.dot(&view.camera.forward()).abs(), view))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self { order: order.into_iter().map(|(_, view)| view).collect() }
    }

    fn allow_some(&self, view: &MaskView, pixel: [f64; 2], sphere: Sphere) -> bool {
        some_on_ray(view, pixel, sphere, |p| self.order.iter().all(|o| o.allows(p)))
    }
}

/// Whether some point that a pixel of a view shows, within the sphere, is as asked for.
pub(crate) fn some_on_ray(
    view: &MaskView,
    [column, row]: [f64; 2],
    sphere: Sphere,
    is_wanted: impl Fn([f64; 3]) -> bool,
) -> bool {
    let ray = view.camera.ray(column, row);
    let to: [f64; 3] = std::array::from_fn(|a| sphere.center[a] - ray.origin[a]);
    let middle: f64 = (0..3).map(|a| to[a] * ray.direction[a]).sum();
    (0..STEPS).any(|step| {
        let t = middle + sphere.radius * ((2 * step + 1) as f64 / STEPS as f64 - 1.0);
        let p = std::array::from_fn(|a| ray.origin[a] + t * ray.direction[a]);
        (t > 0.0 || !view.camera.is_perspective()) && is_wanted(p)
    })
}

/// The hull on a grid of `side` cells along the longest side of its box, in two passes.
///
/// A cell is in it where its centre is allowed by every view. `None` where nothing is left, or the sphere is too small for
/// its place.
pub(crate) fn carve(views: &[MaskView], sphere: Sphere, side: usize) -> Option<VoxelGrid> {
    let seen: Vec<&MaskView> = views.iter().filter(|view| view.bounds().is_some()).collect();
    let low = sphere.center.map(|c| (c - sphere.radius) as f32);
    let high = sphere.center.map(|c| (c + sphere.radius) as f32);
    // Cells smaller than the steps of numbers there cannot be told apart.
    let fine = |k: usize| low[k].abs().max(high[k].abs()) * f32::EPSILON;
    if !(0..3).all(|k| (high[k] - low[k]) / side.max(32) as f32 > fine(k)) {
        return None;
    }
    let coarse = carved(&seen, low, high, 32);
    let (low, high) = occupied(&coarse)?;
    let fine = carved(&seen, low, high, side);
    occupied(&fine).is_some().then_some(fine)
}

fn carved(views: &[&MaskView], low: [f32; 3], high: [f32; 3], side: usize) -> VoxelGrid {
    let longest = longest_side((low, high));
    let dims = std::array::from_fn(|k| {
        (((high[k] - low[k]) / longest * side as f32).ceil() as usize).clamp(1, side)
    });
    let mut grid = VoxelGrid::new(dims, (low, high));
    let bits = (0..grid.bits.len())
        .into_par_iter()
        .with_min_len(4096)
        .map(|k| {
            let cell = [k % dims[0], k / dims[0] % dims[1], k / dims[0] / dims[1]];
            let p = grid.center(cell).map(f64::from);
            views.iter().all(|view| view.allows(p))
        })
        .collect();
    grid.bits = bits;
    grid
}

/// The box of the occupied cells with one cell around it.
fn occupied(grid: &VoxelGrid) -> Option<([f32; 3], [f32; 3])> {
    let [nx, ny, _] = grid.dims;
    let mut bounds: Option<([usize; 3], [usize; 3])> = None;
    for (k, _) in grid.bits.iter().enumerate().filter(|(_, bit)| **bit) {
        let cell = [k % nx, k / nx % ny, k / nx / ny];
        let (low, high) = bounds.get_or_insert((cell, cell));
        for a in 0..3 {
            low[a] = low[a].min(cell[a]);
            high[a] = high[a].max(cell[a]);
        }
    }
    let (low, high) = bounds?;
    let at = |k: usize, cells: f32| grid.origin[k] + grid.cell[k] * cells;
    Some((
        std::array::from_fn(|k| at(k, low[k] as f32 - 1.0)),
        std::array::from_fn(|k| at(k, high[k] as f32 + 2.0)),
    ))
}
