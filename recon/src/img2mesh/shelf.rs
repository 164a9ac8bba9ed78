//! Many objects whose views are prepared once and kept.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use datasets::{Dataset, ReadOptions};
use mesh_core::TriMesh;

use super::config::Img2MeshConfig;
use super::prepared::Prepared;
use crate::train::DataError;

/// Bytes of views that are kept at most; what is beyond is read again each time.
const BUDGET: usize = 6 << 30;

/// A dataset, and the views of it that were prepared so far. What is returned does not depend on
/// what is kept.
#[derive(Debug)]
pub(super) struct Shelf {
    dataset: Box<dyn Dataset>,
    options: ReadOptions,
    kept: Vec<Vec<OnceLock<Arc<Prepared>>>>,
    bytes: AtomicUsize,
}

impl Shelf {
    pub(super) fn new(dataset: Box<dyn Dataset>, options: ReadOptions) -> Self {
        let places = |views: usize| (0..views).map(|_| OnceLock::new()).collect();
        let kept = dataset.entries().iter().map(|entry| places(entry.views)).collect();
        Self { dataset, options, kept, bytes: AtomicUsize::new(0) }
    }

    /// How many views an object has.
    pub(super) fn count(&self, object: usize) -> usize {
        self.kept[object].len()
    }

    /// The named views of an object, in this order.
    pub(super) fn views(
        &self,
        object: usize,
        which: &[usize],
        config: &Img2MeshConfig,
        frame: [f64; 4],
    ) -> Result<Vec<Arc<Prepared>>, DataError> {
        let places = &self.kept[object];
        let missing: Vec<usize> =
            which.iter().copied().filter(|&view| places[view].get().is_none()).collect();
        let mut read = Vec::new();
        if !missing.is_empty() {
            let views = self.dataset.views(object, Some(&missing), &self.options, &|_, _| ())?;
            let name = &self.dataset.entries()[object].name;
            if views.len() < missing.len() {
                let (found, asked) = (views.len(), missing.len());
                let text = format!(
                    "{name}: {found} of {asked} views can be read; training takes whole objects"
                );
                return Err(DataError::Unfit(text));
            }
            for view in &views.views {
                let mut prepared = Prepared::new(view, config, frame)?;
                prepared.name = format!("{name} view {}", view.name);
                read.push(Arc::new(prepared));
            }
        }
        let mut read = missing.into_iter().zip(read);
        let one = |&view: &usize| {
            places[view].get().map_or_else(
                || {
                    let (view, prepared) = read.next().expect("what is not kept was read");
                    self.keep(&places[view], &prepared);
                    prepared
                },
                Arc::clone,
            )
        };
        Ok(which.iter().map(one).collect())
    }

    fn keep(&self, place: &OnceLock<Arc<Prepared>>, prepared: &Arc<Prepared>) {
        let bytes = prepared.image.len() + prepared.target.len() + prepared.mask.len();
        if self.bytes.fetch_add(bytes, Ordering::Relaxed) + bytes <= BUDGET {
            // Another thread may have been faster, with the same.
            let _ = place.set(Arc::clone(prepared));
        }
    }

    /// The true surface in the world of the cameras, where it is known.
    pub(super) fn truth(&self, object: usize) -> Result<Option<TriMesh>, DataError> {
        Ok(self.dataset.truth(object)?.mesh)
    }
}
