//! Reading OBJ as people have it.

use super::mtl::Materials;
use super::parse::{NONE, Parsed, UNCOLORED, parse};
use crate::io::open::{self, Contents, readers};
use crate::io::remark::counted;
use crate::io::{ReadMeshError, Remark};
use crate::{Budget, Image, Texture, TriMesh};

readers! {
    /// Reads an OBJ file and the texture of its material library, or where there is none the materials' colours (`Kd`).
    ///
    /// Vertices keep their order, used or not. Polygons become triangles. Indices may be
    /// negative, corners may be `v`, `v/vt`, `v//vn` or `v/vt/vn` in any mixture, lines may end in LF, CR
    /// LF or CR or continue after a backslash, and `v` may carry a weight (ignored) or a colour. Where
    /// only some vertices have a colour the others are white; a material's colour is its vertices', where faces of several meet the
    /// first one's.
    ///
    /// What other programs pass over is left out here too: points, lines, faces of one or two corners,
    /// triangles that name a vertex twice, texture coordinates that are not in the file, a texture or a
    /// library that is not there. [`read_with`] says what it was.
    ///
    /// Files that the mesh names (`mtllib`, and `map_Kd` in the library) are opened only if they are
    /// regular files in the mesh's folder or below it, wherever links lead; see
    /// [`Limits::outside_links`](crate::Limits::outside_links).
    ///
    /// # Errors
    /// The file cannot be read; a number is missing, unreadable or not finite; an index of a vertex is 0
    /// or out of range; an image that is there cannot be read; the default [`Limits`](crate::Limits) are not enough.
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
    let mut image = None;
    if only_uvs {
        image = (!parsed.uv_faces.is_empty()).then(open::blank);
    } else if let Some(root) = root {
        let materials = Materials::read(&parsed, &root, path, limits, remarks)?;
        if let Some(file) = materials.image(&parsed, &root, remarks) {
            image = Some(open::texture(path, &file, limits)?);
        } else if parsed.colors.is_empty() {
            let colors = materials.vertex_colors(&parsed, &mut budget, remarks);
            parsed.colors = colors.map_err(ReadMeshError::over_limit(path))?;
        }
    }
    mesh_of(parsed, image, &mut budget, remarks).map_err(ReadMeshError::over_limit(path))
}

fn mesh_of(
    parsed: Parsed,
    image: Option<Image>,
    budget: &mut Budget,
    remarks: &mut Vec<Remark>,
) -> Result<TriMesh, crate::OverLimit> {
    let Parsed { positions, mut colors, uvs, faces, uv_faces, .. } = parsed;
    let texture = image
        .map(|image| texture(uvs, uv_faces, faces.len(), image, budget, remarks))
        .transpose()?;
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

fn texture(
    mut uvs: Vec<[f32; 2]>,
    mut faces: Vec<[u32; 3]>,
    count: usize,
    image: Image,
    budget: &mut Budget,
    remarks: &mut Vec<Remark>,
) -> Result<Texture, crate::OverLimit> {
    budget.fill(&mut faces, count, [NONE; 3], 0)?;
    let bare = faces.iter().flatten().filter(|&&i| i == NONE).count();
    if bare > 0 {
        let origin = uvs.len() as u32;
        budget.push(&mut uvs, [0.0; 2])?;
        for i in faces.iter_mut().flatten().filter(|i| **i == NONE) {
            *i = origin;
        }
    }
    counted(remarks, bare, |count| Remark::MissingTexcoords { count });
    Ok(Texture { uvs, faces, image })
}
