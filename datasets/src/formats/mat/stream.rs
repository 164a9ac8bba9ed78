//! Bytes, tags and numbers of a MAT file, from memory or from a deflate stream alike.

use std::io::{ErrorKind, Read};
use std::path::Path;

use mesh_core::{Budget, OverLimit};
use pickle::Dtype;

use super::value::Data;
use crate::content::over;
use crate::error::ReadViewsError;

/// How many bytes are moved at a time: what a forged length can make us take at once.
const CHUNK: usize = 1 << 16;
/// The format has 32 bits for the length of a variable.
const INFLATED_BYTES: u64 = 1 << 32;

/// Type numbers of elements that hold others.
pub(super) const MATRIX: u32 = 14;
pub(super) const COMPRESSED: u32 = 15;

/// The start of an element: what it holds and how many bytes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tag {
    pub(super) kind: u32,
    pub(super) size: u64,
    /// Where the data of the small form stands in the tag itself.
    small: Option<[u8; 4]>,
}

/// A file, or a variable that is being inflated.
pub(super) struct Stream<'a> {
    input: &'a mut dyn Read,
    big_endian: bool,
    file: &'a Path,
    /// What is being read, for messages.
    pub(super) place: String,
    /// Bytes that the element around still has.
    pub(super) left: u64,
    /// Memory that the values of the file may still take.
    pub(super) budget: Budget,
}

impl<'a> Stream<'a> {
    pub(super) fn new(
        input: &'a mut dyn Read,
        big_endian: bool,
        file: &'a Path,
        place: String,
        left: Option<u64>,
        budget: Budget,
    ) -> Self {
        let left = left.unwrap_or(INFLATED_BYTES);
        Self { input, big_endian, file, place, left, budget }
    }

