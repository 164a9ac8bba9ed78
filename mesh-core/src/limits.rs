//! How much memory reading may take, and which other files it may open.

/// What readers of files are held to: memory in proportion to the file, images of a sane size, no
/// way out of the file's folder.
///
/// A file of a few kB can ask for gigabytes: a scene that shows one part a million times, an image
/// of one colour. Readers count what they hold and stop with an error before it is more than
/// [`peak`](Self::peak). Images, also those inside meshes, are held to
/// [`max_pixels`](Self::max_pixels) instead, before anything is unpacked.
///
/// ```
/// use mesh_core::{Limits, read_mesh_with};
///
/// // A scan with a texture of a quarter of a gigapixel, from a folder that one trusts.
/// let limits = Limits { max_pixels: 1 << 28, outside_links: true, ..Limits::default() };
/// let mut remarks = Vec::new();
/// assert!(read_mesh_with("no/such/scan.obj", &limits, &mut remarks).is_err());
///
/// // What a reader may hold for a file of a megabyte.
/// assert_eq!(Limits::default().peak(1_000_000), 276_000_000);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes that reading any file may hold, however small the file is; 256 MB by default.
    pub base_bytes: u64,
    /// Bytes that it may hold beyond that for each byte of the file; 20 by default.
    pub bytes_per_byte: u64,
    /// Pixels that the header of an image may claim; 128 million by default.
    ///
    /// What is unpacked may take 4 bytes for each of them: an image of 16 bits and 4 channels may
    /// have half as many pixels. The texture of a mesh takes up to 16 bytes a pixel while it is read, those
    /// of an OBJ's materials together up to 24, for all that are read.
    pub max_pixels: u64,
    /// Whether an OBJ, MTL, PLY or GLB file may name files outside its own folder, by `..`, by an absolute
    /// path or by a link; not so by default.
    pub outside_links: bool,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            base_bytes: 256_000_000,
            bytes_per_byte: 20,
            max_pixels: 128_000_000,
            outside_links: false,
        }
    }
}

impl Limits {
    /// The most bytes that reading a file of `length` bytes may hold at a time.
    pub fn peak(&self, length: u64) -> u64 {
        self.bytes_per_byte.saturating_mul(length).saturating_add(self.base_bytes)
    }

    /// An account of what reading a file of `length` bytes holds; nothing is held yet.
    pub fn budget(&self, length: u64) -> Budget {
        Budget { most: self.peak(length), held: 0 }
    }
}

/// More memory was asked for than the [`Limits`] allow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("needs {needed} bytes of memory, the limit for a file of this size is {most}")]
pub struct OverLimit {
    /// Bytes that would have been held.
    pub needed: u64,
    /// Bytes that may be.
    pub most: u64,
}

/// What the reader of one file holds, and the most that it may.
///
/// ```
/// use mesh_core::Limits;
///
/// let limits = Limits { base_bytes: 1000, bytes_per_byte: 0, ..Limits::default() };
/// let mut budget = limits.budget(7);
/// let mut list: Vec<u64> = Vec::new();
/// budget.reserve(&mut list, 100)?;
/// assert_eq!((budget.held(), list.capacity()), (800, 100));
/// assert!(budget.take(201).is_err());
/// budget.give_back(800);
/// budget.take(1000)?;
/// # Ok::<(), mesh_core::OverLimit>(())
/// ```
#[derive(Clone, Debug)]
pub struct Budget {
    most: u64,
    held: u64,
}

impl Budget {
    /// Bytes that are held.
    pub fn held(&self) -> u64 {
        self.held
    }

    /// Counts `bytes` that are about to be held.
    ///
    /// # Errors
    /// If that is more than the limit; nothing is counted then.
    pub fn take(&mut self, bytes: u64) -> Result<(), OverLimit> {
        let needed = self.held.saturating_add(bytes);
        if needed > self.most {
            return Err(OverLimit { needed, most: self.most });
        }
        self.held = needed;
        Ok(())
    }

    /// Counts `bytes` that are no longer held.
    pub fn give_back(&mut self, bytes: u64) {
        self.held = self.held.saturating_sub(bytes);
    }

    /// Makes room for `more` items, as `Vec::reserve` does: capacity doubles where the limit leaves
    /// room for it, so that pushing stays cheap.
    ///
    /// While a list grows its old memory is held beside the new; both are counted.
    ///
    /// # Errors
    /// If not even the items themselves have room; the list is as it was.
    pub fn reserve<T>(&mut self, list: &mut Vec<T>, more: usize) -> Result<(), OverLimit> {
        let (needed, old) = (list.len().saturating_add(more), list.capacity());
        if needed <= old {
            return Ok(());
        }
        let size = size_of::<T>().max(1) as u64;
        let room = usize::try_from((self.most - self.held.min(self.most)) / size);
        let new = needed.max(old.saturating_mul(2)).min(room.unwrap_or(usize::MAX)).max(needed);
        self.take((new as u64).saturating_mul(size))?;
        list.reserve_exact(new - list.len());
        self.give_back(old as u64 * size);
        Ok(())
    }

    /// Makes a list as long as it should be by items that are all alike, with room for so many more.
    ///
    /// # Errors
    /// As [`reserve`](Self::reserve).
    pub fn fill<T: Clone>(
        &mut self,
        list: &mut Vec<T>,
        length: usize,
        item: T,
        more: usize,
    ) -> Result<(), OverLimit> {
        self.reserve(list, length.saturating_sub(list.len()).saturating_add(more))?;
        list.resize(length, item);
        Ok(())
    }

    /// `push`, with room made as [`reserve`](Self::reserve) does.
    ///
    /// # Errors
    /// As [`reserve`](Self::reserve).
    pub fn push<T>(&mut self, list: &mut Vec<T>, item: T) -> Result<(), OverLimit> {
        if list.len() == list.capacity() {
            self.reserve(list, 1)?;
        }
        list.push(item);
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn nothing_wraps() {
        let endless = Limits { bytes_per_byte: u64::MAX, ..Limits::default() };
        assert_eq!(endless.peak(u64::MAX), u64::MAX);
        let mut budget = endless.budget(2);
        budget.take(u64::MAX).unwrap();
        budget.take(0).unwrap();
        let mut list = vec![0_u64; 3];
        let limit = Limits::default().budget(0).reserve(&mut list, usize::MAX);
        assert_eq!(limit.unwrap_err().most, 256_000_000);
    }

    #[test]
    fn lists_grow_by_doubling_up_to_the_limit_and_no_further() {
        let limits = Limits { base_bytes: 4000, bytes_per_byte: 0, ..Limits::default() };
        let mut budget = limits.budget(0);
        let (mut list, mut growths) = (Vec::<u32>::new(), 0);
        let refused = loop {
            let before = list.capacity();
            match budget.push(&mut list, 7) {
                Ok(()) => growths += usize::from(list.capacity() > before),
                Err(error) => break error,
            }
            assert_eq!(budget.held(), 4 * list.capacity() as u64);
        };
        assert!(
            list.len() >= 500 && list.len() <= 1000 && growths < 15,
            "{} {growths}",
            list.len()
        );
        assert_eq!(refused.most, 4000);
    }
}
