//! Reading GLB.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Matrix4, Quaternion, UnitQuaternion, Vector3, Vector4};

use super::document::{Accessor, Document, Node, Primitive};
use super::{BIN, JSON, MAGIC, component};
use crate::io::{ReadMeshError, read_bytes};
use crate::{Image, Texture, TriMesh, decode_image, linear_to_srgb};

/// Reads the triangles of a GLB file's scene as one mesh, nodes' transforms applied.
///
/// Vertices that files split at seams of normals or texture coordinates are joined again where
/// position and colour are the same bits. Vertex colours come back as sRGB. One texture is kept:
/// see [`read_with_notes`].
///
/// # Errors
/// The file cannot be read, is no GLB 2.0, needs an extension that changes its geometry
/// (compression), keeps data in other files, or holds an index or a length out of range, or a
/// position that is not finite.
pub fn read(path: impl AsRef<Path>) -> Result<TriMesh, ReadMeshError> {
    read_with_notes(path, &mut Vec::new())
}

/// The same, and a sentence in `notes` for each thing that the mesh cannot hold.
///
/// # Errors
/// As [`read`].
pub fn read_with_notes(
    path: impl AsRef<Path>,
    notes: &mut Vec<String>,
) -> Result<TriMesh, ReadMeshError> {
    let path = path.as_ref();
    assemble(&read_bytes(path)?, path, notes)
}

/// The mesh in the bytes of a GLB file; `name` stands for the file in errors.
///
/// # Errors
/// As [`read`].
pub fn decode(bytes: &[u8], name: impl AsRef<Path>) -> Result<TriMesh, ReadMeshError> {
    assemble(bytes, name.as_ref(), &mut Vec::new())
}

/// A node may show the same mesh again and again. That ends at this many vertices or triangles,
/// or at one per byte of a larger file.
const MOST: usize = 1 << 22;

/// Extensions that leave positions, indices and colours as they are.
fn is_harmless(extension: &str) -> bool {
    extension == "KHR_mesh_quantization" || extension.starts_with("KHR_materials_")
}

struct Glb<'a> {
    path: &'a Path,
    document: Document,
    bin: &'a [u8],
    /// How many vertices, and triangles, the scene may have.
    most: usize,
}

/// What the nodes add up to, before seams are joined.
#[derive(Default)]
struct Soup {
    positions: Vec<[f32; 3]>,
    colors: Vec<[f32; 3]>,
    colored: bool,
    uvs: Vec<[f32; 2]>,
    faces: Vec<[u32; 3]>,
    /// Whether any part was split at seams.
    split: bool,
    /// The image in use and whether it was found.
    image: Option<usize>,
}

fn assemble(bytes: &[u8], path: &Path, notes: &mut Vec<String>) -> Result<TriMesh, ReadMeshError> {
    let glb = Glb::open(bytes, path)?;
    let mut soup = Soup::default();
    for (node, transform) in glb.placed()? {
        let Some(mesh) = glb.document.nodes[node].mesh else { continue };
        let mesh = glb.get(&glb.document.meshes, mesh, "mesh")?;
        for primitive in &mesh.primitives {
            glb.primitive(primitive, &transform, &mut soup, notes)?;
        }
    }
    let image = match soup.image {
        Some(index) => Some(glb.image(index)?),
        None => None,
    };
    Ok(soup.joined(image))
}

