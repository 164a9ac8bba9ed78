//! OFF, Geomview's text format: a count, the vertices, the faces. Read, never written.

use std::iter::Enumerate;
use std::path::Path;

use super::open::{Contents, readers};
use super::polygons::Polygons;
use super::remark::counted;
use super::{ReadMeshError, Remark};
use crate::{Budget, TriMesh};

readers! {
    /// Reads an OFF file; polygons become triangles, colours of vertices are read, those of faces
    /// and normals passed over, faces of one or two corners and triangles that name a vertex twice left out.
    ///
    /// # Errors
    /// The file cannot be read or ends early, a number is unreadable or not finite, or an index is out
    /// of range.
    read,
    /// The mesh in the bytes of an OFF file.
    decode,
    parse
}

/// The lines that say something, without their comments.
struct Lines<'a> {
    path: &'a Path,
    rest: Enumerate<std::str::Lines<'a>>,
}

impl<'a> Lines<'a> {
    /// The next one and its number.
    fn next(&mut self, field: &str, expected: &str) -> Result<(usize, &'a str), ReadMeshError> {
        let said = |(k, line): (usize, &'a str)| {
            let line = line.split('#').next().unwrap_or_default().trim();
            (!line.is_empty()).then_some((k + 1, line))
        };
        self.rest.find_map(said).ok_or_else(|| {
            ReadMeshError::at_line(self.path, None, field, "the end of the file", expected)
        })
    }

    /// What is said of a line that is wrong.
    fn bad(&self, line: usize, field: &str, found: &str, expected: &str) -> ReadMeshError {
        ReadMeshError::at_line(self.path, Some(line), field, format!("{found:?}"), expected)
    }
}

fn parse(contents: Contents<'_>, remarks: &mut Vec<Remark>) -> Result<TriMesh, ReadMeshError> {
    let Contents { bytes, path, mut budget, .. } = contents;
    if std::str::from_utf8(&bytes).is_err() {
        // The copy has a replacement character, of three bytes, for each that is wrong.
        budget.take(6 * bytes.len() as u64).map_err(ReadMeshError::over_limit(path))?;
    }
    let text = String::from_utf8_lossy(&bytes);
    let mut lines = Lines { path, rest: text.lines().enumerate() };
    let Header { vertices, faces, color } = header(&mut lines)?;
    let (positions, colors) = corners(&mut lines, vertices, color, &mut budget)?;
    let faces = triangles(&mut lines, faces, &positions, &mut budget, remarks)?;
    Ok(TriMesh { positions, faces, colors, texture: None })
}

/// How many vertices and faces there are, and behind how many numbers of a vertex its colour.
struct Header {
    vertices: usize,
    faces: usize,
    color: Option<usize>,
}

fn header(lines: &mut Lines<'_>) -> Result<Header, ReadMeshError> {
    let (line, first) = lines.next("header", "OFF")?;
    // Letters before it say what follows the coordinates of a vertex: a normal, then a colour.
    let mut plain = first;
    let mut takes = |letters: &str| {
        let rest = plain.strip_prefix(letters);
        plain = rest.unwrap_or(plain);
        rest.is_some()
    };
    takes("ST");
    let (colored, with_normal) = (takes("C"), takes("N"));
    let color = colored.then_some(if with_normal { 6 } else { 3 });
    let counts =
        plain.strip_prefix("OFF").ok_or_else(|| lines.bad(line, "header", first, "OFF"))?;
    // Some files have the counts on the first line.
    let (line, counts) =
        if counts.trim().is_empty() { lines.next("counts", "two counts")? } else { (line, counts) };
    let mut words = counts.split_whitespace().map(str::parse::<usize>);
    let (Some(Ok(vertices)), Some(Ok(faces))) = (words.next(), words.next()) else {
        return Err(lines.bad(line, "counts", counts, "how many vertices and faces there are"));
    };
    Ok(Header { vertices, faces, color })
}

/// Positions, and colours of as many.
type Corners = (Vec<[f32; 3]>, Option<Vec<[f32; 3]>>);

/// Positions, and colours where the file has them: whole numbers to 255, or up to 1.
fn corners(
    lines: &mut Lines<'_>,
    vertices: usize,
    color: Option<usize>,
    budget: &mut Budget,
) -> Result<Corners, ReadMeshError> {
    let over = ReadMeshError::over_limit(lines.path);
    let (mut positions, mut colors) = (Vec::new(), Vec::new());
    let mut largest = 255.0;
    for _ in 0..vertices {
        let (line, text) = lines.next("vertices", "as many as the header counts")?;
        let mut numbers = text.split_whitespace().map_while(|word| word.parse::<f32>().ok());
        let mut position = [f32::NAN; 3];
        position.iter_mut().zip(&mut numbers).for_each(|(out, value)| *out = value);
        if !position.iter().all(|v| v.is_finite()) {
            return Err(lines.bad(line, "vertex", text, "three finite numbers"));
        }
        budget.push(&mut positions, position).map_err(&over)?;
        let Some(before) = color else { continue };
        let mut color = [1.0; 3];
        for (out, word) in color.iter_mut().zip(text.split_whitespace().skip(before)) {
            *out = word.parse().ok().filter(|c: &f32| c.is_finite()).ok_or_else(|| {
                lines.bad(line, "colour of the vertex", text, "three finite numbers")
            })?;
            largest = if word.contains('.') { 1.0 } else { largest };
        }
        budget.push(&mut colors, color).map_err(&over)?;
    }
    for c in colors.iter_mut().flatten() {
        *c = (*c / largest).clamp(0.0, 1.0);
    }
    Ok((positions, color.map(|_| colors)))
}

