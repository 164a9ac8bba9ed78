//! When cameras are refined in the course of a fit, and whether that is kept.

use datasets::View;
use mesh_core::Camera;
use rayon::prelude::*;

use super::cameras::{Cameras, longer};
use super::config::REFINING;
use super::distance::Blur;
use super::{FitConfig, FitError, Order, Run, Shape, Target};
use crate::inspect::Consistency;

/// Rounds end where one takes away less than this share of the outlines' distance to the masks.
const WORTHWHILE: f64 = 0.0005;
/// Length of the steps, as a share of the longest.
const RATE: f32 = 0.6;
/// Cameras whose outlines miss one another by less than so many pixels in the mean (of an image of at most 320) are left alone.
const EXACT: f64 = 0.3;
/// Pixels between outlines, in images brought to 320 at most, below which cameras that were refined are right to a fraction of a pixel.
const CLOSE: f64 = 0.25;
/// Refined cameras are kept if that falls at least to this share: it is measured without the mesh, which follows any cameras.
const HELPS: f64 = 0.5;
/// Cameras whose outlines moved by more of what is looked at around the object are not refined but lost.
const FARTHEST: f64 = 0.25;
/// Fewer views leave too much open.
const FEWEST: usize = 4;

/// Cameras that are not exact, as they were given.
#[derive(Debug)]
pub(super) struct Given {
    consistency: Consistency,
    cameras: Vec<Camera>,
    /// By how much outlines miss one another.
    gap: f64,
}

impl Given {
    /// The cameras of some views, where they are to be refined; then masks do not tell the widths of thin parts, which need cameras that are
    /// right to a fraction of a pixel.
    pub(super) fn of(views: &[&View], targets: &mut [Target], config: &FitConfig) -> Option<Self> {
        if !config.refine_cameras || views.len() < FEWEST {
            return None;
        }
        let consistency = Consistency::of(views)?;
        let cameras: Vec<Camera> = views.iter().map(|view| view.camera.clone()).collect();
        let gap = consistency.gap(&cameras);
        if gap < EXACT {
            return None;
        }
        measure(targets, Blur { keeps_thin: false, ..config.blur() });
        Some(Self { consistency, cameras, gap })
    }
}

/// What became of the cameras of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct RefinedCameras {
    /// The cameras of all views, in their order, of what these hold of their images. Views that are held out keep their pose, since it must not be taken from the masks
    /// that score; the focal length, which all views share, is refined in them too.
    pub cameras: Vec<Camera>,
    /// Those of the held-out views, in their order, found from their own masks by the finished mesh: poses that are as far off as
    /// the others were say nothing of a shape. Six numbers a view, as in the evaluation of BARF (Lin et al. 2021, section 4.2).
    pub located: Vec<Camera>,
    /// The focal length, times the one given.
    pub focal: f64,
    /// How far the outlines moved in the images that were fitted, root mean square in pixels.
    pub motion: f64,
    /// Distance of the outlines to the masks before and after, root mean square in pixels.
    pub distance: [f64; 2],
    /// How far outlines miss one another before and after, mean in pixels of an image of at most 320, measured without the mesh; see
    /// [`Coherence::gap`](crate::inspect::Coherence::gap).
    pub gap: [f64; 2],
}

/// Cameras that are being refined.
#[derive(Clone, Debug)]
pub(super) struct Alignment {
    cameras: Cameras,
    /// Those of the held-out views as they were given, in the targets' boxes.
    held_out: Vec<Camera>,
    distance: [f64; 2],
    gap: [f64; 2],
}

impl Alignment {
    /// Whether outlines moved out of what is looked at.
    fn is_lost(&self, shape: &Shape, targets: &[Target]) -> bool {
        let side = |target: &Target| target.width.max(target.height) as f64;
        let least = targets.iter().map(side).fold(f64::INFINITY, f64::min);
        self.cameras.motion(shape, targets) > FARTHEST * least
    }
}

