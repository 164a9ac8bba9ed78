//! Why a mesh cannot be remeshed.

use crate::MeshError;

/// Why a mesh cannot be remeshed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RemeshError {
    /// The mesh is not valid.
    #[error(transparent)]
    Invalid(#[from] MeshError),
    /// An edge has not two faces.
    #[error("edge {edge:?} has {faces} face(s), expected 2 (a closed mesh)")]
    NotClosed {
        /// Its vertices.
        edge: [u32; 2],
        /// How many faces it has.
        faces: usize,
    },
    /// The two faces on an edge run along it in the same direction.
    #[error("the faces on edge {edge:?} are oriented against each other")]
    NotOriented {
        /// Its vertices.
        edge: [u32; 2],
    },
    /// Several fans of faces meet in one vertex.
    #[error("several parts of the surface meet in vertex {vertex}, expected one")]
    NotManifold {
        /// The vertex.
        vertex: usize,
    },
    /// A vertex has no faces.
    #[error("vertex {vertex} has no faces")]
    Isolated {
        /// The vertex.
        vertex: usize,
    },
    /// The length that edges should have is of no use.
    #[error("edges should be {found} long, expected a positive length of at most 20 million faces")]
    EdgeLength {
        /// The length.
        found: f64,
    },
    /// There is not one length for each vertex.
    #[error("{lengths} lengths of edges for {vertices} vertices")]
    Lengths {
        /// The lengths.
        lengths: usize,
        /// The vertices.
        vertices: usize,
    },
    /// The mesh has a texture, which would not fit the new faces.
    #[error("the mesh has a texture, expected none (make the texture after remeshing)")]
    Textured,
}
