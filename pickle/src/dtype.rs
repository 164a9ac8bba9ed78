//! How NumPy stores numbers.

/// How one number of an array is stored.
///
/// ```
/// let short = pickle::Dtype::named(">i2").unwrap();
/// assert_eq!((short.size(), short.number(&[1, 2])), (2, 258.0));
/// assert!(pickle::Dtype::named("c8").is_none());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dtype {
    /// `f`, `i`, `u` or `b`, as NumPy calls them.
    pub(crate) kind: u8,
    pub(crate) size: u8,
    pub(crate) big_endian: bool,
}

/// A type of NumPy's as far as it is understood.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Kind {
    /// Of numbers that are read.
    Number(Dtype),
    /// Texts, objects, records, complex numbers: the value that names it, where one does.
    Other(Option<u32>),
}

/// An array as a pickle describes it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Array {
    /// The value that holds the lengths of its axes.
    pub(crate) shape: u32,
    pub(crate) dtype: Kind,
    pub(crate) fortran: bool,
    /// The value that holds its bytes.
    pub(crate) data: u32,
}

impl Dtype {
    /// From a name such as `f4`, `<i8`, `|u1`: whole numbers, truth values, floats of 2, 4 or 8 bytes.
    pub fn named(name: &str) -> Option<Self> {
        let rest = name.strip_prefix(['<', '>', '|', '=']).unwrap_or(name);
        let kind = *rest.as_bytes().first().filter(|kind| b"fiub".contains(kind))?;
        let size = rest[1..].parse().ok()?;
        let sizes: &[u8] = match kind {
            b'f' => &[2, 4, 8],
            b'b' => &[1],
            _ => &[1, 2, 4, 8],
        };
        sizes.contains(&size).then_some(Self { kind, size, big_endian: name.starts_with('>') })
    }

    /// Whether it has whole numbers alone, or truth values.
    pub fn is_whole(self) -> bool {
        self.kind != b'f'
    }

    /// Bytes of a number.
    pub fn size(self) -> usize {
        usize::from(self.size)
    }

    /// The number in these bytes.
    ///
    /// # Panics
    /// If they are not as many as it has.
    pub fn number(self, bytes: &[u8]) -> f64 {
        let mut raw = [0_u8; 8];
        raw[..self.size()].copy_from_slice(bytes);
        if self.big_endian {
            raw[..self.size()].reverse();
        }
        let bits = u64::from_le_bytes(raw);
        match (self.kind, self.size) {
            (b'f', 2) => half(bits as u16),
            (b'f', 4) => f64::from(f32::from_bits(bits as u32)),
            (b'f', _) => f64::from_bits(bits),
            (b'i', 1) => f64::from(bits as i8),
            (b'i', 2) => f64::from(bits as i16),
            (b'i', 4) => f64::from(bits as i32),
            (b'i', _) => bits as i64 as f64,
            _ => bits as f64,
        }
    }
}

/// A float of 16 bits: a sign, 5 bits of exponent, 10 of fraction.
fn half(bits: u16) -> f64 {
    let fraction = f64::from(bits & 0x3ff) / 1024.0;
    let size = match bits >> 10 & 0x1f {
        0 => fraction * 2_f64.powi(-14),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        exponent => (1.0 + fraction) * 2_f64.powi(i32::from(exponent) - 15),
    };
    if bits >> 15 == 0 { size } else { -size }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn half_floats_are_those_of_ieee() {
        let of = |bits: u16| Dtype::named("<f2").unwrap().number(&bits.to_le_bytes());
        for (bits, value) in [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0400, 2_f64.powi(-14)),
            (0x0001, 2_f64.powi(-24)),
            (0x3555, 1365.0 / 4096.0),
            (0x7c00, f64::INFINITY),
            (0xfc00, f64::NEG_INFINITY),
        ] {
            assert_eq!(of(bits), value, "{bits:#x}");
        }
        assert!(of(0x7e01).is_nan() && of(0x8000).is_sign_negative());
    }
}
