//! The numbers after the header of a PLY file.

use std::path::Path;

use super::header::{Format, Header, Property, Scalar};
use crate::io::ReadMeshError;

/// The numbers after the header, one after the other.
pub(super) struct Numbers<'a> {
    bytes: &'a [u8],
    position: usize,
    format: Format,
    pub(super) path: &'a Path,
    /// For errors: what is being read.
    element: String,
    pub(super) item: u64,
    line: usize,
}

impl<'a> Numbers<'a> {
    pub(super) fn new(bytes: &'a [u8], header: &Header, path: &'a Path) -> Self {
        Self {
            bytes,
            position: header.end,
            format: header.format,
            path,
            element: String::new(),
            item: 0,
            line: header.lines + 1,
        }
    }

    pub(super) fn wrong(&self, field: &str, found: impl ToString, expected: &str) -> ReadMeshError {
        let line = self.line();
        let field = format!("{} {}, {field}", self.element, self.item);
        ReadMeshError::at_line(self.path, line, field, found, expected)
    }

    /// Goes on to the items of an element.
    pub(super) fn begin(&mut self, element: &str) {
        element.clone_into(&mut self.element);
        self.item = 0;
    }

    /// The line, in text.
    pub(super) fn line(&self) -> Option<usize> {
        (self.format == Format::Ascii).then_some(self.line)
    }

    /// The length of a list; a number takes a byte at least, in any of the formats, so it is no
    /// more than there are bytes left.
    pub(super) fn length(&mut self, kind: Scalar) -> Result<usize, ReadMeshError> {
        let count = self.number(kind)?;
        let left = (self.bytes.len() - self.position) as f64;
        if !(0.0..=left).contains(&count) || count.fract() != 0.0 {
            return Err(self.wrong("length of a list", count, "no more than the file holds"));
        }
        Ok(count as usize)
    }

    /// Passes over one property: one number, or those of a list.
    pub(super) fn skip(&mut self, property: &Property) -> Result<(), ReadMeshError> {
        let count = property.length.map_or(Ok(1), |kind| self.length(kind))?;
        for _ in 0..count {
            self.number(property.scalar)?;
        }
        Ok(())
    }

    /// One number.
    pub(super) fn number(&mut self, scalar: Scalar) -> Result<f64, ReadMeshError> {
        if self.format == Format::Ascii {
            return self.word();
        }
        let size = scalar.size();
        let Some(bytes) = self.bytes.get(self.position..self.position + size) else {
            return Err(self.wrong("data", "the end of the file", "as many as the header claims"));
        };
        self.position += size;
        let mut raw = [0_u8; 8];
        raw[..size].copy_from_slice(bytes);
        if self.format == Format::Big {
            raw[..size].reverse();
        }
        let four = [raw[0], raw[1], raw[2], raw[3]];
        Ok(match scalar {
            Scalar::I8 => f64::from(raw[0].cast_signed()),
            Scalar::U8 => f64::from(raw[0]),
            Scalar::I16 => f64::from(i16::from_le_bytes([raw[0], raw[1]])),
            Scalar::U16 => f64::from(u16::from_le_bytes([raw[0], raw[1]])),
            Scalar::I32 => f64::from(i32::from_le_bytes(four)),
            Scalar::U32 => f64::from(u32::from_le_bytes(four)),
            Scalar::F32 => f64::from(f32::from_le_bytes(four)),
            Scalar::F64 => f64::from_le_bytes(raw),
        })
    }

    fn word(&mut self) -> Result<f64, ReadMeshError> {
        while let Some(b) = self.bytes.get(self.position).filter(|b| b.is_ascii_whitespace()) {
            self.line += usize::from(*b == b'\n');
            self.position += 1;
        }
        let rest = &self.bytes[self.position..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        if length == 0 {
            return Err(self.wrong("data", "the end of the file", "as many as the header claims"));
        }
        self.position += length;
        let word = String::from_utf8_lossy(&rest[..length.min(64)]);
        word.parse().map_err(|_| self.wrong("data", format!("{word:?}"), "a number"))
    }
}
