//! Decoded views, kept within a budget of memory.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use crate::dataset::Dataset;
use crate::error::ReadViewsError;
use crate::options::ReadOptions;
use crate::view::View;

/// Views of a dataset, decoded once and kept as long as there is room.
///
/// Where there is none the views that were asked for longest ago go. What is returned never
/// depends on what is kept. Shared between threads: two that ask for the same view at the same
/// time may both read it.
#[derive(Debug)]
pub struct ViewCache {
    dataset: Arc<dyn Dataset>,
    options: ReadOptions,
    budget: usize,
    kept: Mutex<Kept>,
}

/// An object's number, and that of one of its views.
type Key = (usize, usize);

#[derive(Debug, Default)]
struct Kept {
    views: BTreeMap<Key, (u64, Arc<View>)>,
    /// By when they were last asked for.
    turns: BTreeMap<u64, Key>,
    /// The next turn.
    turn: u64,
    bytes: usize,
}

impl ViewCache {
    /// Keeps at most `budget` bytes of pixels of this dataset's views.
    pub fn new(dataset: Arc<dyn Dataset>, options: ReadOptions, budget: usize) -> Self {
        Self { dataset, options, budget, kept: Mutex::default() }
    }

    /// The dataset behind it.
    pub fn dataset(&self) -> &Arc<dyn Dataset> {
        &self.dataset
    }

    /// Views of one object, in the order asked for; those that are not kept are read together.
    ///
    /// # Errors
    /// As [`Dataset::views`] of those that are read.
    /// # Panics
    /// If the object or a view does not exist, or the options leave a view out (`allow_missing`).
    pub fn views(&self, object: usize, which: &[usize]) -> Result<Vec<Arc<View>>, ReadViewsError> {
        let mut found: BTreeMap<usize, Arc<View>> = BTreeMap::new();
        {
            let mut kept = self.lock();
            for &view in which {
                if let Some(there) = kept.get((object, view)) {
                    found.insert(view, there);
                }
            }
        }
        let mut missing: Vec<usize> =
            which.iter().copied().filter(|view| !found.contains_key(view)).collect();
        missing.sort_unstable();
        missing.dedup();
        if !missing.is_empty() {
            // Not under the lock: others go on meanwhile.
            let read = self.dataset.views(object, Some(&missing), &self.options, &|_, _| {})?.views;
            assert_eq!(read.len(), missing.len(), "ViewCache: views left out of object {object}");
            let mut kept = self.lock();
            for (view, read) in missing.into_iter().zip(read) {
                let read = Arc::new(read);
                kept.put((object, view), &read, self.budget);
                found.insert(view, read);
            }
        }
        Ok(which.iter().map(|view| Arc::clone(&found[view])).collect())
    }

    /// Bytes of pixels that are kept now: never more than the budget.
    pub fn bytes(&self) -> usize {
        self.lock().bytes
    }

    /// How many views are kept now.
    pub fn len(&self) -> usize {
        self.lock().views.len()
    }

