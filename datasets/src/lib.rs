//! Views of objects from the layouts that people have.
//!
//! A view is an image, a mask of the object, and the camera; all layouts become the same
//! [`Views`]:
//!
//! ```
//! use datasets::{ReadOptions, View, read_views, split, write_transforms};
//! use mesh_core::{ByteImage, Camera};
//!
//! // Four images of a grey disc, from four sides.
//! let views: Vec<View> = (0..4)
//!     .map(|i| {
//!         let (sin, cos) = (f64::from(i) * 1.6).sin_cos();
//!         let eye = [4.0 * sin, 1.0, 4.0 * cos];
//!         let camera = Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.7, 32, 32);
//!         let disc = (0..32 * 32).map(|k: i32| (k / 32 - 16).pow(2) + (k % 32 - 16).pow(2) < 90);
//!         let mask: Vec<u8> = disc.map(|inside| if inside { 255 } else { 0 }).collect();
//!         let color = mask.iter().flat_map(|&m| [m / 2; 3]).collect();
//!         let image = |channels, data| ByteImage { height: 32, width: 32, channels, data };
//!         let (color, mask) = (image(3, color), image(1, mask));
//!         View { name: i.to_string(), color, mask, camera, depth: None, crop: None }
//!     })
//!     .collect();
//!
//! let folder = tempfile::tempdir()?;
//! write_transforms(&views, folder.path())?;
//! let read = read_views(folder.path(), &ReadOptions::default(), &|done, total| {
//!     assert!(done <= total); // for a progress bar
//! })?;
//! assert_eq!(read.views[2].mask, views[2].mask);
//! assert_eq!(split(read.len(), Some(4)).held_out, [3]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | to | use |
//! |---|---|
//! | read whatever is there | [`read_views`] with [`ReadOptions`] |
//! | open whatever is there, many objects too | [`fn@open`], a [`Dataset`] |
//! | find every fault | [`fn@validate`] |
//! | choose where masks come from | [`MaskSource`] |
//! | write for other tools | [`write_kaolin`], [`write_transforms`], [`write_colmap`], [`write_photos`], [`r2n2::write_object`] |
//! | read many objects | [`Dataset`]: [`r2n2::R2n2`], [`pixel2mesh::Pixel2Mesh`], [`Bop`], [`Pix3d`], [`Pascal3d`], [`Cub`], [`Mcmr`] |
//! | part objects into training, validation and test | [`Subsets`], [`split_objects`] |
//! | keep views back for judging | [`split()`], [`is_held_out`] |
//! | read one depth map, or a disparity | [`read_depth_file`], [`read_disparity_file`] |
//! | estimate depth from an image | `DepthEstimator` (feature `onnx`) with a [`DepthInput`] |
//! | find the object in images without a plain backdrop | [`segment_by_color`]; `MaskEstimator` (feature `onnx`) with a [`MaskInput`], then [`agree`] |
//!
//! # Layouts
//!
//! [`Layout`] says of each what it is recognised by and what of it is read.
//!
//! # Conventions
//!
//! Masks hold 255 where the object is and 0 elsewhere, nothing between, and belong to pixel
//! centres. Colours are sRGB bytes. Cameras are [`mesh_core::Camera`] in the world of the files,
//! which is never moved or scaled, so that a mesh fits back onto its source.
//!
//! # What this crate promises
//!
//! Any bytes may arrive: sizes are checked before memory is taken, and every [`ReadViewsError`]
//! names the file, the field, what was found and what was expected. The error is that of the
//! first view in order, whatever the number of threads. Nothing here knows of tapes or training.
//!
//! What a file makes its reader take is held to [`mesh_core::Limits`], 256 MB and 20 bytes for each of
//! its own by default: a denser content is refused with what it would have taken. Images are held
//! to a number of pixels by their header, arrays of masks to the images that they belong to, files of depth to 256 MB, and an archive's entry to half of what its stored bytes may take.
//!
//! Files name others. Of those only regular files are opened, no pipes and no devices, and only below
//! the folder that was opened: never by an absolute name, nor by a `..` that leads out of it. The
//! layouts of one object may reach two folders further up, because nerfstudio keeps poses beside
//! `images/` and says `../images/0.png`, and COLMAP its models in `sparse/0/`. Links in a folder are
//! followed: whoever made them could as well have copied what they lead to.

mod assemble;
mod backdrop;
mod budget;
mod consistency;
mod content;
mod convention;
mod counted;
mod crop;
mod dataset;
mod depth;
#[cfg(feature = "onnx")]
mod depth_estimator;
mod depth_file;
mod depth_input;
mod error;
mod formats;
mod layouts;
mod mask;
#[cfg(feature = "onnx")]
mod mask_estimator;
mod mask_file;
mod mask_input;
mod mix64;
mod morphology;
mod names;
mod natural;
#[cfg(feature = "onnx")]
mod network;
mod open;
mod options;
mod photograph;
mod read;
mod segment;
mod source;
mod split;
mod subsets;
mod undistort;
mod unknown_layout;
mod validate;
mod view;
mod view_error;
mod wanted;

pub use backdrop::mask_from_backdrop;
pub use convention::{CameraAxes, Convention, PoseDirection};
pub use crop::Crop;
pub use dataset::{Catalog, Dataset, Entry, Subset, SurfacePoints, Truth};
#[cfg(feature = "onnx")]
pub use depth_estimator::DepthEstimator;
pub use depth_file::{read_depth_file, read_disparity_file};
pub use depth_input::{DepthInput, SizeFit};
pub use error::{ReadViewsError, ViewsProblem, WriteViewsError};
pub use layouts::bop::Bop;
pub use layouts::colmap::{Colmap, ColmapForm, ColmapPoint, write_colmap};
pub use layouts::cub::{Cub, CubAnnotation, CubMeanShape};
pub use layouts::generated::Generated;
pub use layouts::kaolin::write_kaolin;
pub use layouts::mcmr::{Mcmr, McmrAnnotation};
pub use layouts::pascal3d::{Pascal3d, Pascal3dAnnotation, Viewpoint};
pub use layouts::photos::write_photos;
pub use layouts::pix3d::{Pix3d, Pix3dAnnotation};
pub use layouts::transforms::{write_transforms, write_transforms_split};
pub use layouts::{pixel2mesh, r2n2};
pub use mask::{clean_mask, mask_from_alpha};
#[cfg(feature = "onnx")]
pub use mask_estimator::MaskEstimator;
pub use mask_input::{MaskInput, MaskScale, PixelScale, mask_of_shares};
pub use mix64::mix64;
pub use names::is_called;
#[cfg(feature = "onnx")]
pub use network::{NetworkError, NetworkProblem};
pub use open::{choose, open, open_with, read_views};
pub use options::{MaskSource, OnInconsistent, ReadOptions, Turntable};
pub use photograph::Photograph;
pub use segment::{Agreement, Region, SegmentError, agree, segment_by_color, tidy};
pub use split::{Split, is_held_out, split, split_objects};
pub use subsets::{LeakError, Subsets};
pub use undistort::OffAxisError;
pub use validate::{Fault, Validation, validate};
pub use view::{Layout, View, Views};
pub use view_error::ViewError;
