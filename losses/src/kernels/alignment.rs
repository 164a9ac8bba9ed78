//! The scale and shift that bring one set of numbers closest to another.

use autodiff_lite::Real;

/// A spread of this many times the typical magnitude is rounding, not a spread.
const CONSTANT: f64 = 1e-6;

/// `y ≈ scale x + shift`, by least squares.
///
/// ```
/// use losses::ScaleShift;
/// let (x, y) = ([1.0f32, 2.0, 7.0, 4.0], [5.0, 7.0, f32::INFINITY, 11.0]);
/// let fit = ScaleShift::fit(&x, &y, &[0, 1, 3], -1.0);
/// assert!((fit.scale - 2.0).abs() < 1e-9 && (fit.shift() - 3.0).abs() < 1e-9);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleShift {
    /// What `x` is multiplied with; 0 where `x` is constant.
    pub scale: f64,
    /// Pearson's correlation of `x` and `y`, in [-1, 1]; 0 where either is constant.
    pub correlation: f64,
    /// Whether the scale stands at the floor rather than at the least squares.
    pub floored: bool,
    /// The mean of `x`.
    pub mean_x: f64,
    /// The mean of `y`.
    pub mean_y: f64,
    /// `Σ (x - mean)²`; 0 where that is rounding.
    pub spread_x: f64,
}

impl ScaleShift {
    /// Fits over the elements that `pixels` lists.
    ///
    /// With `ρ` the correlation and `σ` the standard deviations, least squares has the scale
    /// `ρ σ_y / σ_x`; here it is `max(ρ, least_correlation) σ_y / σ_x`, and the shift brings the means
    /// together. A floor of -1 is never reached. Where `x` is constant (or is one number) the scale is 0
    /// and the shift the mean of `y`: the least squares of least norm. Nothing fits nothing with zeros.
    ///
    /// # Cost
    /// Two passes over the listed elements, summed in `f64`.
    /// # Panics
    /// If a listed element does not exist.
    pub fn fit<F: Real>(x: &[F], y: &[F], pixels: &[u32], least_correlation: f64) -> Self {
        let pairs = || {
            let at = |&p: &u32| (x[p as usize], y[p as usize]);
            pixels.iter().map(at).map(|(x, y)| (Real::to_f64(x), Real::to_f64(y)))
        };
        let count = pixels.len().max(1) as f64;
        let (mut mean_x, mut mean_y, mut squares_x, mut squares_y) = (0.0, 0.0, 0.0, 0.0);
        for (x, y) in pairs() {
            mean_x += x;
            mean_y += y;
            squares_x += x * x;
            squares_y += y * y;
        }
        (mean_x, mean_y) = (mean_x / count, mean_y / count);
        let (mut spread_x, mut spread_y, mut both) = (0.0, 0.0, 0.0);
        for (x, y) in pairs() {
            let (x, y) = (x - mean_x, y - mean_y);
            spread_x += x * x;
            spread_y += y * y;
            both += x * y;
        }
        let mut fit =
            Self { scale: 0.0, correlation: 0.0, floored: false, mean_x, mean_y, spread_x };
        if is_constant(spread_x, squares_x) {
            fit.spread_x = 0.0;
            return fit;
        }
        if !is_constant(spread_y, squares_y) {
            fit.correlation = both / (spread_x * spread_y).sqrt();
        }
        fit.floored = fit.correlation < least_correlation;
        fit.scale = if fit.floored {
            least_correlation * (spread_y / spread_x).sqrt()
        } else {
            both / spread_x
        };
        fit
    }

    /// Whether `x` is constant, so that no scale is better than another.
    pub fn is_flat(&self) -> bool {
        self.spread_x == 0.0
    }

    /// What is added after scaling.
    pub fn shift(&self) -> f64 {
        self.mean_y - self.scale * self.mean_x
    }

    /// `scale x + shift`.
    pub fn apply(&self, x: f64) -> f64 {
        self.scale * (x - self.mean_x) + self.mean_y
    }
}

/// Whether a sum of squared deviations is rounding beside the sum of squares.
pub(crate) fn is_constant(spread: f64, squares: f64) -> bool {
    // Also where there is nothing. Not a number is not constant: it must be seen.
    spread <= CONSTANT * CONSTANT * squares
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// No other scale and shift come closer.
        #[test]
        fn nothing_is_closer(
            pairs in proptest::collection::vec((-2.0f64..2.0, -2.0f64..2.0), 1..20),
            ds in -0.1f64..0.1, dt in -0.1f64..0.1,
        ) {
            let (x, y): (Vec<f64>, Vec<f64>) = pairs.into_iter().unzip();
            let pixels: Vec<u32> = (0..x.len() as u32).collect();
            let fit = ScaleShift::fit(&x, &y, &pixels, -1.0);
            let off = |s: f64, t: f64| -> f64 {
                x.iter().zip(&y).map(|(x, y)| (s * x + t - y).powi(2)).sum()
            };
            let best = off(fit.scale, fit.shift());
            prop_assert!(best <= off(fit.scale + ds, fit.shift() + dt) + 1e-9);
            prop_assert!(fit.correlation.abs() <= 1.0 + 1e-12);
        }
    }

    #[test]
    fn the_normal_equations_by_hand() {
        // a00 = 14, a01 = 6, a11 = 3, b0 = 25, b1 = 12: s = (75 - 72) / 6, t = (-150 + 168) / 6.
        let fit = ScaleShift::fit(&[1.0, 2.0, 3.0], &[3.0, 5.0, 4.0], &[0, 1, 2], -1.0);
        assert_relative_eq!(fit.scale, 0.5, epsilon = 1e-12);
        assert_relative_eq!(fit.shift(), 3.0, epsilon = 1e-12);
        assert_relative_eq!(fit.apply(2.0), 4.0, epsilon = 1e-12);
        assert_relative_eq!(fit.correlation, 0.5, epsilon = 1e-12);
    }

    #[test]
    fn constants_and_single_numbers_have_no_scale() {
        let fit = ScaleShift::fit(&[0.1f32; 4], &[1.0, 2.0, 3.0, 6.0], &[0, 1, 2, 3], 0.5);
        assert_eq!((fit.scale, fit.shift(), fit.floored), (0.0, 3.0, false));
        let fit = ScaleShift::fit(&[7.0f32], &[2.0], &[0], -1.0);
        assert_eq!((fit.scale, fit.shift()), (0.0, 2.0));
        let fit = ScaleShift::fit::<f32>(&[], &[], &[], -1.0);
        assert_eq!((fit.scale, fit.shift()), (0.0, 0.0));
    }

    #[test]
    fn a_mirrored_relief_is_aligned_only_if_that_is_allowed() {
        let (x, y, all) = ([1.0, 2.0, 4.0], [-2.0, -4.0, -8.0], [0, 1, 2]);
        let free = ScaleShift::fit(&x, &y, &all, -1.0);
        assert_relative_eq!(free.scale, -2.0, epsilon = 1e-12);
        let held = ScaleShift::fit(&x, &y, &all, 0.1);
        assert!(held.floored);
        assert_relative_eq!(held.scale, 0.2, epsilon = 1e-12);
        assert_relative_eq!(held.apply(7.0 / 3.0), -14.0 / 3.0, epsilon = 1e-12);
    }
}
