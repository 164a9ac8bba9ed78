//! NumPy's `.npy` files of numbers: headers that are checked before anything is allocated.

use std::io::Write;

use pickle::{Dtype, row_major};

/// An array read from a `.npy` file, row-major, its numbers converted to one type.
///
/// In `f32` labels, masks and depths all fit: integers above 2^24 lose their last digits, which none
/// of them needs.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NpyArray<T = f32> {
    /// Lengths of the axes.
    pub(crate) shape: Vec<usize>,
    /// As many values as the product of the axes.
    pub(crate) data: Vec<T>,
    /// Whether its type has whole numbers alone.
    pub(crate) is_whole: bool,
}

/// One number a pixel.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NpyImage {
    /// Height and width.
    pub(crate) size: [usize; 2],
    pub(crate) data: Vec<f32>,
    /// Whether the type of the numbers has whole ones alone.
    pub(crate) is_whole: bool,
}

/// Why an array could not be read: the field of the header, what it says, what it may say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct NpyError {
    pub(crate) field: &'static str,
    pub(crate) found: String,
    pub(crate) expected: String,
}

const MAGIC: &[u8; 6] = b"\x93NUMPY";
const DTYPES: &str =
    "one of |b1, |i1, |u1, <i2, <u2, <i4, <u4, <i8, <u8, <f2, <f4, <f8 (or > for big-endian)";

fn error(field: &'static str, found: impl Into<String>, expected: impl Into<String>) -> NpyError {
    NpyError { field, found: found.into(), expected: expected.into() }
}

/// Reads an array whose axes are exactly one of `shapes`.
///
/// The shape is compared before the data is touched, and the data is a slice of `bytes`, so a
/// header that claims terabytes costs nothing.
pub(crate) fn read(bytes: &[u8], shapes: &[&[usize]]) -> Result<NpyArray, NpyError> {
    let expected = || shapes.iter().map(|s| format!("{s:?}")).collect::<Vec<_>>().join(" or ");
    read_if(bytes, |shape| shapes.contains(&shape), expected, |number| number as f32)
}

/// Reads a matrix of four columns and three rows, or of four, of which the last
/// is not looked at.
pub(crate) fn read_matrix(bytes: &[u8]) -> Result<[[f64; 4]; 3], NpyError> {
    let accepts = |shape: &[usize]| matches!(shape, [3 | 4, 4]);
    let array = read_if(bytes, accepts, || "(3, 4) or (4, 4)".to_owned(), |number| number)?;
    Ok(std::array::from_fn(|i| std::array::from_fn(|k| array.data[4 * i + k])))
}

/// Reads one number a pixel, of any size: `[H, W]`, or that with axes of one before or after it.
pub(crate) fn read_image(bytes: &[u8]) -> Result<NpyImage, NpyError> {
    let size = |shape: &[usize]| match *shape {
        [h, w] | [h, w, 1] | [1, h, w] | [1, 1, h, w] if h > 0 && w > 0 => Some([h, w]),
        _ => None,
    };
    let expected = || "(H, W), (H, W, 1), (1, H, W) or (1, 1, H, W)".to_owned();
    let array = read_if(bytes, |shape| size(shape).is_some(), expected, |number| number as f32)?;
    let size = size(&array.shape).expect("a shape that was just accepted");
    Ok(NpyImage { size, data: array.data, is_whole: array.is_whole })
}

