//! Triangle meshes without gradients: topology, primitives, cameras, images and mesh files.
//!
//! ```
//! use mesh_core::{TriMesh, primitives, sample_surface, subdivide};
//!
//! // A vase, turned from its profile; watertight like all primitives.
//! let vase = primitives::lathe(&[[0.4, 0.0], [0.7, 0.4], [0.3, 0.9], [0.45, 1.1]], 48);
//! let health = vase.health();
//! assert!(health.is_watertight() && vase.self_intersections().is_empty());
//! println!("{health}"); // counts, holes, handles, angles, folds
//!
//! // Finer, then a thousand points on it: the same ones for the same seed.
//! let finer = subdivide(&vase);
//! let points = sample_surface(&finer, 1000, 7);
//! assert_eq!(points.len(), 1000);
//!
//! // Whatever comes from elsewhere is checked at the door, by name.
//! let broken = TriMesh::new(vec![[0.0; 3]; 3], vec![[0, 1, 3]]);
//! let error = broken.validate().unwrap_err();
//! assert_eq!(error.to_string(), "face 0 names vertex 3, expected less than 3");
//! ```
//!
//! # By task
//!
//! - **a mesh**: [`TriMesh`], [`Texture`]; [`TriMesh::validate`], [`TriMesh::health`],
//!   [`TriMesh::self_intersections`], both as [`TriMesh::examined`] says them, [`mod@bounds`], area, volume, transforms, [`TriMesh::append`],
//!   [`TriMesh::vertex_colors`]
//! - **make one**: [`primitives`]; finer by [`subdivide`](subdivide()), with anything that lives on the vertices by
//!   [`Subdivision`]; better triangles by [`improve`], of one size by [`fn@remesh`], fewer by [`simplify`], fewer and graded by [`coarsen`];
//!   without self-intersections by [`TriMesh::untangle`]
//! - **who is next to whom**: [`Topology`] (edges, face pairs, rings), [`Csr`]
//! - **measure**: [`face_normals`], [`vertex_normals`], [`face_areas`], [`vertex_areas`];
//!   [`adjacency`], [`uniform_laplacian`], [`combinatorial_laplacian`], [`cotangent_laplacian`] as [`SparseRows`]
//! - **smooth steps**: [`DiffusionSolver`], `(I + λ L) x = b`
//! - **fair surfaces**: [`NormalFilter`]; [`NormalDiffusion`] and [`integrate_normals`], which reach across whole sides
//! - **points and cells**: [`sample_surface`], [`nearest`], [`ClosestPoint`], [`closest_weights`]; [`voxelize_solid`], [`voxelize_surface`],
//!   [`voxelize_parity`], [`voxelize_enclosed`], [`VoxelGrid::iou`]; back to a mesh by [`cubify`](cubify()) and
//!   [`marching_cubes`](marching_cubes()); the cells that a
//!   camera sees, [`CameraVolume`]
//! - **see**: [`Camera`] with every convention that data comes in, [`Distortion`], [`UpAxis`]; [`Image`], [`ByteImage`], [`DepthMap`],
//!   [`DisparityMap`] and the [`GroundPlane`] that estimators make up
//! - **compute** with three numbers: [`vector`]; with many, [`fn@median`]; on a tape, with the feature `ndarray`: `TriMesh::vertices`, `Camera::matrices`
//! - **files**: [`read_mesh`], [`write_mesh`] (OBJ, PLY, GLB, STL; 3MF with the feature `3mf`), [`read_image`], [`write_png`], EXR depth, PFM;
//!   module [`io`]; how much memory reading may take and what else it may open, [`Limits`]
//!
//! # Features
//!
//! On by default: `files` (mesh files; brings `images`), `images` (PNG, JPEG and PFM), `exr` (depth in EXR), `serde` (a [`Health`] as
//! text), `rayon` (threads) and `simd` (vector instructions; without either the same bits). Without any of them there is geometry
//! alone, with a sixth of the dependencies; `camera` adds cameras, [`UpAxis`] and [`simplify`], and comes with `files`. Off by
//! default: `ndarray` (meshes and cameras as arrays), `3mf`.
//!
//! # Conventions
//!
//! Right-handed, +Y up, unit-free. Faces are counter-clockwise seen from outside. Arrays are row-major
//! with features last: positions `[V, 3]`, faces `[F, 3]`, images `[H, W, C]` with row 0 on top.
//! Positions are `f32`; geometry is computed in `f64`. Cameras look along -z (OpenGL), depth is planar
//! and positive in front, `+inf` where there is nothing. Colours are sRGB in `[0, 1]` unless a name
//! says linear.
//!
//! # Invariants
//!
//! - Any bytes may arrive as a file: the answer is a typed error that names what was found and what was
//!   expected. Arrays of the wrong length are mistakes of the caller and panic, as in indexing;
//!   [`TriMesh::validate`] is the door between the two, and what is read from a file passes it.
//! - Reading takes memory in proportion to the file ([`Limits`]) and time too; only regular files are opened.
//! - A mesh without faces, area or extent, or with coordinates that are not finite, has a value or an error
//!   in every function, never a panic, as long as its faces name vertices that exist.
//! - The same input gives the same bits for any number of threads. Randomness is a function of a seed.
//! - [`kernels`] take slices and choose instructions at run time. No `unsafe` in this crate.
//!
//! # Not here
//!
//! Gradients (see `autodiff-lite` and `losses`), rendering (`diff-raster`), booleans, hole filling.

