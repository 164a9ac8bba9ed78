//! Where the object is and how large, from cameras and masks alone.

use datasets::View;
use rayon::prelude::*;

use super::{error::FitError, target::Target};
use crate::inspect::center_of_masks;

/// Cells along each side of the grid that is carved.
const GRID: usize = 48;
/// Share of views that may disagree with every cell before the cameras are declared wrong.
const DISAGREE: f64 = 0.25;

/// The sphere that a fit starts from, and the box of what the masks allow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Centre of mass of the carved hull, in world coordinates.
    pub center: [f64; 3],
    /// Radius of the sphere of the hull's volume.
    pub radius: f64,
    /// Largest distance along an axis from the centre to the hull's border.
    pub half_extent: f64,
}

/// Of the radius, what 32 bits may round a position by.
const ROUNDED: f64 = 1e-3;

impl Placement {
    /// What is to be said of the place, if something is: meshes have positions of 32 bits.
    pub(super) fn remark(&self) -> Option<String> {
        let away = self.center.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let share = away * f64::from(f32::EPSILON) / self.radius;
        (share > ROUNDED).then(|| {
            format!(
                "the object is {:.0} times its radius away from the origin: the mesh's positions, which have 32 bits, are \
                 rounded to {:.1} % of that; move the cameras' origin to the object",
                away / self.radius,
                100.0 * share
            )
        })
    }
}

/// Places the sphere: carves a coarse visual hull and takes its centre and volume.
///
/// The first cube is around the point nearest to the axes through the mask's boxes, as large as
/// the widest of these cones there; a second pass carves the box that the first one left.
/// `views` and `targets` correspond; the targets' frames are changed.
///
/// # Errors
/// [`FitError::Placement`] if the cameras look along one line, or no cell of the grid is seen inside
/// the masks of three quarters of the views.
pub(super) fn place(views: &[&View], targets: &mut [Target]) -> Result<Placement, FitError> {
    let (mut center, mut half) = bounding_sphere(views)?;
    let mut placement = Placement { center, radius: half, half_extent: half };
    for pass in 0..2 {
        for target in targets.iter_mut() {
            target.place(center, half);
        }
        let cells = carve(targets, views, GRID)?;
        let n = cells.len() as f64;
        let mean: [f64; 3] =
            std::array::from_fn(|k| cells.iter().map(|c| f64::from(c[k])).sum::<f64>() / n);
        let cell = 2.0 / GRID as f64;
        let extent = cells
            .iter()
            .flat_map(|c| (0..3).map(|k| (f64::from(c[k]) - mean[k]).abs()))
            .fold(0.0, f64::max)
            + cell / 2.0;
        for k in 0..3 {
            center[k] += half * mean[k];
        }
        let volume = n * (cell * half).powi(3);
        placement = Placement {
            center,
            radius: (0.75 * volume / std::f64::consts::PI).cbrt(),
            half_extent: extent * half,
        };
        if pass == 0 {
            half *= extent + cell;
        }
    }
    Ok(placement)
}

/// The point nearest to all axes through the masks' boxes, and the largest radius of the cones. Where views look along one line from
/// both of its ends, the point at which these cones are equally wide.
///
/// # Errors
/// If the views look along one line from one end, or without perspective, so that no point is nearest.
pub fn bounding_sphere(views: &[&View]) -> Result<([f64; 3], f64), FitError> {
    let axes = views.iter().filter_map(|view| {
        let [top, left, rows, columns] = view.mask_bounds()?.map(|n| n as f64);
        Some(view.camera.ray(left + columns / 2.0, top + rows / 2.0))
    });
    let boxes = views.iter().filter_map(|view| {
        let [top, left, rows, columns] = view.mask_bounds()?.map(|n| n as f64);
        Some((&view.camera, [left, top, left + columns, top + rows]))
    });
    let center = center_of_masks(axes, boxes).ok_or_else(|| FitError::Placement {
        reason: "all look along one line, so the distance to the object is open".into(),
    })?;
    let mut radius = 0.0f64;
    let mut behind = 0;
    for view in views {
        let Some([top, left, rows, columns]) = view.mask_bounds() else { continue };
        if view.camera.is_perspective() && view.camera.project(center).depth <= 0.0 {
            behind += 1;
            continue;
        }
        for (row, column) in
            [(0, 0), (0, columns), (rows, 0), (rows, columns)].map(|(r, c)| (top + r, left + c))
        {
            radius = radius.max(view.camera.ray(column as f64, row as f64).distance(center));
        }
    }
    if behind as f64 > DISAGREE * views.len() as f64 {
        return Err(FitError::Placement {
            reason: format!("their axes meet behind {behind} of {} of them", views.len()),
        });
    }
    if !(radius.is_finite() && radius > 0.0) {
        return Err(FitError::Placement { reason: format!("the object's radius is {radius}") });
    }
    Ok((center, radius))
}

