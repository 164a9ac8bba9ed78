//! Many objects whose views are prepared once and kept.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use datasets::{Dataset, Entry, Layout, ReadOptions, Subsets, Truth, View, Views};
use train::{DataError, Fingerprint};

use crate::parts::identity;

/// Bytes of views that are kept at most; what is beyond is read again each time.
const BUDGET: usize = 6 << 30;

/// What was made of views so far, within a budget.
#[derive(Debug)]
pub(crate) struct Kept<T> {
    places: Vec<Vec<OnceLock<Arc<T>>>>,
    bytes: AtomicUsize,
    budget: usize,
}

impl<T: Stored> Kept<T> {
    /// Nothing yet; `budget` bytes at most.
    pub(crate) fn new(entries: &[Entry], budget: usize) -> Self {
        let places = |entry: &Entry| (0..entry.views).map(|_| OnceLock::new()).collect();
        let places = entries.iter().map(places).collect();
        Self { places, bytes: AtomicUsize::new(0), budget }
    }

    /// What is kept of a view.
    pub(crate) fn get(&self, [object, view]: [usize; 2]) -> Option<Arc<T>> {
        self.places[object][view].get().map(Arc::clone)
    }

    /// Keeps what was made of a view if there is room.
    pub(crate) fn keep(&self, [object, view]: [usize; 2], made: &Arc<T>) {
        let bytes = made.bytes();
        // Another thread may have been faster, with the same.
        let room = self.bytes.load(Ordering::Relaxed) + bytes <= self.budget;
        if room && self.places[object][view].set(Arc::clone(made)).is_ok() {
            self.bytes.fetch_add(bytes, Ordering::Relaxed);
        }
    }
}

/// A dataset, and the views of it that were prepared so far. What is returned does not depend on
/// what is kept.
#[derive(Debug)]
pub(crate) struct ViewCache<T> {
    dataset: Box<dyn Dataset>,
    options: ReadOptions,
    kept: Kept<T>,
}

/// A view as a system takes it.
pub(crate) trait Stored: Sized {
    /// Bytes of its arrays.
    fn bytes(&self) -> usize;
}

impl<T: Stored> ViewCache<T> {
    pub(crate) fn new(dataset: Box<dyn Dataset>, options: ReadOptions) -> Self {
        let kept = Kept::new(dataset.entries(), BUDGET);
        Self { dataset, options, kept }
    }

    /// The same with nothing kept: what is made of views is about to change.
    pub(crate) fn forgetting(self) -> Self {
        Self::new(self.dataset, self.options)
    }

    /// How many views an object has.
    pub(crate) fn count(&self, object: usize) -> usize {
        self.dataset.entries()[object].views
    }

    /// The named views of an object, in this order, each called after its object too.
    pub(crate) fn views(
        &self,
        object: usize,
        which: &[usize],
        prepare: &dyn Fn(&View) -> Result<T, DataError>,
    ) -> Result<Vec<Arc<T>>, DataError> {
        // Looked up once: what another thread keeps meanwhile must not change who is missing.
        let mut found: Vec<Option<Arc<T>>> =
            which.iter().map(|&view| self.kept.get([object, view])).collect();
        let missing: Vec<usize> = (0..which.len()).filter(|&i| found[i].is_none()).collect();
        if !missing.is_empty() {
            let asked: Vec<usize> = missing.iter().map(|&i| which[i]).collect();
            let views = self
                .dataset
                .views(object, Some(&asked), &self.options, &|_, _| ())
                .map_err(DataError::read)?;
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
                self.kept.keep([object, which[i]], &prepared);
                found[i] = Some(prepared);
            }
        }
        Ok(found.into_iter().flatten().collect())
    }

    /// All views of an object as they are, without what is kept.
    pub(crate) fn whole(&self, object: usize) -> Result<Views, DataError> {
        self.dataset.views(object, None, &self.options, &|_, _| ()).map_err(DataError::read)
    }

    /// What is known of the true shape, in the world of the cameras.
    pub(crate) fn truth(&self, object: usize) -> Result<Truth, DataError> {
        self.dataset.truth(object).map_err(DataError::read)
    }

    /// Objects with views, parted as [`Subsets::of`] does.
    ///
    /// # Errors
    /// If no object has a view, or one is in two subsets.
    pub(crate) fn parts(&self, hold_out: Option<usize>) -> Result<Subsets, DataError> {
        let entries = self.dataset.entries();
        if entries.iter().all(|entry| entry.views == 0) {
            let root = self.dataset.root().display();
            return Err(DataError::Unfit(format!("{root}: none of its objects has a view")));
        }
        let mut parts = Subsets::of(entries, hold_out).map_err(DataError::read)?;
        // Its folders part images of the same few objects, and stand for categories here.
        if self.dataset.layout() == Layout::Bop
            && !(parts.train.is_empty() || parts.test.is_empty())
        {
            let text = "BOP parts images, not objects: what is scored may be objects that are trained on, in other images";
            parts.warnings.push(text.to_owned());
        }
        Ok(parts)
    }

    /// See [`identity`](crate::parts::identity).
    pub(crate) fn identity(&self, object: usize) -> u64 {
        identity(&self.dataset.entries()[object])
    }

    /// A number that other names or counts of views change.
    pub(crate) fn fingerprint(&self) -> Fingerprint {
        self.dataset.entries().iter().fold(Fingerprint::new(), |hash, entry| {
            let hash = hash.with(entry.category.as_bytes()).with(entry.name.as_bytes());
            hash.with(&entry.views.to_le_bytes())
        })
    }

    /// What the dataset says of its objects.
    pub(crate) fn entries(&self) -> &[Entry] {
        self.dataset.entries()
    }
}
