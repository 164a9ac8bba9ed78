//! The triangle mesh that every other crate passes around.

use crate::Image;
use crate::bounds::{self, Bounds};
use crate::vector::{affine, area_vector, cross, dot, narrow, norm, scale, sub, triangle, widen};

/// A triangle mesh with optional colours or texture.
///
/// ```
/// use mesh_core::{TriMesh, primitives};
/// let mut two = primitives::cuboid([1.0, 2.0, 3.0]);
/// two.append(&two.clone().translated([5.0, 0.0, 0.0])).unwrap();
/// two.validate().unwrap();
/// assert_eq!(two.volume(), 12.0);
/// assert_eq!(two.bounds(), Some(([-0.5, -1.0, -1.5], [5.5, 1.0, 1.5])));
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    /// Vertex positions, `[V]`, in the user's units; +Y is up.
    pub positions: Vec<[f32; 3]>,
    /// Triangles, `[F]`, as indices into `positions`; counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// One sRGB colour per vertex, each channel in `[0, 1]`.
    pub colors: Option<Vec<[f32; 3]>>,
    /// An image mapped onto the faces.
    pub texture: Option<Texture>,
}

/// An image and how it lies on the faces of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Texture coordinates; `(0, 0)` is the bottom-left corner of the image, v goes up. Beyond 0 to 1 the image is
    /// repeated.
    pub uvs: Vec<[f32; 2]>,
    /// For each face of the mesh, three indices into `uvs`.
    pub faces: Vec<[u32; 3]>,
    /// The image, three channels, sRGB.
    pub image: Image,
}

