//! One image and the surface that it shows: what systems of a single view learn from.
//!
//! Everything lives in the frame of the image's camera: the object in front of it, -z ahead, lengths multiplied by a
//! factor (Pixel2Mesh: 0.57, which brings ShapeNet's objects about 0.8 before the camera). Or, where that is
//! [asked for](Pairs::with_frame), in the object's own: the world of its cameras, times the same factor.
//!
//! ```
//! use models::paired::{Pairs, PairsConfig};
//! use train::Subset;
//!
//! let config = PairsConfig {
//!     image_size: 32,
//!     objects: 2,
//!     test_objects: 1,
//!     families: vec!["airplane".into()],
//!     ..PairsConfig::default()
//! };
//! let pairs = Pairs::synthetic(&config)?;
//! assert_eq!((pairs.trained().len(), pairs.listed(Subset::Test).len()), (2, 1));
//! let pair = pairs.pair(pairs.listed(Subset::Test)[0], 5)?;
//! assert!(pair.truth.positions.iter().all(|p| p[2] < -0.3));
//! # Ok::<(), train::DataError>(())
//! ```

mod config;
mod frame;
mod input_image;
mod paint;
mod pairs;
mod score;
mod shown;

pub use config::PairsConfig;
pub use frame::{Frame, FrameKind};
pub use input_image::InputImage;
pub use pairs::{Pair, Pairs, Surface};
pub(crate) use pairs::{placed, some};
pub use score::{CROSSED, EMD_POINTS, PointScores, point_scores, surface_scores};
pub(crate) use shown::{in_studio, mesh_above_image};
