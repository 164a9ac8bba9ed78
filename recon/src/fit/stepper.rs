//! Single steps, for benches and experiments.

use datasets::View;

use super::{config::FitConfig, error::FitError, placement, shape::Shape, target::Target};

/// A fit that is advanced step by step, at one level, over all views it was given.
///
/// [`fit`](super::fit) is what to use; this is the inside of its loop.
#[derive(Debug)]
pub struct Stepper {
    targets: Vec<Target>,
    views: Vec<usize>,
    shape: Shape,
    config: FitConfig,
    steps: usize,
}

impl Stepper {
    /// Places the icosphere of `config.start_level` for views whose masks are not empty.
    ///
    /// # Errors
    /// As [`fit`](super::fit).
    pub fn new(views: &[View], config: &FitConfig) -> Result<Self, FitError> {
        let problems = config.check();
        if !problems.is_empty() {
            return Err(FitError::Config(problems));
        }
        for view in views {
            view.validate()?;
        }
        let seen: Vec<&View> = views.iter().filter(|v| v.mask_bounds().is_some()).collect();
        let mut targets: Vec<Target> = seen.iter().filter_map(|v| config.target(v)).collect();
        if targets.len() < 2 {
            return Err(FitError::TooFewViews {
                remaining: targets.len(),
                views: views.len(),
                hold_out: None,
            });
        }
        let placement = placement::place(&seen, &mut targets)?;
        for target in &mut targets {
            target.place(placement.center, placement.radius);
        }
        let shape = Shape::sphere(config.start_level, config);
        let views = (0..targets.len()).collect();
        Ok(Self { targets, views, shape, config: config.clone(), steps: 0 })
    }

    /// Makes one step with all its losses, preconditioning and the optimiser, and every
    /// `relax-every` steps the sliding of vertices; returns the root mean square distance of the outline to the
    /// masks' edges, in pixels.
    ///
    /// # Errors
    /// [`FitError::NotFinite`].
    pub fn step(&mut self) -> Result<f64, FitError> {
        self.steps += 1;
        let terms = self.shape.step(
            &self.targets,
            &self.views,
            &self.config,
            self.config.learning_rate,
            self.steps,
        )?;
        if self.config.relax_every.is_some_and(|every| self.steps.is_multiple_of(every)) {
            self.shape.relax(self.config.relax);
        }
        Ok(terms.outline.rms())
    }
}
