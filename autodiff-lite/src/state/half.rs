//! Numbers of 16 bits.

use half::{bf16, f16};

/// IEEE half precision, little-endian: 1 sign, 5 exponent and 10 fraction bits.
pub fn from_half(bytes: [u8; 2]) -> f32 {
    f16::from_le_bytes(bytes).to_f32()
}

/// The nearest number of half precision, little-endian; beyond 65,520 an infinity.
pub fn to_half(x: f32) -> [u8; 2] {
    f16::from_f32(x).to_le_bytes()
}

/// The upper half of a single-precision number, little-endian.
pub fn from_bfloat(bytes: [u8; 2]) -> f32 {
    bf16::from_le_bytes(bytes).to_f32()
}
