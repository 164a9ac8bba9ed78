//! How far a predicted rotation is from the true one.

/// The angle in degrees, `[0, 180]`, between two rotations given as quaternions of any length and sign but
/// zero: `2 acos |⟨q, q'⟩|`.
///
/// NaN when a quaternion is zero or not finite.
///
/// ```
/// let half = std::f64::consts::FRAC_1_SQRT_2;
/// let angle = losses::metrics::rotation_angle([1.0, 0.0, 0.0, 0.0], [-half, 0.0, half, 0.0]);
/// assert!((angle - 90.0).abs() < 1e-12);
/// ```
pub fn rotation_angle(a: [f64; 4], b: [f64; 4]) -> f64 {
    let dot = |p: [f64; 4], q: [f64; 4]| (0..4).map(|k| p[k] * q[k]).sum::<f64>();
    let sizes = (dot(a, a) * dot(b, b)).sqrt();
    let along = dot(a, b) / sizes;
    // By the sine as well: the arc cosine has no digits left near 0.
    let across = (0..4).map(|k| a[k] / dot(a, a).sqrt() - along.signum() * b[k] / dot(b, b).sqrt());
    let half = 2.0 * (0.5 * across.map(|d| d * d).sum::<f64>().sqrt()).clamp(0.0, 1.0).asin();
    (2.0 * half).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_and_large_angles() {
        for degrees in [0.0f64, 1e-6, 0.3, 45.0, 120.0, 179.999, 180.0] {
            let (s, c) = (0.5 * degrees.to_radians()).sin_cos();
            for sign in [1.0, -2.0] {
                let found = rotation_angle([3.0, 0.0, 0.0, 0.0], [sign * c, 0.0, sign * s, 0.0]);
                assert!((found - degrees).abs() < 1e-9, "{found} instead of {degrees}");
            }
        }
        assert!(rotation_angle([0.0; 4], [1.0, 0.0, 0.0, 0.0]).is_nan());
    }
}
