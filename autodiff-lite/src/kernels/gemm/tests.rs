use super::*;
use crate::kernels::compiled::Compiled;
use crate::kernels::product::{gemm, gemm_joined, gemm_then};

fn noise(len: usize, seed: usize) -> Vec<f64> {
    (0..len).map(|i| ((i * 7919 + seed * 104_729) % 1009) as f64 / 504.5 - 1.0).collect()
}

fn convert<F: Compiled>(x: &[f64]) -> Vec<F> {
    x.iter().map(|&x| F::from(x).unwrap()).collect()
}

/// An `m x k` matrix that lies as it is or transposed, in rows that are `gap` longer.
fn matrix<F>(data: &[F], [rows, columns]: [usize; 2], turned: bool, gap: usize) -> Matrix<'_, F> {
    if turned {
        Matrix { data, steps: [1, rows + gap] }
    } else {
        Matrix { data, steps: [columns + gap, 1] }
    }
}

/// Element `i, j` of the product in double precision.
fn element(k: usize, a: Matrix<'_, f64>, b: Matrix<'_, f64>, [i, j]: [usize; 2]) -> f64 {
    let at = |x: Matrix<'_, f64>, i: usize, j: usize| x.data[i * x.steps[0] + j * x.steps[1]];
    (0..k).map(|p| at(a, i, p) * at(b, p, j)).sum()
}

fn check<F: Compiled>(sizes: [usize; 3], turned: [bool; 2], gap: usize, tolerance: f64) {
    let [m, k, n] = sizes;
    let (a, b) = (noise((m + gap) * (k + gap), 1), noise((k + gap) * (n + gap), 2));
    let (af, bf) = (convert::<F>(&a), convert::<F>(&b));
    let ([ta, tb], ma, mb) = (turned, [m, k], [k, n]);
    let (alpha, one) = (F::from(1.5).unwrap(), F::one());
    for beta in [0.0, 1.0, -0.5] {
        let c = noise(m * n, 3);
        // With 0 nothing is read.
        let mut cf = if beta == 0.0 { vec![F::nan(); m * n] } else { convert::<F>(&c) };
        let (am, bm) = (matrix(&af, ma, ta, gap), matrix(&bf, mb, tb, gap));
        gemm_then(sizes, alpha, am, bm, F::from(beta).unwrap(), &mut cf, |part, [row, column]| {
            for (j, x) in part.iter_mut().enumerate() {
                *x += if (row + column + j) % 2 == 0 { one } else { -one };
            }
        });
        for i in 0..m {
            for j in 0..n {
                let product = element(k, matrix(&a, ma, ta, gap), matrix(&b, mb, tb, gap), [i, j]);
                let old = if beta == 0.0 { 0.0 } else { beta * c[i * n + j] };
                let expected = 1.5 * product + old + if (i + j) % 2 == 0 { 1.0 } else { -1.0 };
                let found = cf[i * n + j].to_f64().unwrap();
                let error = (found - expected).abs();
                assert!(
                    error <= tolerance * (1.0 + expected.abs()),
                    "{sizes:?} {turned:?} {i} {j}"
                );
            }
        }
    }
}

const TURNED: [[bool; 2]; 4] = [[false, false], [true, false], [false, true], [true, true]];

#[test]
fn all_transpositions_equal_the_sum() {
    for sizes in [[1, 1, 1], [3, 0, 2], [5, 7, 3], [130, 61, 71], [2, 130, 129], [100, 129, 200]] {
        for turned in TURNED {
            check::<f32>(sizes, turned, 0, 2e-5);
            check::<f64>(sizes, turned, 0, 1e-13);
        }
    }
}

/// Strips, panels, slabs and blocks that are not whole; rows that have a gap, and end with the slice.
#[test]
fn large_products_equal_the_sum() {
    for sizes in [[517, 130, 260], [259, 350, 515], [600, 128, 221]] {
        for turned in TURNED {
            check::<f32>(sizes, turned, 0, 5e-5);
            check::<f32>(sizes, turned, 3, 5e-5);
        }
    }
}

