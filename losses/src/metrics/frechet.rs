//! Distances of sets of features: Fréchet's, and the one that MCMR published under its name.

use autodiff_lite::kernels::gemm::Matrix;
use autodiff_lite::kernels::product::gemm;
use mesh_core::nalgebra::DMatrix;
use ndarray::{ArrayView2, Axis};

/// Why there is no Fréchet distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FrechetError {
    /// A spread needs two images.
    #[error(
        "the Fréchet distance needs the features of at least 2 images in each set, found {found}"
    )]
    TooFew {
        /// In the smaller set.
        found: usize,
    },
    /// The sets have different features.
    #[error("the sets have {left} and {right} features an image")]
    Widths {
        /// In the first set.
        left: usize,
        /// In the second.
        right: usize,
    },
    /// A network gave what is not a number.
    #[error("a feature is not a finite number")]
    NotFinite,
}

/// The Fréchet distance of two sets of features, each taken for a Gaussian:
///
/// ```text
/// ‖μ - ν‖² + tr(C + D - 2 (C D)^(1/2))
/// ```
///
/// with means and covariances (divided by one less than the number of images). It is the FID when the
/// features are those of `nets::InceptionV3` with the weights that it is defined by, and the images are as
/// many as those of the figure compared with: few images make it larger.
///
/// With `C = AᵀA` and `D = BᵀB` (centred features, or the Cholesky factors of covariances once there
/// are more images than features) the trace of the root is the sum of the singular values of `A Bᵀ`. No
/// matrix is inverted, nothing is added to a diagonal, and no imaginary part appears.
///
/// # Shapes
/// `a [P, D]` and `b [Q, D]`: P and Q images, at least two each, with D features.
/// # Errors
/// If a set has less than two images, widths differ, or a number is not finite.
/// # Cost
/// For `k` the smaller of images and features about `8 k³ / 3` flops, on one thread: 16 s at 2048.
/// # References
/// Heusel et al. 2017, *GANs trained by a two time-scale update rule converge to a local Nash
/// equilibrium*, equation 6; Dowson and Landau 1982, *The Fréchet distance between multivariate normal
/// distributions*.
///
/// ```
/// use ndarray::arr2;
/// // Spreads alike, means 3 and 4 apart.
/// let a = arr2(&[[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]]);
/// let b = arr2(&[[3.0, 4.0], [5.0, 4.0], [3.0, 6.0]]);
/// let distance = losses::metrics::frechet(a.view(), b.view())?;
/// assert!((distance - 25.0).abs() < 1e-6);
/// # Ok::<(), losses::metrics::FrechetError>(())
/// ```
#[allow(clippy::needless_pass_by_value, reason = "views are passed like slices")]
pub fn frechet(a: ArrayView2<'_, f32>, b: ArrayView2<'_, f32>) -> Result<f64, FrechetError> {
    let found = a.nrows().min(b.nrows());
    if found < 2 {
        return Err(FrechetError::TooFew { found });
    }
    if a.ncols() != b.ncols() {
        return Err(FrechetError::Widths { left: a.ncols(), right: b.ncols() });
    }
    if a.iter().chain(b.iter()).any(|x| !x.is_finite()) {
        return Err(FrechetError::NotFinite);
    }
    let [(mean, a), (other, b)] = [a, b].map(|x| moments(&x));
    let apart: f64 = mean.iter().zip(&other).map(|(m, n)| (m - n) * (m - n)).sum();
    let trace = |factor: &[f64]| factor.iter().map(|x| x * x).sum::<f64>();
    let width = mean.len();
    let [m, n] = [&a, &b].map(|x| x.len().checked_div(width).unwrap_or(0));
    let mut product = vec![0.0; m * n];
    let (left, right) = (Matrix::rows(&a, width), Matrix::transposed(&b, width));
    gemm([m, width, n], 1.0, left, right, 0.0, &mut product);
    let root = nuclear_norm(product, n);
    Ok((apart + trace(&a) + trace(&b) - 2.0 * root).max(0.0))
}

/// The sum of the singular values of a row-major matrix, the same for its transpose. Small ones come out
/// as accurately as large ones, which roots of the eigenvalues of `AᵀA` do not.
fn nuclear_norm(a: Vec<f64>, columns: usize) -> f64 {
    match a.len().checked_div(columns).unwrap_or(0) {
        0 => 0.0,
        rows => DMatrix::from_vec(columns, rows, a).singular_values_unordered().sum(),
    }
}

