//! Reading PLY by what its header says.

use std::path::Path;

use super::header::{Element, Format, Header, Scalar, parse};
use crate::io::{ReadMeshError, read_bytes};
use crate::{Image, Texture, TriMesh, read_image};

/// Reads a PLY file: ASCII or binary, any order and type of properties.
///
/// Vertices need `x`, `y` and `z`; colours are `red`, `green`, `blue` (bytes, or floats in
/// `[0, 1]`); faces are `vertex_indices` or `vertex_index`, polygons become fans of triangles. A
/// texture is read where a comment `TextureFile` names it and vertices (`s t`, `u v` or
/// `texture_u texture_v`) or faces (`texcoord`) place it. Everything else is passed over.
///
/// # Errors
/// The file cannot be read, ends early, or holds a number that is not finite, an index out of
/// range, or a texture that is no image. A texture that is not there is left out.
pub fn read(path: impl AsRef<Path>) -> Result<TriMesh, ReadMeshError> {
    let path = path.as_ref();
    let bytes = read_bytes(path)?;
    let header = parse(&bytes, path)?;
    let file = header
        .texture
        .as_ref()
        .map(|name| path.with_file_name(name.replace('\\', "/")))
        .filter(|file| file.is_file());
    let parts = parts(&bytes, &header, path)?;
    let (mesh, placed) = parts.mesh(path)?;
    let texture = match (file, placed) {
        (Some(file), Some((uvs, faces))) => {
            let image = read_image(file)
                .map_err(|source| ReadMeshError::Texture { path: path.to_owned(), source })?;
            Some(Texture { uvs, faces, image: Image::from(&image.to_rgb()) })
        }
        _ => None,
    };
    Ok(TriMesh { texture, ..mesh })
}

/// The mesh in the bytes of a PLY file; no other file is looked at, so it has no texture.
///
/// `name` stands for the file in errors.
///
/// # Errors
/// As [`read`], less those of files.
pub fn decode(bytes: &[u8], name: impl AsRef<Path>) -> Result<TriMesh, ReadMeshError> {
    let path = name.as_ref();
    let header = parse(bytes, path)?;
    Ok(parts(bytes, &header, path)?.mesh(path)?.0)
}

/// What the file gives, before it is a mesh.
#[derive(Default)]
struct Parts {
    positions: Vec<[f32; 3]>,
    colors: Option<Vec<[f32; 3]>>,
    vertex_uvs: Option<Vec<[f32; 2]>>,
    faces: Vec<[u32; 3]>,
    /// Texture coordinates of the corners of each triangle.
    corner_uvs: Option<Vec<[[f32; 2]; 3]>>,
}

type Placement = (Vec<[f32; 2]>, Vec<[u32; 3]>);

impl Parts {
    fn mesh(self, path: &Path) -> Result<(TriMesh, Option<Placement>), ReadMeshError> {
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
        let placed = match (self.corner_uvs, self.vertex_uvs) {
            (Some(corners), _) if corners.len() == self.faces.len() => {
                let faces = (0..corners.len() as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]);
                Some((corners.into_iter().flatten().collect(), faces.collect()))
            }
            (_, Some(uvs)) => Some((uvs, self.faces.clone())),
            _ => None,
        };
        let mesh = TriMesh {
            positions: self.positions,
            faces: self.faces,
            colors: self.colors,
            texture: None,
        };
        Ok((mesh, placed))
    }
}

