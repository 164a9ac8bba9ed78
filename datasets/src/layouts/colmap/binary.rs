//! COLMAP's binary files: little-endian, counts that are checked against the bytes that are there.

use std::path::Path;

use super::model::{CAMERA_MODELS, ColmapPoint, Model, ModelCamera, ModelImage};
use super::rig::{Exposure, Pose, Rigs};
use crate::error::ReadViewsError;

/// What is left of a file, with what is said where it ends too early.
struct Bytes<'a> {
    file: &'a Path,
    rest: &'a [u8],
    /// What is being read, like `image 4 of 10`.
    place: String,
}

impl<'a> Bytes<'a> {
    fn wrong(
        &self,
        field: &str,
        found: impl std::fmt::Display,
        expected: impl Into<String>,
    ) -> ReadViewsError {
        let space = if self.place.is_empty() { "" } else { ", " };
        let field = format!("{}{space}{field}", self.place);
        ReadViewsError::field(self.file, field, found.to_string(), expected)
    }

    fn take(&mut self, count: usize, field: &str) -> Result<&'a [u8], ReadViewsError> {
        let Some((taken, rest)) = self.rest.split_at_checked(count) else {
            let found = format!("the end of the file {} bytes on", self.rest.len());
            return Err(self.wrong(field, found, format!("{count} bytes")));
        };
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, field: &str) -> Result<[u8; N], ReadViewsError> {
        let bytes = self.take(N, field)?;
        Ok(bytes.try_into().expect("as many bytes as were taken"))
    }

    fn u64(&mut self, field: &str) -> Result<u64, ReadViewsError> {
        self.array(field).map(u64::from_le_bytes)
    }

    fn u32(&mut self, field: &str) -> Result<u32, ReadViewsError> {
        self.array(field).map(u32::from_le_bytes)
    }

    fn number(&mut self, field: &str) -> Result<f64, ReadViewsError> {
        let value = f64::from_le_bytes(self.array(field)?);
        if value.is_finite() { Ok(value) } else { Err(self.wrong(field, value, "a finite number")) }
    }

    fn numbers<const N: usize>(&mut self, fields: [&str; N]) -> Result<[f64; N], ReadViewsError> {
        let mut out = [0.0; N];
        for (out, field) in out.iter_mut().zip(fields) {
            *out = self.number(field)?;
        }
        Ok(out)
    }

    fn pixels(&mut self, field: &str) -> Result<usize, ReadViewsError> {
        let value = self.u64(field)?;
        if (1..1_000_000_000).contains(&value) {
            Ok(value as usize)
        } else {
            Err(self.wrong(field, value, "a whole number of pixels"))
        }
    }

    /// A count of records of at least so many bytes, all of which must be there.
    fn count(&mut self, field: &str, least: usize) -> Result<usize, ReadViewsError> {
        let claimed = self.u64(field)?;
        let most = self.rest.len() / least;
        if claimed <= most as u64 {
            Ok(claimed as usize)
        } else {
            let expected = format!("at most {most}, for which there are bytes");
            Err(self.wrong(field, claimed, expected))
        }
    }
}

/// Reads `cameras.bin` into the model.
pub(super) fn cameras(bytes: &[u8], file: &Path, model: &mut Model) -> Result<(), ReadViewsError> {
    let mut bytes = Bytes { file, rest: bytes, place: String::new() };
    let count = bytes.count("number of cameras", 24 + 2 * 8)?;
    for k in 0..count {
        bytes.place = format!("camera {k} of {count}");
        let (id, number) = (bytes.u32("camera_id")?, bytes.u32("model_id")?);
        let Some(&(name, params)) = CAMERA_MODELS.get(number as usize) else {
            let expected = format!("0 to {}", CAMERA_MODELS.len() - 1);
            return Err(bytes.wrong("model_id", number, expected));
        };
        let (width, height) = (bytes.pixels("width")?, bytes.pixels("height")?);
        let params = (0..params).map(|_| bytes.number("params")).collect::<Result<Vec<_>, _>>()?;
        model.cameras.insert(id, ModelCamera { model: name.to_owned(), width, height, params });
    }
    Ok(())
}

