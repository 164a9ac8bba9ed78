//! Numbers of 16 bits.

/// The least number of half precision with all its digits, `2^-14`.
const LEAST_NORMAL: f32 = 1.0 / 16384.0;
/// Steps of half precision below that in 1: `2^24`.
const STEPS: f32 = 16777216.0;
/// The exponents of both precisions are counted from 15 and from 127, in half precision above 10 bits.
const BETWEEN: u32 = (127 - 15) << 10;
/// The bits of infinity.
const INFINITY: u32 = 0x7c00;

/// IEEE half precision, little-endian: 1 sign, 5 exponent and 10 fraction bits.
pub fn from_half(bytes: [u8; 2]) -> f32 {
    let bits = u32::from(u16::from_le_bytes(bytes));
    let size = bits & 0x7fff;
    let value = match size {
        // No leading one: a number of steps.
        0..0x400 => size as f32 / STEPS,
        INFINITY => f32::INFINITY,
        _ if size > INFINITY => f32::NAN,
        _ => f32::from_bits((size + BETWEEN) << 13),
    };
    if bits == size { value } else { -value }
}

/// The nearest number of half precision, little-endian; beyond 65,520 an infinity.
pub fn to_half(x: f32) -> [u8; 2] {
    let size = x.abs();
    let bits = if x.is_nan() {
        INFINITY | 0x200
    } else if size < LEAST_NORMAL {
        (size * STEPS).round_ties_even() as u32
    } else {
        // Half a step is added, less a bit where the last kept one is even.
        let bits = size.to_bits();
        let rounded = (bits + 0xfff + (bits >> 13 & 1)) >> 13;
        (rounded - BETWEEN).min(INFINITY)
    };
    let sign = u16::from(x.is_sign_negative()) << 15;
    (bits as u16 | sign).to_le_bytes()
}

/// The upper half of a single-precision number, little-endian.
pub fn from_bfloat([low, high]: [u8; 2]) -> f32 {
    f32::from_le_bytes([0, 0, low, high])
}

#[cfg(test)]
mod tests {
    use half::{bf16, f16};

    use super::*;

    #[test]
    fn all_numbers_of_16_bits_are_those_of_the_crate_half() {
        for bits in 0..=u16::MAX {
            let bytes = bits.to_le_bytes();
            let (ours, theirs) = (from_half(bytes), f16::from_bits(bits).to_f32());
            assert!(ours.to_bits() == theirs.to_bits() || (ours.is_nan() && theirs.is_nan()));
            let (ours, theirs) = (from_bfloat(bytes), bf16::from_bits(bits).to_f32());
            assert!(ours.to_bits() == theirs.to_bits() || (ours.is_nan() && theirs.is_nan()));
        }
    }

    /// Every number of half precision, what lies half-way to the next, and the neighbours of both.
    #[test]
    fn rounding_is_that_of_the_crate_half() {
        for bits in 0..=u16::MAX {
            let x = f16::from_bits(bits).to_f32();
            let middle = x + (f16::from_bits(bits.wrapping_add(1)).to_f32() - x) / 2.0;
            for near in [x, middle, 65519.996, 65520.0, f32::MAX, 1e-45] {
                for x in [near, near.next_up(), near.next_down()] {
                    let (ours, theirs) = (u16::from_le_bytes(to_half(x)), f16::from_f32(x));
                    assert!(ours == theirs.to_bits() || x.is_nan() && theirs.is_nan(), "{x:e}");
                }
            }
            assert!(!x.is_nan() || from_half(to_half(x)).is_nan());
        }
    }
}
