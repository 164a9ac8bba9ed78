//! What was trained, applied to a user's files: from views on disk to the folder that a user keeps.
//!
//! A [`Predictor`] says how files become its input, and makes of the [`PredictInput`] that was read a [`Prediction`];
//! [`deliver`](deliver()) scores it at the cameras that were given and at those that were not, and writes meshes, turntable,
//! report and figures. A [`Familiarity`] says how far the input is from what was trained on. [`refined`] moves the mesh until it agrees with the given views,
//! [`solidified`] leaves of it what is seen from outside. [`milliseconds`] takes the time, for those who ask.
//!
//! ```no_run
//! use models::img2mesh::Img2Mesh;
//! use train::output::OutputFolder;
//! use models::predict::{Choice, Delivery, Predictor, Request, deliver};
//! use train::{Checkpoint, CheckpointPath};
//!
//! let found = CheckpointPath::find("runs/clock".as_ref(), false)?;
//! let (system, _) = Checkpoint::read(&found.file)?.load::<Img2Mesh>()?;
//! let request = Request { choice: Choice::First(3), ..Request::new("views".as_ref()) };
//! let input = system.load(&request)?;
//! let prediction = system.apply(&input)?;
//! let folder = OutputFolder::create("out".as_ref(), false)?;
//! let delivery = Delivery::new("img2mesh", &input, &prediction);
//! println!("mask IoU {}", deliver(&delivery, &folder)?.given.mask_iou);
//! folder.commit()?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod deliver;
mod familiarity;
mod input;
mod judgement;
mod names;
mod one_pass;
mod predictor;
mod refine;
mod sighting;
#[cfg(test)]
mod tests;

pub use deliver::{Delivery, Metrics, deliver};
pub use familiarity::Familiarity;
pub(crate) use input::assumed_camera;
pub use input::{Choice, PredictInput, Request};
pub use judgement::Judgement;
pub use one_pass::OnePass;
pub use predictor::{Detail, Prediction, Predictor, milliseconds};
pub use refine::{refined, solidified};
pub(crate) use sighting::strongest;
pub use sighting::{Features, Sighting};
