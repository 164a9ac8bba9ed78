//! Writing GLB.

use std::fmt::Write as _;
use std::path::Path;

use super::{BIN, GENERATOR, JSON, MAGIC, component};
use crate::io::{EncodeError, WriteError, check, write_atomic};
use crate::{TriMesh, UpAxis, encode_png, srgb_to_linear, vertex_normals};

/// Writes a GLB file: one mesh with smooth normals, one material, the texture inside as PNG.
///
/// The normals are those of [`vertex_normals`]. A mesh with colours or a texture is unlit, as its
/// colours were seen and have their light in them; one without is white and matt, and lit. Vertex
/// colours become linear floats, as the standard wants them. A vertex of a textured mesh that has
/// several texture coordinates becomes several vertices; reading joins them again. Where the mesh is
/// not closed the material is double-sided.
///
/// # Errors
/// The file cannot be written, or [`encode`] refuses the mesh.
pub fn write(path: impl AsRef<Path>, mesh: &TriMesh) -> Result<(), WriteError> {
    write_upright(path, mesh, UpAxis::Y)
}

/// The same of a mesh whose world has another axis up: the file's node turns it, so that it stands in
/// viewers, for which +Y is up. The positions in the file stay as they are; [`read`](super::read()) turns them.
///
/// # Errors
/// As [`write()`].
pub fn write_upright(path: impl AsRef<Path>, mesh: &TriMesh, up: UpAxis) -> Result<(), WriteError> {
    let path = path.as_ref();
    let bytes = encode_upright(mesh, up).map_err(|e| e.at(path))?;
    write_atomic(path, |w| w.write_all(&bytes))
}

/// A GLB file in memory; the same mesh always gives the same bytes.
///
/// # Errors
/// The mesh has an index out of range or a number that is not finite, or is larger than the 4 GB
/// that GLB can count.
pub fn encode(mesh: &TriMesh) -> Result<Vec<u8>, EncodeError> {
    encode_upright(mesh, UpAxis::Y)
}

/// [`write_upright`] into memory.
///
/// # Errors
/// As [`encode`].
pub fn encode_upright(mesh: &TriMesh, up: UpAxis) -> Result<Vec<u8>, EncodeError> {
    check::writable(mesh)?;
    let (json, bin) = body(mesh, up);
    let bytes = length(&json, &bin);
    if u32::try_from(bytes).is_err() {
        return Err(EncodeError::TooLong { bytes });
    }
    Ok(file(&json, &bin))
}

/// The binary chunk and the JSON that describes it, as they grow.
#[derive(Default)]
struct Parts {
    bin: Vec<u8>,
    views: String,
    view_count: usize,
    accessors: String,
    accessor_count: usize,
}

/// `bufferView.target` for vertex attributes and for indices.
const ARRAY: u32 = 34962;
const ELEMENT_ARRAY: u32 = 34963;

impl Parts {
    fn view(&mut self, bytes: impl IntoIterator<Item = u8>, target: Option<u32>) -> usize {
        while !self.bin.len().is_multiple_of(4) {
            self.bin.push(0);
        }
        let offset = self.bin.len();
        self.bin.extend(bytes);
        let length = self.bin.len() - offset;
        let comma = if self.view_count > 0 { "," } else { "" };
        let target = target.map_or_else(String::new, |t| format!(",\"target\":{t}"));
        write!(
            self.views,
            "{comma}{{\"buffer\":0,\"byteOffset\":{offset},\"byteLength\":{length}{target}}}"
        )
        .expect("writing to memory");
        self.view_count += 1;
        self.view_count - 1
    }

    fn accessor(
        &mut self,
        view: usize,
        kind: &str,
        component: u32,
        count: usize,
        more: &str,
    ) -> usize {
        let comma = if self.accessor_count > 0 { "," } else { "" };
        write!(
            self.accessors,
            "{comma}{{\"bufferView\":{view},\"componentType\":{component},\"count\":{count},\
             \"type\":\"{kind}\"{more}}}"
        )
        .expect("writing to memory");
        self.accessor_count += 1;
        self.accessor_count - 1
    }

    fn floats<const N: usize>(&mut self, rows: &[[f32; N]], more: &str) -> usize {
        let bytes = rows.iter().flatten().flat_map(|v| v.to_le_bytes());
        let view = self.view(bytes, Some(ARRAY));
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][N];
        self.accessor(view, kind, component::F32, rows.len(), more)
    }
}

