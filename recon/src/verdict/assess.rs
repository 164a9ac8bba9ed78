//! All that is said of a fit: its verdict, what that is made of, and pictures of where it is worst.

use datasets::Views;
use diff_raster::FacesError;
use mesh_core::ByteImage;

use super::evidence::cameras;
use super::{Evidence, Verdict, disagreement, judge};
use crate::fit::Fitted;

/// Views that are listed.
const LISTED: usize = 8;
/// Views that are shown.
const SHOWN: usize = 6;
/// Views are shown that differ by more than this share of their mask.
const DIFFERS: f64 = 0.002;

/// A fit, assessed.
#[derive(Clone, Debug)]
pub struct Assessment {
    /// The verdict.
    pub verdict: Verdict,
    /// What it is made of; of the views the eight that disagree most.
    pub evidence: Evidence,
    /// The names of those [problems](crate::inspect::Problem) that an inspection of the views may find and the verdict says
    /// already.
    pub said: Vec<&'static str>,
    /// The worst of these as pictures.
    pub pictures: Vec<WorstView>,
}

/// A view in which mesh and mask differ.
#[derive(Clone, Debug)]
pub struct WorstView {
    /// Its name and how it differs, in words.
    pub caption: String,
    /// The view in grey: orange is what the mesh misses of the mask, blue what it covers beside it, pale within a pixel.
    pub difference: ByteImage,
    /// The view as it is, of the same size.
    pub photograph: ByteImage,
}

/// Assesses a fit by the views that it was made of, whose images and masks must still be there.
///
/// # Cost
/// As [`Evidence::of`].
///
/// # Errors
/// If a face names a vertex that is not there.
pub fn assess(views: &Views, fitted: &Fitted) -> Result<Assessment, FacesError> {
    let mut evidence = Evidence::of(views, fitted)?;
    let (mut verdict, said) = (judge(&evidence), evidence.said());
    if fitted.ended.is_cancelled() {
        verdict = verdict.interrupted(fitted.history.len());
    }
    let differ = evidence.views.iter().filter(|view| view.missing + view.excess > DIFFERS);
    let pictures = differ
        .take(SHOWN)
        .map(|found| {
            let view = &views.views[found.index];
            let camera = cameras(fitted, &views.views, found.index);
            let [difference, photograph] = disagreement::picture(&fitted.mesh, view, camera)?;
            Ok(WorstView {
                caption: format!(
                    "view {}: IoU {:.3}, {:.1} % missing (orange), {:.1} % too much (blue)",
                    found.name,
                    found.mask_iou,
                    100.0 * found.missing,
                    100.0 * found.excess
                ),
                difference,
                photograph,
            })
        })
        .collect::<Result<_, FacesError>>()?;
    evidence.views.truncate(LISTED);
    Ok(Assessment { verdict, evidence, said, pictures })
}
