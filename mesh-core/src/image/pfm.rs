//! Portable float maps: what MiDaS and stereo benchmarks write.
//!
//! A few bytes of text (`Pf` for one channel, `PF` for three; width and height; a number whose sign is the
//! byte order, negative for little-endian), then rows of `f32` from the *bottom* of the image to its top.
//!
//! # References
//! P. Debevec, *PFM Portable FloatMap Image Format*; the definition of the Middlebury stereo benchmark.

use std::path::Path;

use super::error::{too_large, too_many};
use super::file::read_bytes;
use super::{Image, ImageError};
use crate::Limits;
use crate::io::{WriteError, write_atomic};

/// Reads a PFM file: the numbers as they stand, row 0 at the top; infinities and NaN may be among them.
///
/// The scale in the header says only what the numbers are to be multiplied with for absolute units, which
/// nobody agrees on; its sign alone is used.
///
/// # Errors
/// The file cannot be read, is no PFM, or has fewer numbers than its header claims.
pub fn read_pfm(path: impl AsRef<Path>) -> Result<Image, ImageError> {
    let path = path.as_ref();
    decode_pfm(&read_bytes(path)?, path)
}

/// The same for bytes that are already in memory; `name` stands for them in errors.
///
/// # Errors
/// As [`read_pfm`].
pub fn decode_pfm(bytes: &[u8], name: impl AsRef<Path>) -> Result<Image, ImageError> {
    decode_pfm_with(bytes, name, &Limits::default())
}

/// [`decode_pfm`] within other limits.
///
/// # Errors
/// As [`read_pfm`].
pub fn decode_pfm_with(
    bytes: &[u8],
    name: impl AsRef<Path>,
    limits: &Limits,
) -> Result<Image, ImageError> {
    let path = name.as_ref();
    let failed = |what: String| ImageError::Decode { path: path.to_owned(), what };
    let mut rest = bytes;
    let mut word = |field: &str| {
        take_word(&mut rest).ok_or_else(|| failed(format!("{field}: the header ends before it")))
    };
    let channels = match word("the first two bytes")? {
        "Pf" => 1,
        "PF" => 3,
        found => {
            let found: String = found.chars().take(16).collect();
            return Err(failed(format!("the first word is {found:?}, expected Pf or PF")));
        }
    };
    let mut number = |field: &str| {
        let found = word(field)?;
        let parsed = found.parse::<u32>().ok().filter(|&n| n > 0);
        parsed.ok_or_else(|| failed(format!("{field} is {found:?}, expected a number above 0")))
    };
    let (width, height) = (number("width")?, number("height")?);
    let scale = word("scale")?;
    let scale = scale
        .parse::<f64>()
        .ok()
        .filter(|s| *s != 0.0 && s.is_finite())
        .ok_or_else(|| failed(format!("scale is {scale:?}, expected a number other than 0")))?;
    let needed = u64::from(width) * u64::from(height);
    let needed = needed.saturating_mul(4 * channels as u64);
    let (width, height) = (width as usize, height as usize);
    // A header whose lines end as Windows has them: one byte more than the numbers.
    if needed.checked_add(1) == Some(rest.len() as u64) && rest[0] == b'\n' {
        rest = &rest[1..];
    }
    too_large(path, (width, height), needed, rest.len() as u64, bytes.len())?;
    // The file is as long as the image: that it has three channels of floats is no bomb.
    too_many(path, (width, height), needed / channels as u64, limits)?;
    let number = |b: &[u8; 4]| {
        if scale < 0.0 { f32::from_le_bytes(*b) } else { f32::from_be_bytes(*b) }
    };
    let numbers = &rest.as_chunks::<4>().0[..width * height * channels];
    let rows = numbers.chunks_exact(width * channels).rev();
    Ok(Image { height, width, channels, data: rows.flatten().map(number).collect() })
}

/// The next word of the header; exactly one blank ends it.
fn take_word<'a>(rest: &mut &'a [u8]) -> Option<&'a str> {
    let start = rest.iter().position(|b| !b.is_ascii_whitespace())?;
    // No word of a header is longer; what follows it may be anything.
    let word = &rest[start..rest.len().min(start + 64)];
    let end = word.iter().position(u8::is_ascii_whitespace)?;
    let word = std::str::from_utf8(&word[..end]).ok()?;
    *rest = &rest[start + end + 1..];
    Some(word)
}

