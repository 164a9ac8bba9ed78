//! From the bytes of a MAT file to values.

use std::path::Path;

use flate2::read::ZlibDecoder;

use super::stream::{COMPRESSED, MATRIX, Stream, Tag};
use super::value::{Array, Data, StructArray, Value, sizes};
use crate::content::Content;
use crate::error::ReadViewsError;

/// The text, the offset of the subsystem, the version and the mark of the byte order.
const HEADER: usize = 128;
/// How deep structs and cells may nest.
const DEPTH: usize = 24;
/// MATLAB's arrays have far fewer axes, names at most 63 letters.
const AXES: u64 = 4 * 32;
const NAME_BYTES: u64 = 256;
const FIELDS: usize = 4096;
/// No text is longer.
const TEXT_BYTES: u64 = 1 << 24;
/// What a value takes beside its numbers: the lengths of its axes, its name while it is read, and
/// what names its place when it is looked at.
const VALUE: usize = 256;

/// The named variables of a file.
pub(super) fn variables(
    content: &Content,
    file: &Path,
) -> Result<Vec<(String, Value)>, ReadViewsError> {
    let big_endian = byte_order(content, file)?;
    let mut rest = &content[HEADER..];
    let mut budget = content.budget();
    let mut out: Vec<(String, Value)> = Vec::new();
    while !rest.is_empty() {
        let place = format!("variable {}", out.len() + 1);
        let left = rest.len() as u64;
        let mut outer =
            Stream::new(&mut rest, big_endian, file, place.clone(), Some(left), budget.clone());
        outer.make_room(&mut out)?;
        budget = outer.budget.clone();
        let tag = outer.need_tag("size")?;
        let size = tag.size as usize;
        match tag.kind {
            COMPRESSED => {
                let (packed, behind) = rest.split_at(size);
                let mut decoder = ZlibDecoder::new(packed);
                let mut inner =
                    Stream::new(&mut decoder, big_endian, file, place, None, budget.clone());
                let tag = inner.need_tag("size")?;
                if tag.kind != MATRIX {
                    return Err(inner.wrong("type", tag.kind.to_string(), "14, a matrix"));
                }
                inner.left = tag.size;
                out.push(matrix(&mut inner, 0)?);
                budget = inner.budget;
                rest = behind;
            }
            MATRIX => {
                let (mut body, behind) = rest.split_at(size);
                let mut inner =
                    Stream::new(&mut body, big_endian, file, place, Some(tag.size), budget.clone());
                out.push(matrix(&mut inner, 0)?);
                budget = inner.budget;
                // Some writers leave the padding away; less of it than a tag is nothing to be read.
                rest = behind.get((8 - size % 8) % 8..).unwrap_or_default();
            }
            other => {
                let found = format!("type {other}");
                return Err(outer.wrong("type", found, "14 (a matrix) or 15 (a compressed one)"));
            }
        }
    }
    Ok(out)
}

/// Whether the file is big-endian; an error where it is no version 5.
fn byte_order(bytes: &[u8], file: &Path) -> Result<bool, ReadViewsError> {
    let wrong = |field: &str, found: String| {
        let expected = "MATLAB's version 5 (re-save with `save(..., '-v7')`, or SciPy's savemat)";
        Err(ReadViewsError::field(file, field, found, expected))
    };
    let hdf5 = b"\x89HDF\r\n\x1a\n";
    if bytes.starts_with(hdf5) || bytes.get(512..520) == Some(hdf5) {
        return wrong("version", "version 7.3, which is HDF5".to_owned());
    }
    let Some(&[v0, v1, e0, e1]) = bytes.get(124..HEADER) else {
        return wrong("header", format!("{} bytes", bytes.len()));
    };
    let (big_endian, version) = match [e0, e1] {
        [b'M', b'I'] => (true, u16::from_be_bytes([v0, v1])),
        [b'I', b'M'] => (false, u16::from_le_bytes([v0, v1])),
        other => return wrong("byte order", format!("{other:?} (version 4, or no MAT file)")),
    };
    match version {
        0x0100 => Ok(big_endian),
        0x0200 => wrong("version", "version 7.3, which is HDF5".to_owned()),
        other => wrong("version", format!("{other:#06x}")),
    }
}

/// The name and the value of a matrix element, all of whose bytes are the stream's.
fn matrix(s: &mut Stream<'_>, depth: usize) -> Result<(String, Value), ReadViewsError> {
    s.charge(VALUE)?;
    if s.left == 0 {
        let array = Array { dims: vec![0, 0], data: Data::Bits(0, Vec::new()) };
        return Ok((String::new(), Value::Numbers(array)));
    }
    if depth > DEPTH {
        return Err(s.wrong("nesting", "structs and cells any deeper", format!("{DEPTH} levels")));
    }
    let flags = s.words("flags", 8)?;
    let &[flags, _] = flags.as_slice() else {
        return Err(s.wrong("flags", format!("{} words", flags.len()), "2"));
    };
    let class = flags as u32 & 0xff;
    // An opaque object has no shape; the rest of it is passed over with it.
    let dims = if class == 17 { vec![0, 0] } else { shape(s)? };
    s.charge(size_of_val(&dims[..]))?;
    let tag = s.need_tag("name")?;
    let name = s.bytes(tag, "name", NAME_BYTES)?;
    let name = String::from_utf8_lossy(&name).trim_end_matches('\0').to_owned();
    if depth == 0 && !name.is_empty() {
        s.place.clone_from(&name);
    }
    let count = dims
        .iter()
        .try_fold(1usize, |n, &d| n.checked_mul(d))
        .ok_or_else(|| s.wrong("shape", sizes(&dims), "a number of values that can be counted"))?;
    let value = match class {
        _ if flags & 0x0800 != 0 => Value::Unread("complex numbers"),
        1 => Value::Cells(nested(s, count, depth)?),
        2 => structs(s, count, depth)?,
        4 => Value::Text(text(s, &dims, count)?),
        6..=15 => Value::Numbers(Array { data: s.numbers(count)?, dims }),
        3 => Value::Unread("an object"),
        5 => Value::Unread("a sparse matrix (write full(x))"),
        16 => Value::Unread("a function handle"),
        17 => Value::Unread("an opaque object"),
        other => {
            return Err(s.wrong("class", other.to_string(), "one of MATLAB's, 1 to 17"));
        }
    };
    s.skip(s.left)?;
    Ok((name, value))
}

