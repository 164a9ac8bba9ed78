//! The focal length and principal point, common to all views, under which the outlines fit together best.

use mesh_core::Camera;
use serde::{Deserialize, Serialize};

use super::coherence::Outlines;
use super::hull::Sphere;
use super::silhouette::Silhouette;

/// Views that the search looks at.
const VIEWS: usize = 24;
/// Places on each of their outlines.
const PLACES: usize = 60;
/// The first steps: logarithm of the focal length's factor, and pixels. They are halved so many times.
const STEPS: [f64; 3] = [0.08, 2.0, 2.0];
const HALVINGS: u32 = 4;
/// Room for what another focal length makes larger.
const ROOM: f64 = 1.3;

/// A lens that explains the outlines better than the one given.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LensFit {
    /// The focal length, times the one given.
    pub focal: f64,
    /// What the principal point is to be moved by, pixels of the first view and in others in proportion to their size: right, down.
    pub shift: [f64; 2],
    /// The mean gap with the lens that is given; see [`Coherence::gap`](super::Coherence::gap).
    pub given: f64,
    /// The mean gap with this one.
    pub gap: f64,
}

/// Looks for a better lens by a pattern search; none where a lens does not divide by depth.
pub(super) fn best_lens(outlines: &Outlines<'_>) -> Option<LensFit> {
    if !outlines.views.iter().all(|view| view.camera.is_perspective()) {
        return None;
    }
    let step = outlines.views.len().div_ceil(VIEWS).max(1);
    let views: Vec<&Silhouette> = outlines.views.iter().step_by(step).collect();
    let sphere = Sphere { radius: ROOM * outlines.sphere.radius, ..outlines.sphere };
    let gap = |at: [f64; 3], most: f64| {
        let moved: Vec<Silhouette> =
            views.iter().map(|view| view.with(with_lens(view, at))).collect();
        Outlines { views: &moved, sphere }.mean_gap(PLACES, most)
    };
    let mut best = [0.0; 3];
    let given = gap(best, f64::INFINITY);
    let mut least = given;
    let mut steps = STEPS;
    for _ in 0..=HALVINGS {
        loop {
            let before = least;
            for k in 0..3 {
                for sign in [-1.0, 1.0] {
                    let mut at = best;
                    at[k] += sign * steps[k];
                    if at[0].abs() > 0.5 {
                        continue;
                    }
                    let found = gap(at, least);
                    if found < least {
                        (best, least) = (at, found);
                    }
                }
            }
            if least >= before {
                break;
            }
        }
        steps = steps.map(|step| 0.5 * step);
    }
    let first = views.first()?;
    let scale = first.scale * first.window.enlarged();
    let shift = [best[1] * scale, best[2] * scale];
    Some(LensFit { focal: best[0].exp(), shift, given, gap: least })
}

/// The same aside of all images, in proportion to their sizes.
fn with_lens(view: &Silhouette, [focal, right, down]: [f64; 3]) -> Camera {
    let camera = &view.camera;
    let [right, down] = [right, down].map(|pixels| pixels * view.window.enlarged());
    let [fx, fy, cx, cy] = camera.lens.numbers();
    let factor = focal.exp();
    let lens = camera.lens.with([fx * factor, fy * factor, cx + right, cy + down]);
    Camera { lens, ..camera.clone() }
}