    /// Whether nothing is kept.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A thread that panicked here has left nothing half done.
    fn lock(&self) -> std::sync::MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Kept {
    fn get(&mut self, key: Key) -> Option<Arc<View>> {
        let next = self.turn;
        let (turn, view) = self.views.get_mut(&key)?;
        self.turns.remove(turn);
        self.turns.insert(next, key);
        *turn = next;
        self.turn += 1;
        Some(Arc::clone(view))
    }

    fn put(&mut self, key: Key, view: &Arc<View>, budget: usize) {
        let bytes = view.bytes();
        // Another thread was faster, or there will never be room.
        if self.views.contains_key(&key) || bytes > budget {
            return;
        }
        while self.bytes > budget - bytes {
            let Some((_, oldest)) = self.turns.pop_first() else { break };
            if let Some((_, gone)) = self.views.remove(&oldest) {
                self.bytes -= gone.bytes();
            }
        }
        self.bytes += bytes;
        self.views.insert(key, (self.turn, Arc::clone(view)));
        self.turns.insert(self.turn, key);
        self.turn += 1;
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::dataset::Entry;
    use crate::view::{Layout, Views};
    use mesh_core::{ByteImage, Camera};
    use std::path::Path;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Two objects of ten views of 4 x 4 pixels, 64 bytes each, and how many were read.
    #[derive(Debug, Default)]
    struct Counted {
        entries: [Entry; 2],
        read: AtomicUsize,
    }

    impl Dataset for Counted {
        fn layout(&self) -> Layout {
            Layout::Memory
        }
        fn root(&self) -> &Path {
            Path::new("memory")
        }
        fn entries(&self) -> &[Entry] {
            &self.entries
        }
        fn views(
            &self,
            object: usize,
            which: Option<&[usize]>,
            _: &ReadOptions,
            _: &(dyn Fn(usize, usize) + Sync),
        ) -> Result<Views, ReadViewsError> {
            let view = |&i: &usize| {
                self.read.fetch_add(1, Ordering::SeqCst);
                View {
                    name: format!("{object} {i}"),
                    color: ByteImage::new(4, 4, 3),
                    mask: ByteImage::new(4, 4, 1),
                    camera: Camera::look_at([0.0, 0.0, 3.0], [0.0; 3], [0.0, 1.0, 0.0], 1.0, 4, 4),
                    depth: None,
                }
            };
            if which.unwrap().contains(&99) {
                return Err(ReadViewsError::field("memory", "view", "99", "less"));
            }
            let views = which.unwrap().iter().map(view).collect();
            let (source, layout, warnings) = ("memory".into(), Layout::Memory, Vec::new());
            Ok(Views { views, source, layout, warnings })
        }
    }

    fn names(cache: &ViewCache, object: usize, which: &[usize]) -> Vec<String> {
        cache.views(object, which).unwrap().iter().map(|v| v.name.clone()).collect()
    }

    #[test]
    fn views_are_read_once_as_long_as_there_is_room() {
        let dataset = Arc::new(Counted::default());
        let cache = ViewCache::new(dataset.clone(), ReadOptions::default(), 3 * 64 + 63);
        let read = || dataset.read.swap(0, Ordering::SeqCst);
        assert!(cache.is_empty());
        assert_eq!(names(&cache, 0, &[2, 1, 2]), ["0 2", "0 1", "0 2"]);
        assert_eq!((read(), cache.len(), cache.bytes()), (2, 2, 128));
        assert_eq!(names(&cache, 0, &[1]), ["0 1"]);
        assert_eq!(names(&cache, 1, &[1]), ["1 1"]);
        assert_eq!((read(), cache.bytes()), (1, 192));
        // View 2 of object 0 was asked for longest ago.
        assert_eq!(names(&cache, 1, &[5]), ["1 5"]);
        assert_eq!((read(), cache.bytes()), (1, 192));
        assert_eq!(names(&cache, 0, &[1]), ["0 1"]);
        assert_eq!(read(), 0);
        assert_eq!(names(&cache, 0, &[2]), ["0 2"]);
        assert_eq!(read(), 1);
        assert!(cache.views(0, &[3, 99]).is_err());
        // More at once than there is room for.
        assert_eq!(names(&cache, 0, &[0, 1, 2, 3, 4]).len(), 5);
        assert!(cache.bytes() <= 3 * 64 + 63);
        let none = ViewCache::new(dataset.clone(), ReadOptions::default(), 63);
        assert_eq!(names(&none, 0, &[7]), ["0 7"]);
        assert!(none.is_empty());
    }

    #[test]
    fn threads_share_it() {
        let cache = ViewCache::new(Arc::new(Counted::default()), ReadOptions::default(), 5 * 64);
        std::thread::scope(|scope| {
            for thread in 0..4_usize {
                let cache = &cache;
                scope.spawn(move || {
                    for i in 0..200 {
                        let (object, view) = (i % 2, (i * 7 + thread) % 10);
                        assert_eq!(names(cache, object, &[view]), [format!("{object} {view}")]);
                    }
                });
            }
        });
        assert!(cache.bytes() <= 5 * 64 && cache.len() == cache.bytes() / 64);
    }
}