/// The mean, and rows `A` with `AᵀA` the covariance: at most as many as there are features.
fn moments(x: &ArrayView2<'_, f32>) -> (Vec<f64>, Vec<f64>) {
    let (rows, width) = x.dim();
    let mean = x.map(|&x| f64::from(x)).mean_axis(Axis(0)).expect("at least two rows").to_vec();
    let scale = 1.0 / ((rows - 1) as f64).sqrt();
    let mut centered = Vec::with_capacity(x.len());
    for row in x.rows() {
        centered.extend(row.iter().zip(&mean).map(|(&x, mean)| scale * (f64::from(x) - mean)));
    }
    if rows <= width {
        return (mean, centered);
    }
    let mut covariance = vec![0.0; width * width];
    let (left, right) = (Matrix::transposed(&centered, width), Matrix::rows(&centered, width));
    gemm([width, rows, width], 1.0, left, right, 0.0, &mut covariance);
    (mean, cholesky(covariance, width))
}

/// Rows `U` with `UᵀU` the symmetric matrix, which has no negative eigenvalue but by rounding: Cholesky's
/// factor with pivots, as many rows as the matrix has rank.
fn cholesky(mut c: Vec<f64>, n: usize) -> Vec<f64> {
    let largest = (0..n).map(|i| c[i * n + i]).fold(0.0, f64::max);
    let mut rows = Vec::new();
    for _ in 0..n {
        let pivot = (0..n).fold(0, |p, i| if c[i * n + i] > c[p * n + p] { i } else { p });
        let square = c[pivot * n + pivot];
        if square <= largest * f64::EPSILON * n as f64 {
            break;
        }
        let scale = 1.0 / square.sqrt();
        let row: Vec<f64> = c[pivot * n..(pivot + 1) * n].iter().map(|x| x * scale).collect();
        for (own, &x) in c.chunks_exact_mut(n).zip(&row) {
            own.iter_mut().zip(&row).for_each(|(c, &y)| *c -= x * y);
        }
        // What is done with is exactly zero, not nearly.
        for i in 0..n {
            (c[pivot * n + i], c[i * n + pivot]) = (0.0, 0.0);
        }
        rows.extend(row);
    }
    rows
}

/// The distance of the features of one image and its target that MCMR's tables give as FID:
/// `‖f - g‖² + (s(f) - s(g))²`, `s` the standard deviation of the numbers of one image.
///
/// It is averaged over the images. It is **not** a Fréchet distance of sets and must not be compared with
/// one: the published evaluation takes the covariance of a single image, which NumPy used to answer with
/// the variance of its features.
///
/// # Panics
/// If the widths differ.
/// # References
/// The evaluation code of Simoni et al. 2021, *Multi-Category Mesh Reconstruction From Image
/// Collections*.
pub fn feature_distance(features: &[f32], target: &[f32]) -> f64 {
    assert_eq!(features.len(), target.len(), "feature_distance: the features differ in number");
    let apart: f64 =
        features.iter().zip(target).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
    apart + (deviation(features) - deviation(target)).powi(2)
}

