//! Any mesh file: the format is that of its name's ending.

use std::path::{Path, PathBuf};

use super::open::Contents;
#[cfg(feature = "3mf")]
use super::threemf;
use super::{ReadMeshError, Remark, WriteError, glb, obj, off, ply, stl};
use crate::{Limits, TriMesh};

/// Reads a mesh; the file's extension says which format it is: `.obj`, `.ply`, `.glb`, `.off` or
/// `.stl`.
///
/// # Errors
/// Another extension, a file that cannot be read, one that is not as its format says, or one that needs
/// more than the default [`Limits`].
pub fn read_mesh(path: impl AsRef<Path>) -> Result<TriMesh, ReadMeshError> {
    read_mesh_with(path, &Limits::default(), &mut Vec::new())
}

/// [`read_mesh`] within other limits; what the mesh does not hold of the file is added to `remarks`.
///
/// # Errors
/// As [`read_mesh`].
pub fn read_mesh_with(
    path: impl AsRef<Path>,
    limits: &Limits,
    remarks: &mut Vec<Remark>,
) -> Result<TriMesh, ReadMeshError> {
    let path = path.as_ref();
    match extension(path).as_str() {
        "obj" => obj::read_with(path, limits, remarks),
        "ply" => ply::read_with(path, limits, remarks),
        "glb" => glb::read_with(path, limits, remarks),
        "off" => off::read_with(path, limits, remarks),
        "stl" => stl::read_with(path, limits, remarks),
        found => Err(ReadMeshError::Extension { path: path.to_owned(), found: found.to_owned() }),
    }
}

/// [`read_mesh_with`] for who makes a texture anew: [`TriMesh::texture`] has the texture coordinates of the file, also where no
/// image lies on the mesh or several do, and in place of an image one white pixel. `None` where the file has no texture
/// coordinates; faces without take those of `(0, 0)`. No other file is opened.
///
/// ```
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("unwrapped.obj");
/// std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")?;
/// assert!(mesh_core::read_mesh(&path)?.texture.is_none()); // there is no image
/// let mesh = mesh_core::read_mesh_with_uvs(&path, &mesh_core::Limits::default(), &mut Vec::new())?;
/// assert_eq!(mesh.texture.ok_or("no texture")?.uvs[1], [1.0, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// As [`read_mesh`], less those of images.
pub fn read_mesh_with_uvs(
    path: impl AsRef<Path>,
    limits: &Limits,
    remarks: &mut Vec<Remark>,
) -> Result<TriMesh, ReadMeshError> {
    let path = path.as_ref();
    let contents = || Ok(Contents { only_uvs: true, ..Contents::of_file(path, limits)? });
    match extension(path).as_str() {
        "obj" => obj::mesh(contents()?, remarks),
        "ply" => ply::mesh(contents()?, remarks),
        "glb" => glb::assemble(contents()?, remarks),
        // The others have none.
        _ => read_mesh_with(path, limits, remarks),
    }
}

/// Writes a mesh in the format of the path's extension: `.obj`, `.ply` (binary), `.glb`, `.stl`, and with the
/// feature `3mf` `.3mf`.
///
/// # Errors
/// Another extension, a file that cannot be written, or a mesh with an index out of range or a
/// position that is not finite.
pub fn write_mesh(path: impl AsRef<Path>, mesh: &TriMesh) -> Result<(), WriteError> {
    let path = path.as_ref();
    match extension(path).as_str() {
        "obj" => obj::write(path, mesh),
        "ply" => ply::write(path, mesh, ply::Encoding::Binary),
        "glb" => glb::write(path, mesh),
        "stl" => stl::write(path, mesh),
        #[cfg(feature = "3mf")]
        "3mf" => threemf::write(path, mesh),
        found => Err(WriteError::Extension { path: path.to_owned(), found: found.to_owned() }),
    }
}

/// The files that [`write_mesh`] makes for a mesh, the one at `path` first: a textured OBJ has
/// [`companions`](super::obj::companions), whatever stood there before.
pub fn files_of(path: impl AsRef<Path>, mesh: &TriMesh) -> Vec<PathBuf> {
    let path = path.as_ref();
    let mut files = vec![path.to_owned()];
    if mesh.texture.is_some() && extension(path) == "obj" {
        files.extend(obj::companions(path));
    }
    files
}

fn extension(path: &Path) -> String {
    path.extension().map_or_else(String::new, |e| e.to_string_lossy().to_lowercase())
}
