//! A unit in which lengths are near 1, for what would otherwise depend on the unit of the world.

/// The power of 16 next to a length; 1 where that is no positive number. Dividing by it rounds nothing, and worlds whose objects are
/// about as large as 1 are computed to the same bits as without it.
pub(super) fn unit_near(length: f64) -> f64 {
    let unit = 16.0_f64.powi((length.log2() / 4.0).round() as i32);
    if length > 0.0 && unit.is_normal() { unit } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_about_1_keep_their_unit() {
        for (length, unit) in
            [(0.3, 1.0), (1.0, 1.0), (3.9, 1.0), (4.1, 16.0), (1e-5, 16f64.powi(-4))]
        {
            assert!((unit_near(length) - unit).abs() < 1e-12 * unit, "{length}");
        }
        for length in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!((unit_near(length) - 1.0).abs() < 1e-12, "{length}");
        }
    }
}