impl Run<'_, '_> {
    /// Refines the cameras for the shape that a level ended with, and keeps them if that helps.
    pub(super) fn align(
        &mut self,
        shape: &mut Shape,
        order: &mut Order,
        config: &FitConfig,
    ) -> Result<(), FitError> {
        let first = self.alignment.is_none();
        if self.ask_cancelled() || first && self.given.is_none() {
            return Ok(());
        }
        let (placement, given) = (self.fitted.placement, self.given.take());
        self.total += REFINING.0 * REFINING.1;
        let before = shape.distance(&self.train);
        let mut alignment = self.alignment.take().unwrap_or_else(|| Alignment {
            cameras: Cameras::of(&self.train, placement.center, placement.radius),
            held_out: self.held_out.iter().map(|target| target.camera().clone()).collect(),
            distance: [before; 2],
            gap: [0.0; 2],
        });
        let start = shape.positions.clone();
        let mut distance = before;
        for round in 0..REFINING.0 {
            if self.ask_cancelled() {
                break;
            }
            alignment.cameras.improve(shape, &mut self.train);
            for _ in 0..REFINING.1 {
                if self.ask_cancelled() {
                    break;
                }
                let rate = RATE * config.learning_rate / ((round + 1) as f32).sqrt();
                let step = self.fitted.history.len() + 1;
                let terms = shape.step(&self.train, order.next(), config, rate, step)?;
                let terms = vec![("silhouette", terms.outline.rms()), ("bending", terms.bending)];
                self.stepped(terms);
            }
            let now = shape.distance(&self.train);
            if now > (1.0 - WORTHWHILE) * distance && round > 2 {
                break;
            }
            distance = now;
        }
        if let Some(Given { consistency, cameras, gap }) = given {
            let refined: Vec<Camera> = cameras
                .iter()
                .zip(&self.train)
                .map(|(given, target)| like(given, target.camera(), alignment.cameras.focal))
                .collect();
            alignment.gap = [gap, consistency.gap(&refined)];
            if alignment.gap[1] > HELPS * gap || alignment.is_lost(shape, &self.train) {
                alignment.cameras.give_back(&mut self.train);
                measure(&mut self.train, config.blur());
                shape.place(start);
                return Ok(());
            }
        }
        alignment.distance[1] = shape.distance(&self.train);
        for (target, given) in self.held_out.iter_mut().zip(&alignment.held_out) {
            let lens = longer(given.lens, alignment.cameras.focal);
            target.set_camera(Camera { lens, ..given.clone() });
            target.place(placement.center, placement.radius);
        }
        // Refined so well that outlines fit together, they tell widths again.
        if first && alignment.gap[1] < CLOSE {
            measure(&mut self.train, config.blur());
        }
        self.alignment = Some(alignment);
        Ok(())
    }

    /// What became of the cameras, for the shape at the end.
    pub(super) fn refined_cameras(&self, shape: &Shape, views: &[View]) -> Option<RefinedCameras> {
        let Alignment { cameras, distance, gap, .. } = self.alignment.as_ref()?;
        let focal = cameras.focal;
        let mut refined: Vec<Camera> =
            views.iter().map(|view| like(&view.camera, &view.camera, focal)).collect();
        for (&i, target) in self.fitted.train_views.iter().zip(&self.train) {
            refined[i] = like(&views[i].camera, target.camera(), focal);
        }
        let motion = cameras.motion(shape, &self.train);
        let located = cameras.locate(shape, &self.held_out);
        let held_out = self.fitted.held_out_views.iter();
        let located =
            held_out.zip(&located).map(|(&i, at)| like(&views[i].camera, at, focal)).collect();
        Some(RefinedCameras {
            cameras: refined,
            located,
            focal,
            motion,
            distance: *distance,
            gap: *gap,
        })
    }
}

/// Measures the masks anew.
fn measure(targets: &mut [Target], blur: Blur) {
    targets.par_iter_mut().for_each(|target| target.measure(blur));
}

/// A camera with the pose of another and a longer lens.
fn like(given: &Camera, posed: &Camera, focal: f64) -> Camera {
    let Camera { rotation, translation, .. } = posed.clone();
    Camera { rotation, translation, lens: longer(given.lens, focal), ..given.clone() }
}
