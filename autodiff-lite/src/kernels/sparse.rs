//! Compressed sparse rows times dense rows: graph convolution, Laplacians, unpooling.

use pulp::{Simd, WithSimd};

use crate::Real;
use crate::kernels::activation::Activation;
use crate::kernels::blocks::{SERIAL_BELOW, Shared, for_each_block};
use crate::kernels::extent::{elements, work};
use crate::kernels::isa::Isa;

/// Compressed sparse rows, borrowed.
#[derive(Clone, Copy, Debug)]
pub struct CsrRows<'a, F> {
    /// Row `i` has entries `offsets[i] .. offsets[i + 1]`.
    pub offsets: &'a [u32],
    /// Column of each entry.
    pub indices: &'a [u32],
    /// Value of each entry.
    pub values: &'a [F],
}

/// Rows of one task.
const BLOCK: usize = 64;

/// `y[b][i] = Σ_j a[i][j] x[b][j]` for `batch` arrays of rows of `width` numbers.
///
/// Four vectors of an output row stay in registers while its entries are read. Parallel over
/// fixed blocks of output rows, each row summed in the order of its entries.
///
/// # Panics
/// If a length does not fit, or an index is not below `columns`.
pub fn csr_times_rows<F: Real>(
    isa: Isa,
    a: CsrRows<'_, F>,
    columns: usize,
    batch: usize,
    width: usize,
    x: &[F],
    y: &mut [F],
) {
    rows_times(isa, a, columns, batch, width, x, y, None);
}

/// `y[b][i] = activation(y[b][i] + Σ_j a[i][j] x[b][j])`, as [`csr_times_rows`].
///
/// # Panics
/// As [`csr_times_rows`].
pub fn csr_add_rows<F: Real>(
    isa: Isa,
    a: CsrRows<'_, F>,
    columns: usize,
    batch: usize,
    width: usize,
    x: &[F],
    y: &mut [F],
    activation: Activation,
) {
    rows_times(isa, a, columns, batch, width, x, y, Some(activation));
}

/// Replaces `y`, or adds to it what `then` is applied to.
fn rows_times<F: Real>(
    isa: Isa,
    a: CsrRows<'_, F>,
    columns: usize,
    batch: usize,
    width: usize,
    x: &[F],
    y: &mut [F],
    then: Option<Activation>,
) {
    assert!(!a.offsets.is_empty(), "no rows begin or end");
    let rows = a.offsets.len() - 1;
    assert_eq!(x.len(), elements(&[batch, columns, width]));
    assert_eq!(y.len(), elements(&[batch, rows, width]));
    assert_eq!(a.indices.len(), a.values.len());
    assert!(a.offsets.is_sorted() && a.offsets[rows] as usize == a.indices.len());
    assert!(a.indices.iter().all(|&j| (j as usize) < columns), "a column that does not exist");
    if y.is_empty() {
        return;
    }
    let blocks = rows.div_ceil(BLOCK);
    let flops = work(&[2, a.indices.len(), width, batch]);
    let out = Shared::new(y);
    for_each_block(batch * blocks, flops >= SERIAL_BELOW / 4, |task| {
        let (b, block) = (task / blocks, task % blocks);
        let (first, last) = (block * BLOCK, (block * BLOCK + BLOCK).min(rows));
        isa.run(Block {
            a,
            first,
            last,
            width,
            then,
            x: &x[b * columns * width..(b + 1) * columns * width],
            // SAFETY: each block is a range of rows of its own.
            y: unsafe { out.slice((b * rows + first) * width, (last - first) * width) },
        });
    });
}

struct Block<'a, F> {
    a: CsrRows<'a, F>,
    first: usize,
    last: usize,
    width: usize,
    then: Option<Activation>,
    x: &'a [F],
    y: &'a mut [F],
}

impl<F: Real> WithSimd for Block<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        const UNROLL: usize = 4;
        let lanes = F::lanes::<S>();
        let zero = F::splat(s, F::zero());
        let adds = self.then.is_some();
        for row in self.first..self.last {
            let range = self.a.offsets[row] as usize..self.a.offsets[row + 1] as usize;
            let (indices, values) = (&self.a.indices[range.clone()], &self.a.values[range]);
            let y = &mut self.y[(row - self.first) * self.width..][..self.width];
            let mut at = 0;
            while at + UNROLL * lanes <= self.width {
                let mut sums = [zero; UNROLL];
                if adds {
                    for v in 0..UNROLL {
                        // SAFETY: the output row holds all four vectors.
                        sums[v] = unsafe { F::load(s, y[at + v * lanes..].as_ptr()) };
                    }
                }
                for (&j, &value) in indices.iter().zip(values) {
                    let from = self.x.as_ptr().wrapping_add(j as usize * self.width + at);
                    let value = F::splat(s, value);
                    for v in 0..UNROLL {
                        // SAFETY: the row exists, as was checked, and holds all four vectors.
                        let x = unsafe { F::load(s, from.wrapping_add(v * lanes)) };
                        sums[v] = F::fma(s, value, x, sums[v]);
                    }
                }
                for v in 0..UNROLL {
                    // SAFETY: the output row holds all four vectors.
                    unsafe { F::store(s, y[at + v * lanes..].as_mut_ptr(), sums[v]) }
                }
                at += UNROLL * lanes;
            }
            while at + lanes <= self.width {
                // SAFETY: the output row holds this vector.
                let mut sum = if adds { unsafe { F::load(s, y[at..].as_ptr()) } } else { zero };
                for (&j, &value) in indices.iter().zip(values) {
                    let from = self.x.as_ptr().wrapping_add(j as usize * self.width + at);
                    // SAFETY: the row exists and holds this vector.
                    sum = F::fma(s, F::splat(s, value), unsafe { F::load(s, from) }, sum);
                }
                // SAFETY: the output row holds this vector.
                unsafe { F::store(s, y[at..].as_mut_ptr(), sum) }
                at += lanes;
            }
            for (column, y) in y.iter_mut().enumerate().skip(at) {
                let mut sum = if adds { *y } else { F::zero() };
                for (&j, &value) in indices.iter().zip(values) {
                    // Fused, as in vectors of any width: which numbers are left over depends on it.
                    sum = value.mul_add(self.x[j as usize * self.width + column], sum);
                }
                *y = sum;
            }
            match self.then {
                None | Some(Activation::None) => {}
                // Named, so that its loop vectorises.
                Some(Activation::Relu) => {
                    for y in y {
                        *y = Activation::Relu.apply(*y);
                    }
                }
                Some(other) => other.apply_all(y),
            }
        }
    }
}