/// Centres, in the targets' frame, of the cells of a grid of this `side` that the most views see inside their masks.
pub(super) fn carve(
    targets: &[Target],
    views: &[&View],
    side: usize,
) -> Result<Vec<[f32; 3]>, FitError> {
    let center = |k: usize| (2 * k + 1) as f32 / side as f32 - 1.0;
    let middle = |cell: usize| [cell % side, cell / side % side, cell / side / side].map(center);
    let half_cell = 1.0 / side as f32;
    // How many views see each cell outside of their mask, counted up to a number.
    let counted = |most: usize| -> Vec<u16> {
        (0..side * side * side)
            .into_par_iter()
            .with_min_len(side * side)
            .map(|cell| {
                let p = middle(cell);
                let refusing = targets.iter().filter(|t| !sees_inside(t, p, half_cell));
                refusing.take(most).count() as u16
            })
            .collect()
    };
    let fewest = |outside: &[u16]| outside.iter().copied().min().unwrap_or(0);
    // Cells that more refuse are not taken, however many.
    let tolerated = (DISAGREE * targets.len() as f64) as usize;
    let mut outside = counted(tolerated + 1);
    let mut least = fewest(&outside);
    if usize::from(least) > tolerated {
        outside = counted(targets.len());
        least = fewest(&outside);
        let worst = targets
            .iter()
            .zip(views)
            .min_by_key(|(t, _)| {
                (0..outside.len())
                    .filter(|&cell| outside[cell] == least)
                    .filter(|&cell| sees_inside(t, middle(cell), half_cell))
                    .count()
            })
            .map_or("", |(t, _)| t.name.as_str());
        return Err(FitError::Placement {
            reason: format!(
                "no point lies inside the masks of more than {} of {} views (view {worst} disagrees most); \
                 are the cameras in another convention?",
                targets.len() - usize::from(least),
                targets.len(),
            ),
        });
    }
    Ok((0..outside.len()).filter(|&cell| outside[cell] == least).map(middle).collect())
}

/// Whether a cell of half side `half_cell` reaches into the mask.
fn sees_inside(target: &Target, point: [f32; 3], half_cell: f32) -> bool {
    let seen @ [column, row, depth] = target.project(point);
    target.is_before(seen)
        && target.distance(column, row) < half_cell * target.pixels_per_unit(depth)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use datasets::Views;
    use mesh_core::{Camera, Lens, TriMesh, primitives};
    use synth::{Orbit, RenderOptions, render_views};
    use train::progress::Watch;

    use super::Placement;
    use crate::evaluate::score_views;
    use crate::fit::{FitConfig, fit};

    fn ellipsoid() -> TriMesh {
        primitives::icosphere(3).scaled([0.6, 0.4, 0.5]).colored([0.8, 0.1, 0.1])
    }

    fn cameras() -> Vec<Camera> {
        Orbit { count: 12, width: 48, height: 48, ..Orbit::default() }.cameras()
    }

    /// Mask IoU and PSNR of a short fit, on the views that it was made of.
    fn fitted(object: &TriMesh, cameras: &[Camera]) -> (f64, f64) {
        let views = render_views(object, cameras, &RenderOptions::default(), &|_, _| {}).unwrap();
        let views = Views::in_memory(views);
        let config = FitConfig { start_level: 2, level: 3, steps: 40, ..FitConfig::default() };
        let fitted = fit(&views, &config, &mut Watch::default()).unwrap();
        let all: Vec<_> = views.views.iter().collect();
        let scores = score_views(&fitted.mesh, &all, &|_, _| {}).unwrap();
        (scores.mask_iou, scores.psnr.unwrap())
    }

    /// Rays that are parallel have no beginning: where the cameras' planes are does not matter.
    #[test]
    fn parallel_cameras_may_stand_in_the_object() {
        let lens = Lens::Orthographic { sx: 30.0, sy: 30.0, cx: 24.0, cy: 24.0 };
        let found = [0.0, 1.0].map(|away| {
            let moved = |camera: &Camera| {
                let translation = away * camera.translation;
                Camera { lens, translation, ..camera.clone() }
            };
            let cameras: Vec<Camera> = cameras().iter().map(moved).collect();
            fitted(&ellipsoid(), &cameras)
        });
        assert!(found.iter().all(|(iou, psnr)| *iou > 0.93 && *psnr > 25.0), "{found:?}");
    }

    /// What each misses the middle by is not taken for a distance.
    #[test]
    fn views_from_opposite_sides_place_what_is_between_them() {
        let mut object = primitives::cuboid([0.5; 3]);
        object.append(&primitives::cuboid([0.3, 0.2, 0.1]).translated([0.3, 0.2, 0.2])).unwrap();
        let object = object.colored([0.5; 3]);
        for aside in [0.0, 0.1, 0.3] {
            let eyes = [[0.0, 0.0, 3.0], [aside, aside, -3.0]];
            let camera = |eye| Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.7, 96, 96);
            let options = RenderOptions::default();
            let views = render_views(&object, &eyes.map(camera), &options, &|_, _| {}).unwrap();
            let (center, radius) =
                super::bounding_sphere(&views.iter().collect::<Vec<_>>()).unwrap();
            let off = center.iter().map(|x| x * x).sum::<f64>().sqrt();
            assert!(off < 0.35 && (0.3..0.8).contains(&radius), "{aside}: {center:?} {radius}");
        }
    }

    #[test]
    fn places_that_32_bits_round_are_told_of() {
        let placed = |x: f64| Placement { center: [x, 0.0, 1.0], radius: 0.5, half_extent: 0.6 };
        assert_eq!(placed(-100.0).remark(), None);
        let said = placed(-5e5).remark().unwrap();
        assert!(said.contains("1000000 times its radius") && said.contains("11.9 %"), "{said}");
    }

    /// The unit of the world does not matter.
    #[test]
    fn a_tiny_world_is_fitted_and_colored() {
        let found = [1.0, 1e-5].map(|unit| {
            let moved = |camera: &Camera| {
                let translation = unit * camera.translation;
                Camera { translation, ..camera.clone() }
            };
            let cameras: Vec<Camera> = cameras().iter().map(moved).collect();
            fitted(&ellipsoid().scaled([unit as f32; 3]), &cameras)
        });
        assert!(found.iter().all(|(iou, psnr)| *iou > 0.93 && *psnr > 25.0), "{found:?}");
    }
}