/// Reads an array whose axes are accepted; what would have been is `expected`.
fn read_if<T: Copy>(
    bytes: &[u8],
    accepts: impl Fn(&[usize]) -> bool,
    expected: impl Fn() -> String,
    convert: impl Fn(f64) -> T,
) -> Result<NpyArray<T>, NpyError> {
    let magic = "\\x93NUMPY and a version";
    if bytes.len() < 10 || &bytes[..6] != MAGIC {
        return Err(error("magic", "other bytes", magic));
    }
    let (length, start): (usize, usize) = match bytes[6] {
        1 => (usize::from(u16::from_le_bytes([bytes[8], bytes[9]])), 10),
        2 | 3 if bytes.len() >= 12 => {
            (u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]) as usize, 12)
        }
        other => return Err(error("version", other.to_string(), "1, 2 or 3")),
    };
    let header =
        start.checked_add(length).and_then(|end| bytes.get(start..end)).ok_or_else(|| {
            error("header length", length.to_string(), format!("at most {}", bytes.len() - start))
        })?;
    let header = String::from_utf8_lossy(header);
    let descr = value_of(&header, "descr")
        .ok_or_else(|| error("descr", "nothing", DTYPES))?
        .trim_matches(['\'', '"'])
        .to_owned();
    let fortran = match value_of(&header, "fortran_order") {
        Some("True") => true,
        Some("False") => false,
        other => return Err(error("fortran_order", other.unwrap_or("nothing"), "True or False")),
    };
    let shape_text = value_of(&header, "shape").unwrap_or("nothing");
    let shape = parse_shape(shape_text)
        .filter(|shape| accepts(shape.as_slice()))
        .ok_or_else(|| error("shape", shape_text, expected()))?;
    let kind = dtype(&descr).ok_or_else(|| error("descr", descr.as_str(), DTYPES))?;
    let data = &bytes[start + length..];
    let needed = shape.iter().try_fold(kind.size(), |n, &axis| n.checked_mul(axis));
    if needed != Some(data.len()) {
        let wanted = needed.map_or_else(|| "too many".to_owned(), |n| n.to_string());
        let wanted = format!("{wanted} ({shape_text} of {descr})");
        return Err(error("data, in bytes", data.len().to_string(), wanted));
    }
    let values: Vec<T> = data.chunks_exact(kind.size()).map(|b| convert(kind.number(b))).collect();
    let data = if fortran { row_major(&values, &shape) } else { values };
    Ok(NpyArray { shape, data, is_whole: kind.is_whole() })
}

/// The text after `'key':` in a Python dict of literals, up to the comma that ends it.
fn value_of<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let at = header.find(&format!("'{key}'")).or_else(|| header.find(&format!("\"{key}\"")))?;
    let rest = header[at + key.len() + 2..].trim_start().strip_prefix(':')?.trim_start();
    let end = if rest.starts_with('(') {
        rest.find(')')? + 1
    } else {
        rest.find([',', '}']).unwrap_or(rest.len())
    };
    Some(rest[..end].trim())
}

fn parse_shape(text: &str) -> Option<Vec<usize>> {
    let inner = text.strip_prefix('(')?.strip_suffix(')')?;
    inner
        .split(',')
        .map(str::trim)
        .filter(|part| !part.is_empty())
        .map(|part| part.parse().ok())
        .collect()
}

/// Files say the order of bytes, where there is one.
fn dtype(descr: &str) -> Option<Dtype> {
    let ordered = descr.starts_with(['<', '>', '=']);
    let dtype = Dtype::named(descr)?;
    (descr.len() == 3 && (ordered || (descr.starts_with('|') && dtype.size() == 1)))
        .then_some(dtype)
}

