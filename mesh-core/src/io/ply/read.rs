//! Reading PLY by what its header says.

use std::path::Path;

use super::faces::{faces, strips};
use super::header::{Element, Header, Scalar, parse};
use super::numbers::Numbers;
use crate::io::open::{Contents, blank, readers, texture};
use crate::io::polygons::Polygons;
use crate::io::remark::{counted, not_read};
use crate::io::{ReadMeshError, Remark};
use crate::{Budget, Texture, TriMesh};

readers! {
    /// Reads a PLY file: ASCII or binary, any order and type of properties.
    ///
    /// Vertices need `x`, `y` and `z`; colours are `red`, `green`, `blue`. Integers are bytes
    /// where none is above 255, numbers of 16 bits where none is above those, or else count up to the largest of their type, which they
    /// always do in `char` (127). Floats are bytes where all are whole and one is above 1, or else cut off at 0 and 1. Faces are
    /// `vertex_indices` or `vertex_index`, polygons become triangles; `tristrips` are strips of triangles, which -1 ends. A texture is
    /// read where a comment `TextureFile` names one in the file's folder or below it and vertices (`s t`, `u v` or
    /// `texture_u texture_v`) or faces (`texcoord`) place it. Faces of one or two corners and triangles that name a vertex twice are
    /// left out. Everything else is passed over.
    ///
    /// # Errors
    /// The file cannot be read, ends early, or holds a number that is not finite, an index out of
    /// range, or a texture that is damaged; the default [`Limits`](crate::Limits) are not enough. A texture that is
    /// not there, or neither PNG nor JPEG, is left out.
    read,
    /// The mesh in the bytes of a PLY file; no other file is looked at, so it has no texture.
    decode,
    mesh
}

pub(in crate::io) fn mesh(
    contents: Contents<'_>,
    remarks: &mut Vec<Remark>,
) -> Result<TriMesh, ReadMeshError> {
    let Contents { bytes, path, limits, mut budget, root, only_uvs } = contents;
    let header = parse(&bytes, path, &mut budget)?;
    let parts = parts(&bytes, &header, path, &mut budget)?;
    drop(bytes);
    let (mesh, placed) = parts.mesh(path, &mut budget, remarks)?;
    if only_uvs {
        let texture = placed.map(|(uvs, faces)| Texture { uvs, faces, image: blank() });
        return Ok(TriMesh { texture, ..mesh });
    }
    let (Some(root), Some(name), Some((uvs, faces))) = (root, header.texture, placed) else {
        return Ok(mesh);
    };
    let image = match root.find(root.folder(), &name) {
        Ok(file) => texture(path, &file, limits)?,
        Err(why) => Err(why),
    };
    let texture = match image {
        Ok(image) => {
            counted(remarks, header.other_textures, |count| Remark::OtherTextures { count });
            Some(Texture { uvs, faces, image })
        }
        Err(why) => {
            not_read(remarks, &name, why);
            None
        }
    };
    Ok(TriMesh { texture, ..mesh })
}

/// What the file gives, before it is a mesh.
#[derive(Default)]
pub(super) struct Parts {
    positions: Vec<[f32; 3]>,
    colors: Option<Vec<[f32; 3]>>,
    vertex_uvs: Option<Vec<[f32; 2]>>,
    pub(super) faces: Vec<[u32; 3]>,
    /// Those that are polygons.
    pub(super) polygons: Polygons,
    /// Texture coordinates of the corners of each triangle.
    pub(super) corner_uvs: Option<Vec<[[f32; 2]; 3]>>,
    /// Faces of fewer than three corners, and the line of the first.
    pub(super) short: usize,
    pub(super) first_short: Option<usize>,
    /// Triangles that name a vertex twice.
    pub(super) repeated: usize,
    /// Faces with a colour of their own.
    pub(super) face_colors: usize,
    /// Corners without a place on the texture, where others have one.
    pub(super) bare: usize,
}

type Placement = (Vec<[f32; 2]>, Vec<[u32; 3]>);

impl Parts {
    fn mesh(
        mut self,
        path: &Path,
        budget: &mut Budget,
        remarks: &mut Vec<Remark>,
    ) -> Result<(TriMesh, Option<Placement>), ReadMeshError> {
        let over = ReadMeshError::over_limit(path);
        let count = self.positions.len();
        if let Some((f, face)) =
            self.faces.iter().enumerate().find(|(_, f)| f.iter().any(|&i| i as usize >= count))
        {
            return Err(ReadMeshError::malformed(
                path,
                format!("triangle {f}"),
                format!("indices {face:?}"),
                format!("0 to {} ({count} vertices)", count as i64 - 1),
            ));
        }
        let corners = self.corner_uvs.as_deref_mut().filter(|uvs| uvs.len() == self.faces.len());
        self.polygons.cut(&self.positions, &mut self.faces, corners);
        let placed = match (self.corner_uvs, self.vertex_uvs) {
            (Some(corners), _) if corners.len() == self.faces.len() => {
                counted(remarks, self.bare, |count| Remark::MissingTexcoords { count });
                let mut faces = Vec::new();
                budget.reserve(&mut faces, corners.len()).map_err(&over)?;
                faces.extend((0..corners.len() as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]));
                Some((corners.into_flattened(), faces))
            }
            (_, Some(uvs)) => {
                let mut faces = Vec::new();
                budget.reserve(&mut faces, self.faces.len()).map_err(&over)?;
                faces.extend_from_slice(&self.faces);
                Some((uvs, faces))
            }
            _ => None,
        };
        let line = self.first_short;
        counted(remarks, self.short, |count| Remark::ShortFaces { count, line });
        counted(remarks, self.repeated, |count| Remark::RepeatedVertices { count });
        counted(remarks, self.face_colors, |count| Remark::FaceColors { count });
        let mesh = TriMesh {
            positions: self.positions,
            faces: self.faces,
            colors: self.colors,
            texture: None,
        };
        Ok((mesh, placed))
    }
}

