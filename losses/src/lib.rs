//! Losses and metrics for meshes, masks, images and point sets.
//!
//! A loss is a function of [`Var`](autodiff_lite::Var)s that returns a scalar with a gradient. All losses of meshes take a
//! [`Topology`](mesh_core::Topology); those that need one list of it (edges, faces, neighbours) take that too. A metric is a function of plain meshes, images and point sets, summed in `f64`.
//!
//! ```
//! use autodiff_lite::Tape;
//! use mesh_core::{Topology, primitives::icosphere};
//!
//! let ball = icosphere(2);
//! let topology = Topology::of(&ball);
//!
//! let tape = Tape::<f32>::train(0);
//! let positions = tape.leaf(ball.vertices());
//! let smooth = losses::laplacian_norm(positions, &topology);
//! let short = losses::edge_length(positions, &topology, 0.0);
//! let loss = smooth.scale(0.1).add(short);
//! let gradient = loss.backward();
//! assert_eq!(gradient.wrt(positions).unwrap().shape(), [162, 3]);
//! ```
//!
//! # Losses
//! | for | use |
//! |---|---|
//! | images | [`l1`], [`l2`] (with a mask if wanted), [`ssim_loss`], [`ssim_loss_valid`] |
//! | colours as they are seen | [`rgb_to_lab`], [`lab_lightness`], [`lab_color`] |
//! | how images look | [`lpips`] over the maps of a network, [`pyramid`] without one |
//! | cameras | [`camera_loss`], [`rotation_loss`], [`rotation_sine`], [`quaternion_length`] |
//! | silhouettes | [`mask_iou`], [`mask_bce`], of logits [`mask_bce_logits`] (and [`l2`]) |
//! | classes | [`cross_entropy`] of logits |
//! | depth maps | [`ScaleShiftInvariant`] on [`disparity`] (scale and shift), [`log_depth`] (scale); their parts: [`align_scale_shift`], [`normalize_depth`], [`depth_l2`], [`depth_l1_trimmed`], [`depth_gradients`] |
//! | flat, unfolded surfaces | [`face_angle`](face_angle()), [`normal_consistency`] |
//! | even, smooth surfaces | [`edge_length`], [`edge_length_sum`], [`laplacian_squared`], [`laplacian_norm`], [`laplacian_cotangent`], [`laplacian_cotcurv`] |
//! | small deformations | [`deformation_norm`] |
//! | point sets | [`chamfer`](chamfer()), [`chamfer_distance`] and [`chamfer_normals`] over [`Matches`], [`chamfer_l1`], [`chamfer_normals_signed`], [`earth_mover`](earth_mover()); [`knn_points`], [`knn_gather`] over [`Neighbors`] |
//! | points and a surface | [`point_mesh_face_distance`], [`point_face_distance`], [`face_point_distance`]; [`nearest_faces`], [`nearest_points`] |
//! | edges in a true surface | [`edge_normal`](edge_normal()) |
//! | geometry that carries gradients | [`vertex_normals`], [`face_normals`], [`surface_points`], [`surface_normals`] |
//!
//! # Metrics
//! [`metrics`] compares images, masks, point sets and meshes; two meshes are compared under a named
//! protocol that is part of the report.
//!
//! # Conventions
//! Batches come first and features last: vertices `[V, 3]` or `[N, V, 3]`, images `[N, H, W, C]`. A batch
//! is averaged. Wrong shapes panic at the caller. All results are the same for any number of threads. A
//! [`SparseRows`](mesh_core::SparseRows) of either precision becomes a matrix of the tape by [`sparse_matrix`]. No
//! second derivatives.
//!
//! # What this crate does not do
//! It weighs no losses against each other, draws no samples (mesh-core does) and renders nothing
//! (diff-raster does).

/// The crates whose types stand in this one's functions.
pub use {autodiff_lite, mesh_core, ndarray};

pub mod kernels;
pub mod metrics;

mod camera;
mod chamfer;
mod cotangent;
mod curvature;
mod deformation;
mod depth;
mod earth_mover;
mod edge;
mod edge_normal;
mod face_angle;
mod image;
mod knn;
mod lab;
mod laplacian;
mod logits;
mod mask;
mod matches;
mod normals;
mod perceptual;
mod point_face;
mod scalar;
mod sparse;
mod ssim;
mod surface;
#[cfg(test)]
mod testing;

pub use camera::{camera_loss, quaternion_length, rotation_loss, rotation_sine};
pub use chamfer::{
    Directions, chamfer, chamfer_distance, chamfer_l1, chamfer_normals, chamfer_normals_signed,
};
pub use cotangent::laplacian_cotangent;
pub use curvature::laplacian_cotcurv;
pub use deformation::deformation_norm;
pub use depth::{
    DepthMean, Robustness, ScaleShiftInvariant, align_scale_shift, depth_gradients,
    depth_l1_trimmed, depth_l2, disparity, log_depth, normalize_depth,
};
pub use earth_mover::earth_mover;
pub use edge::{edge_length, edge_length_sum};
pub use edge_normal::edge_normal;
pub use face_angle::{face_angle, normal_consistency};
pub use image::{l1, l2};
pub use kernels::alignment::ScaleShift;
pub use kernels::assignment::Assignment;
pub use kernels::neighbors::Norm;
pub use knn::{Neighbors, knn_distances, knn_gather, knn_points};
pub use lab::{lab_color, lab_lightness, rgb_to_lab};
pub use laplacian::{laplacian_norm, laplacian_squared};
pub use logits::{cross_entropy, mask_bce_logits};
pub use mask::{mask_bce, mask_iou};
pub use matches::Matches;
pub use normals::{face_normals, vertex_normals};
pub use perceptual::{lpips, pyramid};
pub use point_face::{
    face_point_distance, nearest_faces, nearest_points, point_face_distance,
    point_mesh_face_distance,
};
pub use sparse::sparse_matrix;
pub use ssim::{ssim_loss, ssim_loss_valid};
pub use surface::{surface_normals, surface_points};