fn shape(s: &mut Stream<'_>) -> Result<Vec<usize>, ReadViewsError> {
    let dims = s.words("shape", AXES)?;
    let lengths: Option<Vec<usize>> = dims.iter().map(|&d| usize::try_from(d).ok()).collect();
    lengths
        .filter(|dims| dims.len() >= 2)
        .ok_or_else(|| s.wrong("shape", format!("{dims:?}"), "at least 2 axes, none below 0"))
}

/// Matrix elements that follow each other.
fn nested(s: &mut Stream<'_>, count: usize, depth: usize) -> Result<Vec<Value>, ReadViewsError> {
    let mut out = Vec::new();
    // No capacity in advance: the count is a claim, and every element needs its tag.
    for _ in 0..count {
        let tag: Tag = s.need_tag("element")?;
        if tag.kind != MATRIX {
            return Err(s.wrong("element", format!("type {}", tag.kind), "14, a matrix"));
        }
        let outer = s.left - tag.size;
        s.left = tag.size;
        s.make_room(&mut out)?;
        out.push(matrix(s, depth + 1)?.1);
        s.left = outer;
        let padding = (8 - tag.size % 8) % 8;
        s.skip(padding.min(s.left))?;
    }
    Ok(out)
}

fn structs(s: &mut Stream<'_>, count: usize, depth: usize) -> Result<Value, ReadViewsError> {
    let length = s.words("field name length", 4)?;
    let length = match length.as_slice() {
        &[length] if (1..=NAME_BYTES as i32).contains(&length) => length as usize,
        other => return Err(s.wrong("field name length", format!("{other:?}"), "1 to 256")),
    };
    let tag = s.need_tag("field names")?;
    let names = s.bytes(tag, "field names", (FIELDS * length) as u64)?;
    let fields: Vec<String> = names
        .chunks_exact(length)
        .map(|name| {
            let end = name.iter().position(|&b| b == 0).unwrap_or(length);
            String::from_utf8_lossy(&name[..end]).into_owned()
        })
        .collect();
    s.charge(fields.len() * (size_of::<String>() + length))?;
    let total = count.checked_mul(fields.len()).ok_or_else(|| {
        s.wrong("shape", count.to_string(), "a number of structs that can be counted")
    })?;
    let values = nested(s, total, depth)?;
    Ok(Value::Struct(Box::new(StructArray { fields, values })))
}

fn text(s: &mut Stream<'_>, dims: &[usize], count: usize) -> Result<String, ReadViewsError> {
    let Some(tag) = s.tag()? else { return Ok(String::new()) };
    let big_endian = s.is_big_endian();
    let size = match tag.kind {
        1 | 2 | 16 => 1,
        3 | 4 | 17 => 2,
        5 | 6 | 18 => 4,
        other => return Err(s.wrong("text", format!("type {other}"), "characters")),
    };
    let bytes = s.bytes(tag, "text", TEXT_BYTES.min(s.left.max(4)))?;
    // Letters, and the text, either of which may move into twice the room while it grows.
    let most = 24 * bytes.len();
    s.charge(most)?;
    let unit = |raw: &[u8]| {
        raw.iter().enumerate().fold(0u32, |unit, (k, &byte)| {
            unit | u32::from(byte) << (8 * if big_endian { raw.len() - 1 - k } else { k })
        })
    };
    let letters: Vec<char> = match (tag.kind, size) {
        (16, _) => String::from_utf8_lossy(&bytes).chars().collect(),
        (_, 2) => {
            let units = bytes.chunks_exact(2).map(|raw| unit(raw) as u16);
            char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
        }
        _ => {
            let units = bytes.chunks_exact(size).map(unit);
            units.map(|c| char::from_u32(c).unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
        }
    };
    let rows = dims[0];
    // Of no letters there may be billions of rows.
    let text: String = if rows <= 1 || count == 0 || letters.len() != count {
        letters.into_iter().collect()
    } else {
        // From a slice: an iterator would go through all rows before.
        let row = |i: usize| letters[i..].iter().step_by(rows).collect::<String>();
        (0..rows).map(|i| row(i).trim_end().to_owned() + "\n").collect()
    };
    s.budget.give_back((most - most.min(text.capacity())) as u64);
    Ok(text)
}
