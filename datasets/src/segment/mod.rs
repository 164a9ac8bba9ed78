//! Masks of the object from all views together: their colours, and what their cameras allow.

mod agreement;
mod color_model;
mod cut;
mod dissent;
mod palette;
mod region;

pub use agreement::{Agreement, agree, tidy};
pub use color_model::segment_by_color;
pub use region::Region;

/// Why views do not say together what the object is.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SegmentError {
    /// Too few views.
    #[error("{found} views, expected at least {LEAST}: fewer say nothing of each other")]
    FewViews {
        /// How many there are.
        found: usize,
    },
    /// The cameras do not surround anything.
    #[error(
        "the cameras look at no common point, so nothing says where the object is; a box around it would"
    )]
    NoRegion,
    /// Nothing in the region differs from what is around it.
    #[error(
        "nothing that all views show differs from its surroundings; a tighter box around the object may help"
    )]
    NoObject,
}

/// Views below this number do not fix a hull.
const LEAST: usize = 3;