impl<'a> Glb<'a> {
    fn open(bytes: &'a [u8], path: &'a Path) -> Result<Self, ReadMeshError> {
        let bad = |field: &str, found: &dyn ToString, expected: &str| {
            ReadMeshError::malformed(path, field, found.to_string(), expected)
        };
        let word = |at: usize| {
            let four = bytes.get(at..at + 4)?;
            Some(u32::from_le_bytes([four[0], four[1], four[2], four[3]]))
        };
        if word(0) != Some(MAGIC) {
            return Err(bad("first bytes", &"others", "glTF"));
        }
        match word(4) {
            Some(2) => {}
            Some(v) => return Err(bad("version", &v, "2")),
            None => return Err(bad("header", &"the end of the file", "12 bytes")),
        }
        let chunk = |at: usize, kind: u32, name: &str| {
            let (Some(length), Some(found)) = (word(at), word(at + 4)) else {
                return Err(bad(name, &"the end of the file", "a chunk"));
            };
            if found != kind {
                return Err(bad(name, &format!("type {found:#x}"), &format!("type {kind:#x}")));
            }
            let start = at + 8;
            let data = bytes.get(start..start.saturating_add(length as usize));
            data.ok_or_else(|| {
                let left = bytes.len() - start;
                bad(name, &format!("{left} bytes"), &format!("the {length} that it claims"))
            })
        };
        let json = chunk(12, JSON, "JSON chunk")?;
        let next = 20 + json.len();
        let bin = if next < bytes.len() { chunk(next, BIN, "BIN chunk")? } else { &[] };
        let text = json.trim_ascii_end();
        // Spaces pad the chunk, but some writers take zeros.
        let end = text.iter().rposition(|&b| b != 0).map_or(0, |last| last + 1);
        let document: Document = serde_json::from_slice(&text[..end])
            .map_err(|e| bad("JSON chunk", &e, "a glTF 2.0 document"))?;
        if let Some(name) = document.extensions_required.iter().find(|name| !is_harmless(name)) {
            return Err(bad("extensionsRequired", name, "none that changes geometry or colours"));
        }
        Ok(Self { path, document, bin, most: MOST.max(bytes.len()) })
    }

    fn bad(&self, field: &str, found: impl ToString, expected: &str) -> ReadMeshError {
        ReadMeshError::malformed(self.path, field, found, expected)
    }

