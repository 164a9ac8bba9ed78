//! STL, the format of 3D printers: triangles, each with its own three corners and nothing else.
//!
//! Read in both forms, binary and text; written binary. Corners at exactly the same place become one
//! vertex on reading, so that a closed solid is one. Units are whatever the user means; printers mean
//! millimetres.

mod text;

use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use self::text::Words;
use super::open::{Contents, readers};
use super::remark::counted;
use super::{EncodeError, ReadMeshError, Remark, WriteError, check, write_atomic};
use crate::vector::{area_vector, narrow, triangle, unit};
use crate::{Budget, TriMesh};

/// What binary files begin with: anything but the word `solid`.
const HEADER: usize = 80;
/// Bytes of a triangle: a normal, three corners, two bytes that mean nothing.
const TRIANGLE: usize = 50;
/// What a table takes for a vertex at worst: 17 bytes a slot, sixteen slots for seven vertices when it has just
/// grown, and the eight old ones beside them.
const ENTRY: u64 = 60;

readers! {
    /// Reads an STL file, binary or text; normals and colours are passed over, triangles with two corners at one
    /// place left out.
    ///
    /// # Errors
    /// The file cannot be read, is of neither form, or a coordinate is not finite.
    read,
    /// The mesh in the bytes of an STL file.
    decode,
    parse
}

fn parse(contents: Contents<'_>, remarks: &mut Vec<Remark>) -> Result<TriMesh, ReadMeshError> {
    let Contents { bytes, path, budget, .. } = contents;
    let claimed =
        bytes.get(HEADER..HEADER + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let length = claimed.map(|count| HEADER as u64 + 4 + u64::from(count) * TRIANGLE as u64);
    // Some binary files begin with the word of text files, so their length comes first.
    let exact = length == Some(bytes.len() as u64);
    let mut soup =
        Soup { mesh: TriMesh::default(), seen: HashMap::new(), repeated: 0, path, budget };
    if exact {
        binary(&bytes[HEADER + 4..], &mut soup)?;
    } else if let Some(words) = Words::of(&bytes) {
        text::read(words, &mut soup)?;
    } else if let (Some(count), Some(length)) = (claimed, length) {
        let found = format!("{count} in a file of {} bytes", bytes.len());
        let expected =
            format!("as many as there are: {length} bytes, or a text that begins with `solid`");
        return Err(ReadMeshError::malformed(path, "number of triangles", found, expected));
    } else {
        let expected = "a binary STL file, or a text that begins with `solid`";
        let found = format!("{} bytes", bytes.len());
        return Err(ReadMeshError::malformed(path, "header", found, expected));
    }
    counted(remarks, soup.repeated, |count| Remark::RepeatedVertices { count });
    Ok(soup.mesh)
}

/// Triangles whose corners become vertices.
struct Soup<'a> {
    mesh: TriMesh,
    /// Vertices by the bits of their coordinates.
    seen: HashMap<[u32; 3], u32>,
    repeated: usize,
    path: &'a Path,
    budget: Budget,
}

impl Soup<'_> {
    /// A triangle, unless two of its corners are at one place.
    fn push(&mut self, corners: [[f32; 3]; 3]) -> Result<(), ReadMeshError> {
        // Minus zero is where zero is.
        let keys = corners.map(|corner| corner.map(|x| (x + 0.0).to_bits()));
        if keys[0] == keys[1] || keys[1] == keys[2] || keys[2] == keys[0] {
            self.repeated += 1;
            return Ok(());
        }
        let over = ReadMeshError::over_limit(self.path);
        let mut face = [0; 3];
        for (index, (key, corner)) in face.iter_mut().zip(keys.into_iter().zip(corners)) {
            *index = if let Some(&known) = self.seen.get(&key) {
                known
            } else {
                let new = self.mesh.positions.len() as u32;
                self.budget.take(ENTRY).map_err(&over)?;
                self.budget.push(&mut self.mesh.positions, corner).map_err(&over)?;
                self.seen.insert(key, new);
                new
            };
        }
        self.budget.push(&mut self.mesh.faces, face).map_err(&over)
    }
}

fn binary(triangles: &[u8], soup: &mut Soup<'_>) -> Result<(), ReadMeshError> {
    for (index, bytes) in triangles.chunks_exact(TRIANGLE).enumerate() {
        let number = |k: usize| {
            let at = 12 + 4 * k;
            f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
        };
        let corners: [[f32; 3]; 3] =
            std::array::from_fn(|i| std::array::from_fn(|k| number(3 * i + k)));
        if let Some(found) = corners.as_flattened().iter().find(|x| !x.is_finite()) {
            let field = format!("triangle {index}");
            return Err(ReadMeshError::malformed(soup.path, field, found, "finite numbers"));
        }
        soup.push(corners)?;
    }
    Ok(())
}

/// Writes a mesh as binary STL, without its colours.
///
/// # Errors
/// The file cannot be written, or the mesh has an index out of range or a number that is not finite.
pub fn write(path: impl AsRef<Path>, mesh: &TriMesh) -> Result<(), WriteError> {
    let path = path.as_ref();
    check::writable(mesh).map_err(|e| e.at(path))?;
    write_atomic(path, |w| body(w, mesh))
}

