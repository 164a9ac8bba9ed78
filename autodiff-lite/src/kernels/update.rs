//! One pass of an optimiser over one parameter.

use crate::Real;
use crate::kernels::blocks::{Shared, beside, for_each_part};
use crate::kernels::elementwise::{CHUNK, PARALLEL_FROM};
use crate::kernels::simd::clones;

/// The numbers of one Adam step, corrections for the start included.
#[derive(Clone, Copy, Debug)]
pub struct AdamStep<F> {
    /// Decay of the first moment.
    pub beta1: F,
    /// Decay of the second moment.
    pub beta2: F,
    /// `1 - beta1` and `1 - beta2`, rounded once: the difference of rounded numbers has lost digits.
    pub rests: [F; 2],
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
    let [rest1, rest2] = h.rests;
    for (((w, &g), m), v) in w.iter_mut().zip(g).zip(m).zip(v) {
        let g = g + h.coupled_decay * *w;
        *m = h.beta1 * *m + rest1 * g;
        *v = h.beta2 * *v + rest2 * g * g;
        *w = h.shrink * *w - h.step * *m / (v.sqrt() / h.correction + h.epsilon);
    }
}

clones!(fn adam_chunk[F: Real](h: &AdamStep<F>, w: &mut [F], g: &[F], m: &mut [F], v: &mut [F]) = adam_body);

/// One step of Adam or AdamW on `w` with gradient `g` and moments `m`, `v`, all in one pass.
pub fn adam<F: Real>(h: &AdamStep<F>, w: &mut [F], g: &[F], m: &mut [F], v: &mut [F]) {
    if w.len() < PARALLEL_FROM {
        return adam_chunk(h, w, g, m, v);
    }
    let (m, v) = (Shared::new(m), Shared::new(v));
    for_each_part(w, CHUNK, true, |k, w| {
        let (start, len) = (k * CHUNK, w.len());
        // SAFETY: no other part has these elements.
        let (m, v) = unsafe { (m.slice(start, len), v.slice(start, len)) };
        adam_chunk(h, w, beside(g, k, CHUNK, w), m, v);
    });
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
    let v = Shared::new(v);
    for_each_part(w, CHUNK, true, |k, w| {
        // SAFETY: no other part has these elements.
        let v = unsafe { v.slice(k * CHUNK, w.len()) };
        sgd_chunk(h, w, beside(g, k, CHUNK, w), v);
    });
}

/// The numbers of one RMSprop step.
#[derive(Clone, Copy, Debug)]
pub struct RmsPropStep<F> {
    /// Learning rate.
    pub lr: F,
    /// Decay of the mean of squares, and of the mean.
    pub alpha: F,
    /// `1 - alpha`, rounded once.
    pub rest: F,
    /// Added to the root.
    pub epsilon: F,
    /// Added to the gradient, times the weight.
    pub decay: F,
    /// Decay of the velocity.
    pub momentum: F,
    /// Whether the square of the mean is subtracted.
    pub centered: bool,
}

#[inline(always)]
fn rmsprop_body<F: Real>(
    h: &RmsPropStep<F>,
    w: &mut [F],
    g: &[F],
    v: &mut [F],
    m: &mut [F],
    a: &mut [F],
) {
    let rest = h.rest;
    for ((((w, &g), v), m), a) in w.iter_mut().zip(g).zip(v).zip(m).zip(a) {
        let g = g + h.decay * *w;
        *v = h.alpha * *v + rest * g * g;
        let mut square = *v;
        if h.centered {
            *a = h.alpha * *a + rest * g;
            // Never below zero but for rounding.
            square = (square - *a * *a).max(F::zero());
        }
        *m = h.momentum * *m + g / (square.sqrt() + h.epsilon);
        *w -= h.lr * *m;
    }
}

clones!(fn rmsprop_chunk[F: Real](h: &RmsPropStep<F>, w: &mut [F], g: &[F], v: &mut [F], m: &mut [F], a: &mut [F]) = rmsprop_body);

/// One step of RMSprop on `w` with gradient `g`, mean of squares `v`, velocity `m` and mean `a`.
pub fn rmsprop<F: Real>(h: &RmsPropStep<F>, w: &mut [F], g: &[F], [v, m, a]: [&mut [F]; 3]) {
    if w.len() < PARALLEL_FROM {
        return rmsprop_chunk(h, w, g, v, m, a);
    }
    let (v, m, a) = (Shared::new(v), Shared::new(m), Shared::new(a));
    for_each_part(w, CHUNK, true, |k, w| {
        let (start, len) = (k * CHUNK, w.len());
        // SAFETY: no other part has these elements.
        let (v, m, a) = unsafe { (v.slice(start, len), m.slice(start, len), a.slice(start, len)) };
        rmsprop_chunk(h, w, beside(g, k, CHUNK, w), v, m, a);
    });
}