/// The faces as triangles; what is left out of them goes into `remarks`.
fn triangles(
    lines: &mut Lines<'_>,
    faces: usize,
    positions: &[[f32; 3]],
    budget: &mut Budget,
    remarks: &mut Vec<Remark>,
) -> Result<Vec<[u32; 3]>, ReadMeshError> {
    let over = ReadMeshError::over_limit(lines.path);
    let vertices = positions.len();
    let (mut triangles, mut polygons) = (Vec::new(), Polygons::default());
    let (mut short, mut first_short, mut repeated) = (0, None, 0);
    for _ in 0..faces {
        let (line, text) = lines.next("faces", "as many as the header counts")?;
        let bad = || {
            let expected = format!("a count, then as many indices of vertices, below {vertices}");
            lines.bad(line, "face", text, &expected)
        };
        let mut words = text.split_whitespace().map(str::parse::<usize>);
        let count = words.next().and_then(Result::ok).ok_or_else(bad)?;
        if count < 3 {
            short += 1;
            first_short.get_or_insert(line);
            continue;
        }
        // What follows the indices is a colour.
        let mut take = || {
            let index = words.next().and_then(Result::ok);
            index.filter(|&index| index < vertices).ok_or_else(bad)
        };
        let (first, mut last) = (take()? as u32, take()? as u32);
        let start = triangles.len();
        for _ in 2..count {
            let corner = take()? as u32;
            if first == last || last == corner || corner == first {
                repeated += 1;
            } else {
                budget.push(&mut triangles, [first, last, corner]).map_err(&over)?;
            }
            last = corner;
        }
        if triangles.len() - start == count - 2 {
            polygons.note(start..triangles.len(), budget).map_err(&over)?;
        }
    }
    polygons.cut(positions, &mut triangles, None::<&mut [[(); 3]]>);
    counted(remarks, short, |count| Remark::ShortFaces { count, line: first_short });
    counted(remarks, repeated, |count| Remark::RepeatedVertices { count });
    Ok(triangles)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::Limits;

    fn message(text: &str) -> String {
        decode(text.as_bytes(), "a.off").unwrap_err().to_string()
    }

    #[test]
    fn colors_of_vertices_are_bytes_or_up_to_one() {
        let colors = |text: &str| decode(text.as_bytes(), "a.off").unwrap().colors.unwrap();
        let face = "3 0 1 2\n";
        let bytes =
            format!("COFF\n3 1 0\n0 0 0 255 0 51 255\n1 0 0 1 0 0 255\n0 1 0 0 0 0 255\n{face}");
        assert_eq!(colors(&bytes)[..2], [[1.0, 0.0, 0.2], [1.0 / 255.0, 0.0, 0.0]]);
        let unit =
            format!("CNOFF\n3 1 0\n0 0 0 0 0 1 1 0 0.5\n1 0 0 0 0 1 0 0 0\n0 1 0 0 0 1\n{face}");
        assert_eq!(colors(&unit), [[1.0, 0.0, 0.5], [0.0; 3], [1.0; 3]]);
        assert!(message("COFF\n1 0 0\n0 0 0 x 0 0\n").contains("colour"));
    }

    /// A colour behind the corners is no corner in place of a wrong one.
    #[test]
    fn indices_out_of_range_are_named() {
        let corners = "OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n";
        for face in ["3 0 1 7 2 0 0", "3 0 x 1 2", "4 0 1 2"] {
            let found = message(&format!("{corners}{face}\n"));
            assert!(found.contains(face) && found.contains("face"), "{found}");
        }
    }

    #[test]
    fn polygons_comments_and_colors_are_taken() {
        let text = "OFF # by hand\n\n4 2 0\n0 0 0\n1 0 0\n1 1 0 # corner\n0 1 0\n\
                    4 0 1 2 3 255 0 0\n3 0 2 1\n";
        let mesh = decode(text.as_bytes(), "a.off").unwrap();
        assert_eq!(mesh.positions[2], [1.0, 1.0, 0.0]);
        assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 2, 1]]);
        let joined = decode(b"OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2", "a.off").unwrap();
        assert_eq!(joined.faces, [[0, 1, 2]]);
        let colored =
            "COFF\n3 3 0\n0 0 0 1 0 0 1\n1 0 0 1 0 0 1\n0 1 0 1 0 0 1\n2 0 1\n3 0 1 1\n3 0 1 2";
        let mut remarks = Vec::new();
        let limits = Limits::default();
        let mesh = decode_with(colored.as_bytes(), "a.off", &limits, &mut remarks).unwrap();
        assert_eq!((mesh.positions[1], mesh.faces.len()), ([1.0, 0.0, 0.0], 1));
        let lines: Vec<String> = remarks.iter().map(ToString::to_string).collect();
        assert_eq!(
            lines,
            [
                "1 face of fewer than three corners left out (the first in line 6)",
                "1 triangle that names a vertex twice left out"
            ]
        );
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        assert!(message("PLY\n").contains("a.off:1: header"));
        assert!(message("OFF\n3 x\n").contains("a.off:2: counts"));
        assert!(message("OFF\n1 0 0\n0 nan 0\n").contains("a.off:3: vertex"));
        assert!(message("OFF\n1 1 0\n0 0 0\n3 0 0 1\n").contains("a.off:4: face"));
        assert!(message("OFF\n1 1 0\n0 0 0\nthree\n").contains("a.off:4: face"));
        assert!(message("OFF\n99999999999 1 0\n0 0 0\n").contains("vertices: found the end"));
        assert!(message("OFF\n1 1 0\n0 0 0\n18446744073709551615 0 0").contains("face"));
        assert!(message("").contains("header"));
    }
}