/// Writes 32-bit integers, version 1.0, row-major, as kaolin's writer does.
pub(crate) fn write_i32(
    out: &mut impl Write,
    shape: &[usize],
    values: impl Iterator<Item = i32>,
) -> std::io::Result<()> {
    let axes = shape.iter().fold(String::new(), |text, n| text + &n.to_string() + ", ");
    let mut header =
        format!("{{'descr': '<i4', 'fortran_order': False, 'shape': ({}), }}", axes.trim_end());
    // The data starts at a multiple of 64 bytes, behind a newline.
    let padding = (64 - (MAGIC.len() + 4 + header.len() + 1) % 64) % 64;
    header.push_str(&" ".repeat(padding));
    header.push('\n');
    out.write_all(MAGIC)?;
    out.write_all(&[1, 0])?;
    out.write_all(&(header.len() as u16).to_le_bytes())?;
    out.write_all(header.as_bytes())?;
    let mut bytes = Vec::with_capacity(4 * shape.iter().product::<usize>());
    values.for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
    out.write_all(&bytes)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn file(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header =
            format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend_from_slice(&(header.len() as u16).to_le_bytes());
        bytes.extend_from_slice(header.as_bytes());
        bytes.extend_from_slice(data);
        bytes
    }

    #[test]
    fn what_is_written_is_read() {
        let mut bytes = Vec::new();
        write_i32(&mut bytes, &[2, 3, 1], 0..6).unwrap();
        assert_eq!(bytes.len() % 64, 24);
        let array = read(&bytes, &[&[2, 3], &[2, 3, 1]]).unwrap();
        assert_eq!(array.shape, [2, 3, 1]);
        assert_eq!(array.data, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    }

    #[test]
    fn every_number_type_is_read() {
        let one =
            |descr: &str, data: &[u8]| read(&file(descr, "(1,)", data), &[&[1]]).unwrap().data[0];
        assert_eq!(one("|b1", &[1]), 1.0);
        assert_eq!(one("|i1", &[255]), -1.0);
        assert_eq!(one("<i2", &(-300i16).to_le_bytes()), -300.0);
        assert_eq!(one(">u2", &300u16.to_be_bytes()), 300.0);
        assert_eq!(one("<i8", &(-5i64).to_le_bytes()), -5.0);
        assert_eq!(one("<f2", &[0, 0x3e]), 1.5);
        assert_eq!(one(">f2", &[0xc1, 0]), -2.5);
        assert_eq!(one("<f4", &1.5f32.to_le_bytes()), 1.5);
        assert_eq!(one(">f8", &(-2.5f64).to_be_bytes()), -2.5);
    }

    #[test]
    fn fortran_order_is_turned_round() {
        let bytes = file("|u1", "(2, 3)", &[0, 3, 1, 4, 2, 5]);
        let text = String::from_utf8_lossy(&bytes)
            .replace("'fortran_order': False", "'fortran_order': True ");
        assert!(text.contains("True"));
        let at = bytes.windows(5).position(|w| w == b"False").unwrap();
        let mut bytes = bytes;
        bytes[at..at + 5].copy_from_slice(b"True ");
        assert_eq!(read(&bytes, &[&[2, 3]]).unwrap().data, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    }

    #[test]
    fn each_mistake_names_its_field() {
        let field = |bytes: &[u8]| read(bytes, &[&[2, 2]]).unwrap_err().field;
        assert_eq!(field(b"PK"), "magic");
        assert_eq!(field(&file("|u1", "(99999999999, 99999)", &[0; 4])), "shape");
        assert_eq!(field(&file("<c8", "(2, 2)", &[0; 32])), "descr");
        assert_eq!(field(&file("|O", "(2, 2)", &[0; 32])), "descr");
        assert_eq!(field(&file("<i4", "(2, 2)", &[0; 15])), "data, in bytes");
        let mut long = file("<i4", "(2, 2)", &[0; 16]);
        long[8..10].copy_from_slice(&[255, 255]);
        assert_eq!(field(&long), "header length");
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = read(&bytes, &[&[2, 2]]);
            let mut dressed = b"\x93NUMPY\x01\x00".to_vec();
            dressed.extend_from_slice(&bytes);
            let _ = read(&dressed, &[&[2, 2]]);
        }

        #[test]
        fn no_header_makes_it_panic(header in "[{}':,()a-z0-9<>|_ ]{0,80}", tail in 0usize..40) {
            let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
            bytes.extend_from_slice(&(header.len() as u16).to_le_bytes());
            bytes.extend_from_slice(header.as_bytes());
            bytes.extend(std::iter::repeat_n(0, tail));
            let _ = read(&bytes, &[&[2, 2]]);
        }
    }
}
