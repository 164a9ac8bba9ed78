//! Triangle meshes without gradients: topology, primitives, cameras, images and mesh files.

mod camera;
mod image;
pub mod io;
mod mesh;

pub use camera::{
    Camera, CameraError, ColmapCamera, KaolinCamera, Lens, OpenCvCamera, Projected,
    Pytorch3dCamera, R2n2View, Ray, WeakPerspective,
};
pub use image::{
    ByteImage, DepthMap, Image, ImageError, decode_depth, decode_image, encode_depth, encode_png,
    linear_to_srgb, read_depth, read_depth_png, read_image, srgb_to_linear, write_depth, write_png,
};
pub use io::WriteError;
pub use mesh::{Texture, TriMesh};
pub use nalgebra;
