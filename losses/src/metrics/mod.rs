//! How good a result is: figures over plain images, masks, meshes and point sets; no gradients.
//!
//! - images: [`l1`], [`mse`], [`psnr`], [`psnr_inside`], [`ssim`], [`ssim_valid`]
//! - masks: [`mask_iou`], [`mask_iou_by`] a published or a strict [`MaskRule`]
//! - depth maps: [`depth_error`]
//! - cameras: [`rotation_angle`], and [`symmetric_rotation_angle`] modulo the [`turns`] of an object
//! - features of a network, run elsewhere: [`frechet`](frechet()) (the FID), [`feature_distance`] (MCMR's figure of that name)
//! - point sets: [`point_distances`] and what follows from them ([`PointDistances`])
//! - meshes: [`evaluate`] under a published [`Protocol`]; [`voxel_iou`], [`mcmr_iou`]; [`FrameMismatch`], where they lie apart
//!
//! Distances between the same two meshes differ between papers by factors of a thousand, because scale,
//! squaring, and the number of points differ. So a figure is only ever given together with the
//! [`Protocol`] that made it, and that protocol is part of the serialised [`Report`].

mod bounds;
mod depth;
mod frame;
mod frechet;
mod image;
mod mask;
mod mcmr;
mod points;
mod protocol;
mod report;
mod rotation;
mod symmetry;
mod voxel;

pub use depth::{DepthError, depth_error};
pub use frame::FrameMismatch;
pub use frechet::{FrechetError, feature_distance, frechet};
pub use image::{l1, mse, psnr, psnr_inside, ssim, ssim_valid};
pub use mask::{MaskRule, mask_iou, mask_iou_by};
pub use mcmr::{McmrAlignment, mcmr_iou};
pub use points::{FScore, PointDistances, point_distances};
pub use protocol::{
    Combination, IouProtocol, Normalization, Points, Preset, Protocol, UnknownPreset,
};
pub use report::{CompareError, Report, Role, evaluate};
pub use rotation::rotation_angle;
pub use symmetry::{symmetric_rotation_angle, turns};
pub use voxel::voxel_iou;