    fn get<'b, T>(&self, list: &'b [T], index: usize, what: &str) -> Result<&'b T, ReadMeshError> {
        list.get(index).ok_or_else(|| {
            self.bad(what, format!("index {index}"), &format!("less than {}", list.len()))
        })
    }

    /// The nodes of the scene and where each stands in the world.
    fn placed(&self) -> Result<Vec<(usize, Matrix4<f64>)>, ReadMeshError> {
        let document = &self.document;
        let roots = if let Some(scene) = document.scenes.get(document.scene.unwrap_or(0)) {
            scene.nodes.clone()
        } else {
            let mut is_child = vec![false; document.nodes.len()];
            for &child in document.nodes.iter().flat_map(|n| &n.children) {
                if let Some(flag) = is_child.get_mut(child) {
                    *flag = true;
                }
            }
            (0..document.nodes.len()).filter(|&i| !is_child[i]).collect()
        };
        let mut seen = vec![false; document.nodes.len()];
        let mut placed = Vec::new();
        let mut stack: Vec<(usize, Matrix4<f64>)> =
            roots.into_iter().rev().map(|i| (i, Matrix4::identity())).collect();
        while let Some((index, parent)) = stack.pop() {
            let node = self.get(&document.nodes, index, "node")?;
            if std::mem::replace(&mut seen[index], true) {
                return Err(self.bad("nodes", format!("node {index} twice"), "a tree"));
            }
            let transform = parent * local(node);
            placed.push((index, transform));
            stack.extend(node.children.iter().rev().map(|&child| (child, transform)));
        }
        Ok(placed)
    }

    fn primitive(
        &self,
        primitive: &Primitive,
        transform: &Matrix4<f64>,
        soup: &mut Soup,
        notes: &mut Vec<String>,
    ) -> Result<(), ReadMeshError> {
        let mode = primitive.mode.unwrap_or(4);
        let Some(position) = primitive.attributes.position else {
            return Ok(()); // nothing to show, says the standard
        };
        if matches!(mode, 1..=3) {
            notes.push("lines are left out".to_owned());
            return Ok(());
        }
        let positions = self.floats::<3>(position, "POSITION")?;
        let (base, count) = (soup.positions.len(), positions.len());
        if base + count > self.most {
            return Err(self.bad("scene", "more", &format!("at most {} vertices", self.most)));
        }
        for p in &positions {
            let v = transform * Vector4::new(p[0].into(), p[1].into(), p[2].into(), 1.0);
            let placed = [v.x as f32, v.y as f32, v.z as f32];
            if !placed.iter().all(|v| v.is_finite()) {
                return Err(self.bad("POSITION", format!("{placed:?}"), "finite numbers"));
            }
            soup.positions.push(placed);
        }

        let material = match primitive.material {
            Some(m) => Some(self.get(&self.document.materials, m, "material")?),
            None => None,
        };
        let surface = material.map(|m| &m.pbr_metallic_roughness);
        let mut uvs = None;
        if let Some(info) = surface.and_then(|s| s.base_color_texture.as_ref()) {
            let texture = self.get(&self.document.textures, info.index, "texture")?;
            let usable =
                info.tex_coord == 0 && soup.image.is_none_or(|i| texture.source == Some(i));
            match (primitive.attributes.texcoord, texture.source) {
                (Some(texcoord), Some(source)) if usable => {
                    soup.image = Some(source);
                    uvs = Some(self.floats::<2>(texcoord, "TEXCOORD_0")?);
                }
                _ => notes.push("a mesh holds one texture, another is left out".to_owned()),
            }
        }
        soup.split |= uvs.is_some() || primitive.attributes.normal.is_some();
        let uvs = uvs.unwrap_or_else(|| vec![[0.0, 1.0]; count]);
        soup.uvs.extend(uvs.iter().map(|[u, v]| [*u, 1.0 - v]));

        let factor =
            surface.and_then(|s| s.base_color_factor).map_or([1.0; 3], |f| [f[0], f[1], f[2]]);
        let colors = match primitive.attributes.color {
            Some(color) => Some(self.colors(color)?),
            None => None,
        };
        soup.colored |= colors.is_some() || factor != [1.0; 3];
        let colors = colors.unwrap_or_else(|| vec![[1.0; 3]; count]);
        if colors.len() != count || uvs.len() != count {
            return Err(self.bad(
                "attributes",
                format!("{count} positions, {} colours, {} texcoords", colors.len(), uvs.len()),
                "as many of each",
            ));
        }
        soup.colors.extend(
            colors.iter().map(|c| {
                std::array::from_fn(|k| linear_to_srgb((c[k] * factor[k]).clamp(0.0, 1.0)))
            }),
        );

        let indices = match primitive.indices {
            Some(accessor) => self.indices(accessor, count)?,
            None => (0..count as u32).collect(),
        };
        if soup.faces.len() + indices.len() > self.most.saturating_mul(3) {
            return Err(self.bad("scene", "more", &format!("at most {} triangles", self.most)));
        }
        let mirrored = transform.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        let first = base as u32;
        for [a, b, c] in triangles(mode, &indices) {
            let [a, b, c] = [first + a, first + b, first + c];
            soup.faces.push(if mirrored { [a, c, b] } else { [a, b, c] });
        }
        Ok(())
    }

    /// The items of an accessor: where each begins in `bin`, and how it is written.
    fn items(&self, index: usize, name: &str) -> Result<(&Accessor, Vec<&'a [u8]>), ReadMeshError> {
        let accessor = self.get(&self.document.accessors, index, "accessor")?;
        if accessor.sparse.is_some() {
            return Err(self.bad(name, "a sparse accessor", "a plain one"));
        }
        let width = match accessor.kind.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            other => return Err(self.bad(name, format!("{other:?}"), "SCALAR or VEC2 to VEC4")),
        };
        let size = match accessor.component_type {
            component::I8 | component::U8 => 1,
            component::I16 | component::U16 => 2,
            component::U32 | component::F32 => 4,
            other => return Err(self.bad(name, format!("componentType {other}"), "5120 to 5126")),
        } * width;
        let Some(view) = accessor.buffer_view else {
            return Err(self.bad(name, "an accessor without data", "one with a bufferView"));
        };
        let bytes = self.view(view, name)?;
        let stride = self.document.buffer_views[view].byte_stride.unwrap_or(size as u64);
        if stride < size as u64 {
            return Err(self.bad(name, format!("byteStride {stride}"), &format!("{size} or more")));
        }
        // The last item need not be followed by the rest of its stride.
        let end = accessor.count.checked_sub(1).map_or(Some(0), |last| {
            last.checked_mul(stride)?.checked_add(accessor.byte_offset)?.checked_add(size as u64)
        });
        if end.is_none_or(|end| end > bytes.len() as u64) {
            return Err(self.bad(
                name,
                format!("{} items in {} bytes", accessor.count, bytes.len()),
                "as many as there are bytes for",
            ));
        }
        let start = |k: u64| (accessor.byte_offset + k * stride) as usize;
        let items = (0..accessor.count).map(|k| &bytes[start(k)..start(k) + size]).collect();
        Ok((accessor, items))
    }

    fn view(&self, index: usize, name: &str) -> Result<&'a [u8], ReadMeshError> {
        let view = self.get(&self.document.buffer_views, index, "bufferView")?;
        let buffer = self.get(&self.document.buffers, view.buffer, "buffer")?;
        if view.buffer != 0 || buffer.uri.is_some() {
            return Err(self.bad(name, "data in another file", "data in the BIN chunk"));
        }
        let end = view.byte_offset.saturating_add(view.byte_length);
        let range = view.byte_offset as usize..end as usize;
        self.bin.get(range).ok_or_else(|| {
            let found = format!("bytes {} to {end} of {}", view.byte_offset, self.bin.len());
            self.bad(name, found, "a bufferView inside the BIN chunk")
        })
    }

    fn floats<const N: usize>(
        &self,
        index: usize,
        name: &str,
    ) -> Result<Vec<[f32; N]>, ReadMeshError> {
        let (accessor, items) = self.items(index, name)?;
        let size = component_size(accessor.component_type);
        if items.first().is_some_and(|item| item.len() < N * size) {
            return Err(self.bad(name, &accessor.kind, &format!("VEC{N}")));
        }
        let number = |bytes: &[u8]| number(bytes, accessor);
        let row = |item: &&[u8]| std::array::from_fn(|k| number(&item[k * size..(k + 1) * size]));
        let rows: Vec<[f32; N]> = items.iter().map(row).collect();
        if let Some(bad) = rows.iter().flatten().find(|v| !v.is_finite()) {
            return Err(self.bad(name, bad, "finite numbers"));
        }
        Ok(rows)
    }

    fn colors(&self, index: usize) -> Result<Vec<[f32; 3]>, ReadMeshError> {
        self.floats::<3>(index, "COLOR_0")
    }

    fn indices(&self, index: usize, vertices: usize) -> Result<Vec<u32>, ReadMeshError> {
        let (accessor, items) = self.items(index, "indices")?;
        let mut indices = Vec::with_capacity(items.len());
        for item in items {
            let i = match (accessor.component_type, item) {
                (component::U8, &[a]) => u32::from(a),
                (component::U16, &[a, b]) => u32::from(u16::from_le_bytes([a, b])),
                (component::U32, &[a, b, c, d]) => u32::from_le_bytes([a, b, c, d]),
                _ => return Err(self.bad("indices", &accessor.kind, "unsigned SCALARs")),
            };
            if i as usize >= vertices {
                return Err(self.bad("indices", i, &format!("less than {vertices}")));
            }
            indices.push(i);
        }
        Ok(indices)
    }

    fn image(&self, index: usize) -> Result<Image, ReadMeshError> {
        let image = self.get(&self.document.images, index, "image")?;
        let Some(view) = image.buffer_view else {
            let found = image.uri.as_deref().map_or("nothing", |_| "a uri");
            return Err(self.bad("image", found, "an image in the BIN chunk"));
        };
        let bytes = self.view(view, "image")?;
        let decoded = decode_image(bytes, self.path)
            .map_err(|source| ReadMeshError::Texture { path: self.path.to_owned(), source })?;
        Ok(Image::from(&decoded.to_rgb()))
    }
}

