//! Writing OBJ, MTL and the texture.

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::io::{WriteError, check, write_atomic};
use crate::{TriMesh, write_png};

/// Writes an OBJ file; a textured mesh also gets `.mtl` and `.png` files of the same name beside it.
///
/// Numbers are the shortest that read back as the same `f32`. Colours, sRGB, follow the
/// coordinates of their vertex. The OBJ file comes last, so that it never names what is not there.
///
/// # Errors
/// A file cannot be written, or the mesh has an index out of range or a number that is not finite.
pub fn write(path: impl AsRef<Path>, mesh: &TriMesh) -> Result<(), WriteError> {
    let path = path.as_ref();
    check::writable(mesh).map_err(|e| e.at(path))?;
    let library = match &mesh.texture {
        None => None,
        Some(texture) => {
            let [library, image] = companions(path);
            write_png(&image, &texture.image.to_bytes())?;
            let name = file_name(&image);
            write_atomic(&library, |w| {
                writeln!(w, "newmtl surface\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {name}")
            })?;
            Some(file_name(&library))
        }
    };
    write_atomic(path, |w| geometry(w, mesh, library.as_deref()))
}

fn geometry(w: &mut dyn Write, mesh: &TriMesh, library: Option<&str>) -> std::io::Result<()> {
    writeln!(w, "# mesh-core {}: units and axes of the input", env!("CARGO_PKG_VERSION"))?;
    writeln!(w, "# {} vertices, {} triangles", mesh.positions.len(), mesh.faces.len())?;
    if let Some(library) = library {
        writeln!(w, "mtllib {library}")?;
    }
    match &mesh.colors {
        None => {
            for [x, y, z] in &mesh.positions {
                writeln!(w, "v {x} {y} {z}")?;
            }
        }
        Some(colors) => {
            for ([x, y, z], [r, g, b]) in mesh.positions.iter().zip(colors) {
                writeln!(w, "v {x} {y} {z} {r} {g} {b}")?;
            }
        }
    }
    let Some(texture) = &mesh.texture else {
        for face in &mesh.faces {
            let [a, b, c] = face.map(|i| u64::from(i) + 1);
            writeln!(w, "f {a} {b} {c}")?;
        }
        return Ok(());
    };
    for [u, v] in &texture.uvs {
        writeln!(w, "vt {u} {v}")?;
    }
    writeln!(w, "usemtl surface")?;
    for (face, uv) in mesh.faces.iter().zip(&texture.faces) {
        let [a, b, c] = face.map(|i| u64::from(i) + 1);
        let [s, t, u] = uv.map(|i| u64::from(i) + 1);
        writeln!(w, "f {a}/{s} {b}/{t} {c}/{u}")?;
    }
    Ok(())
}

/// The files that [`write()`] makes beside an OBJ file for a textured mesh: the library of materials and the image.
///
/// ```
/// use std::path::Path;
/// use mesh_core::io::obj;
///
/// let beside = ["a/the_mug.mtl", "a/the_mug.png"].map(|name| Path::new(name).to_owned());
/// assert_eq!(obj::companions("a/the mug.obj"), beside);
/// ```
pub fn companions(path: impl AsRef<Path>) -> [PathBuf; 2] {
    ["mtl", "png"].map(|extension| beside(path.as_ref(), extension))
}

/// The file of the same stem with another extension; spaces, which many readers of MTL stumble
/// over, become underscores.
fn beside(path: &Path, extension: &str) -> PathBuf {
    let stem = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    path.with_file_name(format!("{}.{extension}", stem.replace(char::is_whitespace, "_")))
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}
