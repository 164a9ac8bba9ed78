//! From evidence to a verdict.

use mesh_core::Examination;

use super::{Disagreement, Evidence, Grade, Verdict};
use crate::inspect::Coherence;

// The bounds below are chosen on the fits of the example `verdicts` with its seeds for choosing; `docs/verdict.md` has how they
// do on others.

/// Mean mask IoU of held-out views below which a fit failed, and below which it is doubtful.
const IOU: [f64; 2] = [0.6, 0.98];
/// One view disagrees where its IoU is below this.
const VIEW_IOU: f64 = 0.85;
/// A piece of this share of a mask, in one view, is a part that is missing or too much.
const PIECE: f64 = 0.02;
/// Pixels of gap between outlines that exact cameras and masks do not leave.
const GAP: f64 = 0.35;
/// Pixels between the masks' edges and those of the images.
const EDGE: f64 = 0.7;
/// What masks show that no body can, as a share of the masks.
const MISSING: f64 = 0.01;
/// What the hull has beside the masks, as a share of the masks, where the views leave the shape open.
const EXCESS: f64 = 0.1;
/// Share of directions that no view shows.
const UNSEEN: f64 = 0.3;
/// Views below which any shape is a guess.
const FEW: usize = 7;
/// Pixels, of images brought to 320 at most, that cameras were moved by beyond which their frame is not sure.
const MOTION: f64 = 3.0;
/// Share of the views that the border of the image cuts.
const CUT: f64 = 0.1;
/// A view whose IoU is so much below the mean stands apart from the others; cameras or masks may be why.
const APART: f64 = 0.1;
/// Below this mask IoU more than the shape may be wrong.
const AGREES: f64 = 0.9;

/// Weighs the evidence, of all views: where only the worst are left, as [`assess`](super::assess) has them, shares of views are
/// those of the worst.
pub fn judge(evidence: &Evidence) -> Verdict {
    let mut reasons: Vec<(Grade, String)> = Vec::new();
    let mut say = |grade, text: String| reasons.push((grade, text));
    let iou = evidence.mask_iou;
    for (bound, grade) in IOU.into_iter().zip([Grade::Failed, Grade::Doubtful]) {
        if iou < bound {
            let all_fitted = evidence.fitted_views == evidence.views.len();
            let which = if all_fitted { "the fitted" } else { "held-out" };
            say(grade, format!("the mask IoU on {which} views is {iou:.3}, below {bound}"));
            break;
        }
    }
    if !evidence.closed {
        say(Grade::Failed, "the mesh is not closed".to_owned());
    }
    disagreements(evidence, &mut say);
    masks(evidence, &mut say);
    views(evidence, &mut say);
    if let Some(text) = Examination::crossings_of(evidence.self_intersections) {
        say(Grade::Doubtful, text);
    }
    let grade = reasons.iter().map(|(grade, _)| *grade).max().unwrap_or(Grade::Good);
    reasons.sort_by_key(|reason| std::cmp::Reverse(reason.0));
    Verdict { grade, reasons: reasons.into_iter().map(|(_, text)| text).collect() }
}

impl Evidence {
    /// Whether cameras and masks agree so well with one another that what is wrong with a fit is not to be looked for in them:
    /// then [`inspect_views`](crate::inspect::inspect_views) has nothing to say.
    pub fn is_coherent(&self) -> bool {
        let fits = |c: Coherence| c.gap <= GAP && c.missing <= MISSING && c.excess <= EXCESS;
        let apart = |view: &Disagreement| view.mask_iou < self.mask_iou - APART;
        self.mask_iou >= AGREES
            && self.coherence.is_some_and(fits)
            && self.lens.is_none()
            && self.mask_edge.is_none_or(|edge| edge.abs() <= EDGE)
            && self.motion <= MOTION
            && !self.views.iter().any(apart)
    }
}