    /// An error about a part of what is being read.
    pub(super) fn wrong(
        &self,
        what: &str,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> ReadViewsError {
        ReadViewsError::field(self.file, format!("{}: {what}", self.place), found, expected)
    }

    /// Reads so many bytes, which the element around must have.
    pub(super) fn fill(&mut self, out: &mut [u8]) -> Result<(), ReadViewsError> {
        if out.len() as u64 > self.left {
            let expected = format!("{} bytes more", out.len());
            return Err(self.wrong("data", format!("{} bytes", self.left), expected));
        }
        self.left -= out.len() as u64;
        self.input.read_exact(out).map_err(|error| match error.kind() {
            ErrorKind::UnexpectedEof => self.wrong("data", "the end of the file", "more bytes"),
            ErrorKind::InvalidData | ErrorKind::InvalidInput => {
                self.wrong("compressed data", error.to_string(), "a deflate stream")
            }
            _ => ReadViewsError::new(self.file, error),
        })
    }

    pub(super) fn skip(&mut self, mut count: u64) -> Result<(), ReadViewsError> {
        let mut chunk = [0u8; 4096];
        while count > 0 {
            let n = count.min(chunk.len() as u64) as usize;
            self.fill(&mut chunk[..n])?;
            count -= n as u64;
        }
        Ok(())
    }

    pub(super) fn is_big_endian(&self) -> bool {
        self.big_endian
    }

    fn word(&self, bytes: [u8; 4]) -> u32 {
        if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
    }

    /// The next tag; `None` at the very end of the element around.
    pub(super) fn tag(&mut self) -> Result<Option<Tag>, ReadViewsError> {
        if self.left == 0 {
            return Ok(None);
        }
        let mut first = [0u8; 4];
        let mut second = [0u8; 4];
        self.fill(&mut first)?;
        self.fill(&mut second)?;
        let word = self.word(first);
        let small_size = word >> 16;
        if small_size != 0 {
            if small_size > 4 {
                let expected = "at most 4 bytes in a small element";
                return Err(self.wrong("size", small_size.to_string(), expected));
            }
            let kind = word & 0xffff;
            // What follows such a tag is read as its data, of which a small one has none behind it.
            if matches!(kind, MATRIX | COMPRESSED) {
                let found = format!("a small element of type {kind}");
                return Err(self.wrong("type", found, "the long form for what holds others"));
            }
            return Ok(Some(Tag { kind, size: small_size.into(), small: Some(second) }));
        }
        Ok(Some(Tag { kind: word, size: self.word(second).into(), small: None }))
    }

    /// The next tag, which must be there.
    pub(super) fn need_tag(&mut self, what: &str) -> Result<Tag, ReadViewsError> {
        let tag = self.tag()?.ok_or_else(|| self.wrong(what, "nothing", "an element"))?;
        if tag.small.is_none() && tag.size > self.left {
            let expected = format!("at most the {} that are left", self.left);
            return Err(self.wrong(what, format!("{} bytes", tag.size), expected));
        }
        Ok(tag)
    }

    /// Hands the data of an element over in pieces, and passes over the padding behind it.
    pub(super) fn data(
        &mut self,
        tag: Tag,
        mut take: impl FnMut(&mut Self, &[u8]) -> Result<(), ReadViewsError>,
    ) -> Result<(), ReadViewsError> {
        if let Some(small) = tag.small {
            return take(self, &small[..tag.size as usize]);
        }
        let mut chunk = vec![0u8; CHUNK.min(tag.size as usize)];
        let mut rest = tag.size;
        while rest > 0 {
            let n = rest.min(chunk.len() as u64) as usize;
            self.fill(&mut chunk[..n])?;
            take(self, &chunk[..n])?;
            rest -= n as u64;
        }
        // Some writers leave the padding of the last element away.
        let padding = (8 - tag.size % 8) % 8;
        self.skip(padding.min(self.left))
    }

    /// All bytes of an element that may have at most `limit`.
    pub(super) fn bytes(
        &mut self,
        tag: Tag,
        what: &str,
        limit: u64,
    ) -> Result<Vec<u8>, ReadViewsError> {
        if tag.size > limit {
            return Err(self.wrong(
                what,
                format!("{} bytes", tag.size),
                format!("at most {limit}"),
            ));
        }
        let mut out = Vec::with_capacity((tag.size as usize).min(CHUNK));
        self.data(tag, |_, piece| {
            out.extend_from_slice(piece);
            Ok(())
        })?;
        Ok(out)
    }

    /// Whole numbers of 32 bits.
    pub(super) fn words(&mut self, what: &str, limit: u64) -> Result<Vec<i32>, ReadViewsError> {
        let tag = self.need_tag(what)?;
        if !matches!(tag.kind, 5 | 6) || !tag.size.is_multiple_of(4) {
            let found = format!("type {} of {} bytes", tag.kind, tag.size);
            return Err(self.wrong(what, found, "32-bit integers"));
        }
        let bytes = self.bytes(tag, what, limit)?;
        let word = |b: &[u8]| self.word([b[0], b[1], b[2], b[3]]) as i32;
        Ok(bytes.chunks_exact(4).map(word).collect())
    }

    /// Takes memory from what the values of the file may take.
    pub(super) fn charge(&mut self, bytes: usize) -> Result<(), ReadViewsError> {
        let taken = self.budget.take(bytes as u64);
        taken.map_err(|limit| over(self.file, self.place.clone(), limit))
    }

    /// Makes room for one value more, within what the values of the file may take.
    pub(super) fn make_room<T>(&mut self, list: &mut Vec<T>) -> Result<(), ReadViewsError> {
        let room = self.budget.reserve(list, 1);
        room.map_err(|limit| over(self.file, self.place.clone(), limit))
    }

    /// Exactly `count` numbers of any stored type, in the narrowest form that holds them.
    pub(super) fn numbers(&mut self, count: usize) -> Result<Data, ReadViewsError> {
        let tag = self.need_tag("numbers")?;
        let kind = dtype(tag.kind, self.big_endian).ok_or_else(|| {
            self.wrong("data type", tag.kind.to_string(), "a number: 1 to 7, 9, 12 or 13")
        })?;
        if tag.size != (count as u64).saturating_mul(kind.size() as u64) {
            let found = format!("{} bytes", tag.size);
            let expected = format!("{count} values of {} bytes", kind.size());
            return Err(self.wrong("numbers", found, expected));
        }
        let mut narrow = Narrow { whole: count, ..Narrow::default() };
        // Chunks are a multiple of 8 bytes long, so no number is cut.
        self.data(tag, |stream, piece| {
            for raw in piece.chunks_exact(kind.size()) {
                let pushed = narrow.push(kind.number(raw), &mut stream.budget);
                pushed.map_err(|limit| over(stream.file, stream.place.clone(), limit))?;
            }
            Ok(())
        })?;
        Ok(narrow.finish())
    }
}

/// Numbers as they arrive: bits until one is neither 0 nor 1, bytes until one is no byte.
#[derive(Default)]
struct Narrow {
    /// How many there will be.
    whole: usize,
    count: usize,
    bits: Vec<u8>,
    bytes: Vec<u8>,
    floats: Vec<f64>,
}

impl Narrow {
    fn push(&mut self, value: f64, budget: &mut Budget) -> Result<(), OverLimit> {
        // -0.0 stays a float: it is not the same number to a reader of signs.
        let is_byte =
            value.fract() == 0.0 && (0.0..=255.0).contains(&value) && value.is_sign_positive();
        let is_bit = is_byte && value <= 1.0;
        if self.count == 0 {
            budget.reserve(&mut self.bits, self.whole.div_ceil(8))?;
        }
        if !is_byte && self.floats.is_empty() {
            self.widen(budget, f64::from, |narrow| &mut narrow.floats)?;
            budget.give_back(self.bytes.capacity() as u64);
            self.bytes = Vec::new();
        } else if !is_bit && self.floats.is_empty() && self.bytes.is_empty() {
            self.widen(budget, |v| v, |narrow| &mut narrow.bytes)?;
        }
        if !self.floats.is_empty() || !is_byte {
            self.floats.push(value);
        } else if !self.bytes.is_empty() || !is_bit {
            self.bytes.push(value as u8);
        } else {
            if self.count.is_multiple_of(8) {
                self.bits.push(0);
            }
            if value == 1.0 {
                self.bits[self.count / 8] |= 1 << (self.count % 8);
            }
        }
        self.count += 1;
        Ok(())
    }

