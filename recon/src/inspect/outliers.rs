//! Views that fit none of the others: what is wrong is theirs alone.
//!
//! One camera that stands or looks elsewhere leaves nothing of the visual hull, so that all views disagree. Two views alone tell whether they may
//! show one object: the rays through the pixels of one mask pass through the other.

use mesh_core::{MedianOfEven, median};
use rayon::prelude::*;

use super::hull::{Sphere, agreement, bounding_sphere, consensus_sphere, some_on_ray};
use super::mask_view::MaskView;

/// Views that each is held against; of more, evenly chosen ones.
const PARTNERS: usize = 28;
/// Pixels of each mask that are looked at.
const SAMPLES: usize = 64;
/// The same for what the others agree by.
const HULL_SAMPLES: usize = 140;
/// A view whose median with its partners is below the first is an outlier where the median of all views is above the second.
const FITS: (f64, f64) = (0.7, 0.9);
/// No more than one view in so many.
const MOST: usize = 4;
/// How well the others must agree without them.
const AGREES: f64 = 0.85;

/// Views that fit none of the others.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Outliers {
    /// Which.
    pub(super) views: Vec<usize>,
    /// The agreement of the others.
    pub(super) without: f64,
}

impl Outliers {
    /// `None` where there are none, or where they are not what is wrong.
    pub(super) fn of(views: &[MaskView]) -> Option<Self> {
        let sphere = consensus_sphere(views)?;
        let seen: Vec<usize> = (0..views.len()).filter(|&k| views[k].bounds().is_some()).collect();
        let partners: Vec<usize> =
            seen.iter().copied().step_by(seen.len().div_ceil(PARTNERS).max(1)).collect();
        let pixels: Vec<Vec<[f64; 2]>> = views.iter().map(|view| view.pixels(SAMPLES)).collect();
        let share = |from: usize, to: usize| {
            let through = |pixel: &&[f64; 2]| {
                some_on_ray(&views[from], **pixel, sphere, |p| views[to].allows(p))
            };
            let passing = pixels[from].iter().filter(through).count();
            passing as f64 / pixels[from].len().max(1) as f64
        };
        let fit = |&view: &usize| {
            let others = partners.iter().filter(|&&other| other != view);
            let both = others.map(|&other| share(view, other).min(share(other, view)));
            median(both, MedianOfEven::Lower).unwrap_or(1.0)
        };
        let fits: Vec<f64> = seen.par_iter().map(fit).collect();
        let usual = median(fits.iter().copied(), MedianOfEven::Lower)?;
        let outliers: Vec<usize> = seen
            .iter()
            .zip(&fits)
            .filter(|(_, fit)| **fit < FITS.0)
            .map(|(&view, _)| view)
            .collect();
        if usual < FITS.1 || outliers.is_empty() || MOST * outliers.len() > seen.len() {
            return None;
        }
        let others: Vec<MaskView> =
            (0..views.len()).filter(|k| !outliers.contains(k)).map(|k| views[k].clone()).collect();
        let without = mean_agreement(&others, bounding_sphere(&others)?)?;
        (without > AGREES).then_some(Self { views: outliers, without })
    }
}

fn mean_agreement(views: &[MaskView], sphere: Sphere) -> Option<f64> {
    let shares: Vec<f64> = agreement(views, sphere, HULL_SAMPLES).into_iter().flatten().collect();
    (!shares.is_empty()).then(|| shares.iter().sum::<f64>() / shares.len() as f64)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use datasets::View;
    use mesh_core::nalgebra::{Matrix3, Vector3};
    use synth::shapes::AlarmClock;
    use synth::{Orbit, RenderOptions, render_views};

    use super::*;
    use crate::inspect::reading::Reading;

    fn clock() -> Vec<View> {
        let orbit = Orbit { count: 14, width: 96, height: 96, ..Orbit::default() };
        let clock = AlarmClock::default().build();
        render_views(&clock, &orbit.cameras(), &RenderOptions::default(), &|_, _| {}).unwrap()
    }

    fn found(views: &[View]) -> Option<Vec<usize>> {
        let views: Vec<MaskView> = views.iter().map(MaskView::new).collect();
        Outliers::of(&views).map(|outliers| {
            assert!(outliers.without > 0.95, "{outliers:?}");
            outliers.views
        })
    }

    #[test]
    fn a_camera_anywhere_else_is_found() {
        assert_eq!(found(&clock()), None);
        let aside = |view: &mut View| view.camera.translation += Vector3::new(1.5, 0.5, 0.0);
        let far = |view: &mut View| view.camera.translation *= 100.0;
        let away = |view: &mut View| {
            let turn = Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, -1.0));
            view.camera.rotation = turn * view.camera.rotation;
            view.camera.translation = turn * view.camera.translation;
        };
        for spoil in [&aside as &dyn Fn(&mut View), &far, &away] {
            let mut views = clock();
            spoil(&mut views[5]);
            assert_eq!(found(&views), Some(vec![5]));
            spoil(&mut views[9]);
            assert_eq!(found(&views), Some(vec![5, 9]));
        }
    }

    /// What is wrong with all of them is not the fault of some.
    #[test]
    fn other_readings_are_no_outliers() {
        let views: Vec<MaskView> = clock().iter().map(MaskView::new).collect();
        for reading in [
            Reading::FlippedX,
            Reading::FlippedY,
            Reading::Turned,
            Reading::OpenCvAxes,
            Reading::InversePose,
            Reading::InverseOpenCvPose,
            Reading::Focal(0.7),
            Reading::Focal(1.4),
        ] {
            let views: Vec<MaskView> = views.iter().map(|view| view.under(reading)).collect();
            assert_eq!(Outliers::of(&views), None, "{reading:?}");
        }
        assert_eq!(Outliers::of(&[]), None);
        assert_eq!(Outliers::of(&views[..2]), None);
    }
}
