//! Reading a safetensors file. Any bytes may arrive.

use std::path::Path;

use safetensors::{Dtype, SafeTensors};

use super::half::{from_bfloat, from_half};
use super::{LoadError, Numbers, State, Stored, length};

impl State {
    /// Reads a safetensors file.
    ///
    /// # Errors
    /// If it cannot be read, or is not a safetensors file.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, LoadError> {
        let path = path.as_ref();
        let bytes = std::fs::read(path)
            .map_err(|source| LoadError::Io { path: path.to_owned(), source })?;
        Self::from_bytes(&bytes)
            .map_err(|reason| LoadError::Format { path: path.to_owned(), reason })
    }

    /// Reads the bytes of a safetensors file. Memory is taken only for numbers that are there.
    ///
    /// Half-precision numbers become single ones; other types than these, `F32`, `F64` and `U64`
    /// are listed without their content.
    ///
    /// # Errors
    /// What is wrong with the bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(|error| error.to_string())?;
        let tensors = SafeTensors::deserialize(bytes).map_err(|error| error.to_string())?;
        let mut state = Self::new();
        if let Some(metadata) = header.metadata() {
            // Into a sorted map: the order of the hash map is not seen.
            state.metadata = metadata.clone().into_iter().collect();
        }
        for name in tensors.names() {
            let view = tensors.tensor(name).map_err(|error| error.to_string())?;
            let numbers = match view.dtype() {
                Dtype::F32 => Numbers::Singles(numbers(view.data(), f32::from_le_bytes)),
                Dtype::F64 => Numbers::Doubles(numbers(view.data(), f64::from_le_bytes)),
                Dtype::U64 => Numbers::Counts(numbers(view.data(), u64::from_le_bytes)),
                Dtype::F16 => Numbers::Singles(numbers(view.data(), from_half)),
                Dtype::BF16 => Numbers::Singles(numbers(view.data(), from_bfloat)),
                other => Numbers::Other(format!("{other:?}")),
            };
            let shape = view.shape().to_vec();
            if length(&shape).is_none() {
                return Err(format!("{name:?} has the shape {shape:?}, which no array can have"));
            }
            state.arrays.insert(name.to_owned(), Stored { shape, numbers });
        }
        Ok(state)
    }
}

fn numbers<T, const N: usize>(bytes: &[u8], convert: impl Fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks::<N>().0.iter().map(|&chunk| convert(chunk)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::half::to_half;
    use super::*;

    #[test]
    fn half_precision() {
        // 0x3C00 = 1, 0xC000 = -2, 0x3555 ≈ 1/3, 0x0001 = 2⁻²⁴, 0x7BFF = 65504, 0x7C00 = ∞
        let read = |bits: u16| from_half(bits.to_le_bytes());
        assert_eq!([read(0x3C00), read(0xC000), read(0x7BFF)], [1.0, -2.0, 65504.0]);
        assert_eq!([read(0x0001), read(0x7C00)], [2.0_f32.powi(-24), f32::INFINITY]);
        assert!((read(0x3555) - 1.0 / 3.0).abs() < 1e-4);
        assert!(read(0x7E00).is_nan());
        for x in [0.0, 1.0, -0.1, 65504.0, 6e-8, 1e-3_f32] {
            let there = from_half(to_half(x));
            assert!((there - x).abs() <= x.abs() / 2048.0 + 2.0_f32.powi(-25), "{x} {there}");
        }
    }
}
