//! Triangle meshes without gradients: topology, primitives, cameras, images and mesh files.

mod camera;
mod image;
mod mesh;

pub use camera::{
    Camera, CameraError, ColmapCamera, KaolinCamera, Lens, OpenCvCamera, Projected,
    Pytorch3dCamera, R2n2View, Ray, WeakPerspective,
};
pub use image::{ByteImage, Image};
pub use mesh::{Texture, TriMesh};
pub use nalgebra;
