//! Sum of the singular values of a matrix.
//!
//! Householder reflections from both sides make it bidiagonal; the symmetric matrix
//! `[0 Bᵀ; B 0]`, its rows shuffled, is then tridiagonal with a zero diagonal, and its eigenvalues are
//! the singular values with both signs. Unlike the eigenvalues of `AᵀA`, small ones come out as
//! accurately as large ones.
//!
//! References: Golub and Kahan 1965, *Calculating the singular values and pseudo-inverse of a matrix*;
//! Bowdler, Martin, Reinsch, Wilkinson 1968, *The QR and QL algorithms for symmetric matrices*.

use rayon::prelude::*;

/// Rows in a task; sums over rows are made task by task, so that threads change no bit.
const ROWS: usize = 64;
/// Elements below which everything stays on one thread.
const SERIAL: usize = 64 * 1024;

/// The sum of the singular values of a row-major matrix of `columns` columns, which is overwritten.
///
/// Values that are not finite give a result that is none.
///
/// # Cost
/// `4 (m n² - n³ / 3)` flops for `m` rows and `n` columns, `m >= n`.
pub fn nuclear_norm(a: &mut [f64], columns: usize) -> f64 {
    let rows = a.len().checked_div(columns).unwrap_or(0);
    if rows == 0 {
        return 0.0;
    }
    if a.iter().any(|x| !x.is_finite()) {
        return f64::NAN;
    }
    if rows < columns {
        let mut transposed = vec![0.0; a.len()];
        for (i, row) in a.chunks_exact(columns).enumerate() {
            row.iter().enumerate().for_each(|(j, &x)| transposed[j * rows + i] = x);
        }
        return nuclear_norm(&mut transposed, rows);
    }
    let mut chain = bidiagonal(a, rows, columns);
    let mut diagonal = vec![0.0; chain.len() + 1];
    chain.push(0.0);
    eigenvalues(&mut diagonal, &mut chain);
    0.5 * diagonal.iter().map(|x| x.abs()).sum::<f64>()
}

/// A reflection that sends `x` to `(alpha, 0, ..)`: `x` becomes `v`, and `1 - beta v vᵀ` reflects.
fn reflection(x: &mut [f64]) -> (f64, f64) {
    let length = x.iter().map(|x| x * x).sum::<f64>().sqrt();
    let alpha = if x[0] > 0.0 { -length } else { length };
    x[0] -= alpha;
    let square: f64 = x.iter().map(|x| x * x).sum();
    (alpha, if square > 0.0 { 2.0 / square } else { 0.0 })
}

/// `d0, e0, d1, e1, .., dn` of the bidiagonal form of `rows x columns`, `rows >= columns`.
fn bidiagonal(a: &mut [f64], rows: usize, columns: usize) -> Vec<f64> {
    let mut chain = Vec::with_capacity(2 * columns);
    let mut column = vec![0.0; rows];
    for k in 0..columns {
        let width = columns - k - 1;
        let below = &mut a[k * columns..];
        let v = &mut column[..rows - k];
        v.iter_mut().zip(below.chunks_exact(columns)).for_each(|(v, row)| *v = row[k]);
        let (alpha, beta) = reflection(v);
        chain.push(alpha);
        if width == 0 {
            break;
        }
        let parallel = below.len() >= SERIAL;
        // wᵀ = vᵀ A, then A - beta v wᵀ.
        let mut w = vec![0.0; width];
        let part = |(v, rows): (&[f64], &[f64])| {
            let mut part = vec![0.0; width];
            for (&v, row) in v.iter().zip(rows.chunks_exact(columns)) {
                part.iter_mut().zip(&row[k + 1..]).for_each(|(w, &a)| *w += v * a);
            }
            part
        };
        let parts: Vec<Vec<f64>> = if parallel {
            let tasks = v.par_chunks(ROWS).zip(below.par_chunks(ROWS * columns));
            tasks.map(part).collect()
        } else {
            v.chunks(ROWS).zip(below.chunks(ROWS * columns)).map(part).collect()
        };
        for part in parts {
            w.iter_mut().zip(part).for_each(|(w, part)| *w += part);
        }
        let mut first: Vec<f64> =
            (0..width).map(|j| below[k + 1 + j] - beta * v[0] * w[j]).collect();
        let (next, gamma) = reflection(&mut first);
        chain.push(next);
        // Both reflections of a row at once: A - beta v wᵀ, then that times 1 - gamma u uᵀ.
        let update = |(v, rows): (&[f64], &mut [f64])| {
            for (&v, row) in v.iter().zip(rows.chunks_exact_mut(columns)) {
                let (row, v) = (&mut row[k + 1..], beta * v);
                let mut along = 0.0;
                for ((a, &w), &u) in row.iter_mut().zip(&w).zip(&first) {
                    *a -= v * w;
                    along += *a * u;
                }
                let along = gamma * along;
                row.iter_mut().zip(&first).for_each(|(a, &u)| *a -= along * u);
            }
        };
        if parallel {
            v.par_chunks(ROWS).zip(below.par_chunks_mut(ROWS * columns)).for_each(update);
        } else {
            v.chunks(ROWS).zip(below.chunks_mut(ROWS * columns)).for_each(update);
        }
    }
    chain
}

