//! Masks that are made here: by a network, or by the colours of all views.

use datasets::{SegmentError, View, agree, segment_by_color, tidy};
use mesh_core::ByteImage;
use serde::Serialize;

use crate::args::Masking;
use crate::console::Console;
use crate::failure::Failure;
use crate::progress::Progress;

/// How the masks were made, and what was put right.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(crate) struct Made {
    /// Pixels of all views that the network called object and the other views do not.
    pub(crate) dropped: usize,
    /// Pixels of all views that the network missed.
    pub(crate) filled: usize,
}

/// Gives all views masks; `cameras` says whether they have cameras to agree by.
pub(crate) fn make(
    console: Console,
    masking: &Masking,
    views: &mut [View],
    cameras: bool,
) -> Result<Made, Failure> {
    let masks = if masking.model.is_some() {
        estimated(console, masking, views)?
    } else {
        let progress = Progress::in_shares(console, "mask");
        segment_by_color(views, masking.region, &|done, all| progress.set(done, all))
            .map_err(Failure::input)?
    };
    for (view, mask) in views.iter_mut().zip(masks) {
        view.mask = mask;
    }
    if masking.model.is_none() {
        return Ok(Made::default());
    }
    let found = if cameras { agree(views) } else { Err(SegmentError::NoRegion) };
    match found {
        Ok(agreement) => {
            return Ok(Made { dropped: agreement.dropped, filled: agreement.filled });
        }
        Err(error @ (SegmentError::FewViews { .. } | SegmentError::NoObject)) => {
            console.warn(error);
        }
        Err(_) => {
            console
                .remark("no cameras: each mask keeps its largest part, and its holes are filled");
        }
    }
    for view in views {
        tidy(&mut view.mask);
    }
    Ok(Made::default())
}

#[cfg(not(feature = "onnx"))]
fn estimated(_: Console, masking: &Masking, _: &[View]) -> Result<Vec<ByteImage>, Failure> {
    Err(Failure::Usage(format!(
        "{}: this unsphere was built without the feature onnx, which runs networks; build it with \
         cargo install --path cli --features onnx",
        masking.model.as_deref().unwrap_or_else(|| std::path::Path::new("--model")).display()
    )))
}

#[cfg(feature = "onnx")]
fn estimated(
    console: Console,
    masking: &Masking,
    views: &[View],
) -> Result<Vec<ByteImage>, Failure> {
    let Some(model) = &masking.model else { return Ok(Vec::new()) };
    let estimator =
        datasets::MaskEstimator::open(model, masking.kind.input()).map_err(Failure::input)?;
    let progress = Progress::new(console, "mask");
    let mask = |(done, view): (usize, &View)| {
        progress.set(done, views.len());
        estimator.mask(&view.color).map_err(Failure::input)
    };
    views.iter().enumerate().map(mask).collect()
}
