//! One `.dat`: points with normals and, in the ports, the image.

use std::path::Path;

use mesh_core::ByteImage;
use mesh_core::io::write_atomic;
use pickle::{Item, Pickle, PickleError};

use crate::content::Content;
use crate::dataset::SurfacePoints;
use crate::error::{ReadViewsError, WriteViewsError};
use crate::source::Source;

/// No sample is longer than this: the published ones have about 1 MB.
const MOST_BYTES: u64 = 1 << 26;

/// What stands in a `.dat`.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// The image, where it is in the file: `[H, W, 3]` or `[H, W, 4]`, as it is.
    pub picture: Option<ByteImage>,
    /// Points and normals in the camera's frame. The originals' normals point inwards where the
    /// faces of the models are wound so.
    pub points: SurfacePoints,
}

/// Reads a sample of either kind.
///
/// # Errors
/// If the file cannot be read, is no pickle of arrays, or these are not of the stated shapes.
pub fn read_sample(path: &Path) -> Result<Sample, ReadViewsError> {
    let bytes = read_bytes(path)?;
    decode(&bytes).map_err(|e| ReadViewsError::field(path, e.field, e.found, e.expected))
}

pub(super) fn read_bytes(path: &Path) -> Result<Content, ReadViewsError> {
    let folder = path.parent().unwrap_or_else(|| Path::new(""));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    Source::folder(folder).open()?.read(&name, "pickle", MOST_BYTES)
}

fn decode(bytes: &[u8]) -> Result<Sample, PickleError> {
    let pickle = Pickle::parse(bytes)?;
    let root = pickle.root();
    if root.is_array() {
        return Ok(Sample { picture: None, points: points(&root)? });
    }
    let [picture, label] = root.elements(2)?.try_into().expect("two elements");
    let points = points(&label)?;
    Ok(Sample { picture: Some(image(&picture)?), points })
}

fn points(item: &Item<'_, '_>) -> Result<SurfacePoints, PickleError> {
    let rows = item.rows::<6>()?;
    let part =
        |start: usize| rows.iter().map(move |r| std::array::from_fn(|k| r[start + k] as f32));
    Ok(SurfacePoints { positions: part(0).collect(), normals: part(3).collect() })
}

fn image(item: &Item<'_, '_>) -> Result<ByteImage, PickleError> {
    let numbers = item.numbers()?;
    match *numbers.shape.as_slice() {
        [height, width, channels @ (3 | 4)] if numbers.bytes && height * width > 0 => {
            let data = numbers.data.iter().map(|&v| v as u8).collect();
            Ok(ByteImage { height, width, channels, data })
        }
        _ => Err(PickleError {
            field: item.field.clone(),
            found: format!("an array {:?}", numbers.shape),
            expected: "a picture: bytes, [H, W, 3] or [H, W, 4]".to_owned(),
        }),
    }
}

/// Writes a sample as the PyTorch ports read it, or without an image as the original does,
/// atomically: a pickle of protocol 2 that Python 2 and 3 load (`encoding="latin1"`), points as
/// 32-bit floats.
///
/// # Errors
/// If the file cannot be written, there are not as many normals as points, or the image is empty.
pub fn write_sample(path: &Path, sample: &Sample) -> Result<(), WriteViewsError> {
    let SurfacePoints { positions, normals } = &sample.points;
    if positions.len() != normals.len() {
        let what = format!("{} points with {} normals", positions.len(), normals.len());
        return Err(WriteViewsError::new(path, what));
    }
    let rows = positions.iter().zip(normals).flat_map(|(p, n)| [*p, *n]);
    let label: Vec<u8> = rows.flatten().flat_map(f32::to_le_bytes).collect();
    let mut out = vec![0x80, 2];
    if let Some(ByteImage { height, width, channels, data }) = &sample.picture {
        if data.is_empty() || data.len() != height * width * channels {
            return Err(WriteViewsError::new(path, "the picture is empty or not of its size"));
        }
        out.push(b']');
        out.push(b'(');
        array(&mut out, &[*height, *width, *channels], "u1", data);
        array(&mut out, &[positions.len(), 6], "f4", &label);
        out.push(b'e');
    } else {
        array(&mut out, &[positions.len(), 6], "f4", &label);
    }
    out.push(b'.');
    write_atomic(path, |file| file.write_all(&out)).map_err(|e| WriteViewsError::new(path, e))
}

/// An array as NumPy pickles it for Python 2.
fn array(out: &mut Vec<u8>, shape: &[usize], dtype: &str, data: &[u8]) {
    let text = |out: &mut Vec<u8>, text: &[u8]| {
        out.push(b'U');
        out.push(text.len() as u8);
        out.extend(text);
    };
    let number = |out: &mut Vec<u8>, n: i32| {
        out.push(b'J');
        out.extend(n.to_le_bytes());
    };
    out.extend(b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\0\x85");
    text(out, b"b");
    out.extend(b"\x87R("); // three arguments, the call; then the state
    number(out, 1);
    out.push(b'(');
    for &n in shape {
        number(out, n as i32);
    }
    out.extend(b"tcnumpy\ndtype\n");
    text(out, dtype.as_bytes());
    out.extend(b"K\0K\x01\x87R(");
    number(out, 3);
    text(out, if dtype == "u1" { b"|" } else { b"<" });
    out.extend(b"NNN");
    number(out, -1);
    number(out, -1);
    number(out, 0);
    out.extend(b"tb\x89T"); // the dtype is complete; not in Fortran order; the bytes
    out.extend((data.len() as u32).to_le_bytes());
    out.extend(data);
    out.extend(b"tb");
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("02691156_x_00.dat");
        let points = SurfacePoints {
            positions: vec![[0.1, 0.2, -0.8], [1.0, -2.0, -3.0]],
            normals: vec![[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]],
        };
        let picture = ByteImage { height: 2, width: 3, channels: 3, data: (0..18).collect() };
        for picture in [None, Some(picture)] {
            let sample = Sample { picture, points: points.clone() };
            write_sample(&path, &sample).unwrap();
            assert_eq!(read_sample(&path).unwrap(), sample);
        }
    }
}
