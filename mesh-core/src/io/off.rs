//! OFF, Geomview's text format: a count, the vertices, the faces. Read, never written.

use super::open::{Contents, readers};
use super::remark::counted;
use super::{ReadMeshError, Remark};
use crate::TriMesh;

readers! {
    /// Reads an OFF file; polygons become fans of triangles, colours and normals are passed over, faces of
    /// one or two corners and triangles that name a vertex twice left out.
    ///
    /// # Errors
    /// The file cannot be read or ends early, a number is unreadable or not finite, or an index is out
    /// of range.
    read,
    /// The mesh in the bytes of an OFF file.
    decode,
    parse
}

fn parse(contents: Contents<'_>, remarks: &mut Vec<Remark>) -> Result<TriMesh, ReadMeshError> {
    let Contents { bytes, path, mut budget, .. } = contents;
    let over = ReadMeshError::over_limit(path);
    if std::str::from_utf8(&bytes).is_err() {
        // The copy has a replacement character, of three bytes, for each that is wrong.
        budget.take(6 * bytes.len() as u64).map_err(&over)?;
    }
    let text = String::from_utf8_lossy(&bytes);
    let lines = text.lines().enumerate().map(|(k, line)| {
        let line = line.split('#').next().unwrap_or_default();
        (k + 1, line.trim())
    });
    let mut lines = lines.filter(|(_, line)| !line.is_empty());
    let bad = |line: usize, field: &str, found: &str, expected: &str| {
        ReadMeshError::at_line(path, Some(line), field, format!("{found:?}"), expected)
    };
    let mut next = |field: &str, expected: &str| {
        lines.next().ok_or_else(|| {
            ReadMeshError::at_line(path, None, field, "the end of the file", expected)
        })
    };
    let (line, first) = next("header", "OFF")?;
    // Letters before it say what follows the coordinates of a vertex.
    let plain = ["ST", "C", "N"].iter().fold(first, |rest, p| rest.strip_prefix(p).unwrap_or(rest));
    let counts = plain.strip_prefix("OFF").ok_or_else(|| bad(line, "header", first, "OFF"))?;
    // Some files have the counts on the first line.
    let (line, counts) =
        if counts.trim().is_empty() { next("counts", "two counts")? } else { (line, counts) };
    let mut words = counts.split_whitespace().map(str::parse::<usize>);
    let (Some(Ok(vertices)), Some(Ok(faces))) = (words.next(), words.next()) else {
        return Err(bad(line, "counts", counts, "how many vertices and faces there are"));
    };
    let mut mesh = TriMesh::default();
    for _ in 0..vertices {
        let (line, text) = next("vertices", "as many as the header counts")?;
        let mut numbers = text.split_whitespace().map_while(|word| word.parse::<f32>().ok());
        let mut position = [f32::NAN; 3];
        position.iter_mut().zip(&mut numbers).for_each(|(out, value)| *out = value);
        if !position.iter().all(|v| v.is_finite()) {
            return Err(bad(line, "vertex", text, "three finite numbers"));
        }
        budget.push(&mut mesh.positions, position).map_err(&over)?;
    }
    let (mut short, mut first_short, mut repeated) = (0, None, 0);
    for _ in 0..faces {
        let (line, text) = next("faces", "as many as the header counts")?;
        let expected = "a count, then as many indices of vertices";
        let mut words = text.split_whitespace().map(str::parse::<usize>);
        let count = words.next().and_then(Result::ok);
        let count = count.ok_or_else(|| bad(line, "face", text, expected))?;
        if count < 3 {
            short += 1;
            first_short.get_or_insert(line);
            continue;
        }
        let mut corners = words.map_while(Result::ok).filter(|&index| index < vertices);
        let mut take = || corners.next().ok_or_else(|| bad(line, "face", text, expected));
        let (first, mut last) = (take()? as u32, take()? as u32);
        for _ in 2..count {
            let corner = take()? as u32;
            if first == last || last == corner || corner == first {
                repeated += 1;
            } else {
                budget.push(&mut mesh.faces, [first, last, corner]).map_err(&over)?;
            }
            last = corner;
        }
    }
    counted(remarks, short, |count| Remark::ShortFaces { count, line: first_short });
    counted(remarks, repeated, |count| Remark::RepeatedVertices { count });
    Ok(mesh)
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
    fn polygons_comments_and_colours_are_taken() {
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