fn parts(
    bytes: &[u8],
    header: &Header,
    path: &Path,
    budget: &mut Budget,
) -> Result<Parts, ReadMeshError> {
    let mut numbers = Numbers::new(bytes, header, path);
    let mut parts = Parts::default();
    if !header.elements.iter().any(|e| e.name == "vertex") {
        return Err(ReadMeshError::malformed(path, "element vertex", "none", "one"));
    }
    for element in &header.elements {
        if element.properties.is_empty() {
            continue; // takes no bytes, however many are claimed
        }
        numbers.begin(&element.name);
        match element.name.as_str() {
            "vertex" => vertices(element, &mut numbers, &mut parts, budget)?,
            "face" => faces(element, &mut numbers, &mut parts, budget)?,
            "tristrips" => strips(element, &mut numbers, &mut parts, budget)?,
            _ => {
                for item in 0..element.count {
                    numbers.item = item;
                    for p in &element.properties {
                        numbers.skip(p)?;
                    }
                }
            }
        }
    }
    Ok(parts)
}

fn vertices(
    element: &Element,
    numbers: &mut Numbers<'_>,
    parts: &mut Parts,
    budget: &mut Budget,
) -> Result<(), ReadMeshError> {
    let over = ReadMeshError::over_limit(numbers.path);
    let find = |names: &[&str]| element.number_named(names);
    let [Some(x), Some(y), Some(z)] = [find(&["x"]), find(&["y"]), find(&["z"])] else {
        let names: Vec<&str> = element.properties.iter().map(|p| p.name.as_str()).collect();
        return Err(ReadMeshError::malformed(
            numbers.path,
            "element vertex",
            format!("properties {}", names.join(", ")),
            "x, y and z among them",
        ));
    };
    let rgb = [
        find(&["red", "r", "diffuse_red"]),
        find(&["green", "g", "diffuse_green"]),
        find(&["blue", "b", "diffuse_blue"]),
    ];
    let rgb = if let [Some(r), Some(g), Some(b)] = rgb { Some([r, g, b]) } else { None };
    let uv = [find(&["texture_u", "u", "s"]), find(&["texture_v", "v", "t"])];
    let uv = if let [Some(u), Some(v)] = uv { Some([u, v]) } else { None };

    let (mut colors, mut largest) = (Vec::new(), [0.0_f32; 3]);
    let mut is_whole = [true; 3];
    let mut uvs = Vec::new();
    let mut row = vec![0.0; element.properties.len()];
    for item in 0..element.count {
        numbers.item = item;
        for (slot, p) in row.iter_mut().zip(&element.properties) {
            match p.length {
                None => *slot = numbers.number(p.scalar)?,
                Some(_) => numbers.skip(p)?,
            }
        }
        let position = [x, y, z].map(|k| row[k] as f32);
        if let Some(bad) = position.iter().find(|v| !v.is_finite()) {
            return Err(numbers.wrong("x, y, z", bad, "finite numbers"));
        }
        budget.push(&mut parts.positions, position).map_err(&over)?;
        if let Some(rgb) = rgb {
            let color = rgb.map(|k| row[k] as f32);
            if let Some(bad) = color.iter().find(|v| !v.is_finite()) {
                return Err(numbers.wrong("red, green, blue", bad, "finite numbers"));
            }
            largest = std::array::from_fn(|k| largest[k].max(color[k]));
            is_whole = std::array::from_fn(|k| is_whole[k] && color[k].fract() == 0.0);
            budget.push(&mut colors, color).map_err(&over)?;
        }
        if let Some(uv) = uv {
            let uv = uv.map(|k| row[k] as f32);
            if let Some(bad) = uv.iter().find(|v| !v.is_finite()) {
                return Err(numbers.wrong("texture coordinates", bad, "finite numbers"));
            }
            budget.push(&mut uvs, uv).map_err(&over)?;
        }
    }
    parts.colors = rgb.map(|rgb| {
        to_unit(&mut colors, rgb.map(|k| element.properties[k].scalar), largest, is_whole);
        colors
    });
    parts.vertex_uvs = uv.map(|_| uvs);
    Ok(())
}

/// Brings colours to `[0, 1]`, by the types of their channels, the largest value of each and whether all of it are whole.
fn to_unit(colors: &mut [[f32; 3]], scalars: [Scalar; 3], largest: [f32; 3], is_whole: [bool; 3]) {
    let white = scalars.map(|scalar| {
        let alike = || (0..3).filter(|&k| scalars[k] == scalar);
        let largest = alike().map(|k| largest[k]).fold(0.0, f32::max);
        scalar.white(largest, alike().all(|k| is_whole[k]))
    });
    for color in colors {
        *color = std::array::from_fn(|k| (f64::from(color[k]) / white[k]).clamp(0.0, 1.0) as f32);
    }
}
