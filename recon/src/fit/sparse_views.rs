//! Few views leave a visual hull that is much larger than the object. A smooth surface that meets their masks is nearer to it: a mesh
//! is not blown up against that hull then, and does not start as it where a sphere comes as near to the masks.

use super::{FitConfig, FitError, Order, Run, Shape};

/// The mask IoU at which a sphere meets the masks.
const MEETS: f64 = 0.97;

impl Run<'_, '_> {
    /// A sphere fitted up to the level before the last, in the place of a hull that few views leave much larger than the object is;
    /// `None` if it does not meet the masks.
    pub(super) fn sphere_instead(
        &mut self,
        order: &mut Order,
        config: &FitConfig,
    ) -> Result<Option<Shape>, FitError> {
        if config.start_level >= config.level {
            return Ok(None);
        }
        let mut shape = Shape::sphere(config.start_level, config);
        let levels = config.start_level..config.level;
        self.total += levels.len() * config.steps;
        for level in levels {
            if level > config.start_level {
                shape = shape.subdivided(config);
            }
            let name = format!("level {level}");
            self.stage(&name, shape.positions.len(), shape.faces.len());
            self.level(&mut shape, order, config)?;
            self.lap(&name);
            if self.ask_cancelled() {
                break;
            }
        }
        Ok((shape.mask_iou(&self.train) >= MEETS).then_some(shape))
    }
}
