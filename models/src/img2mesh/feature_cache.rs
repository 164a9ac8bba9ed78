//! Features of images under an encoder that does not change.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use autodiff_lite::{Tape, Var};

use super::model::Model;
use super::prepared::Prepared;
use crate::stacked::stacked;

/// Numbers that are kept at most.
const MOST: usize = 1 << 28;

/// Features that were computed before, by image. The encoder must be the one that computed them:
/// frozen, and filled with its weights before the first image.
#[derive(Debug, Default)]
pub(super) struct FeatureCache(Mutex<HashMap<u64, Arc<[f32]>>>);

impl FeatureCache {
    /// Features of views, `[M, D]`, as constants.
    pub(super) fn of<'t>(
        &self,
        tape: &'t Tape,
        model: &Model,
        side: usize,
        views: &[Arc<Prepared>],
    ) -> Var<'t> {
        let rows: Vec<Arc<[f32]>> = views.iter().map(|view| self.one(model, side, view)).collect();
        let width = rows.first().map_or(0, |row| row.len());
        stacked(tape, rows.iter().map(|row| &row[..]), &[views.len(), width])
    }

    /// Each image by itself: beside others its last bits might differ.
    fn one(&self, model: &Model, side: usize, view: &Arc<Prepared>) -> Arc<[f32]> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner).get(&view.key).cloned();
        kept.unwrap_or_else(|| {
            let tape = Tape::eval();
            let images = super::image_tensor(&tape, side, std::slice::from_ref(view));
            let features = model.encode(images).value();
            let row = Arc::from(features.as_slice());
            self.keep(view.key, &row);
            row
        })
    }

    fn keep(&self, key: u64, row: &Arc<[f32]>) {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if (kept.len() + 1) * row.len() <= MOST {
            kept.insert(key, Arc::clone(row));
        }
    }
}