/// The eigenvalues of the symmetric tridiagonal matrix of diagonal `d` and off-diagonal `e` (whose last
/// element counts for nothing), left in `d` in no order; implicit QL steps.
fn eigenvalues(d: &mut [f64], e: &mut [f64]) {
    let n = d.len();
    let size = d.iter().chain(e.iter()).fold(0.0_f64, |size, x| size.max(x.abs()));
    let small = f64::EPSILON * size;
    for l in 0..n {
        // Three steps an eigenvalue are usual; sixty have not been seen.
        for _ in 0..60 {
            let m = (l..n - 1).find(|&m| e[m].abs() <= small).unwrap_or(n - 1);
            if m == l {
                break;
            }
            let mut g = (d[l + 1] - d[l]) / (2.0 * e[l]);
            g = d[m] - d[l] + e[l] / (g + g.hypot(1.0).copysign(g));
            let (mut s, mut c, mut p) = (1.0, 1.0, 0.0);
            let mut split = false;
            for i in (l..m).rev() {
                let (f, b) = (s * e[i], c * e[i]);
                let r = f.hypot(g);
                e[i + 1] = r;
                if r == 0.0 {
                    d[i + 1] -= p;
                    e[m] = 0.0;
                    split = true;
                    break;
                }
                (s, c) = (f / r, g / r);
                g = d[i + 1] - p;
                let r = (d[i] - g) * s + 2.0 * c * b;
                p = s * r;
                d[i + 1] = g + p;
                g = c * r - b;
            }
            if !split {
                d[l] -= p;
                e[l] = g;
                e[m] = 0.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn wavy(count: usize, seed: u64) -> Vec<f64> {
        (0..count).map(|i| ((i as f64 + 1.3) * (1.7 + seed as f64 * 0.11)).sin()).collect()
    }

    proptest! {
        /// The squares of the singular values are those of the elements; the sum lies between.
        #[test]
        fn between_the_norms(m in 1usize..30, n in 1usize..30, seed in 0u64..1000) {
            let a = wavy(m * n, seed);
            let frobenius = a.iter().map(|x| x * x).sum::<f64>().sqrt();
            let sum = nuclear_norm(&mut a.clone(), n);
            let rank = m.min(n) as f64;
            prop_assert!(sum >= frobenius * (1.0 - 1e-12) && sum <= rank.sqrt() * frobenius * (1.0 + 1e-12));
            let double: Vec<f64> = a.iter().map(|x| 2.0 * x).collect();
            prop_assert!((nuclear_norm(&mut double.clone(), n) - 2.0 * sum).abs() < 1e-10 * sum);
        }
    }

    #[test]
    fn values_that_are_known() {
        // Rank one: the product of the lengths. A rotation: one for each axis. A diagonal: its values.
        let (u, v) = (wavy(40, 1), wavy(25, 2));
        let length = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
        let mut product: Vec<f64> = u.iter().flat_map(|u| v.iter().map(move |v| u * v)).collect();
        assert!((nuclear_norm(&mut product, 25) - length(&u) * length(&v)).abs() < 1e-11);
        let (s, c) = 0.7_f64.sin_cos();
        assert!((nuclear_norm(&mut [c, -s, s, c], 2) - 2.0).abs() < 1e-14);
        let mut diagonal = vec![0.0; 36];
        (0..6).for_each(|i| diagonal[7 * i] = [3.0, -1.0, 0.0, 1e-9, 0.5, 2.0][i]);
        assert!((nuclear_norm(&mut diagonal, 6) - 6.500000001).abs() < 1e-14);
        assert_eq!(nuclear_norm(&mut [], 3), 0.0);
        assert_eq!(nuclear_norm(&mut [0.0; 6], 2), 0.0);
        assert!(nuclear_norm(&mut [1.0, f64::NAN], 2).is_nan());
    }

    #[test]
    fn threads_change_no_bit() {
        let a = wavy(300 * 260, 5);
        let of = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
            pool.install(|| nuclear_norm(&mut a.clone(), 260))
        };
        assert_eq!(of(1), of(3));
    }
}
