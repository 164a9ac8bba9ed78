//! Reading OBJ as people have it.

use super::mtl::Materials;
use super::parse::{Parsed, UNCOLORED, parse};
use super::skin;
use crate::TriMesh;
use crate::io::open::{self, Contents, readers};
use crate::io::{ReadMeshError, Remark};

readers! {
    /// Reads an OBJ file and the textures of its material libraries, or where there are none the materials' colours (`Kd`).
    ///
    /// Where materials differ, one image is made of all their textures and of the colours of those without; where one texture
    /// lies on all it stays as it is. `-s` and `-o` of `map_Kd` are applied. A texture that is repeated more often than the image has room for is made
    /// smaller on the faces that repeat it.
    ///
    /// Vertices keep their order, used or not. Polygons become triangles. Indices may be
    /// negative, corners may be `v`, `v/vt`, `v//vn` or `v/vt/vn` in any mixture, lines may end in LF, CR
    /// LF or CR or continue after a backslash, and `v` may carry a weight (ignored) or a colour. Where
    /// only some vertices have a colour the others are white; a material's colour is its vertices', where faces of several meet the
    /// first one's.
    ///
    /// What other programs pass over is left out here too: points, lines, faces of one or two corners,
    /// triangles that name a vertex twice, texture coordinates that are not in the file, a texture or a
    /// library that is not there, a texture that is neither PNG nor JPEG. [`read_with`] says what it was.
    ///
    /// Files that the mesh names (`mtllib`, and `map_Kd` in the library) are opened only if they are
    /// regular files in the mesh's folder or below it, wherever links lead; see
    /// [`Limits::outside_links`](crate::Limits::outside_links).
    ///
    /// # Errors
    /// The file cannot be read; a number is missing, unreadable or not finite; an index of a vertex is 0
    /// or out of range; the first image is damaged; the default [`Limits`](crate::Limits) are not enough.
    read,
    /// The mesh in the bytes of an OBJ file; no other file is looked at, so it has no texture.
    decode,
    mesh
}

pub(in crate::io) fn mesh(
    contents: Contents<'_>,
    remarks: &mut Vec<Remark>,
) -> Result<TriMesh, ReadMeshError> {
    let Contents { bytes, path, limits, mut budget, root, only_uvs } = contents;
    let mut parsed = parse(&bytes, path, &mut budget, remarks)?;
    drop(bytes);
    let over = ReadMeshError::over_limit(path);
    let mut texture = None;
    if only_uvs {
        if !parsed.uv_faces.is_empty() {
            let blank = skin::one(&mut parsed, skin::PLAIN, open::blank(), &mut budget, remarks);
            texture = Some(blank.map_err(&over)?);
        }
    } else if let Some(root) = root {
        let materials = Materials::read(&parsed, &root, path, limits, remarks)?;
        let place = (path, limits);
        texture = skin::texture(&mut parsed, &materials, &root, place, &mut budget, remarks)?;
        if texture.is_none() && parsed.colors.is_empty() {
            let colors = materials.vertex_colors(&parsed, &mut budget, remarks);
            parsed.colors = colors.map_err(&over)?;
        }
    }
    let Parsed { positions, mut colors, faces, .. } = parsed;
    to_unit(&mut colors);
    let colors = (!colors.is_empty()).then_some(colors);
    Ok(TriMesh { positions, faces, colors, texture })
}

/// Brings colours to `[0, 1]`: some tools write 0..255 where everyone else writes 0..1.
fn to_unit(colors: &mut [[f32; 3]]) {
    let given = |color: &&mut [f32; 3]| **color != UNCOLORED;
    let bytes = colors.iter_mut().filter(given).flatten().any(|c| *c > 1.5);
    let largest = if bytes { 255.0 } else { 1.0 };
    for color in colors {
        *color = if *color == UNCOLORED {
            [1.0; 3]
        } else {
            color.map(|c| (c / largest).clamp(0.0, 1.0))
        };
    }
}