/// What is wrong with a mesh: where, what was found and what was expected.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} is at {position:?}, expected finite coordinates")]
    NotFinite {
        /// The vertex.
        vertex: usize,
        /// Where it is.
        position: [f32; 3],
    },
    /// There are no faces where a surface is needed.
    #[error("found {vertices} vertices and no faces, expected a surface")]
    NoFaces {
        /// How many vertices there are.
        vertices: usize,
    },
    /// A face names a vertex that does not exist.
    #[error("face {face} names vertex {vertex}, expected less than {vertices}")]
    VertexOutOfRange {
        /// The face.
        face: usize,
        /// The vertex it names.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
    /// A face names the same vertex twice.
    #[error("face {face} is {corners:?}, expected three different vertices")]
    RepeatedVertex {
        /// The face.
        face: usize,
        /// Its corners.
        corners: [u32; 3],
    },
    /// The colours are not one per vertex.
    #[error("found {colors} colours, expected one for each of {vertices} vertices")]
    ColorCount {
        /// How many colours there are.
        colors: usize,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A colour is NaN or infinite.
    #[error("vertex {vertex} has colour {color:?}, expected finite values")]
    ColorNotFinite {
        /// The vertex.
        vertex: usize,
        /// Its colour.
        color: [f32; 3],
    },
    /// The texture does not map every face.
    #[error("the texture maps {found} faces, expected {faces}")]
    TextureFaceCount {
        /// How many faces the texture has.
        found: usize,
        /// How many faces the mesh has.
        faces: usize,
    },
    /// A face names a texture coordinate that does not exist.
    #[error("face {face} names texture coordinate {uv}, expected less than {uvs}")]
    UvOutOfRange {
        /// The face.
        face: usize,
        /// The texture coordinate it names.
        uv: u32,
        /// How many there are.
        uvs: usize,
    },
    /// A texture coordinate is NaN or infinite.
    #[error("texture coordinate {uv} is {value:?}, expected finite values")]
    UvNotFinite {
        /// Which one.
        uv: usize,
        /// Its value.
        value: [f32; 2],
    },
    /// The data of the texture image does not have the size that its shape says.
    #[error("the texture image has {found} values, expected {height} x {width} x {channels}")]
    TextureImageSize {
        /// How many values there are.
        found: usize,
        /// Rows.
        height: usize,
        /// Columns.
        width: usize,
        /// Channels.
        channels: usize,
    },
    /// There are more vertices or corners than `u32` can number.
    #[error("{vertices} vertices and {faces} faces, expected at most 2^32 vertices and corners")]
    TooLarge {
        /// How many vertices there are.
        vertices: usize,
        /// How many faces there are.
        faces: usize,
    },
    /// One of two meshes to be joined has something that the other lacks.
    #[error("only one of the two meshes has {0}")]
    OnlyOneHas(&'static str),
    /// Two meshes to be joined have different texture images.
    #[error("the two meshes have different texture images")]
    DifferentImages,
}

impl TriMesh {
    /// A mesh without colours or texture.
    pub fn new(positions: Vec<[f32; 3]>, faces: Vec<[u32; 3]>) -> Self {
        Self { positions, faces, colors: None, texture: None }
    }

    /// Checks that positions are finite, indices exist, no face names a vertex twice, and colours
    /// and texture fit the mesh.
    ///
    /// # Errors
    /// The first thing that is wrong. A mesh that passes can be given to any function of this
    /// workspace; whether it is closed, oriented and well shaped is what [`TriMesh::health`] tells.
    pub fn validate(&self) -> Result<(), MeshError> {
        let vertices = self.positions.len();
        let corners = self.faces.len().checked_mul(3);
        if u32::try_from(vertices).is_err() || corners.is_none_or(|n| u32::try_from(n).is_err()) {
            return Err(MeshError::TooLarge { vertices, faces: self.faces.len() });
        }
        self.sound()?;
        for (face, &corners) in self.faces.iter().enumerate() {
            let [a, b, c] = corners;
            if a == b || b == c || c == a {
                return Err(MeshError::RepeatedVertex { face, corners });
            }
        }
        Ok(())
    }

    /// The same, but for faces that name a vertex twice, which files may have, and for the size.
    pub(crate) fn sound(&self) -> Result<(), MeshError> {
        let vertices = self.positions.len();
        for (vertex, &position) in self.positions.iter().enumerate() {
            if !position.iter().all(|x| x.is_finite()) {
                return Err(MeshError::NotFinite { vertex, position });
            }
        }
        for (face, &corners) in self.faces.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= vertices) {
                return Err(MeshError::VertexOutOfRange { face, vertex, vertices });
            }
        }
        if let Some(colors) = &self.colors {
            if colors.len() != vertices {
                return Err(MeshError::ColorCount { colors: colors.len(), vertices });
            }
            for (vertex, &color) in colors.iter().enumerate() {
                if !color.iter().all(|x| x.is_finite()) {
                    return Err(MeshError::ColorNotFinite { vertex, color });
                }
            }
        }
        self.texture.as_ref().map_or(Ok(()), |texture| texture.validate(self.faces.len()))
    }

    /// Refuses a mesh without faces, as files of points are read: for whatever needs a surface.
    ///
    /// # Errors
    /// [`MeshError::NoFaces`].
    pub fn require_faces(&self) -> Result<(), MeshError> {
        if self.faces.is_empty() {
            return Err(MeshError::NoFaces { vertices: self.positions.len() });
        }
        Ok(())
    }

    /// The smallest box around the finite vertices, `(minimum, maximum)`; `None` if there are none.
    pub fn bounds(&self) -> Option<Bounds> {
        let mut finite = self.positions.iter().filter(|p| p.iter().all(|x| x.is_finite()));
        let first = *finite.next()?;
        Some(finite.fold((first, first), |(low, high), p| {
            (std::array::from_fn(|k| low[k].min(p[k])), std::array::from_fn(|k| high[k].max(p[k])))
        }))
    }

    /// The area of all faces.
    ///
    /// # Panics
    /// If a face names a vertex that does not exist.
    pub fn area(&self) -> f64 {
        self.faces.iter().map(|&f| 0.5 * norm(area_vector(triangle(&self.positions, f)))).sum()
    }

    /// The volume enclosed by a closed mesh; negative if its faces point inward.
    ///
    /// The sum of the signed tetrahedra between each face and a corner of the mesh (Gauss's
    /// theorem). For a mesh with borders the value depends on that corner and means little.
    ///
    /// # Panics
    /// If a face names a vertex that does not exist.
    pub fn volume(&self) -> f64 {
        signed_volume(&self.positions, &self.faces)
    }

    /// Moves every vertex by `f`.
    #[must_use]
    pub fn map_positions(mut self, f: impl FnMut([f32; 3]) -> [f32; 3]) -> Self {
        let mut f = f;
        for position in &mut self.positions {
            *position = f(*position);
        }
        self
    }

    /// The mesh moved by `offset`.
    #[must_use]
    pub fn translated(self, offset: [f32; 3]) -> Self {
        self.map_positions(|p| std::array::from_fn(|k| p[k] + offset[k]))
    }

    /// The mesh scaled about the origin along each axis.
    ///
    /// An odd number of negative factors mirrors it; the faces are then turned round, so that what
    /// was outward stays outward.
    #[must_use]
    pub fn scaled(self, factors: [f32; 3]) -> Self {
        let mirrors = factors.iter().filter(|&&x| x < 0.0).count() % 2 == 1;
        let mesh = self.map_positions(|p| std::array::from_fn(|k| p[k] * factors[k]));
        if mirrors { mesh.flipped() } else { mesh }
    }

    /// The mesh under `p -> A p + t`, given as the rows `[A | t]`; turned round if `det A < 0`.
    #[must_use]
    pub fn transformed(self, rows: &[[f64; 4]; 3]) -> Self {
        let [x, y, z] = rows.map(|row| [row[0], row[1], row[2]]);
        let mesh = self.map_positions(|p| narrow(affine(rows, widen(p))));
        if dot(x, cross(y, z)) < 0.0 { mesh.flipped() } else { mesh }
    }

    /// The mesh with every face turned round.
    #[must_use]
    pub fn flipped(mut self) -> Self {
        let texture = self.texture.iter_mut().flat_map(|texture| &mut texture.faces);
        for face in self.faces.iter_mut().chain(texture) {
            face.swap(1, 2);
        }
        self
    }

    /// Scales and moves the mesh so that its box is centred at the origin and its largest side is
    /// `size`; a mesh without extent is only centred, an empty one left alone.
    #[must_use]
    pub fn normalized(self, size: f32) -> Self {
        let Some((low, high)) = self.bounds() else { return self };
        let around = (widen(low), widen(high));
        let (center, extent) = (bounds::center(around), bounds::longest_side(around));
        let factor = if extent > 0.0 { f64::from(size) / extent } else { 1.0 };
        self.map_positions(|p| narrow(scale(sub(widen(p), center), factor)))
    }

    /// Adds another mesh; its vertices and faces follow those that are here.
    ///
    /// # Errors
    /// If only one of the two (neither being empty) has colours or a texture, if their texture
    /// images differ, or if the sum is too large for `u32`. Nothing has changed then.
    pub fn append(&mut self, other: &TriMesh) -> Result<(), MeshError> {
        if self.positions.is_empty() && self.faces.is_empty() {
            *self = other.clone();
            return Ok(());
        }
        if other.positions.is_empty() && other.faces.is_empty() {
            return Ok(());
        }
        let (vertices, faces) =
            (self.positions.len() + other.positions.len(), self.faces.len() + other.faces.len());
        if u32::try_from(vertices.max(faces.saturating_mul(3))).is_err() {
            return Err(MeshError::TooLarge { vertices, faces });
        }
        if self.colors.is_some() != other.colors.is_some() {
            return Err(MeshError::OnlyOneHas("colours"));
        }
        match (&mut self.texture, &other.texture) {
            (None, None) => {}
            (Some(a), Some(b)) if a.image == b.image => {
                let first = a.uvs.len() as u32;
                a.uvs.extend_from_slice(&b.uvs);
                a.faces.extend(b.faces.iter().map(|f| f.map(|uv| uv + first)));
            }
            (Some(_), Some(_)) => return Err(MeshError::DifferentImages),
            _ => return Err(MeshError::OnlyOneHas("a texture")),
        }
        if let (Some(a), Some(b)) = (&mut self.colors, &other.colors) {
            a.extend_from_slice(b);
        }
        let first = self.positions.len() as u32;
        self.positions.extend_from_slice(&other.positions);
        self.faces.extend(other.faces.iter().map(|f| f.map(|v| v + first)));
        Ok(())
    }

    /// The mesh with one colour on all vertices.
    #[must_use]
    pub fn colored(mut self, color: [f32; 3]) -> Self {
        self.colors = Some(vec![color; self.positions.len()]);
        self
    }
}

