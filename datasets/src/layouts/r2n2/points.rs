//! `model_normal.xyz`: a point and its normal a line.

use std::fmt::Write as _;
use std::path::Path;

use crate::content::cut;
use crate::dataset::SurfacePoints;
use crate::error::ReadViewsError;
use crate::source::Source;

/// No file of points is longer than this.
const MOST_BYTES: u64 = 1 << 30;

/// Reads six numbers a line: position, normal. Normals are brought to length 1; one of length 0
/// stays.
pub(super) fn read(path: &Path) -> Result<SurfacePoints, ReadViewsError> {
    let (folder, name) = (path.parent().unwrap_or(path), path.file_name().unwrap_or_default());
    let source = Source::folder(folder);
    let bytes = source.open()?.read(&name.to_string_lossy(), "points", MOST_BYTES)?;
    parse(&String::from_utf8_lossy(&bytes), path)
}

fn parse(text: &str, path: &Path) -> Result<SurfacePoints, ReadViewsError> {
    let mut points = SurfacePoints::default();
    for (i, line) in text.lines().enumerate() {
        let mut numbers = [0.0_f32; 6];
        let mut count = 0;
        for word in line.split_whitespace() {
            let value: Option<f32> = word.parse().ok().filter(|v: &f32| v.is_finite());
            match (value, numbers.get_mut(count)) {
                (Some(value), Some(slot)) => *slot = value,
                (None, _) => {
                    let field = format!("line {}", i + 1);
                    return Err(ReadViewsError::field(path, field, cut(word), "a finite number"));
                }
                (_, None) => {}
            }
            count += 1;
        }
        if count == 0 {
            continue;
        }
        if count != 6 {
            let expected = "6: a position and a normal";
            let field = format!("line {}, count of numbers", i + 1);
            return Err(ReadViewsError::field(path, field, count.to_string(), expected));
        }
        let [x, y, z, normal @ ..] = numbers;
        points.positions.push([x, y, z]);
        points.normals.push(unit(normal));
    }
    if points.positions.is_empty() {
        return Err(ReadViewsError::field(path, "lines", "none", "one for each point"));
    }
    Ok(points)
}

fn unit(normal: [f32; 3]) -> [f32; 3] {
    let length = normal.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
    // What is of length 1 already keeps its bits, so that a copy of a file is the file.
    if length == 0.0 || (length - 1.0).abs() < 1e-6 {
        return normal;
    }
    normal.map(|x| (f64::from(x) / length) as f32)
}

/// The text of a file with these points.
pub(super) fn text(points: &SurfacePoints) -> String {
    let mut text = String::new();
    for ([x, y, z], [nx, ny, nz]) in points.positions.iter().zip(&points.normals) {
        writeln!(text, "{x} {y} {z} {nx} {ny} {nz}").expect("into memory");
    }
    text
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn points_survive_and_mistakes_are_named() {
        let points = SurfacePoints {
            positions: vec![[0.1, -2.5e-7, 3.0], [4.0, 5.0, 6.0]],
            normals: vec![[0.0, 0.6, 0.8], [1.0, 0.0, 0.0]],
        };
        assert_eq!(parse(&text(&points), Path::new("p")).unwrap(), points);
        let long = parse("0 0 0 0 3 4", Path::new("p")).unwrap();
        assert_eq!(long.normals, [[0.0, 0.6, 0.8]]);
        let error = |text: &str| parse(text, Path::new("p.xyz")).unwrap_err().to_string();
        assert!(error("1 2 3 0 0 1\n1 2 3").contains("line 2, count"));
        assert!(error("1 2 3 0 0 1 7").contains("found 7"));
        assert!(error("1 2 3 0 inf 1").contains("inf"));
        assert!(error("").contains("lines"));
    }
}
