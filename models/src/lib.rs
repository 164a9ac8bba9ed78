//! Systems that learn meshes from images.
//!
//! ```
//! use models::img2mesh::Img2Mesh;
//! use train::{Configuration, System, settings};
//!
//! let (name, preset) = Img2Mesh::PRESETS[0];
//! let config: Configuration<<Img2Mesh as System>::Config> =
//!     settings::read_text(name.as_ref(), preset, &[])?;
//! assert!(Img2Mesh::check(&config.system).is_empty());
//! assert!(Img2Mesh::summary(&config.system).trainable > 1000);
//! # Ok::<(), settings::SettingsError>(())
//! ```
//!
//! # By task
//!
//! - **several views to one mesh, learned from images**: [`img2mesh`]
//! - **one image to a mesh, learned from true surfaces**: [`mod@pixel2mesh`], in continuous time and in stages; its data:
//!   [`paired`]
//! - **the same with depth, and through voxels**: [`depth`], depth-aware Pixel2Mesh and Mesh R-CNN
//! - **photo collections of many categories to textured meshes**: [`mod@mcmr`], learned from masks and rough poses
//! - **from where an image was taken**, guessed: [`mod@viewpoint`]
//! - **apply what was trained** to a user's files: [`predict`]
//! - **all systems**, for a program that offers them: [`register`]
//! - **published forms** are the presets `paper`; their rows in tables `paper-table`; what mends them: [`repairs`](repairs())
//!
//! Training is [`train`](fn@train::train)'s; a system implements [`train::System`].
//!
//! # Invariants
//!
//! - Nothing is printed. The same seed gives the same bits whatever the number of threads.
//! - A checkpoint has all that a prediction needs.
//! - Objects are parted into training, validation and test before anything is drawn, and no object is in two of them.
//!   What an object is scored in follows from its name, so that tests are the same whatever is trained on.

pub mod depth;
pub mod img2mesh;
pub mod mcmr;
pub mod paired;
pub mod pixel2mesh;
pub mod predict;
pub mod viewpoint;

mod instance;
mod mesh_pairs;
mod parts;
mod pretrained;
mod quality;
mod registry;
mod repairs;
mod square;
mod stacked;
#[cfg(test)]
mod testing;
mod view_cache;

pub use mesh_pairs::{MeshPair, MeshPairs};
/// Networks in ONNX's form, as [`predict::Predictor::to_onnx`] gives them.
pub use nets::onnx::{OnnxModel, OnnxValue};
pub use quality::Quality;
pub use registry::{Registry, register};
pub use repairs::{Repair, repairs};