/// The volume that `faces` enclose, positive if they point outward.
pub(crate) fn signed_volume(positions: &[[f32; 3]], faces: &[[u32; 3]]) -> f64 {
    // Relative to a vertex, so that a mesh far from the origin keeps its digits.
    let origin = faces.first().map_or([0.0; 3], |face| widen(positions[face[0] as usize]));
    let six_times = faces.iter().map(|&face| {
        let [a, b, c] = triangle(positions, face).map(|p| sub(p, origin));
        dot(a, cross(b, c))
    });
    six_times.sum::<f64>() / 6.0
}

impl Texture {
    fn validate(&self, faces: usize) -> Result<(), MeshError> {
        if self.faces.len() != faces {
            return Err(MeshError::TextureFaceCount { found: self.faces.len(), faces });
        }
        for (uv, &value) in self.uvs.iter().enumerate() {
            if !value.iter().all(|x| x.is_finite()) {
                return Err(MeshError::UvNotFinite { uv, value });
            }
        }
        let uvs = self.uvs.len();
        for (face, corners) in self.faces.iter().enumerate() {
            if let Some(&uv) = corners.iter().find(|&&uv| uv as usize >= uvs) {
                return Err(MeshError::UvOutOfRange { face, uv, uvs });
            }
        }
        let Image { height, width, channels, ref data } = self.image;
        let expected = height.checked_mul(width).and_then(|n| n.checked_mul(channels));
        if expected != Some(data.len()) || data.is_empty() {
            let found = data.len();
            return Err(MeshError::TextureImageSize { found, height, width, channels });
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::primitives;

    #[test]
    fn a_box_has_the_measures_of_a_box() {
        let cube = primitives::cuboid([1.0, 2.0, 3.0]);
        assert_eq!(cube.volume(), 6.0);
        assert_eq!(cube.area(), 22.0);
        assert_eq!(cube.clone().flipped().volume(), -6.0);
        assert_eq!(cube.clone().scaled([-1.0, 1.0, 1.0]).volume(), 6.0);
        assert_eq!(cube.clone().normalized(1.0).bounds().unwrap().1, [1.0 / 6.0, 1.0 / 3.0, 0.5]);
        let mirrored = [[0.0, 1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let mirrored = cube.transformed(&mirrored);
        assert_eq!(mirrored.volume(), 6.0);
        assert_eq!(mirrored.bounds(), Some(([0.0, -0.5, -1.5], [2.0, 0.5, 1.5])));
    }

    #[test]
    fn errors_name_the_place() {
        let good = primitives::cuboid([1.0; 3]);
        let message = |mesh: &TriMesh| mesh.validate().unwrap_err().to_string();

        let mut mesh = good.clone();
        mesh.positions[3][1] = f32::NAN;
        assert!(message(&mesh).starts_with("vertex 3 is at [0.5, NaN"), "{}", message(&mesh));

        let mut mesh = good.clone();
        mesh.faces[5][2] = 8;
        assert_eq!(message(&mesh), "face 5 names vertex 8, expected less than 8");

        let mut mesh = good.clone();
        mesh.faces[2] = [1, 1, 0];
        assert_eq!(message(&mesh), "face 2 is [1, 1, 0], expected three different vertices");

        let mut mesh = good.clone();
        mesh.colors = Some(vec![[0.0; 3]; 7]);
        assert_eq!(message(&mesh), "found 7 colours, expected one for each of 8 vertices");

        let mut mesh = good.clone();
        let texture =
            Texture { uvs: vec![[0.0; 2]], faces: vec![[0; 3]; 12], image: Image::new(2, 2, 3) };
        mesh.texture = Some(texture.clone());
        mesh.validate().unwrap();
        mesh.texture = Some(Texture { faces: vec![[0; 3]; 11], ..texture.clone() });
        assert_eq!(message(&mesh), "the texture maps 11 faces, expected 12");
        mesh.texture = Some(Texture { faces: vec![[1; 3]; 12], ..texture.clone() });
        assert_eq!(message(&mesh), "face 0 names texture coordinate 1, expected less than 1");
        let image = Image { height: usize::MAX, ..texture.image.clone() };
        mesh.texture = Some(Texture { image, ..texture });
        assert!(message(&mesh).contains("has 12 values"));
    }

    #[test]
    fn appending_needs_like_with_like() {
        let mut mesh = TriMesh::default();
        let ball = primitives::icosphere(1);
        mesh.append(&ball).unwrap();
        mesh.append(&TriMesh::default()).unwrap();
        mesh.append(&ball.clone().translated([3.0, 0.0, 0.0])).unwrap();
        mesh.validate().unwrap();
        assert_eq!(mesh.faces.len(), 160);
        approx::assert_relative_eq!(mesh.volume(), 2.0 * ball.volume(), max_relative = 1e-6);
        let before = mesh.clone();
        assert_eq!(
            mesh.append(&ball.colored([1.0, 0.0, 0.0])),
            Err(MeshError::OnlyOneHas("colours"))
        );
        assert_eq!(mesh, before);
    }
}
