//! A unit in which lengths are near 1, for what would otherwise depend on the unit of the world.

/// The power of 4096 next to a length, of those that are `f32` as their inverses are (up to 2^120); 1 where that is no positive number. Dividing by it rounds nothing, and worlds whose objects have
/// from a 64th of 1 to 64 are computed to the same bits as without it.
pub(super) fn unit_near(length: f64) -> f64 {
    let unit = 4096.0_f64.powi((length.log2() / 12.0).round().clamp(-10.0, 10.0) as i32);
    if length > 0.0 && length.is_finite() { unit } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_about_1_keep_their_unit() {
        let small = 1.0 / 4096.0;
        for (length, unit) in [(0.02, 1.0), (1.0, 1.0), (63.0, 1.0), (65.0, 4096.0), (1e-5, small)]
        {
            assert!((unit_near(length) - unit).abs() < 1e-12 * unit, "{length}");
        }
        for length in [f32::from_bits(1), f32::MIN_POSITIVE, f32::MAX] {
            let unit = unit_near(f64::from(length)) as f32;
            assert!(unit.is_normal() && unit.recip().is_normal(), "{length}: {unit}");
        }
        for length in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!((unit_near(length) - 1.0).abs() < 1e-12, "{length}");
        }
    }
}
