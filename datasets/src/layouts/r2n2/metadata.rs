//! `rendering_metadata.txt` and `renderings.txt`: where each image was taken from.

use std::path::Path;

use mesh_core::R2n2View;

use crate::content::{cut, numbered};
use crate::error::ReadViewsError;
use crate::source::Source;

pub(super) const FILE: &str = "rendering_metadata.txt";
pub(super) const NAMES: &str = "renderings.txt";
/// Neither file is longer than this.
const MOST_BYTES: u64 = 1 << 24;
/// What a line takes: a view, and its name, and both again while their lists grow.
const LINE: usize = 400;

/// One view as the metadata has it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Line {
    /// The image's file, beside the metadata.
    pub(super) image: String,
    pub(super) view: R2n2View,
    /// The last column, degrees: said to be the field of view.
    pub(super) fov: f64,
}

/// The views of an object, at least one.
#[derive(Debug)]
pub(super) struct Lines(pub(super) Vec<Line>);

impl Lines {
    /// Reads them from the folder of the images.
    pub(super) fn read(source: &Source) -> Result<Self, ReadViewsError> {
        let mut opened = source.open()?;
        let path = source.locate(FILE);
        let text = opened.read(FILE, "cameras", MOST_BYTES)?;
        let views = parse(&text.text(LINE, &path)?, &path)?;
        if !source.has(NAMES) {
            let line = |(i, (view, fov))| Line { image: format!("{i:02}.png"), view, fov };
            return Ok(Self(views.into_iter().enumerate().map(line).collect()));
        }
        let names = opened.read(NAMES, "names of the images", MOST_BYTES)?;
        let path = source.locate(NAMES);
        let names = parse_names(&names.text(LINE, &path)?, views.len(), &path)?;
        let line = |(image, (view, fov))| Line { image, view, fov };
        Ok(Self(names.into_iter().zip(views).map(line).collect()))
    }
}

/// Five numbers a line; empty lines do not count.
fn parse(text: &str, path: &Path) -> Result<Vec<(R2n2View, f64)>, ReadViewsError> {
    let mut views = Vec::new();
    for (i, line) in numbered(text) {
        let wrong = |column: &str, found: &str, expected: &str| {
            ReadViewsError::field(path, format!("line {i}, {column}"), cut(found), expected)
        };
        let words: Vec<&str> = line.split_whitespace().collect();
        let &[azimuth, elevation, roll, ratio, fov] = words.as_slice() else {
            let expected = "5: azimuth, elevation, in-plane rotation, distance ratio, fov";
            return Err(wrong("number of columns", &words.len().to_string(), expected));
        };
        let number = |column: &str, word: &str, expected: &str, fits: &dyn Fn(f64) -> bool| {
            let value: Option<f64> = word.parse().ok();
            value.filter(|v| fits(*v)).ok_or_else(|| wrong(column, word, expected))
        };
        let angle = |v: f64| v.is_finite() && v.abs() <= 1e6;
        let view = R2n2View {
            azimuth: number("azimuth", azimuth, "degrees", &angle)?,
            // Straight above, up is no longer up.
            elevation: number("elevation", elevation, "degrees between -90 and 90", &|v| {
                v.abs() < 90.0
            })?,
            distance_ratio: number("distance ratio", ratio, "a number above 0", &|v| {
                v > 0.0 && v <= 1e6
            })?,
        };
        number("in-plane rotation", roll, "0, as in all of these renderings", &|v| v == 0.0)?;
        let fov = number("fov", fov, "degrees between 0 and 180", &|v| v > 0.0 && v < 180.0)?;
        views.push((view, fov));
    }
    if views.is_empty() {
        return Err(ReadViewsError::field(path, "lines", "none", "one for each image"));
    }
    Ok(views)
}

/// One name a line, as many as there are views.
fn parse_names(text: &str, count: usize, path: &Path) -> Result<Vec<String>, ReadViewsError> {
    let mut names = Vec::new();
    for (i, name) in numbered(text) {
        // A name with a folder in it could be any file of the machine.
        if name.contains(['/', '\\', '\0']) || name == ".." {
            let expected = "the name of a file beside it";
            return Err(ReadViewsError::field(path, format!("line {i}"), cut(name), expected));
        }
        names.push(name.to_owned());
    }
    if names.len() != count {
        let expected = format!("{count}, as many as lines of {FILE}");
        return Err(ReadViewsError::field(path, "lines", names.len().to_string(), expected));
    }
    Ok(names)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn each_mistake_names_line_and_column() {
        let error = |text: &str| parse(text, Path::new("m.txt")).unwrap_err().to_string();
        assert!(error("\n1 2 0 0.7 25\n1 2 0 0.7\n").contains("line 3, number of columns"));
        assert!(error("nan 2 0 0.7 25").contains("line 1, azimuth"));
        assert!(error("1 90 0 0.7 25").contains("line 1, elevation"));
        assert!(error("1 2 5 0.7 25").contains("in-plane rotation"));
        assert!(error("1 2 0 -1 25").contains("distance ratio"));
        assert!(error("1 2 0 1 180").contains("fov"));
        assert!(error("\n \n").contains("lines"));
        let names = |text: &str| parse_names(text, 1, Path::new("n.txt")).unwrap_err().to_string();
        assert!(names("00.png\n01.png").contains("found 2, expected 1"));
        assert!(names("../../secret").contains("line 1"));
    }
}
