//! One pass of an optimiser over one parameter.

use rayon::prelude::*;

use crate::Real;
use crate::kernels::elementwise::{CHUNK, PARALLEL_FROM};
use crate::kernels::simd::clones;

/// The numbers of one Adam step, corrections for the start included.
#[derive(Clone, Copy, Debug)]
pub struct AdamStep<F> {
    /// Decay of the first moment.
    pub beta1: F,
    /// Decay of the second moment.
    pub beta2: F,
    /// `lr / (1 - beta1ᵗ)`.
    pub step: F,
    /// `sqrt(1 - beta2ᵗ)`.
    pub correction: F,
    /// Added to the root of the second moment.
    pub epsilon: F,
    /// Weight decay that is added to the gradient (Adam).
    pub coupled_decay: F,
    /// What the weight is multiplied by first (AdamW): `1 - lr * decay`.
    pub shrink: F,
}

#[inline(always)]
fn adam_body<F: Real>(h: &AdamStep<F>, w: &mut [F], g: &[F], m: &mut [F], v: &mut [F]) {
    let one = F::one();
    for (((w, &g), m), v) in w.iter_mut().zip(g).zip(m).zip(v) {
        let g = g + h.coupled_decay * *w;
        *m = h.beta1 * *m + (one - h.beta1) * g;
        *v = h.beta2 * *v + (one - h.beta2) * g * g;
        *w = h.shrink * *w - h.step * *m / (v.sqrt() / h.correction + h.epsilon);
    }
}

clones!(fn adam_chunk[F: Real](h: &AdamStep<F>, w: &mut [F], g: &[F], m: &mut [F], v: &mut [F]) = adam_body);

/// One step of Adam or AdamW on `w` with gradient `g` and moments `m`, `v`, all in one pass.
pub fn adam<F: Real>(h: &AdamStep<F>, w: &mut [F], g: &[F], m: &mut [F], v: &mut [F]) {
    if w.len() < PARALLEL_FROM {
        return adam_chunk(h, w, g, m, v);
    }
    let weights = w.par_chunks_mut(CHUNK).zip(g.par_chunks(CHUNK));
    let moments = m.par_chunks_mut(CHUNK).zip(v.par_chunks_mut(CHUNK));
    weights.zip(moments).for_each(|((w, g), (m, v))| adam_chunk(h, w, g, m, v));
}

/// The numbers of one SGD step.
#[derive(Clone, Copy, Debug)]
pub struct SgdStep<F> {
    /// Learning rate.
    pub lr: F,
    /// Decay of the velocity.
    pub momentum: F,
    /// Added to the gradient, times the weight.
    pub decay: F,
    /// Whether to look ahead along the velocity.
    pub nesterov: bool,
}

#[inline(always)]
fn sgd_body<F: Real>(h: &SgdStep<F>, w: &mut [F], g: &[F], v: &mut [F]) {
    for ((w, &g), v) in w.iter_mut().zip(g).zip(v) {
        let g = g + h.decay * *w;
        *v = h.momentum * *v + g;
        let step = if h.nesterov { g + h.momentum * *v } else { *v };
        *w -= h.lr * step;
    }
}

clones!(fn sgd_chunk[F: Real](h: &SgdStep<F>, w: &mut [F], g: &[F], v: &mut [F]) = sgd_body);

/// One step of SGD on `w` with gradient `g` and velocity `v`.
pub fn sgd<F: Real>(h: &SgdStep<F>, w: &mut [F], g: &[F], v: &mut [F]) {
    if w.len() < PARALLEL_FROM {
        return sgd_chunk(h, w, g, v);
    }
    let chunks = w.par_chunks_mut(CHUNK).zip(g.par_chunks(CHUNK)).zip(v.par_chunks_mut(CHUNK));
    chunks.for_each(|((w, g), v)| sgd_chunk(h, w, g, v));
}
