//! Memory of one kind that tasks lend from each other.

use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Memory of one kind that tasks lend from each other, so that it is allocated once and stays hot.
#[derive(Debug)]
pub(crate) struct ScratchPool<T>(Arc<Mutex<Vec<T>>>);

impl<T> Clone for ScratchPool<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T> Default for ScratchPool<T> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<T> ScratchPool<T> {
    pub(crate) fn give(&self, spare: T) {
        self.lock().push(spare);
    }

    pub(crate) fn lock(&self) -> MutexGuard<'_, Vec<T>> {
        // A panic elsewhere does not make scratch memory any worse.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T: Default> ScratchPool<T> {
    /// Calls `f` with scratch of unknown content.
    pub(crate) fn with<R>(&self, f: impl FnOnce(&mut T) -> R) -> R {
        let mut own = self.take();
        let result = f(&mut own);
        self.give(own);
        result
    }

    /// Scratch of unknown content, which comes back on drop.
    pub(crate) fn lend(&self) -> Lent<T> {
        Lent { own: self.take(), pool: self.clone() }
    }

    fn take(&self) -> T {
        self.lock().pop().unwrap_or_default()
    }
}

/// Scratch in the hands of an operation, until the tape drops it.
#[derive(Debug)]
pub(crate) struct Lent<T: Default> {
    own: T,
    pool: ScratchPool<T>,
}

impl<T: Default> Deref for Lent<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.own
    }
}

impl<T: Default> DerefMut for Lent<T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.own
    }
}

impl<T: Default> Drop for Lent<T> {
    fn drop(&mut self) {
        self.pool.give(std::mem::take(&mut self.own));
    }
}
