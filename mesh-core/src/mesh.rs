//! The triangle mesh that every other crate passes around.

use crate::Image;

/// A triangle mesh with optional colours or texture.
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
    /// Texture coordinates; `(0, 0)` is the bottom-left corner of the image, v goes up.
    pub uvs: Vec<[f32; 2]>,
    /// For each face of the mesh, three indices into `uvs`.
    pub faces: Vec<[u32; 3]>,
    /// The image, three channels, sRGB.
    pub image: Image,
}

impl TriMesh {
    /// A mesh without colours or texture.
    pub fn new(positions: Vec<[f32; 3]>, faces: Vec<[u32; 3]>) -> Self {
        Self { positions, faces, colors: None, texture: None }
    }
}