fn component_size(component: u32) -> usize {
    match component {
        component::I8 | component::U8 => 1,
        component::I16 | component::U16 => 2,
        _ => 4,
    }
}

/// One number; whole numbers stand for themselves, or for fractions where they are normalised.
fn number(bytes: &[u8], accessor: &Accessor) -> f32 {
    let (value, one) = match (accessor.component_type, bytes) {
        (component::I8, &[a]) => (f32::from(a.cast_signed()), 127.0),
        (component::U8, &[a]) => (f32::from(a), 255.0),
        (component::I16, &[a, b]) => (f32::from(i16::from_le_bytes([a, b])), 32767.0),
        (component::U16, &[a, b]) => (f32::from(u16::from_le_bytes([a, b])), 65535.0),
        (component::U32, &[a, b, c, d]) => (u32::from_le_bytes([a, b, c, d]) as f32, 1.0),
        (_, &[a, b, c, d]) => (f32::from_le_bytes([a, b, c, d]), 1.0),
        _ => (f32::NAN, 1.0),
    };
    if accessor.normalized { (value / one).max(-1.0) } else { value }
}

fn local(node: &Node) -> Matrix4<f64> {
    if let Some(columns) = node.matrix {
        return Matrix4::from_column_slice(&columns);
    }
    let [x, y, z, w] = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.0).unwrap_or_default();
    Matrix4::new_translation(&Vector3::from(node.translation.unwrap_or([0.0; 3])))
        * rotation.to_homogeneous()
        * Matrix4::new_nonuniform_scaling(&Vector3::from(node.scale.unwrap_or([1.0; 3])))
}