/// A binary STL file in memory; the same mesh always gives the same bytes.
///
/// # Errors
/// The mesh has an index out of range or a number that is not finite.
pub fn encode(mesh: &TriMesh) -> Result<Vec<u8>, EncodeError> {
    check::writable(mesh)?;
    let mut bytes = Vec::with_capacity(HEADER + 4 + TRIANGLE * mesh.faces.len());
    body(&mut bytes, mesh).expect("writing to memory");
    Ok(bytes)
}

fn body(w: &mut dyn Write, mesh: &TriMesh) -> std::io::Result<()> {
    let mut header = [b' '; HEADER];
    header[..12].copy_from_slice(b"binary STL, ");
    header[12..20].copy_from_slice(b"unsphere");
    w.write_all(&header)?;
    let count = u32::try_from(mesh.faces.len()).map_err(std::io::Error::other)?;
    w.write_all(&count.to_le_bytes())?;
    for &face in &mesh.faces {
        let normal = narrow(unit(area_vector(triangle(&mesh.positions, face))));
        for point in [normal].into_iter().chain(face.map(|v| mesh.positions[v as usize])) {
            for x in point {
                w.write_all(&x.to_le_bytes())?;
            }
        }
        w.write_all(&[0; 2])?;
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::{Limits, primitives};

    #[test]
    fn what_is_written_is_read_as_one_solid() {
        let ball = primitives::icosphere(2);
        let bytes = encode(&ball).unwrap();
        assert_eq!(bytes.len(), 84 + 50 * ball.faces.len());
        let back = decode(&bytes, "a.stl").unwrap();
        assert_eq!(
            (back.positions.len(), back.faces.len()),
            (ball.positions.len(), ball.faces.len())
        );
        assert!(back.health().is_watertight());
        assert_eq!(encode(&back).unwrap(), bytes, "corners in the same order");
        // The normal of the first triangle is of length one and points outward.
        let normal: [f32; 3] = std::array::from_fn(|k| {
            f32::from_le_bytes(bytes[84 + 4 * k..88 + 4 * k].try_into().unwrap())
        });
        let corner = ball.positions[ball.faces[0][0] as usize];
        let dot: f32 = normal.iter().zip(corner).map(|(a, b)| a * b).sum();
        assert!(dot > 0.9, "{normal:?}");
    }

    #[test]
    fn text_and_files_that_begin_like_text() {
        let facet = |p: [&str; 3]| {
            let lines = p.map(|p| format!("      vertex {p}\n")).concat();
            format!("  facet normal 0 0 1\n    outer loop\n{lines}    endloop\n  endfacet\n")
        };
        let text = format!(
            "solid two words\n{}{}{}endsolid\n",
            facet(["0 0 0", "1 0 0", "0 1 0"]),
            facet(["1 0 0", "1 1 0", "0 1 -0"]),
            facet(["1 0 0", "1 0 0", "0 1 0"]),
        );
        let mut remarks = Vec::new();
        let mesh = decode_with(text.as_bytes(), "a.stl", &Limits::default(), &mut remarks).unwrap();
        assert_eq!((mesh.positions.len(), mesh.faces.as_slice()), (4, &[[0, 1, 2], [1, 3, 2]][..]));
        assert_eq!(remarks, [Remark::RepeatedVertices { count: 1 }]);
        let mut bytes = encode(&mesh).unwrap();
        bytes[..6].copy_from_slice(b"solid ");
        assert_eq!(decode(&bytes, "a.stl").unwrap().faces, mesh.faces);
        let message = |bytes: &[u8]| decode(bytes, "a.stl").unwrap_err().to_string();
        assert!(message(&bytes[..bytes.len() - 1]).contains("a.stl"));
        assert!(message(b"nothing").contains("begins with `solid`"));
        assert!(message(&[7; 200]).contains("number of triangles"));
        assert!(message(text.replace("1 1 0", "1 x 0").as_bytes()).contains("a.stl:12: vertex"));
        assert!(message(b"solid\nfacet\nouter loop\nvertex 0 0 0\nendloop").contains("1 vertices"));
        assert!(message(b"solid\nvertex 0 0 0").contains("end of the file"));
        assert!(message(b"solid\npolygon").contains("a.stl:2: word: found \"polygon\""));
        let mut nan = encode(&mesh).unwrap();
        nan[96..100].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(message(&nan).contains("triangle 0"));
    }

    #[test]
    fn vertices_of_triangles_that_are_left_out_are_too() {
        let mut bytes = encode(&primitives::icosphere(0)).unwrap();
        let needle = [[5.0; 3], [5.0; 3], [6.0_f32, 0.0, 0.0]].concat();
        bytes.extend([0; 12]);
        bytes.extend(needle.into_iter().flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
        bytes[80..84].copy_from_slice(&21_u32.to_le_bytes());
        let mesh = decode(&bytes, "a.stl").unwrap();
        assert_eq!((mesh.positions.len(), mesh.faces.len()), (12, 20));
    }
}
