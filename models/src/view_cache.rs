//! Many objects whose views are prepared once and kept.

use std::collections::{BTreeMap, btree_map};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

use datasets::{Dataset, Entry, Layout, ReadOptions, Subsets, Truth, View, Views};
use train::{DataError, Fingerprint};

use crate::parts::identity;

/// Bytes of what is made of views that are kept at most; what is beyond is made again each time.
const BUDGET: usize = 6 << 30;

/// What was made of views so far, within a budget.
#[derive(Debug)]
pub(crate) struct Kept<T> {
    /// Of each object what was made of its views: a list may count more of them than can ever be read.
    objects: Vec<RwLock<BTreeMap<usize, Arc<T>>>>,
    bytes: AtomicUsize,
    budget: usize,
}

impl<T: Stored> Kept<T> {
    /// Nothing yet; `budget` bytes at most.
    pub(crate) fn new(entries: &[Entry], budget: usize) -> Self {
        let objects = entries.iter().map(|_| RwLock::default()).collect();
        Self { objects, bytes: AtomicUsize::new(0), budget }
    }

    /// What is kept of a view.
    pub(crate) fn get(&self, [object, view]: [usize; 2]) -> Option<Arc<T>> {
        let views = self.objects[object].read().unwrap_or_else(PoisonError::into_inner);
        views.get(&view).map(Arc::clone)
    }

    /// Keeps what was made of a view if there is room.
    pub(crate) fn keep(&self, [object, view]: [usize; 2], made: &Arc<T>) {
        let bytes = made.bytes();
        // Room is taken first: other threads keep theirs at the same time.
        let with = |taken: usize| taken.checked_add(bytes).filter(|&all| all <= self.budget);
        if self.bytes.fetch_update(Ordering::Relaxed, Ordering::Relaxed, with).is_err() {
            return;
        }
        let mut views = self.objects[object].write().unwrap_or_else(PoisonError::into_inner);
        match views.entry(view) {
            btree_map::Entry::Vacant(place) => drop(place.insert(Arc::clone(made))),
            // Another thread was faster, with the same.
            btree_map::Entry::Occupied(_) => {
                self.bytes.fetch_sub(bytes, Ordering::Relaxed);
            }
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

    /// See [`identity`].
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq)]
    struct Made(usize);

    impl Stored for Made {
        fn bytes(&self) -> usize {
            self.0
        }
    }

    /// A list that counts more views than there is memory costs nothing until they are read.
    #[test]
    fn what_is_kept_follows_what_is_made_and_not_what_is_counted() {
        let entries = [usize::MAX, 2].map(|views| Entry { views, ..Entry::default() });
        let kept = Kept::new(&entries, 10);
        let place = [0, 900_000_000];
        assert_eq!(kept.get(place), None);
        kept.keep(place, &Arc::new(Made(6)));
        kept.keep(place, &Arc::new(Made(4)));
        assert_eq!(*kept.get(place).unwrap(), Made(6));
        kept.keep([1, 1], &Arc::new(Made(5)));
        assert_eq!(kept.get([1, 1]), None);
        kept.keep([1, 1], &Arc::new(Made(4)));
        assert_eq!(*kept.get([1, 1]).unwrap(), Made(4));
    }

    /// One waits to put its view down while another asks for room.
    #[test]
    fn threads_share_the_budget() {
        let entries = [2, 2].map(|views| Entry { views, ..Entry::default() });
        let kept = Kept::new(&entries, 10);
        std::thread::scope(|scope| {
            let held = kept.objects[0].write().unwrap();
            let waits = scope.spawn(|| kept.keep([0, 0], &Arc::new(Made(6))));
            // It has taken its room before it waits; what takes none until then would never end this by itself.
            let begun = std::time::Instant::now();
            while kept.bytes.load(Ordering::Relaxed) == 0 && begun.elapsed().as_secs() < 2 {
                std::thread::yield_now();
            }
            kept.keep([1, 0], &Arc::new(Made(6)));
            drop(held);
            waits.join().unwrap();
        });
        let there = [[0, 0], [1, 0]].map(|place| kept.get(place).is_some());
        assert_eq!((there, kept.bytes.load(Ordering::Relaxed)), ([true, false], 6));
        // What is there already takes no room twice.
        kept.keep([0, 0], &Arc::new(Made(4)));
        assert_eq!(kept.bytes.load(Ordering::Relaxed), 6);
    }
}
