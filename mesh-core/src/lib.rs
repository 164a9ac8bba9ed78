//! Triangle meshes without gradients: topology, primitives, cameras, images and mesh files.

mod camera;
mod csr;
mod differential;
mod diffusion;
mod health;
mod image;
mod intersect;
pub mod io;
pub mod kernels;
mod mesh;
mod normals;
pub mod primitives;
mod remesh;
mod sample;
mod subdivide;
mod topology;
mod vector;
mod voxel;

pub use camera::{
    Camera, CameraError, ColmapCamera, KaolinCamera, Lens, OpenCvCamera, Projected,
    Pytorch3dCamera, R2n2View, Ray, WeakPerspective,
};
pub use csr::Csr;
pub use differential::{
    SparseRows, combinatorial_laplacian, cotangent_laplacian, cotangent_weights, uniform_laplacian,
    vertex_areas,
};
pub use diffusion::{DiffusionSolver, SolveReport};
pub use health::Health;
pub use image::{
    ByteImage, DepthMap, Image, ImageError, decode_depth, decode_image, encode_depth, encode_png,
    linear_to_srgb, read_depth, read_depth_png, read_image, srgb_to_linear, write_depth, write_png,
};
pub use io::{ReadMeshError, WriteError, read_mesh, write_mesh};
pub use kernels::nearest::{Nearest, NearestScratch, nearest, nearest_into};
pub use mesh::{MeshError, Texture, TriMesh};
pub use nalgebra;
pub use normals::{face_areas, face_normals, vertex_normals};
pub use remesh::{ImproveOptions, Improvement, RemeshError, improve};
pub use sample::{SurfacePoint, sample_points, sample_surface};
pub use subdivide::{Subdivision, subdivide};
pub use topology::{FacePair, Topology};
pub use voxel::{VoxelGrid, voxelize_enclosed, voxelize_parity, voxelize_solid, voxelize_surface};
