//! Matrix products `C = alpha A B + beta C` of any strides, for `f32` and `f64`.
//!
//! Large products of `f32` on AVX-512 are our own: B is packed into panels, A strip by strip where it is used, and a
//! register tile multiplies the two. Sums are cut into slabs of at most 320 products, by the sizes alone; see `blocks` for
//! why the number of threads changes no bit. The others are the `gemm` crate's, which is better at small ones.
//!
//! Goto and van de Geijn 2008, *Anatomy of high-performance matrix multiplication*; Van Zee and van de Geijn 2015,
//! *BLIS: a framework for rapidly instantiating BLAS functionality*.

mod blocks;
pub(crate) mod library;
mod pack;
mod strip;
mod sweep;
pub(crate) mod tile;
mod transpose;

use crate::kernels::extent::work;
use crate::kernels::isa::Isa;
use crate::kernels::lane::Lane;

use sweep::Sweep;
use tile::Layout;

/// A matrix within a slice.
#[derive(Clone, Copy, Debug)]
pub struct Matrix<'a, F> {
    /// Its elements, the first at the front.
    pub data: &'a [F],
    /// Steps between rows and between columns.
    pub steps: [usize; 2],
}

impl<'a, F> Matrix<'a, F> {
    /// A contiguous matrix of `columns` columns.
    pub fn rows(data: &'a [F], columns: usize) -> Self {
        Self { data, steps: [columns, 1] }
    }

    /// The transpose of a contiguous matrix that has `columns` columns as it lies.
    pub fn transposed(data: &'a [F], columns: usize) -> Self {
        Self { data, steps: [1, columns] }
    }

    /// Its transpose, of the same numbers.
    #[must_use]
    pub fn flipped(self) -> Self {
        Self { steps: [self.steps[1], self.steps[0]], ..self }
    }
}

/// Which side products that are made together have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Joined {
    /// `C_i = A_i B`: B is packed once.
    Rows,
    /// `C_i = A B_i`: A is read once.
    Columns,
    /// `C = Σ_i A_i B_i`: C is written once a slab.
    Sum,
}

/// What is done with a part of a row of a product: its elements, then which product it is of, its row and its first
/// column.
pub type Finish<'a, F> = &'a (dyn Fn(&mut [F], [usize; 3]) + Sync);

/// Several products in one sweep, of sound sizes, none of them 0: what [`gemm_joined`](crate::kernels::product::gemm_joined) does
/// after it has looked at them.
pub(super) fn products<F: Lane>(
    joined: Joined,
    sizes: [usize; 3],
    alpha: F,
    a: &[Matrix<'_, F>],
    b: &[Matrix<'_, F>],
    beta: F,
    c: &mut [&mut [F]],
    finish: Option<Finish<'_, F>>,
) {
    let isa = Isa::best();
    if sweeps(isa, sizes, a, b) {
        // SAFETY: the best instruction set is there, and it is AVX-512.
        unsafe { Sweep::new(isa, joined, sizes, alpha, a, b, beta, c, finish) }.run();
    } else {
        library::multiply(joined, sizes, alpha, a, b, beta, c, finish);
    }
}

/// Whether our own loops are the faster ones. Each limit is where they were on a Zen 4 (`benches/results`): they pack both
/// operands, which small products do not pay back, and the crate is slow where the columns of B do not lie together.
fn sweeps<F: Lane>(
    isa: Isa,
    [m, k, n]: [usize; 3],
    a: &[Matrix<'_, F>],
    b: &[Matrix<'_, F>],
) -> bool {
    #[cfg(target_arch = "x86_64")]
    let wide = isa == Isa::Avx512;
    #[cfg(not(target_arch = "x86_64"))]
    let wide = {
        let _ = isa;
        false
    };
    let turned = |x: &Matrix<'_, F>| x.steps[0] == 1 && x.steps[1] != 1;
    // Strips of all terms are packed in the same way.
    let alike = a.iter().all(|x| turned(x) == turned(&a[0]));
    if !wide || !alike || F::product_tile(Layout::Rows, 1, true).is_none() || k < 64 || n < 64 {
        return false;
    }
    if turned(&b[0]) {
        return m >= 2 && work(&[k, n]) >= 16 * 1024;
    }
    let large = work(&[m, n]) >= 128 * 1024 && k >= 128 && n >= 128;
    if turned(&a[0]) { large } else { large && m >= 512 && m >= n }
}

/// `beta x`, where nothing is read if `beta` is 0.
pub(super) fn scale<F: Lane>(beta: F, x: &mut [F]) {
    if beta == F::zero() {
        x.fill(F::zero());
    } else if beta != F::one() {
        for x in x {
            *x *= beta;
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests;