/// The triangles of a list (4), a strip (5) or a fan (6); points and unknown modes have none.
fn triangles(mode: u32, indices: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        4 => indices.as_chunks::<3>().0.to_vec(),
        5 => indices
            .windows(3)
            .enumerate()
            .map(|(k, w)| if k % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] })
            .collect(),
        6 => indices.windows(2).skip(1).map(|w| [indices[0], w[0], w[1]]).collect(),
        _ => Vec::new(),
    }
}

impl Soup {
    /// One mesh, its seams joined.
    fn joined(self, image: Option<Image>) -> TriMesh {
        let count = self.positions.len();
        // For each vertex, the first with the same position and colour.
        let mut kept: Vec<u32> = Vec::new();
        let mut target: Vec<u32> = Vec::with_capacity(count);
        if self.split {
            let mut first: BTreeMap<[u32; 6], u32> = BTreeMap::new();
            for v in 0..count {
                let (p, c) = (self.positions[v], self.colors[v]);
                // Adding zero makes -0 and 0 the same.
                let bits = [p[0], p[1], p[2], c[0], c[1], c[2]].map(|v| (v + 0.0).to_bits());
                let next = kept.len() as u32;
                let joined = *first.entry(bits).or_insert(next);
                if joined == next {
                    kept.push(v as u32);
                }
                target.push(joined);
            }
        } else {
            kept.extend(0..count as u32);
            target.extend(0..count as u32);
        }
        let positions = kept.iter().map(|&v| self.positions[v as usize]).collect();
        let colors = self.colored.then(|| kept.iter().map(|&v| self.colors[v as usize]).collect());
        let faces = self.faces.iter().map(|f| f.map(|v| target[v as usize])).collect();
        let texture = image.map(|image| Texture { uvs: self.uvs, faces: self.faces, image });
        TriMesh { positions, faces, colors, texture }
    }
}