impl Evidence {
    /// What of that which [`inspect_views`](crate::inspect::inspect_views) may find the verdict says already, by the names of its
    /// problems: with figures of the views that were fitted, under the cameras that the mesh agrees with, so that they differ.
    pub(super) fn said(&self) -> Vec<&'static str> {
        let gap = self.coherence.is_some_and(|coherence| coherence.gap > GAP);
        let edge = self.mask_edge.is_some_and(|edge| edge.abs() > EDGE);
        [
            (self.lens.is_some(), &["focal_length", "principal_point"][..]),
            (edge, &["large_masks", "small_masks"]),
            (gap, &["loose_cameras"]),
            (self.unseen.0 > UNSEEN, &["one_sided"]),
            (self.cut().is_some(), &["out_of_frame"]),
        ]
        .into_iter()
        .filter(|(is_said, _)| *is_said)
        .flat_map(|(_, kinds)| kinds.iter().copied())
        .collect()
    }

    /// The views that have what is asked for, in words; none where there is none.
    fn named(&self, wanted: &dyn Fn(&Disagreement) -> bool) -> Option<String> {
        let names: Vec<&str> =
            self.views.iter().filter(|v| wanted(v)).map(|v| v.name.as_str()).collect();
        match names.len() {
            0 => None,
            1 => Some(format!("view {}", names[0])),
            2..=4 => Some(format!("views {}", names.join(", "))),
            n => Some(format!("{n} views ({}, ..)", names[..3].join(", "))),
        }
    }

    /// The views in which the border cuts the object, where those are too many.
    fn cut(&self) -> Option<String> {
        let cut = self.count(|view| view.cut);
        let too_many = cut as f64 > CUT * self.views.len() as f64;
        self.named(&|view| view.cut).filter(|_| too_many)
    }
}

/// Where mesh and masks differ.
fn disagreements(evidence: &Evidence, say: &mut impl FnMut(Grade, String)) {
    let named = |wanted: &dyn Fn(&Disagreement) -> bool| evidence.named(wanted);
    if let Some(names) = named(&|view| view.mask_iou < VIEW_IOU) {
        let verb = if evidence.count(|view| view.mask_iou < VIEW_IOU) == 1 {
            "disagrees"
        } else {
            "disagree"
        };
        say(Grade::Doubtful, format!("{names} {verb} with the mesh (mask IoU below {VIEW_IOU})"));
    }
    if let Some(names) =
        named(&|view| view.holes > 0).filter(|_| evidence.count(|v| v.holes > 0) > 1)
    {
        let text = format!("masks have holes that the mesh covers, in {names}");
        say(Grade::Doubtful, text);
    }
    if let Some(names) = named(&|view| view.largest > PIECE) {
        say(Grade::Doubtful, format!("a part is missing, or is too much, in {names}"));
    }
}

/// What masks and cameras say of each other.
fn masks(evidence: &Evidence, say: &mut impl FnMut(Grade, String)) {
    let Some(coherence) = evidence.coherence else {
        say(Grade::Doubtful, "cameras and masks fix no body".to_owned());
        return;
    };
    if coherence.gap > GAP {
        let text = format!(
            "outlines miss one another by {:.2} pixels in the mean, in images brought to 320 at most: cameras or masks are off",
            coherence.gap
        );
        say(Grade::Doubtful, text);
    }
    if coherence.missing > MISSING {
        let text = format!(
            "{:.1} % of the masks lie where other views see no object: masks show something else, or cameras are off",
            100.0 * coherence.missing
        );
        say(Grade::Doubtful, text);
    }
    if coherence.excess > EXCESS {
        let text = format!(
            "the views leave the shape open: what they allow covers {:.0} % of a mask beside it",
            100.0 * coherence.excess
        );
        say(Grade::Doubtful, text);
    }
    if let Some(lens) = evidence.lens {
        let [right, down] = lens.shift;
        let text = format!(
            "another lens explains the masks better: {:.3} times the focal length given (--focal-scale), the principal point \
             {right:+.1} pixels to the right and {down:+.1} down",
            lens.focal
        );
        say(Grade::Doubtful, text);
    }
    if let Some(edge) = evidence.mask_edge.filter(|edge| edge.abs() > EDGE) {
        let word = if edge < 0.0 { "larger" } else { "smaller" };
        let text = format!(
            "the masks are about {:.1} pixels {word} than the object in the images, brought to 320 pixels at most",
            edge.abs()
        );
        say(Grade::Doubtful, text);
    }
    if evidence.motion > MOTION {
        let text = format!(
            "the cameras had to be moved by {:.1} pixels, in images brought to 320 at most",
            evidence.motion
        );
        say(Grade::Doubtful, text);
    }
}

/// What the views do not show.
fn views(evidence: &Evidence, say: &mut impl FnMut(Grade, String)) {
    if evidence.fitted_views < FEW {
        let text =
            format!("{} views are few: what lies between them is a guess", evidence.fitted_views);
        say(Grade::Doubtful, text);
    }
    let (share, side) = &evidence.unseen;
    if *share > UNSEEN {
        let text = format!(
            "no view shows the side towards {side} ({:.0} % of all directions)",
            100.0 * share
        );
        say(Grade::Doubtful, text);
    }
    if let Some(cut) = evidence.cut() {
        let text = format!("the object is out of frame in {cut}, of {}", evidence.views.len());
        say(Grade::Doubtful, text);
    }
}
