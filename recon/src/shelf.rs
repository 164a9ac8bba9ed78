//! Many objects whose views are prepared once and kept.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use datasets::{Dataset, Entry, ReadOptions, Truth, View};

use crate::train::DataError;

/// Bytes of views that are kept at most; what is beyond is read again each time.
const BUDGET: usize = 6 << 30;

/// A dataset, and the views of it that were prepared so far. What is returned does not depend on
/// what is kept.
#[derive(Debug)]
pub(crate) struct Shelf<T> {
    dataset: Box<dyn Dataset>,
    options: ReadOptions,
    kept: Vec<Vec<OnceLock<Arc<T>>>>,
    bytes: AtomicUsize,
}

/// A view as a system takes it.
pub(crate) trait Stored: Sized {
    /// Bytes of its arrays.
    fn bytes(&self) -> usize;
}

impl<T: Stored> Shelf<T> {
    pub(crate) fn new(dataset: Box<dyn Dataset>, options: ReadOptions) -> Self {
        let places = |views: usize| (0..views).map(|_| OnceLock::new()).collect();
        let kept = dataset.entries().iter().map(|entry| places(entry.views)).collect();
        Self { dataset, options, kept, bytes: AtomicUsize::new(0) }
    }

    /// How many views an object has.
    pub(crate) fn count(&self, object: usize) -> usize {
        self.kept[object].len()
    }

    /// The named views of an object, in this order, each called after its object too.
    pub(crate) fn views(
        &self,
        object: usize,
        which: &[usize],
        prepare: &dyn Fn(&View) -> Result<T, DataError>,
    ) -> Result<Vec<Arc<T>>, DataError> {
        let places = &self.kept[object];
        // Looked up once: what another thread keeps meanwhile must not change who is missing.
        let mut found: Vec<Option<Arc<T>>> =
            which.iter().map(|&view| places[view].get().map(Arc::clone)).collect();
        let missing: Vec<usize> = (0..which.len()).filter(|&i| found[i].is_none()).collect();
        if !missing.is_empty() {
            let asked: Vec<usize> = missing.iter().map(|&i| which[i]).collect();
            let views = self.dataset.views(object, Some(&asked), &self.options, &|_, _| ())?;
            let name = &self.dataset.entries()[object].name;
            if views.len() < asked.len() {
                let text = format!(
                    "{name}: {} of {} views can be read; training takes whole objects",
                    views.len(),
                    asked.len()
                );
                return Err(DataError::Unfit(text));
            }
            for (&i, mut view) in missing.iter().zip(views.views) {
                view.name = format!("{name} view {}", view.name);
                let prepared = Arc::new(prepare(&view)?);
                self.keep(&places[which[i]], &prepared);
                found[i] = Some(prepared);
            }
        }
        Ok(found.into_iter().flatten().collect())
    }

    fn keep(&self, place: &OnceLock<Arc<T>>, prepared: &Arc<T>) {
        let bytes = prepared.bytes();
        // Another thread may have been faster, with the same.
        let room = self.bytes.load(Ordering::Relaxed) + bytes <= BUDGET;
        if room && place.set(Arc::clone(prepared)).is_ok() {
            self.bytes.fetch_add(bytes, Ordering::Relaxed);
        }
    }

    /// What is known of the true shape, in the world of the cameras.
    pub(crate) fn truth(&self, object: usize) -> Result<Truth, DataError> {
        Ok(self.dataset.truth(object)?)
    }

    /// What the dataset says of its objects.
    pub(crate) fn entries(&self) -> &[Entry] {
        self.dataset.entries()
    }
}
