//! COLMAP's text files.

use std::path::Path;

use super::model::{ColmapPoint, Model, ModelCamera, ModelImage};
use super::rig::{Exposure, Pose, Rigs};
use crate::content::cut;
use crate::error::ReadViewsError;

/// One line that holds words, with its number for messages.
struct Line<'a> {
    file: &'a Path,
    number: usize,
    text: &'a str,
    rest: &'a str,
}

impl<'a> Line<'a> {
    fn new(file: &'a Path, number: usize, text: &'a str) -> Self {
        Self { file, number, text, rest: text.trim() }
    }

    /// Whether the line says nothing.
    fn is_empty(&self) -> bool {
        self.rest.is_empty() || self.rest.starts_with('#')
    }

    fn wrong(&self, field: &str, found: &str, expected: &str) -> ReadViewsError {
        let (place, found) = (format!("line {}, {field}", self.number), cut(found));
        ReadViewsError::field(self.file, place, format!("{found:?}"), expected)
    }

    fn word(&mut self, field: &str) -> Result<&'a str, ReadViewsError> {
        let end = self.rest.find(char::is_whitespace).unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        self.rest = rest.trim_start();
        if word.is_empty() {
            return Err(self.wrong(field, self.text.trim(), "a value: the line ends before it"));
        }
        Ok(word)
    }

    fn parsed<T: std::str::FromStr>(
        &mut self,
        field: &str,
        expected: &str,
    ) -> Result<T, ReadViewsError> {
        let word = self.word(field)?;
        word.parse().map_err(|_| self.wrong(field, word, expected))
    }

    fn number(&mut self, field: &str) -> Result<f64, ReadViewsError> {
        let word = self.word(field)?;
        let value = word.parse().ok().filter(|v: &f64| v.is_finite());
        value.ok_or_else(|| self.wrong(field, word, "a finite number"))
    }

    fn numbers<const N: usize>(&mut self, fields: [&str; N]) -> Result<[f64; N], ReadViewsError> {
        let mut out = [0.0; N];
        for (out, field) in out.iter_mut().zip(fields) {
            *out = self.number(field)?;
        }
        Ok(out)
    }

    fn id(&mut self, field: &str) -> Result<u32, ReadViewsError> {
        self.parsed(field, "a whole number from 0 to 4294967295")
    }

    fn pixels(&mut self, field: &str) -> Result<usize, ReadViewsError> {
        let word = self.word(field)?;
        let value = word.parse().ok().filter(|n: &usize| (1..1_000_000_000).contains(n));
        value.ok_or_else(|| self.wrong(field, word, "a whole number of pixels"))
    }
}

fn lines<'a>(text: &'a str, file: &'a Path) -> impl Iterator<Item = Line<'a>> {
    text.lines().enumerate().map(move |(i, line)| Line::new(file, i + 1, line))
}

/// Reads `cameras.txt` into the model.
pub(super) fn cameras(bytes: &[u8], file: &Path, model: &mut Model) -> Result<(), ReadViewsError> {
    let text = String::from_utf8_lossy(bytes);
    for mut line in lines(&text, file).filter(|line| !line.is_empty()) {
        let id = line.id("CAMERA_ID")?;
        let name = line.word("MODEL")?.to_owned();
        let (width, height) = (line.pixels("WIDTH")?, line.pixels("HEIGHT")?);
        let mut params = Vec::new();
        while !line.rest.is_empty() {
            params.push(line.number("PARAMS[]")?);
        }
        model.cameras.insert(id, ModelCamera { model: name, width, height, params });
    }
    Ok(())
}

/// Reads `images.txt` into the model: two lines an image, of which the second may be empty.
pub(super) fn images(bytes: &[u8], file: &Path, model: &mut Model) -> Result<(), ReadViewsError> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = lines(&text, file);
    while let Some(mut line) = lines.next() {
        if line.is_empty() {
            continue;
        }
        let id = line.id("IMAGE_ID")?;
        let quaternion = line.numbers(["QW", "QX", "QY", "QZ"])?;
        let translation = line.numbers(["TX", "TY", "TZ"])?;
        let camera = line.id("CAMERA_ID")?;
        // Names may hold spaces.
        let name = line.rest.trim_end().to_owned();
        if name.is_empty() {
            return Err(line.wrong("NAME", line.text.trim(), "the name of the image"));
        }
        model.images.push(ModelImage { id, quaternion, translation, camera, name });
        // The points that the image saw, which nothing here needs.
        lines.next();
    }
    Ok(())
}

/// What COLMAP calls a camera among its kinds of sensors.
const CAMERA: &str = "CAMERA";

impl Line<'_> {
    fn pose(&mut self) -> Result<Pose, ReadViewsError> {
        let quaternion = self.numbers(["QW", "QX", "QY", "QZ"])?;
        if quaternion.iter().all(|&x| x == 0.0) {
            return Err(self.wrong("QW to QZ", "0 0 0 0", "a quaternion"));
        }
        Ok(Pose { quaternion, translation: self.numbers(["TX", "TY", "TZ"])? })
    }
}

/// Reads `rigs.txt`.
pub(super) fn rigs(bytes: &[u8], file: &Path, rigs: &mut Rigs) -> Result<(), ReadViewsError> {
    let text = String::from_utf8_lossy(bytes);
    for mut line in lines(&text, file).filter(|line| !line.is_empty()) {
        let (rig, sensors) = (line.id("RIG_ID")?, line.id("NUM_SENSORS")?);
        for at in 0..sensors {
            let (kind, id) = (line.word("SENSOR_TYPE")?, line.id("SENSOR_ID")?);
            if at == 0 {
                if kind == CAMERA {
                    rigs.add_reference(rig, id);
                }
                continue;
            }
            let pose = if line.id("HAS_POSE")? == 0 { None } else { Some(line.pose()?) };
            if kind == CAMERA {
                rigs.add_sensor(rig, id, pose);
            }
        }
    }
    Ok(())
}

/// Reads `frames.txt`.
pub(super) fn frames(bytes: &[u8], file: &Path, rigs: &mut Rigs) -> Result<(), ReadViewsError> {
    let text = String::from_utf8_lossy(bytes);
    for mut line in lines(&text, file).filter(|line| !line.is_empty()) {
        let (frame, rig) = (line.id("FRAME_ID")?, line.id("RIG_ID")?);
        let pose = line.pose()?;
        for _ in 0..line.id("NUM_DATA_IDS")? {
            let (kind, camera) = (line.word("SENSOR_TYPE")?, line.id("SENSOR_ID")?);
            let image = line.parsed("DATA_ID", "a whole number")?;
            if kind == CAMERA {
                rigs.add_exposure(image, Exposure { frame, rig, camera, pose });
            }
        }
    }
    Ok(())
}

/// Reads `points3D.txt`.
pub(super) fn points(bytes: &[u8], file: &Path) -> Result<Vec<ColmapPoint>, ReadViewsError> {
    let text = String::from_utf8_lossy(bytes);
    let mut points = Vec::new();
    for mut line in lines(&text, file).filter(|line| !line.is_empty()) {
        line.word("POINT3D_ID")?;
        let position = line.numbers(["X", "Y", "Z"])?;
        let mut color = [0u8; 3];
        for (out, field) in color.iter_mut().zip(["R", "G", "B"]) {
            *out = line.parsed(field, "0 to 255")?;
        }
        let error = line.number("ERROR")?;
        let observations = line.rest.split_whitespace().count() / 2;
        points.push(ColmapPoint { position, color, error, observations });
    }
    Ok(points)
}
