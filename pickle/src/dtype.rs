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

/// An array as a pickle describes it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Array {
    /// The value that holds the lengths of its axes.
    pub(crate) shape: u32,
    pub(crate) dtype: Dtype,
    pub(crate) fortran: bool,
    /// The value that holds its bytes.
    pub(crate) data: u32,
}

impl Dtype {
    /// From a name such as `f4`, `<i8`, `|u1`: whole numbers, truth values, floats of 4 or 8 bytes.
    pub fn named(name: &str) -> Option<Self> {
        let rest = name.strip_prefix(['<', '>', '|', '=']).unwrap_or(name);
        let kind = *rest.as_bytes().first().filter(|kind| b"fiub".contains(kind))?;
        let size = rest[1..].parse().ok()?;
        let sizes: &[u8] = match kind {
            b'f' => &[4, 8],
            b'b' => &[1],
            _ => &[1, 2, 4, 8],
        };
        sizes.contains(&size).then_some(Self { kind, size, big_endian: name.starts_with('>') })
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