#[test]
fn those_are_swept_where_the_machine_can() {
    let data = [0.0_f32];
    let [flat, turned] = [[8, 1], [1, 8]].map(|steps| [Matrix { data: &data, steps }]);
    for (a, b, sizes) in [
        (&flat, &flat, [517, 130, 260]),
        (&turned, &flat, [259, 350, 515]),
        (&flat, &turned, [2, 130, 129]),
    ] {
        assert_eq!(sweeps(Isa::best(), sizes, a, b), wide());
        assert!(!sweeps(Isa::Scalar, sizes, a, b));
    }
    assert!(!sweeps(Isa::best(), [4, 512, 512], &flat, &flat));
}

fn wide() -> bool {
    #[cfg(target_arch = "x86_64")]
    return Isa::best() == Isa::Avx512;
    #[cfg(not(target_arch = "x86_64"))]
    return false;
}

/// Together and one by one, of sizes for our loops and for the crate.
#[test]
fn joined_products_are_the_products() {
    for sizes in [[260, 131, 515], [520, 131, 255], [9, 5, 7]] {
        let [m, k, n] = sizes;
        let a: Vec<Vec<f32>> = (0..2).map(|i| convert(&noise(m * k, i))).collect();
        let b: Vec<Vec<f32>> = (2..4).map(|i| convert(&noise(k * n, i))).collect();
        for turned in TURNED {
            let am = [0, 1].map(|i| matrix(&a[i], [m, k], turned[0], 0));
            let bm = [0, 1].map(|i| matrix(&b[i], [k, n], turned[1], 0));
            let one = |i: usize, j: usize| {
                let mut c = vec![0.0; m * n];
                gemm(sizes, 0.5, am[i], bm[j], 0.0, &mut c);
                c
            };
            let (mut c, mut d) = (vec![1.0; m * n], vec![1.0; m * n]);
            let mark = |part: &mut [f32], [product, ..]: [usize; 3]| {
                for x in part {
                    *x += product as f32;
                }
            };
            let marked = |x: Vec<f32>| x.iter().map(|x| x + 1.0).collect::<Vec<f32>>();
            let mut both = [&mut c[..], &mut d[..]];
            gemm_joined(Joined::Rows, sizes, 0.5, &am, &bm[..1], 0.0, &mut both, Some(&mark));
            assert!(c == one(0, 0) && d == marked(one(1, 0)), "{sizes:?} {turned:?}");
            let mut both = [&mut c[..], &mut d[..]];
            gemm_joined(Joined::Columns, sizes, 0.5, &am[..1], &bm, 0.0, &mut both, Some(&mark));
            assert!(c == one(0, 0) && d == marked(one(0, 1)), "{sizes:?} {turned:?}");
            gemm_joined(Joined::Sum, sizes, 0.5, &am, &bm, 0.0, &mut [&mut c], Some(&mark));
            let sum: Vec<f32> = one(0, 0).iter().zip(one(1, 1)).map(|(x, y)| x + y).collect();
            let worst = c.iter().zip(&sum).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
            assert!(worst < 2e-5, "{sizes:?} {turned:?} {worst}");
        }
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    for (sizes, turned) in [
        ([257, 300, 401], [false, true]),
        ([700, 700, 300], [false, false]),
        ([530, 640, 257], [true, false]),
        ([40, 640, 257], [false, true]),
    ] {
        let [m, k, n] = sizes;
        let (a, b) = (convert::<f32>(&noise(m * k, 1)), convert::<f32>(&noise(k * n, 2)));
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut c = vec![f32::NAN; m * n];
            pool.install(|| {
                let a = matrix(&a, [m, k], turned[0], 0);
                gemm(sizes, 1.0, a, matrix(&b, [k, n], turned[1], 0), 0.0, &mut c);
            });
            c
        };
        let one = run(1);
        for threads in [2, 3, 7] {
            assert_eq!(one, run(threads), "{sizes:?} {threads}");
        }
    }
}

#[test]
#[should_panic(expected = "are not joined by Rows")]
fn joined_matrices_are_counted() {
    let x = [Matrix::rows(&[1.0_f32], 1)];
    gemm_joined(Joined::Rows, [1, 1, 1], 1.0, &x, &[], 0.0, &mut [], None);
}
