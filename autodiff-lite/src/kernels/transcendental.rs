//! Transcendental functions that vectorise: straight-line code without calls, so that a loop over
//! a slice becomes SIMD in each of its clones.
//!
//! `f32` uses polynomials, with a relative error below 2e-7 for the exponential and below 4e-7 for what is made of it; that of
//! the error function is absolute, below 6e-7. `f64`, which is only for gradient
//! checks, calls the standard library.

use ndarray::NdFloat;

/// Functions of one number, fit for the inside of a vectorised loop.
pub trait Transcendental: Copy {
    /// `eˣ`: 0 below -87.3 (no subnormals), infinite above 88.7 in `f32`; NaN stays NaN.
    #[must_use]
    fn fast_exp(self) -> Self;

    /// `eˣ - 1`, with the digits of small values; -1 below -87.3.
    #[must_use]
    fn fast_exp_m1(self) -> Self;

    /// `1 / (1 + e⁻ˣ)`.
    #[must_use]
    fn fast_sigmoid(self) -> Self;

    /// The hyperbolic tangent.
    #[must_use]
    fn fast_tanh(self) -> Self;

    /// The error function; in `f32` within 6e-7 of it, so that small values have few digits.
    #[must_use]
    fn fast_erf(self) -> Self;
}

/// `1 / (1 + e⁻ˣ)` by the standard library's exponential, whose argument is never positive: nothing overflows, and small
/// values keep their digits. For loops that are short, or where digits matter more than time.
#[inline]
pub fn sigmoid<F: NdFloat>(x: F) -> F {
    let small = (-x.abs()).exp();
    let positive = F::one() / (F::one() + small);
    if x >= F::zero() { positive } else { small * positive }
}

/// Half of ln 2, within which [`beyond_one`] is.
const REACH: f32 = std::f32::consts::LN_2 / 2.0;

/// `eʳ - 1` near 0: Cephes' polynomial.
#[allow(clippy::excessive_precision, reason = "digits as they are printed")]
#[inline(always)]
fn beyond_one(r: f32) -> f32 {
    let mut p = 1.9875691500e-4_f32;
    p = p * r + 1.3981999507e-3;
    p = p * r + 8.3334519073e-3;
    p = p * r + 4.1665795894e-2;
    p = p * r + 1.6666665459e-1;
    p = p * r + 5.0000001201e-1;
    p * (r * r) + r
}

#[allow(clippy::excessive_precision, reason = "digits as they are printed")]
impl Transcendental for f32 {
    #[inline(always)]
    fn fast_exp(self) -> Self {
        // 1.5 * 2²³: adding it leaves the nearest integer in the low bits of the sum.
        const ROUND: f32 = 12582912.0;
        let x = if self < -88.0 { -88.0 } else { self };
        let x = if x > 88.8 { 88.8 } else { x };
        let z = x * std::f32::consts::LOG2_E + ROUND;
        let n = z - ROUND;
        // ln 2 in two parts; the first has few bits, so that n times it is exact.
        let r = x - n * 0.693359375 + n * 2.12194440e-4;
        let y = beyond_one(r) + 1.0;
        // 2ⁿ in two factors: n = 128 has no single one. Wrapping, because a check for overflow would
        // keep the loop from becoming SIMD in debug builds.
        let n = (z.to_bits() as i32).wrapping_sub(ROUND.to_bits() as i32);
        let half = n >> 1;
        let rest = n.wrapping_sub(half);
        let power = |n: i32| f32::from_bits((n.wrapping_add(127) as u32) << 23);
        let y = y * power(half) * power(rest);
        let y = if self > 88.72283 { f32::INFINITY } else { y };
        if self < -87.33654 { 0.0 } else { y }
    }

    #[inline(always)]
    fn fast_exp_m1(self) -> Self {
        let far = self.fast_exp() - 1.0;
        if self.abs() < REACH { beyond_one(self) } else { far }
    }

    #[inline(always)]
    fn fast_sigmoid(self) -> Self {
        1.0 / (1.0 + (-self).fast_exp())
    }

    #[inline(always)]
    fn fast_tanh(self) -> Self {
        // Near zero the quotient of exponentials cancels: Cephes' odd polynomial instead.
        let s = self * self;
        let mut p = -5.70498872745e-3_f32;
        p = p * s + 2.06390887954e-2;
        p = p * s - 5.37397155531e-2;
        p = p * s + 1.33314422036e-1;
        p = p * s - 3.33332819422e-1;
        let near = p * s * self + self;
        let far = 1.0 - 2.0 / ((self.abs() * 2.0).fast_exp() + 1.0);
        let far = far.copysign(self);
        if self.abs() < 0.625 { near } else { far }
    }

    #[inline(always)]
    fn fast_erf(self) -> Self {
        // Abramowitz and Stegun 1964, formula 7.1.26: within 1.5e-7 before rounding.
        let x = self.abs();
        let t = 1.0 / (1.0 + 0.3275911 * x);
        let mut p = 1.061405429_f32;
        p = p * t - 1.453152027;
        p = p * t + 1.421413741;
        p = p * t - 0.284496736;
        p = p * t + 0.254829592;
        (1.0 - p * t * (-x * x).fast_exp()).copysign(self)
    }
}

