//! Why a fit could not be made.

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
    #[error("masks are empty in all {views} views: nothing to fit")]
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
    /// A view's image, mask and camera disagree in size.
    #[error(
        "view {view}: {field} is {found:?} (height, width), but the camera's image is {expected:?}"
    )]
    Size {
        /// Name of the view.
        view: String,
        /// `color` or `mask`.
        field: &'static str,
        /// Its height and width.
        found: [usize; 2],
        /// The camera's height and width.
        expected: [usize; 2],
    },
    /// A view's image or mask has another number of channels than a fit takes.
    #[error(
        "view {view}: {field} has {found} channels, expected {expected}: an image has red, green and blue, a mask one channel"
    )]
    Channels {
        /// Name of the view.
        view: String,
        /// `color` or `mask`.
        field: &'static str,
        /// Its channels.
        found: usize,
        /// Those that it should have.
        expected: usize,
    },
    /// A camera that cannot be used.
    #[error("view {view}: camera: {problem}")]
    Camera {
        /// Name of the view.
        view: String,
        /// What is wrong with it.
        problem: String,
    },
    /// Too few views remain to learn a shape from.
    #[error(
        "{remaining} of {views} views remain with the object in their mask{}; at least 2 are needed",
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
    #[error("step {step}: {loss} is not finite in {tensor} (view {view})")]
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
