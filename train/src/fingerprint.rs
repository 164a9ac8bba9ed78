//! A hash of data.

/// A hash of data in 64 bits: to see that it is another, not to be safe.
///
/// Bytes are read as words of eight, lowest first. What is left of them, even if that is nothing, is filled with zeros to one word
/// more, and their number is the word after that. The state `s` is `0xcbf29ce484222325` at first; a word `w` makes it
/// `t ^ (t >> 32)`, where `t = (s ^ w) * 0x100000001b3` modulo 2^64.
///
/// That is FNV-1a (Fowler, Noll, Vo: its offset and prime of 64 bits) by words instead of bytes, and a fold behind each product, which
/// by itself carries to higher bits alone. The values are not those of FNV-1a.
///
/// ```
/// let hash = |bytes: &[u8]| train::Fingerprint::new().with(bytes).value();
/// assert_ne!(hash(b"one"), hash(b"two"));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Fingerprint(u64);

impl Default for Fingerprint {
    fn default() -> Self {
        Self::new()
    }
}

impl Fingerprint {
    /// Of nothing.
    pub fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    /// Of all before and these bytes with their number.
    #[must_use]
    pub fn with(mut self, bytes: &[u8]) -> Self {
        let (words, rest) = bytes.as_chunks::<8>();
        let mut last = [0; 8];
        last[..rest.len()].copy_from_slice(rest);
        let words = words.iter().chain([&last]).map(|word| u64::from_le_bytes(*word));
        for word in words.chain([bytes.len() as u64]) {
            self.0 = (self.0 ^ word).wrapping_mul(0x0000_0100_0000_01b3);
            self.0 ^= self.0 >> 32;
        }
        self
    }

    /// The number.
    pub fn value(self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(parts: &[&[u8]]) -> u64 {
        parts.iter().fold(Fingerprint::new(), |f, p| f.with(p)).value()
    }

    #[test]
    fn fingerprints_tell_apart() {
        assert_ne!(of(&[b"ab", b"c"]), of(&[b"a", b"bc"]));
        assert_ne!(of(&[&[0; 8]]), of(&[&[0; 9]]));
        assert_eq!(of(&[b"ab"]), of(&[b"ab"]));
    }

    /// They stand in checkpoints and in the logs of runs.
    #[test]
    fn values_stay() {
        assert_eq!(of(&[]), 0xcbf2_9ce4_8422_2325);
        assert_eq!(of(&[b""]), 0x6885_3b6a_3912_cca3);
        assert_eq!(of(&[b"ellipsoid"]), 0x3282_2e5d_bca8_f2f0);
    }
}
