//! Writing PLY.

use std::io::Write;
use std::path::Path;

use crate::TriMesh;
use crate::io::{EncodeError, WriteError, check, write_atomic};

/// How the numbers of a PLY file are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Encoding {
    /// Little-endian bytes.
    #[default]
    Binary,
    /// Text: the shortest that reads back as the same `f32`.
    Ascii,
}

/// Writes a PLY file: positions as floats, colours as sRGB bytes, triangles.
///
/// A mesh with a texture and no colours gets the texture's colour at each vertex.
///
/// # Errors
/// The file cannot be written, or the mesh has an index out of range or a number that is not
/// finite.
pub fn write(path: impl AsRef<Path>, mesh: &TriMesh, encoding: Encoding) -> Result<(), WriteError> {
    let path = path.as_ref();
    check::writable(mesh).map_err(|e| e.at(path))?;
    write_atomic(path, |w| body(w, mesh, encoding))
}

/// A PLY file in memory; the same mesh always gives the same bytes.
///
/// # Errors
/// The mesh has an index out of range or a number that is not finite.
pub fn encode(mesh: &TriMesh, encoding: Encoding) -> Result<Vec<u8>, EncodeError> {
    check::writable(mesh)?;
    let mut bytes = Vec::new();
    body(&mut bytes, mesh, encoding).expect("writing to memory");
    Ok(bytes)
}

fn body(w: &mut dyn Write, mesh: &TriMesh, encoding: Encoding) -> std::io::Result<()> {
    let colors = mesh.vertex_colors();
    let format = match encoding {
        Encoding::Binary => "binary_little_endian",
        Encoding::Ascii => "ascii",
    };
    writeln!(w, "ply\nformat {format} 1.0")?;
    writeln!(w, "comment mesh-core {}: units and axes of the input", env!("CARGO_PKG_VERSION"))?;
    writeln!(w, "element vertex {}", mesh.positions.len())?;
    writeln!(w, "property float x\nproperty float y\nproperty float z")?;
    if colors.is_some() {
        writeln!(w, "property uchar red\nproperty uchar green\nproperty uchar blue")?;
    }
    writeln!(w, "element face {}", mesh.faces.len())?;
    writeln!(w, "property list uchar int vertex_indices\nend_header")?;
    for (v, position) in mesh.positions.iter().enumerate() {
        let color = colors.as_ref().map(|c| c[v].map(|x| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8));
        match encoding {
            Encoding::Binary => {
                for x in position {
                    w.write_all(&x.to_le_bytes())?;
                }
                w.write_all(color.as_ref().map_or(&[], |c| &c[..]))?;
            }
            Encoding::Ascii => {
                let [x, y, z] = position;
                write!(w, "{x} {y} {z}")?;
                if let Some([r, g, b]) = color {
                    write!(w, " {r} {g} {b}")?;
                }
                writeln!(w)?;
            }
        }
    }
    for face in &mesh.faces {
        match encoding {
            Encoding::Binary => {
                w.write_all(&[3])?;
                for i in face {
                    w.write_all(&i.to_le_bytes())?;
                }
            }
            Encoding::Ascii => writeln!(w, "3 {} {} {}", face[0], face[1], face[2])?,
        }
    }
    Ok(())
}