fn parts(bytes: &[u8], header: &Header, path: &Path) -> Result<Parts, ReadMeshError> {
    let mut numbers = Numbers::new(bytes, header, path);
    let mut parts = Parts::default();
    if !header.elements.iter().any(|e| e.name == "vertex") {
        return Err(ReadMeshError::malformed(path, "element vertex", "none", "one"));
    }
    for element in &header.elements {
        if element.properties.is_empty() {
            continue; // takes no bytes, however many are claimed
        }
        numbers.element.clone_from(&element.name);
        match element.name.as_str() {
            "vertex" => vertices(element, &mut numbers, &mut parts)?,
            "face" => faces(element, &mut numbers, &mut parts)?,
            _ => {
                let mut values = Vec::new();
                for item in 0..element.count {
                    numbers.item = item;
                    for p in &element.properties {
                        numbers.property(p.length, p.scalar, &mut values)?;
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
) -> Result<(), ReadMeshError> {
    let find = |names: &[&str]| {
        element
            .properties
            .iter()
            .position(|p| names.contains(&p.name.as_str()) && p.length.is_none())
    };
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

    let mut colors = Vec::new();
    let mut uvs = Vec::new();
    let mut row = vec![0.0; element.properties.len()];
    let mut list = Vec::new();
    for item in 0..element.count {
        numbers.item = item;
        for (slot, p) in row.iter_mut().zip(&element.properties) {
            numbers.property(p.length, p.scalar, &mut list)?;
            *slot = list.first().copied().unwrap_or(0.0);
        }
        let position = [x, y, z].map(|k| row[k] as f32);
        if let Some(bad) = position.iter().find(|v| !v.is_finite()) {
            return Err(numbers.wrong("x, y, z", bad, "finite numbers"));
        }
        parts.positions.push(position);
        if let Some(rgb) = rgb {
            let color = rgb.map(|k| (row[k] / element.properties[k].scalar.white()) as f32);
            if let Some(bad) = color.iter().find(|v| !v.is_finite()) {
                return Err(numbers.wrong("red, green, blue", bad, "finite numbers"));
            }
            colors.push(color.map(|v| v.clamp(0.0, 1.0)));
        }
        if let Some(uv) = uv {
            let uv = uv.map(|k| row[k] as f32);
            if let Some(bad) = uv.iter().find(|v| !v.is_finite()) {
                return Err(numbers.wrong("texture coordinates", bad, "finite numbers"));
            }
            uvs.push(uv);
        }
    }
    parts.colors = rgb.map(|_| colors);
    parts.vertex_uvs = uv.map(|_| uvs);
    Ok(())
}

fn faces(
    element: &Element,
    numbers: &mut Numbers<'_>,
    parts: &mut Parts,
) -> Result<(), ReadMeshError> {
    let mut polygon: Vec<u32> = Vec::new();
    let mut texcoord = Vec::new();
    let mut list = Vec::new();
    let mut corner_uvs = Vec::new();
    let mut has_texcoord = false;
    for item in 0..element.count {
        numbers.item = item;
        polygon.clear();
        texcoord.clear();
        for p in &element.properties {
            numbers.property(p.length, p.scalar, &mut list)?;
            match (p.name.as_str(), p.length) {
                ("vertex_indices" | "vertex_index", Some(_)) => {
                    for &v in &list {
                        if !(0.0..=f64::from(u32::MAX)).contains(&v) || v.fract() != 0.0 {
                            return Err(numbers.wrong("vertex_indices", v, "an index"));
                        }
                        polygon.push(v as u32);
                    }
                }
                ("texcoord", Some(_)) => texcoord.clone_from(&list),
                _ => {}
            }
        }
        if polygon.len() < 3 {
            return Err(numbers.wrong("vertex_indices", polygon.len(), "at least three corners"));
        }
        let uv = |k: usize| [texcoord[2 * k] as f32, texcoord[2 * k + 1] as f32];
        let placed = texcoord.len() == 2 * polygon.len() && texcoord.iter().all(|v| v.is_finite());
        has_texcoord |= placed;
        for k in 1..polygon.len() - 1 {
            parts.faces.push([polygon[0], polygon[k], polygon[k + 1]]);
            if placed {
                corner_uvs.push([uv(0), uv(k), uv(k + 1)]);
            }
        }
    }
    parts.corner_uvs = has_texcoord.then_some(corner_uvs);
    Ok(())
}

/// The numbers after the header, one after the other.
struct Numbers<'a> {
    bytes: &'a [u8],
    position: usize,
    format: Format,
    path: &'a Path,
    /// For errors: what is being read.
    element: String,
    item: u64,
    line: usize,
}

impl<'a> Numbers<'a> {
    fn new(bytes: &'a [u8], header: &Header, path: &'a Path) -> Self {
        Self {
            bytes,
            position: header.end,
            format: header.format,
            path,
            element: String::new(),
            item: 0,
            line: header.lines + 1,
        }
    }

    fn wrong(&self, field: &str, found: impl ToString, expected: &str) -> ReadMeshError {
        let line = (self.format == Format::Ascii).then_some(self.line);
        let field = format!("{} {}, {field}", self.element, self.item);
        ReadMeshError::at_line(self.path, line, field, found, expected)
    }

    /// The values of one property: one number, or those of a list.
    fn property(
        &mut self,
        length: Option<Scalar>,
        scalar: Scalar,
        values: &mut Vec<f64>,
    ) -> Result<(), ReadMeshError> {
        values.clear();
        let count = match length {
            None => 1,
            Some(kind) => {
                let count = self.number(kind)?;
                // A number takes a byte at least, in any of the formats.
                let left = (self.bytes.len() - self.position) as f64;
                if !(0.0..=left).contains(&count) || count.fract() != 0.0 {
                    return Err(self.wrong(
                        "length of a list",
                        count,
                        "no more than the file holds",
                    ));
                }
                count as usize
            }
        };
        for _ in 0..count {
            let value = self.number(scalar)?;
            values.push(value);
        }
        Ok(())
    }

    fn number(&mut self, scalar: Scalar) -> Result<f64, ReadMeshError> {
        if self.format == Format::Ascii {
            return self.word();
        }
        let size = scalar.size();
        let Some(bytes) = self.bytes.get(self.position..self.position + size) else {
            return Err(self.wrong("data", "the end of the file", "as many as the header claims"));
        };
        self.position += size;
        let mut raw = [0_u8; 8];
        raw[..size].copy_from_slice(bytes);
        if self.format == Format::Big {
            raw[..size].reverse();
        }
        let four = [raw[0], raw[1], raw[2], raw[3]];
        Ok(match scalar {
            Scalar::I8 => f64::from(raw[0].cast_signed()),
            Scalar::U8 => f64::from(raw[0]),
            Scalar::I16 => f64::from(i16::from_le_bytes([raw[0], raw[1]])),
            Scalar::U16 => f64::from(u16::from_le_bytes([raw[0], raw[1]])),
            Scalar::I32 => f64::from(i32::from_le_bytes(four)),
            Scalar::U32 => f64::from(u32::from_le_bytes(four)),
            Scalar::F32 => f64::from(f32::from_le_bytes(four)),
            Scalar::F64 => f64::from_le_bytes(raw),
        })
    }

    fn word(&mut self) -> Result<f64, ReadMeshError> {
        while let Some(b) = self.bytes.get(self.position).filter(|b| b.is_ascii_whitespace()) {
            self.line += usize::from(*b == b'\n');
            self.position += 1;
        }
        let rest = &self.bytes[self.position..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        if length == 0 {
            return Err(self.wrong("data", "the end of the file", "as many as the header claims"));
        }
        self.position += length;
        let word = String::from_utf8_lossy(&rest[..length.min(64)]);
        word.parse().map_err(|_| self.wrong("data", format!("{word:?}"), "a number"))
    }
}
