//! Scaled dot-product attention of several heads, and its gradients.
//!
//! Heads are columns of the operands as they lie: head `h` of width `d` is columns
//! `h d .. (h + 1) d`. Matrix products take strides, so nothing is transposed or split. A task is
//! one head of one element of the batch and owns its part of every output.

use crate::Real;
use crate::kernels::blocks::{SERIAL_BELOW, Shared, for_each_block};
use crate::kernels::dropout::Kept;
use crate::kernels::extent::{elements, work};
use crate::kernels::gemm::Matrix;
use crate::kernels::product::gemm;
use crate::kernels::softmax::{softmax, softmax_grad};
use crate::kernels::workspace;

/// The sizes of one attention.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AttentionSizes {
    /// N.
    pub batch: usize,
    /// How many heads share out the columns.
    pub heads: usize,
    /// T of the queries.
    pub queries: usize,
    /// T of the keys and values.
    pub keys: usize,
    /// D, of all heads together.
    pub width: usize,
}

/// Queries, keys and values.
#[derive(Clone, Copy, Debug)]
pub enum AttentionOperands<'a, F> {
    /// `[N, T, 3 D]`: side by side in each row.
    Packed(&'a [F]),
    /// `[N, T, D]` each.
    Apart([&'a [F]; 3]),
}

/// Where the gradients of queries, keys and values are written, all of them whole.
#[derive(Debug)]
pub enum AttentionGradients<'a, F> {
    /// `[N, T, 3 D]`.
    Packed(&'a mut [F]),
    /// `[N, T, D]` each.
    Apart([&'a mut [F]; 3]),
}

impl AttentionSizes {
    /// Numbers of the probabilities, `[N, heads, queries, keys]`.
    ///
    /// # Panics
    /// If they are more than a slice can have.
    pub fn probabilities(&self) -> usize {
        elements(&[self.batch, self.heads, self.queries, self.keys])
    }

    /// Columns of one head.
    pub fn head(&self) -> usize {
        self.width / self.heads
    }

    fn tokens(&self, operand: usize) -> usize {
        if operand == 0 { self.queries } else { self.keys }
    }

    /// Scores are divided by the root of a head's width.
    fn scale<F: Real>(&self) -> F {
        F::from_f64(1.0 / (self.head() as f64).sqrt())
    }

    fn parallel(&self) -> bool {
        work(&[4, self.probabilities(), self.head()]) >= SERIAL_BELOW
    }

    /// Step between rows, and the first element of head `h` of element `n`, of an operand whose
    /// rows are `step` long and in which it begins at column `column`.
    fn start(&self, n: usize, h: usize, tokens: usize, [step, column]: [usize; 2]) -> usize {
        n * tokens * step + column + h * self.head()
    }

    fn layout(&self, packed: bool, operand: usize) -> [usize; 2] {
        if packed { [3 * self.width, operand * self.width] } else { [self.width, 0] }
    }
}

impl<'a, F: Real> AttentionOperands<'a, F> {
    /// One head of one operand (0 queries, 1 keys, 2 values), a row per token.
    fn head(&self, s: &AttentionSizes, operand: usize, n: usize, h: usize) -> Matrix<'a, F> {
        let (data, packed) = match *self {
            Self::Packed(all) => (all, true),
            Self::Apart(each) => (each[operand], false),
        };
        let layout = s.layout(packed, operand);
        let start = s.start(n, h, s.tokens(operand), layout);
        Matrix { data: &data[start.min(data.len())..], steps: [layout[0], 1] }
    }

    fn check(&self, s: &AttentionSizes) {
        match self {
            Self::Packed(all) => {
                assert_eq!(s.queries, s.keys);
                assert_eq!(all.len(), elements(&[s.batch, s.keys, 3, s.width]));
            }
            Self::Apart(each) => {
                for (operand, data) in each.iter().enumerate() {
                    assert_eq!(data.len(), elements(&[s.batch, s.tokens(operand), s.width]));
                }
            }
        }
    }
}

/// `y = dropout(softmax(Q Kᵀ / √d + mask)) V` for each head: `y [N, queries, D]`, the
/// probabilities before dropout `[N, heads, queries, keys]`; both are written whole. The mask is
/// `[queries, keys]` or `[N, queries, keys]`.
///
/// # Panics
/// If a slice has another length.
pub fn attention<F: Real>(
    s: &AttentionSizes,
    operands: AttentionOperands<'_, F>,
    mask: Option<&[F]>,
    kept: Option<Kept<'_, F>>,
    probabilities: &mut [F],
    y: &mut [F],
) {
    operands.check(s);
    assert_eq!(probabilities.len(), s.probabilities());
    assert_eq!(y.len(), elements(&[s.batch, s.queries, s.width]));
    let (area, d) = (elements(&[s.queries, s.keys]), s.head());
    assert!(mask.is_none_or(|m| m.len() == area || m.len() == elements(&[s.batch, area])));
    let (shared, out) = (Shared::new(probabilities), Shared::new(y));
    for_each_block(s.batch * s.heads, s.parallel(), |task| {
        let (n, h) = (task / s.heads, task % s.heads);
        // SAFETY: each task has its own part of the probabilities.
        let p = unsafe { shared.slice(task * area, area) };
        let [q, k, v] = [0, 1, 2].map(|operand| operands.head(s, operand, n, h));
        workspace::with(area, |scores: &mut [F]| {
            gemm([s.queries, d, s.keys], s.scale(), q, k.flipped(), F::zero(), scores);
            if let Some(mask) = mask {
                let mask = if mask.len() == area { mask } else { &mask[n * area..][..area] };
                scores.iter_mut().zip(mask).for_each(|(x, &m)| *x += m);
            }
            softmax(scores, s.keys, p);
            let weights: &[F] = if let Some(kept) = &kept {
                scores.copy_from_slice(p);
                kept.apply(task * area, scores);
                scores
            } else {
                p
            };
            workspace::with(s.queries * d, |head: &mut [F]| {
                let weights = Matrix::rows(weights, s.keys);
                gemm([s.queries, s.keys, d], F::one(), weights, v, F::zero(), head);
                let layout = [s.width, 0];
                // SAFETY: the columns of one head of one element belong to one task.
                unsafe { place(out, s.start(n, h, s.queries, layout), s.width, d, head) };
            });
        });
    });
}

/// Writes the rows of `head`, `d` long, `step` apart from `start` on.
///
/// # Safety
/// No other task touches them.
unsafe fn place<F: Real>(out: Shared<F>, start: usize, step: usize, d: usize, head: &[F]) {
    if d == 0 {
        return;
    }
    for (i, row) in head.chunks_exact(d).enumerate() {
        // SAFETY: the caller's promise.
        unsafe { out.slice(start + i * step, d) }.copy_from_slice(row);
    }
}

/// The gradients of queries, keys and values from that of [`attention`]'s output.
///
/// ```text
/// gV = Pₖᵀ g    gP = (g Vᵀ) ∘ kept    gS = P (gP - Σ P gP)    gQ = gS K / √d    gK = gSᵀ Q / √d
/// ```
///
/// # Panics
/// If a slice has another length, or gradients do not lie as the operands do.
pub fn attention_grad<F: Real>(
    s: &AttentionSizes,
    operands: AttentionOperands<'_, F>,
    kept: Option<Kept<'_, F>>,
    probabilities: &[F],
    g: &[F],
    gradients: AttentionGradients<'_, F>,
) {
    operands.check(s);
    assert_eq!(probabilities.len(), s.probabilities());
    assert_eq!(g.len(), elements(&[s.batch, s.queries, s.width]));
    let packed = matches!(gradients, AttentionGradients::Packed(_));
    let outs = match gradients {
        AttentionGradients::Packed(all) => {
            assert_eq!(all.len(), elements(&[s.batch, s.keys, 3, s.width]));
            assert_eq!(s.queries, s.keys);
            [Shared::new(all); 3]
        }
        AttentionGradients::Apart(each) => {
            for (operand, data) in each.iter().enumerate() {
                assert_eq!(data.len(), elements(&[s.batch, s.tokens(operand), s.width]));
            }
            each.map(Shared::new)
        }
    };
    let (area, d) = (elements(&[s.queries, s.keys]), s.head());
    for_each_block(s.batch * s.heads, s.parallel(), |task| {
        let (n, h) = (task / s.heads, task % s.heads);
        let p = &probabilities[task * area..][..area];
        let [q, k, v] = [0, 1, 2].map(|operand| operands.head(s, operand, n, h));
        let start = s.start(n, h, s.queries, [s.width, 0]);
        let g = Matrix { data: &g[start.min(g.len())..], steps: [s.width, 1] };
        let store = |operand: usize, head: &[F]| {
            let layout = s.layout(packed, operand);
            let start = s.start(n, h, s.tokens(operand), layout);
            // SAFETY: the columns of one head of one element of one operand belong to one task.
            unsafe { place(outs[operand], start, layout[0], d, head) };
        };
        workspace::with(area, |work: &mut [F]| {
            workspace::with(s.queries.max(s.keys) * d, |head: &mut [F]| {
                let (long, wide) = (s.keys * d, s.queries * d);
                work.copy_from_slice(p);
                if let Some(kept) = &kept {
                    kept.apply(task * area, work);
                }
                let weights = Matrix::transposed(work, s.keys);
                gemm([s.keys, s.queries, d], F::one(), weights, g, F::zero(), &mut head[..long]);
                store(2, &head[..long]);
                gemm([s.queries, d, s.keys], F::one(), g, v.flipped(), F::zero(), work);
                if let Some(kept) = &kept {
                    kept.apply(task * area, work);
                }
                softmax_grad(p, s.keys, work);
                let scores = Matrix::rows(work, s.keys);
                gemm([s.queries, s.keys, d], s.scale(), scores, k, F::zero(), &mut head[..wide]);
                store(0, &head[..wide]);
                let scores = Matrix::transposed(work, s.keys);
                gemm([s.keys, s.queries, d], s.scale(), scores, q, F::zero(), &mut head[..long]);
                store(1, &head[..long]);
            });
        });
    });
}