impl Transcendental for f64 {
    #[inline(always)]
    fn fast_exp(self) -> Self {
        self.exp()
    }

    #[inline(always)]
    fn fast_exp_m1(self) -> Self {
        self.exp_m1()
    }

    #[inline(always)]
    fn fast_sigmoid(self) -> Self {
        1.0 / (1.0 + (-self).exp())
    }

    #[inline(always)]
    fn fast_tanh(self) -> Self {
        self.tanh()
    }

    fn fast_erf(self) -> Self {
        if self.is_nan() {
            return self;
        }
        let x = self.abs();
        if x > 6.0 {
            return 1.0_f64.copysign(self);
        }
        // Abramowitz and Stegun 1964, formula 7.1.6: all terms have one sign.
        let (mut term, mut sum, mut n) = (x, x, 0.0);
        while term > 1e-18 * sum {
            n += 1.0;
            term *= 2.0 * x * x / (2.0 * n + 1.0);
            sum += term;
        }
        (std::f64::consts::FRAC_2_SQRT_PI * (-x * x).exp() * sum).copysign(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn largest_error(range: f32, fast: fn(f32) -> f32, exact: fn(f64) -> f64) -> f64 {
        let steps = 200_000;
        (0..=steps)
            .map(|k| {
                let x = range * (2.0 * k as f32 / steps as f32 - 1.0);
                let exact = exact(x as f64);
                ((fast(x) as f64 - exact) / exact.abs().max(1e-30)).abs()
            })
            .fold(0.0, f64::max)
    }

    #[test]
    fn relative_errors() {
        assert!(largest_error(87.0, f32::fast_exp, f64::exp) < 2e-7);
        assert!(largest_error(87.0, f32::fast_exp_m1, f64::exp_m1) < 6e-7);
        assert!(largest_error(1e-3, f32::fast_exp_m1, f64::exp_m1) < 2e-7);
        assert!(largest_error(20.0, f32::fast_sigmoid, |x| 1.0 / (1.0 + (-x).exp())) < 4e-7);
        assert!(largest_error(20.0, f32::fast_tanh, f64::tanh) < 4e-7);
    }

    #[test]
    fn sigmoids_keep_their_digits_at_both_ends() {
        assert_eq!(sigmoid(0.0_f32), 0.5);
        assert_eq!((sigmoid(-800.0_f64), sigmoid(800.0_f64)), (0.0, 1.0));
        assert!((sigmoid(-50.0_f64) / (-50.0_f64).exp() - 1.0).abs() < 1e-15);
    }

    /// Values by Python's `math.erf`.
    #[test]
    fn error_function() {
        let known = [
            (0.0, 0.0),
            (0.1, 0.1124629160182849),
            (0.5, 0.5204998778130465),
            (1.0, 0.8427007929497149),
            (2.0, 0.9953222650189527),
            (3.5, 0.9999992569016276),
            (7.0, 1.0),
        ];
        for (x, erf) in known {
            for sign in [-1.0, 1.0] {
                assert!((f64::fast_erf(sign * x) - sign * erf).abs() < 1e-15, "{x}");
                let single = f32::fast_erf((sign * x) as f32) as f64;
                assert!((single - sign * erf).abs() < 6e-7, "{x}: {single}");
            }
        }
        // Where it is worst.
        let worst = (0..=4000)
            .map(|k| k as f32 * 1e-3)
            .map(|x| (f64::from(x.fast_erf()) - f64::from(x).fast_erf()).abs());
        assert!(worst.fold(0.0, f64::max) < 6e-7);
        assert!(f32::fast_erf(f32::NAN).is_nan() && f64::fast_erf(f64::NAN).is_nan());
        assert_eq!(f32::fast_erf(f32::INFINITY), 1.0);
    }

    #[test]
    fn extremes() {
        assert_eq!(f32::fast_exp(0.0), 1.0);
        assert_eq!(f32::fast_exp(f32::NEG_INFINITY), 0.0);
        assert_eq!(f32::fast_exp(-1e30), 0.0);
        assert_eq!(f32::fast_exp(89.0), f32::INFINITY);
        assert!((f32::fast_exp(88.7) / 88.7_f32.exp() - 1.0).abs() < 1e-5);
        assert!(f32::fast_exp(f32::NAN).is_nan());
        assert!(f32::fast_exp_m1(f32::NAN).is_nan());
        assert_eq!(f32::fast_exp_m1(-1e30), -1.0);
        assert_eq!(f32::fast_exp_m1(-1e-20), -1e-20);
        assert!(f32::fast_tanh(f32::NAN).is_nan());
        assert_eq!(f32::fast_tanh(f32::INFINITY), 1.0);
        assert_eq!(f32::fast_tanh(-1e30), -1.0);
        assert_eq!(f32::fast_tanh(1e-20), 1e-20);
        assert_eq!(f32::fast_sigmoid(-1e30), 0.0);
        assert_eq!(f32::fast_sigmoid(1e30), 1.0);
    }
}
