//! The sRGB transfer function (IEC 61966-2-1).

/// Linear light of an sRGB value in `[0, 1]`.
pub fn srgb_to_linear(value: f32) -> f32 {
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// The sRGB value of linear light in `[0, 1]`.
pub fn linear_to_srgb(value: f32) -> f32 {
    if value <= 0.003_130_8 {
        value * 12.92
    } else {
        // 1.055 p - 0.055, in a form that leaves white at exactly 1
        let p = value.powf(1.0 / 2.4);
        p + 0.055 * (p - 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_are_inverses_and_meet_known_values() {
        for i in 0..=1000_u16 {
            let v = f32::from(i) / 1000.0;
            assert!((linear_to_srgb(srgb_to_linear(v)) - v).abs() < 2e-6, "{v}");
        }
        assert_eq!(srgb_to_linear(0.0), 0.0);
        assert_eq!(srgb_to_linear(1.0), 1.0);
        assert_eq!(linear_to_srgb(1.0), 1.0);
        // Middle grey: sRGB 0.5 is 21.4 % of the light.
        assert!((srgb_to_linear(0.5) - 0.214_041).abs() < 1e-6);
    }
}
