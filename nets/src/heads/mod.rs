//! Networks that turn features into voxels, meshes and images.

pub(crate) mod graph_bottleneck;
pub(crate) mod image_decoder;
pub(crate) mod mesh_refinement;
pub(crate) mod voxel_head;
