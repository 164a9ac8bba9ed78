//! Depth-aware Pixel2Mesh and Mesh R-CNN: one image, with or without depth, to a mesh.
//!
//! ```text
//! image [N, S, S, 3 or 4] -> ResNet -> maps of 1/4 to 1/32 of its side
//! an icosphere in front of the camera                                            (`depth-pixel2mesh`)
//! the last map -> voxel branch -> occupied cells of what the camera sees -> their surface  (`mesh-rcnn`)
//!   -> where each vertex is seen, the maps there -> graph convolutions -> offsets    three times
//! ```
//!
//! Depth goes two ways: as a fourth channel into the network (`depth`), and into the loss (`depth-weight`), which renders
//! the predicted mesh's depth from the image's camera and compares it with what is known; see [`DepthLossKind`]. The last
//! stage may give each vertex a colour (`colors`).
//!
//! # References
//! Jolly, Quevedo, Manvi, *Depth-Aware Pixel2Mesh* (poster); Gkioxari, Malik, Johnson 2019, *Mesh R-CNN*, and its code.

mod boxes;
mod canonical;
mod carving;
mod config;
mod depth_targets;
mod encoder;
mod given_depth;
mod guide;
mod mesh_init;
mod mesh_pairs;
mod onnx;
mod packed;
#[cfg(test)]
mod pix3d_tests;
mod places;
mod predictor;
#[cfg(test)]
mod published_tests;
mod refined;
mod rendered;
#[cfg(test)]
mod rendered_tests;
mod residuals;
mod scenes;
mod score;
mod sphere;
mod stage_meshes;
mod surface;
#[cfg(test)]
mod tests;
mod voxels;

pub use boxes::Boxes;
pub use config::{
    BackboneKind, DepthKind, DepthLossKind, EstimateErrors, PlaceKind, RefineConfig, SphereConfig,
    VoxelConfig,
};
pub use depth_targets::DepthTargets;
pub use mesh_init::{InitialMeshes, MeshInit};
pub use packed::{Packed, Shape};
pub use refined::Refined;
pub use scenes::{Scene, Scenes};
pub use score::{Score, Scored};
pub use sphere::Sphere;
pub use voxels::Voxels;

/// Pixel2Mesh as the poster has it: an icosphere that is refined.
pub type DepthPixel2Mesh = Refined<Sphere>;
/// Mesh R-CNN with given boxes: cells, then a mesh around them that is refined.
pub type MeshRcnn = Refined<Voxels>;