    /// Moves what has arrived into a wider form, which gets room for all that will: it never grows.
    fn widen<T>(
        &mut self,
        budget: &mut Budget,
        convert: impl Fn(u8) -> T,
        form: impl Fn(&mut Self) -> &mut Vec<T>,
    ) -> Result<(), OverLimit> {
        let mut wide = Vec::new();
        budget.reserve(&mut wide, self.whole)?;
        let (bits, bytes) = (std::mem::take(&mut self.bits), &self.bytes);
        if bytes.is_empty() {
            wide.extend((0..self.count).map(|i| convert(bits[i / 8] >> (i % 8) & 1)));
        } else {
            wide.extend(bytes.iter().map(|&byte| convert(byte)));
        }
        budget.give_back(bits.capacity() as u64);
        *form(self) = wide;
        Ok(())
    }

    fn finish(self) -> Data {
        if !self.floats.is_empty() {
            Data::Floats(self.floats)
        } else if !self.bytes.is_empty() {
            Data::Bytes(self.bytes)
        } else {
            Data::Bits(self.count, self.bits)
        }
    }
}

/// The numbers of a data type, by NumPy's name for them.
fn dtype(kind: u32, big_endian: bool) -> Option<Dtype> {
    let name = match kind {
        1 => "i1",
        2 => "u1",
        3 => "i2",
        4 => "u2",
        5 => "i4",
        6 => "u4",
        7 => "f4",
        9 => "f8",
        12 => "i8",
        13 => "u8",
        _ => return None,
    };
    Dtype::named(&format!("{}{name}", if big_endian { '>' } else { '<' }))
}
