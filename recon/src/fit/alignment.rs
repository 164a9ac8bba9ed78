//! When cameras are refined in the course of a fit, and whether that is kept.

use datasets::View;
use mesh_core::Camera;

use super::cameras::{Cameras, longer};
use super::target::Target;
use super::{Event, FitConfig, FitError, Order, Run, Shape, Step};

/// Rounds of cameras and shape in turn: the first ones, and those after each level from then on.
const ROUNDS: [usize; 2] = [8, 3];
/// Steps of the shape in a round.
const STEPS: usize = 10;
/// Their length, as a share of the longest.
const RATE: f32 = 0.2;
/// Cameras are kept if the distance of outlines and masks falls at least to this share.
const HELPS: f64 = 0.8;
/// Fewer views leave too much open.
const FEWEST: usize = 4;

/// What became of the cameras of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct RefinedCameras {
    /// The cameras of all views, in their order. Views that are held out keep their pose, since it must not be taken from the masks
    /// that score; the focal length, which all views share, is refined in them too.
    pub cameras: Vec<Camera>,
    /// The focal length, times the one given.
    pub focal: f64,
    /// How far the outlines moved in the images that were fitted, root mean square in pixels.
    pub motion: f64,
    /// Distance of the outlines to the masks before and after, root mean square in pixels.
    pub distance: [f64; 2],
}

/// Cameras that are being refined.
#[derive(Clone, Debug)]
pub(super) struct Alignment {
    cameras: Cameras,
    /// Those of the held-out views as they were given, in the targets' boxes.
    held_out: Vec<Camera>,
    distance: [f64; 2],
}

impl Run<'_> {
    /// Refines the cameras for the shape that a level ended with, and keeps them if that helps.
    pub(super) fn align(
        &mut self,
        shape: &mut Shape,
        order: &mut Order,
        total: usize,
        config: &FitConfig,
    ) -> Result<(), FitError> {
        if !config.refine_cameras || self.train.len() < FEWEST || self.fitted.interrupted {
            return Ok(());
        }
        let placement = self.fitted.placement;
        let first = self.alignment.is_none();
        let before = shape.distance(&self.train);
        let mut alignment = self.alignment.take().unwrap_or_else(|| Alignment {
            cameras: Cameras::of(&self.train, placement.center, placement.radius),
            held_out: self.held_out.iter().map(|target| target.camera().clone()).collect(),
            distance: [before; 2],
        });
        let start = shape.positions.clone();
        for round in 0..ROUNDS[usize::from(!first)] {
            alignment.cameras.improve(shape, &mut self.train);
            for _ in 0..STEPS {
                if self.fitted.interrupted {
                    break;
                }
                let rate = RATE * config.learning_rate / (round + 1) as f32;
                let step = self.fitted.history.len() + 1;
                let edge = shape.mean_edge();
                let stride = |target: &Target| target.lines_between_samples(edge);
                let terms = shape.step(&self.train, order.next(), stride, config, rate, step)?;
                let terms = vec![("silhouette", terms.outline.rms()), ("bending", terms.bending)];
                let report = Step { step, total, terms };
                self.fitted.history.push(report.clone());
                self.tell(Event::Step(report));
            }
        }
        let after = shape.distance(&self.train);
        if first && !(after < HELPS * before) {
            alignment.cameras.give_back(&mut self.train);
            shape.place(start);
            return Ok(());
        }
        alignment.distance[1] = after;
        for (target, given) in self.held_out.iter_mut().zip(&alignment.held_out) {
            let lens = longer(given.lens, alignment.cameras.focal);
            target.set_camera(Camera { lens, ..given.clone() });
            target.place(placement.center, placement.radius);
        }
        self.alignment = Some(alignment);
        Ok(())
    }

    /// What became of the cameras, for the shape at the end.
    pub(super) fn refined_cameras(&self, shape: &Shape, views: &[View]) -> Option<RefinedCameras> {
        let Alignment { cameras, distance, .. } = self.alignment.as_ref()?;
        let focal = cameras.focal;
        let with_lens = |view: &View| {
            let lens = longer(view.camera.lens, focal);
            Camera { lens, ..view.camera.clone() }
        };
        let mut refined: Vec<Camera> = views.iter().map(with_lens).collect();
        for (&i, target) in self.fitted.train_views.iter().zip(&self.train) {
            let Camera { rotation, translation, .. } = target.camera().clone();
            (refined[i].rotation, refined[i].translation) = (rotation, translation);
        }
        let motion = cameras.motion(shape, &self.train);
        Some(RefinedCameras { cameras: refined, focal, motion, distance: *distance })
    }
}

/// The most steps that refining takes in a fit of so many levels.
pub(super) fn most_steps(levels: usize) -> usize {
    levels * ROUNDS[0].max(ROUNDS[1]) * STEPS
}
