//! Memory that is used again.

use std::sync::Arc;

use autodiff_lite::Real;

use crate::Fragments;
use crate::kernels::texture::Sorted;
use crate::kernels::visibility::Planes;
use crate::kernels::{antialias, silhouette};
use crate::scratch_pool::ScratchPool;

/// Memory that rasterising and its operations need between their passes, kept for the next time.
///
/// Nothing in it has a meaning once a call has returned and a tape was reset. Cloning gives another
/// handle to the same memory. A [`Renderer`](crate::Renderer) has its own; several of them may
/// [share](crate::Renderer::with_scratch) one, from any number of threads.
#[derive(Clone, Debug, Default)]
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
