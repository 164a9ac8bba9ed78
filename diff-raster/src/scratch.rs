//! Memory that is used again.

use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use autodiff_lite::Real;

use crate::Fragments;
use crate::kernels::texture::Sorted;
use crate::kernels::visibility::Planes;
use crate::kernels::{antialias, silhouette};

/// Memory that rasterising and its operations need between their passes, kept for the next time.
///
/// Nothing in it has a meaning once a call has returned and a tape was reset. Cloning gives another
/// handle to the same memory. A [`Renderer`](crate::Renderer) has its own; several of them may
/// [share](crate::Renderer::with_scratch) one, from any number of threads.
#[derive(Clone, Debug)]
pub struct Scratch<F: Real = f32> {
    /// Fragments of earlier frames; one that nobody else holds is used again.
    fragments: ScratchPool<Arc<Fragments<F>>>,
    /// Planes of a band while it is drawn.
    pub(crate) planes: ScratchPool<Planes<F>>,
    /// What the soft silhouette keeps for its gradient.
    pub(crate) silhouettes: ScratchPool<silhouette::State<F>>,
    /// The same for the antialiased one.
    pub(crate) borders: ScratchPool<antialias::State<F>>,
    /// Sums of bands, for the gradient of interpolation.
    pub(crate) partials: ScratchPool<Vec<F>>,
    /// Pixels in the order of texels, for the gradient of textures.
    pub(crate) sorted: ScratchPool<Sorted>,
}

impl<F: Real> Default for Scratch<F> {
    fn default() -> Self {
        Self {
            fragments: ScratchPool::default(),
            planes: ScratchPool::default(),
            silhouettes: ScratchPool::default(),
            borders: ScratchPool::default(),
            partials: ScratchPool::default(),
            sorted: ScratchPool::default(),
        }
    }
}

impl<F: Real> Scratch<F> {
    /// Calls `write` with fragments that nobody else holds, and remembers them for when they are
    /// free again.
    pub(crate) fn fragments(&self, write: impl FnOnce(&mut Fragments<F>)) -> Arc<Fragments<F>> {
        let mut fragments = {
            let mut kept = self.fragments.lock();
            let free = kept.iter().position(|fragments| Arc::strong_count(fragments) == 1);
            free.map_or_else(Arc::default, |k| kept.swap_remove(k))
        };
        write(Arc::get_mut(&mut fragments).expect("this was the only handle"));
        self.fragments.give(Arc::clone(&fragments));
        fragments
    }
}

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
    fn give(&self, spare: T) {
        self.lock().push(spare);
    }

    fn lock(&self) -> MutexGuard<'_, Vec<T>> {
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
