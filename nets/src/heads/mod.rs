//! Networks that turn features into voxels, meshes, images and cameras.

pub(crate) mod graph_bottleneck;
pub(crate) mod image_decoder;
pub(crate) mod mesh_refinement;
pub(crate) mod viewpoint_head;
pub(crate) mod voxel_head;