#[cfg(feature = "ndarray")]
mod arrays;
pub mod bounds;
#[cfg(feature = "camera")]
mod camera;
mod closest;
mod conjugate_gradients;
mod counted;
mod crossings;
mod csr;
mod cubify;
mod differential;
mod diffusion;
mod examination;
mod health;
mod image;
mod inside;
mod intersect;
#[cfg(feature = "images")]
pub mod io;
mod iou;
pub mod kernels;
mod limits;
mod marching_cubes;
mod mask;
mod median;
mod mesh;
mod normal_diffusion;
mod normal_filter;
mod normal_integration;
mod normals;
pub mod primitives;
mod remesh;
mod sample;
mod scalar;
mod split_nonmanifold;
mod subdivide;
mod tangles;
mod texture;
mod topology;
mod untangle;
#[cfg(feature = "camera")]
mod up_axis;
pub mod vector;
mod voxel;
mod weld;

pub use bounds::Bounds;
#[cfg(feature = "camera")]
pub use camera::{
    Camera, CameraError, CameraVolume, ColmapCamera, Distortion, KaolinCamera, Lens, OpenCvCamera,
    Projected, Pytorch3dCamera, R2n2View, Ray, SphericalView, WeakPerspective,
    look_at_view_transform,
};
pub use closest::{Closest, ClosestPoint, Hit, closest_weights};
pub use conjugate_gradients::SolveReport;
pub use counted::counted;
pub use csr::Csr;
pub use cubify::{EmptyGrid, cubify};
pub use differential::{
    SparseRows, adjacency, combinatorial_laplacian, cotangent_laplacian, cotangent_weights,
    uniform_laplacian, vertex_areas,
};
pub use diffusion::DiffusionSolver;
pub use examination::Examination;
pub use health::Health;
pub use image::{
    ByteImage, DepthMap, DisparityMap, GroundPlane, Image, Pixels, bilinear, bilinear_repeat,
    linear_to_srgb, srgb_to_linear,
};
#[cfg(feature = "images")]
pub use image::{
    ImageError, StoredImage, decode_depth_png, decode_depth_png_with, decode_image,
    decode_image_with, decode_pfm, decode_pfm_with, encode_pfm, encode_png, read_depth_png,
    read_image, read_image_with, read_pfm, write_pfm, write_png,
};
#[cfg(feature = "exr")]
pub use image::{
    decode_depth, decode_depth_with, encode_depth, encode_exr, read_depth, write_depth,
};
#[cfg(feature = "images")]
pub use io::WriteError;
#[cfg(feature = "files")]
pub use io::{ReadMeshError, Remark, read_mesh, read_mesh_with, read_mesh_with_uvs, write_mesh};
pub use iou::iou;
pub use kernels::nearest::{Nearest, NearestScratch, nearest, nearest_both_into, nearest_into};
pub use limits::{Budget, Limits, OverLimit};
pub use marching_cubes::marching_cubes;
pub use mask::{Components, Mask};
pub use median::{MedianOfEven, median};
pub use mesh::{MeshError, Texture, TriMesh};
#[cfg(feature = "camera")]
pub use nalgebra;
pub use normal_diffusion::NormalDiffusion;
pub use normal_filter::NormalFilter;
pub use normal_integration::integrate_normals;
pub use normals::{face_areas, face_normals, vertex_normals};
#[cfg(feature = "camera")]
pub use remesh::simplify;
pub use remesh::{
    ImproveOptions, Improvement, RemeshError, RemeshOptions, Remeshed, coarsen, improve, remesh,
};
pub use sample::{SurfacePoint, sample_points, sample_surface};
pub use scalar::Scalar;
pub use subdivide::{Subdivision, subdivide};
pub use topology::{FacePair, Topology};
pub use untangle::{untangle, untangle_towards};
#[cfg(feature = "camera")]
pub use up_axis::{UpAxis, UpAxisError};
pub use voxel::{VoxelGrid, voxelize_enclosed, voxelize_parity, voxelize_solid, voxelize_surface};
