//! Why no texture could be baked.

use datasets::ViewError;
use mesh_core::MeshError;

/// What stopped a texture.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BakeError {
    /// The configuration has a value out of its range.
    #[error("bake configuration: {}", .0.join("; "))]
    Config(Vec<String>),
    /// A mesh that is none, or has no faces.
    #[error("the mesh: {0}")]
    Mesh(#[from] MeshError),
    /// All vertices are in one place, or too far apart for single precision.
    #[error("the mesh has no extent: its vertices are in one place, or beyond single precision")]
    NoExtent,
    /// There is nothing to bake from.
    #[error("no views")]
    NoViews,
    /// No view shows the object.
    #[error(
        "masks are empty in all {views} views: nothing to bake from: 255 is the object, 0 what is not"
    )]
    EmptyMasks {
        /// How many views there were.
        views: usize,
    },
    /// A view that is none.
    #[error(transparent)]
    View(#[from] ViewError),
    /// Texture coordinates that are to be kept are not there, or no texture can have them.
    #[error(
        "the mesh's texture coordinates {reason}; unwrap it anew, or take new ones (uv = \"new\")"
    )]
    Uv {
        /// What is wrong with them, in words that go on.
        reason: String,
    },
    /// A texture of the side that was asked for cannot show all faces.
    #[error("no texture: {side} x {side} has no room for {faces} faces; ask for a larger one")]
    Room {
        /// The side, texels.
        side: usize,
        /// How many faces there are.
        faces: usize,
    },
}
