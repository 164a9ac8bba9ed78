//! Matrix products `C = alpha A B + beta C` of any strides, for `f32` and `f64`.

use crate::kernels::blocks::{SERIAL_BELOW, SERIAL_ELEMENTS, Shared, for_each_block};
use crate::kernels::extent::{elements, reach, work};
use crate::kernels::lane::Lane;
use crate::kernels::workspace;

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

/// `C = alpha A B + beta C` where `A` is `m x k`, `B` is `k x n` and `C` is `m x n`, contiguous.
/// With `beta = 0`, `C` is only written.
///
/// Large products are cut into blocks of `C` that depend on the sizes alone, and each block is
/// one product of one thread: the same bits for any number of threads.
///
/// # Panics
/// If a matrix reaches past the end of its slice.
pub fn gemm<F: Lane>(
    sizes: [usize; 3],
    alpha: F,
    a: Matrix<'_, F>,
    b: Matrix<'_, F>,
    beta: F,
    c: &mut [F],
) {
    gemm_then(sizes, alpha, a, b, beta, c, |_, _| {});
}

/// [`gemm()`], and then `finish(part, column)` for each part of a row of `C` that begins at
/// `column`, while it is still in cache: bias and activation.
///
/// # Panics
/// If a matrix reaches past the end of its slice.
pub fn gemm_then<F: Lane>(
    [m, k, n]: [usize; 3],
    alpha: F,
    a: Matrix<'_, F>,
    b: Matrix<'_, F>,
    beta: F,
    c: &mut [F],
    finish: impl Fn(&mut [F], usize) + Sync + Send,
) {
    assert!(reach([m, k], a.steps) <= a.data.len(), "the left matrix reaches past its end");
    assert!(reach([k, n], b.steps) <= b.data.len(), "the right matrix reaches past its end");
    assert!(c.len() >= elements(&[m, n]), "the product is longer than its slice");
    if m == 0 || n == 0 {
        return;
    }
    if k == 0 {
        for row in c[..m * n].chunks_exact_mut(n) {
            for c in &mut *row {
                *c = if beta == F::zero() { F::zero() } else { beta * *c };
            }
            finish(row, 0);
        }
        return;
    }
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
pub(crate) fn transpose<F: Lane>(
    [rows, columns]: [usize; 2],
    from: &[F],
    step: usize,
    to: &mut [F],
) {
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

fn blocks<F: Lane>(
    [m, k, n]: [usize; 3],
    alpha: F,
    a: Matrix<'_, F>,
    b: Matrix<'_, F>,
    beta: F,
    c: &mut [F],
    finish: impl Fn(&mut [F], usize) + Sync + Send,
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
            gemm::gemm(
                here_m,
                here_n,
                k,
                out.at(i * n + j, (here_m - 1) * n + here_n),
                1,
                n as isize,
                beta != F::zero(),
                a.data.as_ptr().add(i * a.steps[0]),
                a.steps[1] as isize,
                a.steps[0] as isize,
                b.data.as_ptr().add(j * b.steps[1]),
                b.steps[1] as isize,
                b.steps[0] as isize,
                beta,
                alpha,
                false,
                false,
                false,
                gemm::Parallelism::None,
            );
        }
        for row in i..i + here_m {
            // SAFETY: the row's part lies in this block alone.
            finish(unsafe { out.slice(row * n + j, here_n) }, j);
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    fn noise(len: usize, seed: usize) -> Vec<f64> {
        (0..len).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f64 / 504.5 - 1.0).collect()
    }

    fn check<F: Lane>(sizes: [usize; 3], transposed: [bool; 2], tolerance: f64) {
        let [m, k, n] = sizes;
        let convert = |x: &[f64]| x.iter().map(|&x| F::from(x).unwrap()).collect::<Vec<F>>();
        let (a, b, c) = (noise(m * k, 1), noise(k * n, 2), noise(m * n, 3));
        let (af, bf, mut cf) = (convert(&a), convert(&b), convert(&c));
        let am = if transposed[0] { Matrix::transposed(&af, m) } else { Matrix::rows(&af, k) };
        let bm = if transposed[1] { Matrix::transposed(&bf, k) } else { Matrix::rows(&bf, n) };
        let (alpha, beta) = (F::from(1.5).unwrap(), F::from(-0.5).unwrap());
        gemm_then(sizes, alpha, am, bm, beta, &mut cf, |row, _| {
            for x in row {
                *x += F::one();
            }
        });
        for i in 0..m {
            for j in 0..n {
                let product: f64 = (0..k)
                    .map(|p| {
                        a[if transposed[0] { p * m + i } else { i * k + p }]
                            * b[if transposed[1] { j * k + p } else { p * n + j }]
                    })
                    .sum();
                let expected = 1.5 * product - 0.5 * c[i * n + j] + 1.0;
                let found = cf[i * n + j].to_f64().unwrap();
                assert!((found - expected).abs() <= tolerance * (1.0 + expected.abs()));
            }
        }
    }

    #[test]
    fn all_transpositions_equal_the_sum() {
        for sizes in [[1, 1, 1], [3, 0, 2], [5, 7, 3], [130, 61, 71], [300, 129, 200]] {
            for transposed in [[false, false], [true, false], [false, true], [true, true]] {
                check::<f32>(sizes, transposed, 2e-5);
                check::<f64>(sizes, transposed, 1e-13);
            }
        }
    }

    #[test]
    fn the_number_of_threads_changes_no_bit() {
        let (m, k, n) = (257, 300, 401);
        let a: Vec<f32> = noise(m * k, 1).iter().map(|&x| x as f32).collect();
        let b: Vec<f32> = noise(k * n, 2).iter().map(|&x| x as f32).collect();
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut c = vec![f32::NAN; m * n];
            pool.install(|| {
                let b = Matrix::transposed(&b, k);
                gemm([m, k, n], 1.0, Matrix::rows(&a, k), b, 0.0, &mut c);
            });
            c
        };
        let one = run(1);
        assert_eq!(one, run(2));
        assert_eq!(one, run(3));
    }
}