fn deviation(x: &[f32]) -> f64 {
    let mean = x.iter().map(|&x| f64::from(x)).sum::<f64>() / x.len().max(1) as f64;
    let squares: f64 = x.iter().map(|&x| (f64::from(x) - mean).powi(2)).sum();
    (squares / x.len().saturating_sub(1).max(1) as f64).sqrt()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use ndarray::{Array2, arr2};
    use proptest::prelude::*;

    use super::*;

    /// The numbers of `tests/fixtures/frechet.py`.
    fn features(rows: usize, columns: usize, seed: usize) -> Array2<f32> {
        Array2::from_shape_fn((rows, columns), |(i, j)| {
            let k = ((seed * 7919 + i * columns + j) * 2_654_435_761) % 4_294_967_296;
            ((k >> 8) % 1000) as f32 / 250.0 + (j % 3) as f32 * seed as f32 / 10.0
        })
    }

    #[test]
    fn sums_of_singular_values_that_are_known() {
        // Rank one: the product of the lengths. A rotation: one for each axis. A diagonal: its values.
        let wave = |count: usize, f: f64| (0..count).map(move |i| ((i as f64 + 1.3) * f).sin());
        let (u, v): (Vec<f64>, Vec<f64>) = (wave(40, 1.8).collect(), wave(25, 1.9).collect());
        let length = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
        let product: Vec<f64> = u.iter().flat_map(|u| v.iter().map(move |v| u * v)).collect();
        assert!((nuclear_norm(product, 25) - length(&u) * length(&v)).abs() < 1e-11);
        let (s, c) = 0.7_f64.sin_cos();
        assert!((nuclear_norm(vec![c, -s, s, c], 2) - 2.0).abs() < 1e-14);
        let mut diagonal = vec![0.0; 36];
        (0..6).for_each(|i| diagonal[7 * i] = [3.0, -1.0, 0.0, 1e-9, 0.5, 2.0][i]);
        assert!((nuclear_norm(diagonal, 6) - 6.500_000_001).abs() < 1e-14);
        for (rows, columns) in [(0, 3), (2, 0), (2, 3), (40, 7)] {
            assert_eq!(nuclear_norm(vec![0.0; rows * columns], columns), 0.0);
        }
    }

    /// SciPy's square roots of matrices, in 50 digits where the covariance has no full rank.
    #[test]
    fn equal_to_scipy() {
        for (m, n, width, expected) in SCIPY {
            let found =
                frechet(features(m, width, 1).view(), features(n, width, 2).view()).unwrap();
            assert!((found - expected).abs() < 1e-7 * expected, "{found} instead of {expected}");
        }
    }

    /// Rows of both sets, features, and the distance that `tests/fixtures/frechet.py` prints.
    const SCIPY: [(usize, usize, usize, f64); 4] = [
        (9, 7, 4, 10.57982905804074),
        (40, 30, 6, 0.3952517939101874),
        (12, 25, 5, 2.5257733200553396),
        (4, 6, 8, 26.662462313926444),
    ];

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn a_distance(m in 2usize..12, n in 2usize..12, width in 1usize..8) {
            let (a, b) = (features(m, width, 3), features(n, width, 5));
            let there = frechet(a.view(), b.view()).unwrap();
            let back = frechet(b.view(), a.view()).unwrap();
            prop_assert!((there - back).abs() < 1e-9 * there.max(1.0));
            prop_assert!(frechet(a.view(), a.view()).unwrap() < 1e-9);
            // Images that are the same, and features that are all zero, are no trouble.
            let mut flat = a.clone();
            flat.row_mut(1).assign(&a.row(0));
            flat.column_mut(0).fill(0.0);
            prop_assert!(frechet(flat.view(), b.view()).unwrap().is_finite());
            prop_assert!(frechet(flat.view(), flat.view()).unwrap() < 1e-9);
            // Axes in another order are the same features.
            let turned = |x: &Array2<f32>| x.slice(ndarray::s![.., ..;-1]).to_owned();
            let again = frechet(turned(&a).view(), turned(&b).view()).unwrap();
            prop_assert!((there - again).abs() < 1e-9 * there.max(1.0));
        }
    }

    /// Along one axis: (μ - ν)² + (σ - τ)².
    #[test]
    fn one_feature_by_hand() {
        let (a, b) = (arr2(&[[0.0], [2.0]]), arr2(&[[5.0], [5.0], [11.0]]));
        let expected = 6.0_f64.powi(2) + (2.0_f64.sqrt() - 12.0_f64.sqrt()).powi(2);
        assert!((frechet(a.view(), b.view()).unwrap() - expected).abs() < 1e-9);
        // And the published figure of single images.
        let distance = feature_distance(&[0.0, 2.0], &[3.0, 3.0]);
        assert!((distance - (9.0 + 1.0 + 2.0)).abs() < 1e-12);
    }

    #[test]
    fn what_has_no_distance_says_why() {
        let (one, two) = (features(1, 3, 0), features(4, 3, 0));
        let error = frechet(one.view(), two.view()).unwrap_err();
        assert_eq!(error, FrechetError::TooFew { found: 1 });
        let error = frechet(two.view(), features(4, 2, 0).view()).unwrap_err();
        assert!(error.to_string().contains("3 and 2 features"));
        let mut broken = two.clone();
        broken[[1, 1]] = f32::NAN;
        assert_eq!(frechet(two.view(), broken.view()), Err(FrechetError::NotFinite));
    }
}