/// The JSON and the binary chunk.
fn body(mesh: &TriMesh, up: UpAxis) -> (String, Vec<u8>) {
    let mut parts = Parts::default();
    let asset = format!(
        "\"asset\":{{\"version\":\"2.0\",\"generator\":\"{GENERATOR}{}\"}}",
        env!("CARGO_PKG_VERSION")
    );
    if mesh.positions.is_empty() {
        return (format!("{{{asset},\"scene\":0,\"scenes\":[{{}}]}}"), Vec::new());
    }
    let corners = Corners::of(mesh);
    let attributes = attributes(mesh, &corners, &mut parts);
    let mode = mode(&corners, &mut parts);
    let (color, images) = texture(mesh, &mut parts);
    let unlit = mesh.texture.is_some() || mesh.colors.is_some();
    let (used, extension) = if unlit {
        (
            ",\"extensionsUsed\":[\"KHR_materials_unlit\"]",
            ",\"extensions\":{\"KHR_materials_unlit\":{}}",
        )
    } else {
        ("", "")
    };
    let json = format!(
        "{{{asset}{used},\"scene\":0,\
         \"scenes\":[{{\"nodes\":[0]}}],\"nodes\":[{{\"mesh\":0{}}}],\
         \"meshes\":[{{\"primitives\":[{{\"attributes\":{{{attributes}}}{mode},\"material\":0}}]}}],\
         \"materials\":[{{\"pbrMetallicRoughness\":{{{color}\"metallicFactor\":0,\
         \"roughnessFactor\":1}},\"doubleSided\":{}{extension}}}]\
         {images},\"accessors\":[{}],\"bufferViews\":[{}],\"buffers\":[{{\"byteLength\":{}}}]}}",
        turn(up),
        !is_closed(&mesh.faces),
        parts.accessors,
        parts.views,
        parts.bin.len()
    );
    (json, parts.bin)
}

/// What the vertices have, in the order of the file: positions, normals, and texture coordinates or colours.
fn attributes(mesh: &TriMesh, corners: &Corners, parts: &mut Parts) -> String {
    let positions: Vec<[f32; 3]> =
        corners.vertices.iter().map(|&(v, _)| mesh.positions[v as usize]).collect();
    let (low, high) = bounds(&positions);
    let range = format!(",\"min\":{low:?},\"max\":{high:?}");
    let mut attributes = format!("\"POSITION\":{}", parts.floats(&positions, &range));
    if !mesh.faces.is_empty() {
        let normals = normals(mesh, corners);
        write!(attributes, ",\"NORMAL\":{}", parts.floats(&normals, "")).expect("memory");
    }
    if let Some(texture) = &mesh.texture {
        // A vertex that no face uses has no place on the image; any will do.
        let uv = |t: u32| texture.uvs.get(t as usize).copied().unwrap_or_default();
        let uvs: Vec<[f32; 2]> = corners
            .vertices
            .iter()
            .map(|&(_, t)| uv(t))
            .map(|[u, v]| [u, 1.0 - v]) // the origin of glTF is the top-left corner
            .collect();
        write!(attributes, ",\"TEXCOORD_0\":{}", parts.floats(&uvs, "")).expect("memory");
    } else if let Some(colors) = &mesh.colors {
        let linear: Vec<[f32; 3]> =
            colors.iter().map(|c| c.map(|v| srgb_to_linear(v.clamp(0.0, 1.0)))).collect();
        write!(attributes, ",\"COLOR_0\":{}", parts.floats(&linear, "")).expect("memory");
    }
    attributes
}

/// What the vertices are the corners of: triangles, or else points.
fn mode(corners: &Corners, parts: &mut Parts) -> String {
    if corners.faces.is_empty() {
        return ",\"mode\":0".to_owned();
    }
    let bytes = corners.faces.iter().flatten().flat_map(|i| i.to_le_bytes());
    let view = parts.view(bytes, Some(ELEMENT_ARRAY));
    let count = corners.faces.len() * 3;
    let indices = parts.accessor(view, "SCALAR", component::U32, count, "");
    format!(",\"indices\":{indices},\"mode\":4")
}

/// What the material says of a texture, and the texture itself; empty where there is none.
fn texture(mesh: &TriMesh, parts: &mut Parts) -> (&'static str, String) {
    let Some(texture) = &mesh.texture else { return ("", String::new()) };
    let view = parts.view(encode_png(&texture.image.to_bytes()), None);
    let repeated = texture.uvs.iter().flatten().any(|x| !(0.0..=1.0).contains(x));
    let wrap = if repeated { 10_497 } else { 33_071 };
    let images = format!(
        ",\"textures\":[{{\"source\":0,\"sampler\":0}}],\
         \"samplers\":[{{\"magFilter\":9729,\"minFilter\":9987,\"wrapS\":{wrap},\"wrapT\":{wrap}}}],\
         \"images\":[{{\"bufferView\":{view},\"mimeType\":\"image/png\"}}]"
    );
    ("\"baseColorTexture\":{\"index\":0},", images)
}