/// A PFM file in memory, little-endian.
///
/// # Panics
/// If the image is empty, has other than 1 or 3 channels, or its data is of another length.
pub fn encode_pfm(image: &Image) -> Vec<u8> {
    let Image { height, width, channels, ref data } = *image;
    assert!(
        data.len() == height * width * channels && !data.is_empty() && matches!(channels, 1 | 3),
        "encode_pfm: {width} x {height} pixels of {channels} channels in {} numbers",
        data.len()
    );
    let kind = if channels == 1 { "Pf" } else { "PF" };
    let mut bytes = format!("{kind}\n{width} {height}\n-1.0\n").into_bytes();
    for row in data.chunks_exact(width * channels).rev() {
        bytes.extend(row.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes
}

/// Writes a PFM file; it appears whole or not at all.
///
/// # Errors
/// The file cannot be written.
///
/// # Panics
/// As [`encode_pfm`].
pub fn write_pfm(path: impl AsRef<Path>, image: &Image) -> Result<(), WriteError> {
    let bytes = encode_pfm(image);
    write_atomic(path, |w| w.write_all(&bytes))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn rows_run_upwards_in_either_byte_order() {
        // 2 x 2, bottom row first: what the format says, byte by byte.
        let values = [3.0_f32, 4.0, 1.0, f32::INFINITY];
        let little: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let big: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
        let expected =
            Image { height: 2, width: 2, channels: 1, data: vec![1.0, f32::INFINITY, 3.0, 4.0] };
        let file = |head: &str, data: &[u8]| [head.as_bytes(), data].concat();
        assert_eq!(decode_pfm(&file("Pf\n2 2\n-1.0\n", &little), "a").unwrap(), expected);
        assert_eq!(decode_pfm(&file("Pf 2\n2\n0.0039\n", &big), "a").unwrap(), expected);
        // A number whose first byte is a blank: one blank alone ends the header.
        let odd = f32::from_le_bytes([b' ', b'\n', 0, 0x40]);
        let image = Image { height: 1, width: 1, channels: 1, data: vec![odd] };
        assert_eq!(decode_pfm(&encode_pfm(&image), "a").unwrap(), image);
    }

    #[test]
    fn bad_files_name_field_and_file() {
        let error = |bytes: &[u8]| decode_pfm(bytes, "maps/7.pfm").unwrap_err().to_string();
        for (bytes, part) in [
            (&b""[..], "first two bytes"),
            (b"P5\n2 2\n255\n", "\"P5\", expected Pf or PF"),
            (b"Pf\n0 2\n-1\n", "width is \"0\""),
            (b"Pf\n2 2\n0\n", "scale is \"0\""),
            (b"Pf\n2 2\n", "scale"),
            (b"Pf\n4000000000 4000000000\n-1\n....", "4000000000 x 4000000000"),
        ] {
            let found = error(bytes);
            assert!(found.contains("maps/7.pfm") && found.contains(part), "{found}");
        }
    }

    proptest! {
        #[test]
        fn there_and_back(h in 1usize..5, w in 1usize..5, color: bool, seed: u32) {
            let channels = if color { 3 } else { 1 };
            let data = (0..h * w * channels).map(|i| (i as f32 + 0.5) * seed as f32).collect();
            let image = Image { height: h, width: w, channels, data };
            prop_assert_eq!(decode_pfm(&encode_pfm(&image), "a").unwrap(), image);
        }

        #[test]
        fn damaged_files_are_errors_or_images(at: prop::sample::Index, byte: u8, cut: prop::sample::Index) {
            let mut bytes = encode_pfm(&Image::new(3, 5, 1));
            let place = at.index(bytes.len());
            bytes[place] = byte;
            let _ = decode_pfm(&bytes, "a");
            bytes.truncate(cut.index(bytes.len()));
            let _ = decode_pfm(&bytes, "a");
        }
    }

    #[test]
    fn lines_of_a_header_may_end_as_in_windows() {
        let numbers = [1.0_f32, -2.5];
        let mut bytes = b"Pf\r\n2 1\r\n-1.0\r\n".to_vec();
        bytes.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
        assert_eq!(decode_pfm(&bytes, "a.pfm").unwrap().data, numbers);
    }
}
