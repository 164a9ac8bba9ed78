//! Products by the `gemm` crate: of few rows or columns, of `f64`, and without AVX-512.

use crate::kernels::blocks::{SERIAL_BELOW, SERIAL_ELEMENTS, Shared, for_each_block};
use crate::kernels::extent::{elements, work};
use crate::kernels::lane::Lane;
use crate::kernels::workspace;

use super::{Finish, Joined, Matrix};

/// What is done with a part of a row, given its row and first column.
type Then<'a, F> = &'a (dyn Fn(&mut [F], [usize; 2]) + Sync);

/// As [`gemm_joined`](crate::kernels::product::gemm_joined), of sizes and matrices that fit, one product after the other.
pub(super) fn multiply<F: Lane>(
    joined: Joined,
    sizes: [usize; 3],
    alpha: F,
    a: &[Matrix<'_, F>],
    b: &[Matrix<'_, F>],
    beta: F,
    c: &mut [&mut [F]],
    finish: Option<Finish<'_, F>>,
) {
    let count = a.len().max(b.len());
    for i in 0..count {
        let (a, b) = (a[i.min(a.len() - 1)], b[i.min(b.len() - 1)]);
        let (sum, last) = (joined == Joined::Sum, i + 1 == count);
        let product = if sum { 0 } else { i };
        let beta = if sum && i > 0 { F::one() } else { beta };
        let part = |part: &mut [F], [row, column]: [usize; 2]| {
            if let Some(finish) = finish {
                finish(part, [product, row, column]);
            }
        };
        let finish: Option<Then<'_, F>> =
            if finish.is_some() && (last || !sum) { Some(&part) } else { None };
        one(sizes, alpha, a, b, beta, c[product], finish);
    }
}

/// One product of the crate's: all three matrices lie in memory, C in rows `c_step` apart.
#[derive(Clone, Copy, Debug)]
pub struct Product<F> {
    sizes: [usize; 3],
    alpha: F,
    beta: F,
    a: *const F,
    a_steps: [usize; 2],
    b: *const F,
    b_steps: [usize; 2],
    c: *mut F,
    c_step: usize,
}

/// The crates are one for each type; `gemm` itself has complex and half numbers too, which take longer to compile than all
/// that is used here.
pub trait Crate: Sized {
    /// # Safety
    /// The matrices are as large as they say, and nobody else touches C.
    unsafe fn multiply(product: &Product<Self>);
}

macro_rules! of_crate {
    ($float:ident, $library:ident) => {
        impl Crate for $float {
            unsafe fn multiply(p: &Product<Self>) {
                let [m, k, n] = p.sizes;
                let [a_row, a_column, b_row, b_column] =
                    [p.a_steps[0], p.a_steps[1], p.b_steps[0], p.b_steps[1]].map(|s| s as isize);
                let (step, none) = (p.c_step as isize, gemm_common::Parallelism::None);
                let run = $library::gemm::$float::get_gemm_fn();
                let (read, plain) = (p.beta != 0.0, false);
                // SAFETY: the caller's promise. The crate wants the columns of C contiguous, as those of its transpose are,
                // and takes what C is multiplied by first.
                unsafe {
                    if step > 1 {
                        run(
                            n, m, k, p.c, step, 1, read, p.b, b_row, b_column, p.a, a_row,
                            a_column, p.beta, p.alpha, plain, plain, plain, none,
                        );
                    } else {
                        run(
                            m, n, k, p.c, 1, step, read, p.a, a_column, a_row, p.b, b_column,
                            b_row, p.beta, p.alpha, plain, plain, plain, none,
                        );
                    }
                }
            }
        }
    };
}

of_crate!(f32, gemm_f32);
of_crate!(f64, gemm_f64);

fn one<F: Lane>(
    [m, k, n]: [usize; 3],
    alpha: F,
    a: Matrix<'_, F>,
    b: Matrix<'_, F>,
    beta: F,
    c: &mut [F],
    finish: Option<Then<'_, F>>,
) {
    // Each block packs its part of B anew, and from columns that do not lie together this takes
    // longer than the products: 1024^3 fell from 200 to 55 GFLOP/s. One copy serves all blocks.
    if b.steps[0] == 1 && b.steps[1] > 1 && m >= 128 && work(&[k, n]) >= 4096 {
        workspace::with(elements(&[k, n]), |copy: &mut [F]| {
            transpose([n, k], b.data, b.steps[1], copy);
            blocks([m, k, n], alpha, a, Matrix::rows(copy, n), beta, c, finish);
        });
    } else {
        blocks([m, k, n], alpha, a, b, beta, c, finish);
    }
}

/// `to[j][i] = from[i][j]` for `rows x columns` elements whose rows lie `step` apart.
fn transpose<F: Lane>([rows, columns]: [usize; 2], from: &[F], step: usize, to: &mut [F]) {
    // Squares of eight: rows that lie a power of two apart share few sets of the cache.
    const SIDE: usize = 8;
    let shared = Shared::new(to);
    let stripes = columns.div_ceil(SIDE * 8);
    for_each_block(stripes, work(&[rows, columns]) >= SERIAL_ELEMENTS, |stripe| {
        let (first, last) = (stripe * SIDE * 8, (stripe * SIDE * 8 + SIDE * 8).min(columns));
        // SAFETY: each stripe is a range of rows of the result.
        let to = unsafe { shared.slice(first * rows, (last - first) * rows) };
        for i in (0..rows).step_by(SIDE) {
            for j in (first..last).step_by(SIDE) {
                let (high, wide) = (SIDE.min(rows - i), SIDE.min(last - j));
                if high == SIDE && wide == SIDE {
                    let mut square = [[F::zero(); SIDE]; SIDE];
                    for r in 0..SIDE {
                        square[r].copy_from_slice(&from[(i + r) * step + j..][..SIDE]);
                    }
                    for q in 0..SIDE {
                        let line = &mut to[(j - first + q) * rows + i..][..SIDE];
                        for r in 0..SIDE {
                            line[r] = square[r][q];
                        }
                    }
                } else {
                    for q in 0..wide {
                        for r in 0..high {
                            to[(j - first + q) * rows + i + r] = from[(i + r) * step + j + q];
                        }
                    }
                }
            }
        }
    });
}

/// Blocks of C that depend on the sizes alone, each a product of one thread.
fn blocks<F: Lane>(
    [m, k, n]: [usize; 3],
    alpha: F,
    a: Matrix<'_, F>,
    b: Matrix<'_, F>,
    beta: F,
    c: &mut [F],
    finish: Option<Then<'_, F>>,
) {
    let out = Shared::new(c);
    let [rows, columns] = block([m, k, n]);
    let across = n.div_ceil(columns);
    let count = m.div_ceil(rows) * across;
    let parallel = work(&[2, m, k, n]) >= SERIAL_BELOW;
    for_each_block(count, parallel, |task| {
        let (i, j) = (task / across * rows, task % across * columns);
        let (here_m, here_n) = (rows.min(m - i), columns.min(n - j));
        // SAFETY: all three matrices were checked to lie in their slices; blocks of C are
        // disjoint.
        unsafe {
            let product = Product {
                sizes: [here_m, k, here_n],
                alpha,
                beta,
                a: a.data.as_ptr().add(i * a.steps[0]),
                a_steps: a.steps,
                b: b.data.as_ptr().add(j * b.steps[1]),
                b_steps: b.steps,
                c: out.at(i * n + j, (here_m - 1) * n + here_n),
                c_step: n,
            };
            F::multiply(&product);
        }
        if let Some(finish) = finish {
            for row in i..i + here_m {
                // SAFETY: the row's part lies in this block alone.
                finish(unsafe { out.slice(row * n + j, here_n) }, [row, j]);
            }
        }
    });
}

/// Rows and columns of a block of C: about 512 of each (with 64 rows, products ran at 85 % of
/// this speed), an even number of blocks where there are several, none under a few Mflop.
fn block([m, k, n]: [usize; 3]) -> [usize; 2] {
    const SIDE: usize = 512;
    let flops = work(&[2, m, k, n]);
    let most = (flops / 4_000_000).max(1);
    let least = (flops / 20_000_000).clamp(1, 8);
    let mut parts = [m.div_ceil(SIDE), n.div_ceil(SIDE)];
    let split = |parts: &mut [usize; 2]| {
        let longer = usize::from(m / parts[0] < n / parts[1]);
        parts[longer] += 1;
    };
    while parts[0] * parts[1] > most {
        let finer = usize::from(parts[0] < parts[1]);
        parts[finer] = parts[finer].div_ceil(2);
    }
    while parts[0] * parts[1] < least {
        split(&mut parts);
    }
    while parts[0] * parts[1] > 1 && !(parts[0] * parts[1]).is_multiple_of(2) {
        split(&mut parts);
    }
    [m.div_ceil(parts[0]).next_multiple_of(16), n.div_ceil(parts[1]).next_multiple_of(64)]
}