/// What a node says where its mesh is turned.
fn turn(up: UpAxis) -> String {
    if up == UpAxis::Y {
        return String::new();
    }
    let [x, y, z] = up.columns().map(|c| c.map(|v| v as i8));
    let column = |[a, b, c]: [i8; 3]| format!("{a},{b},{c},0");
    format!(",\"matrix\":[{},{},{},0,0,0,1]", column(x), column(y), column(z))
}

/// A unit normal for each vertex of the file: smooth over the whole mesh, also across seams. Where
/// there is none, as at a vertex of no face, it points up, for the standard wants one of length 1.
fn normals(mesh: &TriMesh, corners: &Corners) -> Vec<[f32; 3]> {
    let smooth = vertex_normals(&mesh.positions, &mesh.faces);
    let of = |v: u32| match smooth[v as usize] {
        [0.0, 0.0, 0.0] => [0.0, 1.0, 0.0],
        normal => normal,
    };
    corners.vertices.iter().map(|&(v, _)| of(v)).collect()
}

/// The vertices of the file: pairs of a position and a texture coordinate.
struct Corners {
    vertices: Vec<(u32, u32)>,
    faces: Vec<[u32; 3]>,
}

impl Corners {
    fn of(mesh: &TriMesh) -> Self {
        let Some(texture) = &mesh.texture else {
            let vertices = (0..mesh.positions.len() as u32).map(|v| (v, 0)).collect();
            return Self { vertices, faces: mesh.faces.clone() };
        };
        let used = mesh.faces.iter().flatten().zip(texture.faces.iter().flatten());
        let mut vertices: Vec<(u32, u32)> = used.map(|(&v, &t)| (v, t)).collect();
        // Vertices that no face uses stay too, so that reading gives the same list.
        let mut seen = vec![false; mesh.positions.len()];
        for &(v, _) in &vertices {
            seen[v as usize] = true;
        }
        vertices
            .extend((0_u32..).zip(&seen).filter(|(_, seen)| !**seen).map(|(v, _)| (v, u32::MAX)));
        vertices.sort_unstable();
        vertices.dedup();
        let index = |v: u32, t: u32| {
            vertices.binary_search(&(v, t)).expect("each corner is in the list") as u32
        };
        let faces = mesh
            .faces
            .iter()
            .zip(&texture.faces)
            .map(|(f, t)| [index(f[0], t[0]), index(f[1], t[1]), index(f[2], t[2])])
            .collect();
        Self { vertices, faces }
    }
}

fn bounds(positions: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    let start = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    positions.iter().fold(start, |(mut low, mut high), p| {
        for k in 0..3 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
        (low, high)
    })
}

/// Whether every directed edge occurs once, and its reverse too.
fn is_closed(faces: &[[u32; 3]]) -> bool {
    let mut edges: Vec<(u32, u32)> =
        faces.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
    edges.sort_unstable();
    edges.windows(2).all(|w| w[0] != w[1])
        && edges.iter().all(|&(a, b)| edges.binary_search(&(b, a)).is_ok())
}

fn padded(length: usize) -> usize {
    length.next_multiple_of(4)
}

/// How long [`file()`] is.
fn length(json: &str, bin: &[u8]) -> usize {
    20 + padded(json.len()) + if bin.is_empty() { 0 } else { 8 + padded(bin.len()) }
}

/// The two chunks, padded, behind the header.
fn file(json: &str, bin: &[u8]) -> Vec<u8> {
    let total = length(json, bin);
    let mut bytes = Vec::with_capacity(total);
    let word = |bytes: &mut Vec<u8>, v: u32| bytes.extend(v.to_le_bytes());
    for v in [MAGIC, 2, total as u32, padded(json.len()) as u32, JSON] {
        word(&mut bytes, v);
    }
    bytes.extend(json.as_bytes());
    bytes.resize(20 + padded(json.len()), b' ');
    if !bin.is_empty() {
        word(&mut bytes, padded(bin.len()) as u32);
        word(&mut bytes, BIN);
        bytes.extend(bin);
        bytes.resize(total, 0);
    }
    bytes
}
