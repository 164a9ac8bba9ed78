//! Why a fit could not be made.

use datasets::ViewError;

/// What stopped a fit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// The configuration has a value out of its range.
    #[error("fit configuration: {}", .0.join("; "))]
    Config(Vec<String>),
    /// There is nothing to fit to.
    #[error("no views")]
    NoViews,
    /// No view shows the object.
    #[error(
        "masks are empty in all {views} views: nothing to fit: 255 is the object, 0 what is not"
    )]
    EmptyMasks {
        /// How many views there were.
        views: usize,
    },
    /// No view shows anything beside the object.
    #[error(
        "masks fill their images in all {views} views, so that none shows an outline: 0 is what is not the object"
    )]
    FullMasks {
        /// How many views there were.
        views: usize,
    },
    /// A view that is none.
    #[error(transparent)]
    View(#[from] ViewError),
    /// Too few views remain to learn a shape from.
    #[error(
        "{remaining} of {views} views remain with the object in their mask{}; at least 2 are needed: hold fewer out, or give more views",
        held_out(*.hold_out)
    )]
    TooFewViews {
        /// Views with a mask that are not held out.
        remaining: usize,
        /// All views.
        views: usize,
        /// The `hold-out` of the configuration.
        hold_out: Option<usize>,
    },
    /// The cameras and masks leave no place for an object.
    #[error("the cameras do not see one object: {reason}")]
    Placement {
        /// What was found.
        reason: String,
    },
    /// A loss or its gradient became NaN or infinite.
    #[error(
        "step {step}: {loss} is not finite in {tensor} (view {view}): a smaller learning-rate may help; else it is a defect of this program"
    )]
    NotFinite {
        /// Step, counted over all stages.
        step: usize,
        /// Name of the loss.
        loss: &'static str,
        /// Name of the tensor.
        tensor: &'static str,
        /// Name of the first view in which it is so.
        view: String,
    },
}

fn held_out(every: Option<usize>) -> String {
    every.map(|every| format!(" after holding out every {every}th")).unwrap_or_default()
}
