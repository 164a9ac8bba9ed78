//! Which views a fit uses.

use datasets::Views;

use super::config::FitConfig;
use super::error::FitError;

/// The views that a mesh is fitted to, those that it is scored on, and those that say nothing.
pub(super) struct Selection {
    /// Indices of the views that the mesh is fitted to.
    pub(super) train: Vec<usize>,
    /// Indices of those that are held out.
    pub(super) held_out: Vec<usize>,
    /// Names of those that are left out, since their mask is empty.
    pub(super) empty: Vec<String>,
}

impl Selection {
    /// Chooses among views, each of which must be valid.
    pub(super) fn of(views: &Views, config: &FitConfig) -> Result<Self, FitError> {
        if views.is_empty() {
            return Err(FitError::NoViews);
        }
        for view in &views.views {
            view.validate()?;
        }
        let held_back = views.split(config.hold_out).held_out;
        let mut found = Self { train: Vec::new(), held_out: Vec::new(), empty: Vec::new() };
        for (index, view) in views.views.iter().enumerate() {
            if view.mask.data.iter().all(|&m| m == 0) {
                found.empty.push(view.name.clone());
            } else if held_back.binary_search(&index).is_ok() {
                found.held_out.push(index);
            } else {
                found.train.push(index);
            }
        }
        found.suffices(views, config).map(|()| found)
    }

    /// Whether there is enough to learn a shape from.
    fn suffices(&self, views: &Views, config: &FitConfig) -> Result<(), FitError> {
        let count = views.len();
        if self.empty.len() == count {
            return Err(FitError::EmptyMasks { views: count });
        }
        if views.views.iter().all(|view| view.mask.data.iter().all(|&m| m != 0)) {
            return Err(FitError::FullMasks { views: count });
        }
        if self.train.len() < 2 {
            let (remaining, hold_out) = (self.train.len(), config.hold_out);
            return Err(FitError::TooFewViews { remaining, views: count, hold_out });
        }
        Ok(())
    }

    /// What is to be said of it.
    pub(super) fn remark(&self) -> Option<String> {
        let said =
            || format!("left out, since their mask is empty: views {}", self.empty.join(", "));
        (!self.empty.is_empty()).then(said)
    }
}
