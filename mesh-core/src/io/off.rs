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
    /// Numbers may stand on any lines, unless faces have colours.
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

/// What a line says, without its comment.
fn said(line: &str) -> &str {
    line.split('#').next().unwrap_or_default().trim()
}

impl<'a> Lines<'a> {
    /// The next one and its number.
    fn next(&mut self, field: &str, expected: &str) -> Result<(usize, &'a str), ReadMeshError> {
        let text = |(k, line): (usize, &'a str)| {
            let line = said(line);
            (!line.is_empty()).then_some((k + 1, line))
        };
        self.rest.find_map(text).ok_or_else(|| {
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
    match by_lines(&mut lines, &mut budget.clone(), remarks) {
        // The format asks for no lines but for colours of faces, whose end nothing else tells.
        Err(error @ ReadMeshError::Malformed { .. }) => {
            let words = text.lines().flat_map(|line| said(line).split_whitespace());
            by_words(words, path, &mut budget, remarks).map_err(|_| error)
        }
        done => done,
    }
}

fn by_lines(
    lines: &mut Lines<'_>,
    budget: &mut Budget,
    remarks: &mut Vec<Remark>,
) -> Result<TriMesh, ReadMeshError> {
    let Header { vertices, faces, color } = header(lines)?;
    let (positions, colors) = corners(lines, vertices, color, budget)?;
    let mut fans = Fans::default();
    for _ in 0..faces {
        let (line, text) = lines.next("faces", "as many as the header counts")?;
        let bad = || {
            let expected =
                format!("a count, then as many indices of vertices, below {}", positions.len());
            lines.bad(line, "face", text, &expected)
        };
        let mut words = text.split_whitespace();
        let place = (lines.path, Some(line));
        let is_face = fans.add(&mut words, place, positions.len(), budget, bad)?;
        fans.colors += usize::from(is_face && words.next().is_some());
    }
    let faces = fans.cut(&positions, remarks);
    Ok(TriMesh { positions, faces, colors, texture: None })
}

/// The same of files whose lines end anywhere, where each vertex has the numbers that the header says and faces have no colours.
fn by_words<'a>(
    mut words: impl Iterator<Item = &'a str>,
    path: &Path,
    budget: &mut Budget,
    remarks: &mut Vec<Remark>,
) -> Result<TriMesh, ReadMeshError> {
    // What is wrong the attempt by lines has said.
    let bad = || ReadMeshError::malformed(path, "words", "others", "those of an OFF file");
    let over = ReadMeshError::over_limit(path);
    let kind = words.next().and_then(Kind::of).filter(|(_, rest)| rest.is_empty());
    let (kind, _) = kind.ok_or_else(bad)?;
    let mut count = || words.next().and_then(|word| word.parse::<usize>().ok()).ok_or_else(bad);
    let [vertices, faces, _edges] = [count()?, count()?, count()?];
    let before = kind.before_color();
    let length = before + if kind.colored { 4 } else { 0 } + if kind.placed { 2 } else { 0 };
    let (mut positions, mut colors) = (Vec::new(), Vec::new());
    for _ in 0..vertices {
        let mut numbers = [0.0_f32; 12];
        for number in &mut numbers[..length] {
            let word = words.next().and_then(|word| word.parse().ok());
            *number = word.filter(|v: &f32| v.is_finite()).ok_or_else(bad)?;
        }
        budget.push(&mut positions, [numbers[0], numbers[1], numbers[2]]).map_err(&over)?;
        if kind.colored {
            let color = [numbers[before], numbers[before + 1], numbers[before + 2]];
            budget.push(&mut colors, color).map_err(&over)?;
        }
    }
    let mut fans = Fans::default();
    for _ in 0..faces {
        fans.add(&mut words, (path, None), positions.len(), budget, bad)?;
    }
    if words.next().is_some() {
        return Err(bad());
    }
    to_unit(&mut colors);
    let faces = fans.cut(&positions, remarks);
    Ok(TriMesh { positions, faces, colors: kind.colored.then_some(colors), texture: None })
}

/// What the letters before `OFF` say of a vertex: what follows its coordinates, in this order.
struct Kind {
    normal: bool,
    colored: bool,
    /// Texture coordinates.
    placed: bool,
}

impl Kind {
    /// And what stands behind them on the line.
    fn of(first: &str) -> Option<(Self, &str)> {
        let mut rest = first;
        let mut takes = |letters: &str| {
            let behind = rest.strip_prefix(letters);
            rest = behind.unwrap_or(rest);
            behind.is_some()
        };
        let (placed, colored, normal) = (takes("ST"), takes("C"), takes("N"));
        Some((Self { normal, colored, placed }, rest.strip_prefix("OFF")?))
    }

    /// Behind how many numbers of a vertex its colour is.
    fn before_color(&self) -> usize {
        if self.normal { 6 } else { 3 }
    }
}

/// How many vertices and faces there are, and behind how many numbers of a vertex its colour.
struct Header {
    vertices: usize,
    faces: usize,
    color: Option<usize>,
}

fn header(lines: &mut Lines<'_>) -> Result<Header, ReadMeshError> {
    let (line, first) = lines.next("header", "OFF")?;
    let kind = Kind::of(first).ok_or_else(|| lines.bad(line, "header", first, "OFF"))?;
    let (kind, counts) = kind;
    let color = kind.colored.then_some(kind.before_color());
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

/// Positions, and colours where the file has them: up to 255, or up to 1.
fn corners(
    lines: &mut Lines<'_>,
    vertices: usize,
    color: Option<usize>,
    budget: &mut Budget,
) -> Result<Corners, ReadMeshError> {
    let over = ReadMeshError::over_limit(lines.path);
    let (mut positions, mut colors) = (Vec::new(), Vec::new());
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
        let mut color = UNCOLORED;
        for (out, word) in color.iter_mut().zip(text.split_whitespace().skip(before)) {
            *out = word.parse().ok().filter(|c: &f32| c.is_finite()).ok_or_else(|| {
                lines.bad(line, "colour of the vertex", text, "three finite numbers")
            })?;
        }
        budget.push(&mut colors, color).map_err(&over)?;
    }
    to_unit(&mut colors);
    Ok((positions, color.map(|_| colors)))
}

/// Stands for a channel that is not there, which is white; those of a file are finite.
const UNCOLORED: [f32; 3] = [f32::INFINITY; 3];

/// Brings colours to `[0, 1]`: some programs write bytes, with or without a point, and others shares, `1` for `1.0`.
fn to_unit(colors: &mut [[f32; 3]]) {
    let channels = || colors.iter().flatten().filter(|c| c.is_finite());
    let largest = if channels().any(|&c| c > 1.5) { 255.0 } else { 1.0 };
    for c in colors.iter_mut().flatten() {
        *c = (*c / largest).clamp(0.0, 1.0);
    }
}

/// The faces as triangles, and what is left out of them.
#[derive(Default)]
struct Fans {
    triangles: Vec<[u32; 3]>,
    polygons: Polygons,
    short: usize,
    first_short: Option<usize>,
    repeated: usize,
    colors: usize,
}

impl Fans {
    /// Adds the face that is next: how many corners it has, and their indices, below `vertices`. Whether it has three.
    fn add<'a>(
        &mut self,
        words: &mut impl Iterator<Item = &'a str>,
        (path, line): (&Path, Option<usize>),
        vertices: usize,
        budget: &mut Budget,
        bad: impl Fn() -> ReadMeshError,
    ) -> Result<bool, ReadMeshError> {
        let over = ReadMeshError::over_limit(path);
        let mut number = || words.next().and_then(|word| word.parse::<usize>().ok());
        let count = number().ok_or_else(&bad)?;
        let mut take = || number().filter(|&index| index < vertices).ok_or_else(&bad);
        if count < 3 {
            self.short += 1;
            self.first_short = self.first_short.or(line);
            // They end with their line, whatever stands there.
            for _ in 0..if line.is_none() { count } else { 0 } {
                take()?;
            }
            return Ok(false);
        }
        let (first, mut last) = (take()? as u32, take()? as u32);
        let start = self.triangles.len();
        for _ in 2..count {
            let corner = take()? as u32;
            if first == last || last == corner || corner == first {
                self.repeated += 1;
            } else {
                budget.push(&mut self.triangles, [first, last, corner]).map_err(&over)?;
            }
            last = corner;
        }
        if self.triangles.len() - start == count - 2 {
            self.polygons.note(start..self.triangles.len(), budget).map_err(&over)?;
        }
        Ok(true)
    }

    /// The triangles; what is left out of them goes into `remarks`.
    fn cut(mut self, positions: &[[f32; 3]], remarks: &mut Vec<Remark>) -> Vec<[u32; 3]> {
        self.polygons.cut(positions, &mut self.triangles, None::<&mut [[(); 3]]>);
        let line = self.first_short;
        counted(remarks, self.short, |count| Remark::ShortFaces { count, line });
        counted(remarks, self.repeated, |count| Remark::RepeatedVertices { count });
        counted(remarks, self.colors, |count| Remark::FaceColors { count });
        self.triangles
    }
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
        let shares = format!("COFF\n3 1 0\n0 0 0 1 0 0 1\n1 0 0 0 1 0 1\n0 1 0 1 1 1 1\n{face}");
        assert_eq!(colors(&shares), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0; 3]]);
        let points = format!("COFF\n3 1 0\n0 0 0 255.0 51.0 0.0\n1 0 0 0 0 0\n0 1 0\n{face}");
        assert_eq!(colors(&points), [[1.0, 0.2, 0.0], [0.0; 3], [1.0; 3]]);
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
    fn numbers_stand_on_any_lines() {
        let by_lines = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n";
        let expected = decode(by_lines.as_bytes(), "a.off").unwrap();
        for text in [
            by_lines.replace('\n', " "),
            by_lines.replace(' ', "\n"),
            "OFF 4 2 0 # here\n0 0 0 1 0 0\n1 1 0 0 1 0\n3 0\n1 2 3 0 2 3".to_owned(),
        ] {
            assert_eq!(decode(text.as_bytes(), "a.off").unwrap(), expected, "{text}");
        }
        let colored = "CNOFF 3 2 0\n0 0 0 0 0 1 1 0 0 1\n1 0 0 0 0 1 0 1 0 1 0 1 0\n0 0 1 0 0 1 1\n2 0 1 3 0 1 2";
        let mesh = decode(colored.as_bytes(), "a.off").unwrap();
        let colors = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        assert_eq!((mesh.positions[2], mesh.colors.unwrap()), ([0.0, 1.0, 0.0], colors.to_vec()));
        assert_eq!(mesh.faces, [[0, 1, 2]]);
        // What is left over is no OFF file of any kind, and the first attempt says where it went wrong.
        assert!(message(&format!("{} 7", by_lines.replace('\n', " "))).contains("vertices"));
    }

    #[test]
    fn colors_of_faces_are_noted() {
        let text = "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255 0 0\n3 0 2 1\n";
        let mut remarks = Vec::new();
        decode_with(text.as_bytes(), "a.off", &Limits::default(), &mut remarks).unwrap();
        assert_eq!(remarks, [Remark::FaceColors { count: 1 }]);
        assert_eq!(remarks[0].to_string(), "1 colour of a face left out");
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