/// Reads `images.bin` into the model.
pub(super) fn images(bytes: &[u8], file: &Path, model: &mut Model) -> Result<(), ReadViewsError> {
    let mut bytes = Bytes { file, rest: bytes, place: String::new() };
    let count = bytes.count("number of images", 4 + 7 * 8 + 4 + 1 + 8)?;
    for k in 0..count {
        bytes.place = format!("image {k} of {count}");
        let id = bytes.u32("image_id")?;
        let quaternion = bytes.numbers(["qw", "qx", "qy", "qz"])?;
        let translation = bytes.numbers(["tx", "ty", "tz"])?;
        let camera = bytes.u32("camera_id")?;
        let Some(end) = bytes.rest.iter().position(|&b| b == 0) else {
            return Err(bytes.wrong("name", "no end", "text that ends in a zero byte"));
        };
        let name = String::from_utf8_lossy(bytes.take(end, "name")?).into_owned();
        bytes.take(1, "name")?;
        if name.is_empty() {
            return Err(bytes.wrong("name", "nothing", "the name of the image"));
        }
        let seen = bytes.count("number of points2D", 24)?;
        bytes.take(24 * seen, "points2D")?;
        model.images.push(ModelImage { id, quaternion, translation, camera, name });
    }
    Ok(())
}

/// The number of cameras among COLMAP's kinds of sensors.
const CAMERA: u32 = 0;

impl Bytes<'_> {
    fn pose(&mut self) -> Result<Pose, ReadViewsError> {
        let quaternion = self.numbers(["qw", "qx", "qy", "qz"])?;
        if quaternion.iter().all(|&x| x == 0.0) {
            return Err(self.wrong("qw to qz", "zeros", "a quaternion"));
        }
        Ok(Pose { quaternion, translation: self.numbers(["tx", "ty", "tz"])? })
    }
}

/// Reads `rigs.bin`.
pub(super) fn rigs(bytes: &[u8], file: &Path, rigs: &mut Rigs) -> Result<(), ReadViewsError> {
    let mut bytes = Bytes { file, rest: bytes, place: String::new() };
    let count = bytes.count("number of rigs", 4 + 4)?;
    for k in 0..count {
        bytes.place = format!("rig {k} of {count}");
        let (rig, sensors) = (bytes.u32("rig_id")?, bytes.u32("number of sensors")?);
        for at in 0..sensors {
            let (kind, id) = (bytes.u32("sensor type")?, bytes.u32("sensor_id")?);
            if at == 0 {
                if kind == CAMERA {
                    rigs.add_reference(rig, id);
                }
                continue;
            }
            let [known] = bytes.array("has_pose")?;
            let pose = if known == 0 { None } else { Some(bytes.pose()?) };
            if kind == CAMERA {
                rigs.add_sensor(rig, id, pose);
            }
        }
    }
    Ok(())
}

/// Reads `frames.bin`.
pub(super) fn frames(bytes: &[u8], file: &Path, rigs: &mut Rigs) -> Result<(), ReadViewsError> {
    let mut bytes = Bytes { file, rest: bytes, place: String::new() };
    let count = bytes.count("number of frames", 4 + 4 + 7 * 8 + 4)?;
    for k in 0..count {
        bytes.place = format!("frame {k} of {count}");
        let (frame, rig) = (bytes.u32("frame_id")?, bytes.u32("rig_id")?);
        let pose = bytes.pose()?;
        for _ in 0..bytes.u32("number of data")? {
            let (kind, camera) = (bytes.u32("sensor type")?, bytes.u32("sensor_id")?);
            let image = bytes.u64("data_id")?;
            if kind == CAMERA {
                rigs.add_exposure(image, Exposure { frame, rig, camera, pose });
            }
        }
    }
    Ok(())
}

/// Reads `points3D.bin`.
pub(super) fn points(bytes: &[u8], file: &Path) -> Result<Vec<ColmapPoint>, ReadViewsError> {
    let mut bytes = Bytes { file, rest: bytes, place: String::new() };
    let count = bytes.count("number of points", 8 + 3 * 8 + 3 + 8 + 8)?;
    let mut points = Vec::with_capacity(count);
    for k in 0..count {
        bytes.place = format!("point {k} of {count}");
        bytes.u64("point3D_id")?;
        let position = bytes.numbers(["x", "y", "z"])?;
        let color = bytes.array("color")?;
        let error = bytes.number("error")?;
        let observations = bytes.count("track length", 8)?;
        bytes.take(8 * observations, "track")?;
        points.push(ColmapPoint { position, color, error, observations });
    }
    Ok(points)
}
