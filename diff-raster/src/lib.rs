//! DIB-R, a differentiable rasteriser, on the CPU: exact, deterministic, no limit on faces.
//!
//! ```
//! use std::sync::Arc;
//!
//! use autodiff_lite::Tape;
//! use diff_raster::{Faces, Renderer, Settings};
//! use ndarray::{arr2, arr3};
//!
//! let faces = Arc::new(Faces::new(3, &[[0, 1, 2]])?);
//! let renderer = Renderer::new(faces, Settings::new(64, 64)); // once, for all steps
//!
//! // One triangle: NDC x (right), NDC y (up), planar depth.
//! let corners = arr3(&[[[-0.5_f32, -0.5, 2.0], [0.5, -0.5, 2.0], [0.0, 0.5, 3.0]]]);
//! let tape = Tape::train(0);
//! let projected = tape.leaf(corners);
//! let colors = tape.leaf(arr2(&[[1.0_f32, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]));
//! let frame = renderer.frame(projected);
//! let image = frame.interpolate(colors); // [1, 64, 64, 3]
//! let mask = frame.soft_silhouette(); // [1, 64, 64]
//!
//! // Which way must the corners move for the silhouette to grow? Down, down, and up.
//! let gradients = mask.sum().backward();
//! let pull = gradients.wrt(projected).expect("the mask depends on the positions");
//! assert!(pull[[0, 0, 1]] < 0.0 && pull[[0, 1, 1]] < 0.0 && pull[[0, 2, 1]] > 0.0);
//! # assert_eq!(image.shape(), [1, 64, 64, 3]);
//! # Ok::<(), diff_raster::FacesError>(())
//! ```
//!
//! # Where things are
//!
//! | for | see |
//! |---|---|
//! | images on a tape, step after step | [`Renderer`], [`Frame`] |
//! | what is seen at each pixel | [`rasterize`](rasterize()), [`Fragments`]; in the memory of earlier ones [`rasterize_into`] |
//! | how it is drawn | [`Settings`], [`Settings::published`] for DIB-R with its accidents |
//! | memory that several renderers share | [`Scratch`] |
//! | colours, normals, texture coordinates | [`interpolate`], [`interpolate_corners`] |
//! | textures | [`texture`], around a sphere [`sphere_texture`] |
//! | silhouettes | [`soft_silhouette`] pulls from afar, [`antialiased_silhouette`] is exact |
//! | depth | [`depth`] |
//! | several faces a pixel, blended as PyTorch3D does it | [`Layers`], [`LayerSettings`], [`BlendSettings`]; plain values, [`rasterize_layers`] |
//! | the other way: every face a cloud | [`fn@softras`], [`SoftRas`], [`Paint`] |
//! | the loops, without a tape | [`kernels`] |
//! | a slow twin to check against | [`mod@reference`] |
//!
//! What takes [`Fragments`] is also a method of [`Frame`], which works in memory that is used again.
//!
//! # Conventions
//!
//! NDC has x right and y up, `[-1, 1]` over the image; the centre of pixel (row `i`, column `j`) is
//! at `((2j+1-W)/W, (H-2i-1)/H)`. Depth is planar and positive in front of the camera. Arrays are
//! row-major with features last. A face is front-facing if it turns counter-clockwise on the screen.
//!
//! # Invariants
//!
//! - Visibility is a plain value: gradients hold it fixed. What moves silhouettes are the two
//!   silhouette operations.
//! - Results are the same bits for any number of threads. They differ in rounding between
//!   instruction sets, because some have fused multiply-add.
//! - Two faces that share an edge leave no pixel between them, and no face is ever drawn mirrored (but by
//!   [`Settings::published`], which has no near plane):
//!   one with a corner at or behind the near plane, or with a coordinate that is not finite, is
//!   dropped whole.
//! - No limit on faces, faces per pixel or image size, other than [`Settings::max_faces`], which
//!   only [`Settings::published`] sets, and 32-bit indices.
//! - Operations take their numbers from the fragments: give them the positions that were rasterised
//!   (a [`Frame`] does).
//!
//! Shape mistakes panic at the caller. There are no second derivatives.

/// The crates whose types stand in this one's functions.
pub use {autodiff_lite, mesh_core, ndarray};

pub mod kernels;
pub mod ops;
pub mod reference;

mod faces;
mod fragments;
mod frame;
#[cfg(feature = "compiled")]
mod instances;
mod layers;
mod positions;
mod rasterize;
mod renderer;
mod scratch;
mod scratch_pool;
mod settings;
mod softras;
mod softras_settings;

pub use faces::{Faces, FacesError, NONE};
pub use fragments::Fragments;
pub use frame::Frame;
pub use layers::{LayerSettings, LayeredFragments, Layers, rasterize_layers};
pub use ops::{
    BlendSettings, Paint, antialiased_silhouette, depth, interpolate, interpolate_corners,
    soft_silhouette, softras, sphere_texture, texture,
};
pub use positions::Positions;
pub use rasterize::{rasterize, rasterize_into};
pub use renderer::Renderer;
pub use scratch::Scratch;
pub use settings::{Instructions, Rule, Settings};
pub use softras::{SoftRas, texel_centers};
pub use softras_settings::SoftRasSettings;
