//! From where an object is seen: what a network guesses of it, how wrong that is, and which guess to believe.
//!
//! A [`Viewpoint`] is an azimuth, an elevation and a distance around the object's own frame, with +Y up. A
//! [`ViewpointHead`](nets::ViewpointHead) guesses several from an image; [`viewpoint_loss`] is what it misses of true ones, and
//! [`hypotheses`] are the few that are likely.

mod beginning;
mod hypothesis;
mod loss;
mod onnx;
mod place;
#[cfg(test)]
mod tests;

pub(crate) use beginning::{LOOKED_AT, begin_at};
pub use hypothesis::{Hypothesis, hypotheses};
pub use loss::viewpoint_loss;
pub(crate) use onnx::{viewpoint_outputs, viewpoint_to_onnx};
pub use place::{Viewpoint, as_seen};

/// Directions around the object that the camera heads of the systems tell apart.
pub(crate) const DIRECTIONS: usize = 8;
