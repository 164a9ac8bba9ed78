//! Do outlines fit together? Both ways, and in pixels: what of each mask no other view allows, and what all others allow
//! beside it.
//!
//! A point of an outline is seen along a ray that touches the object, so somewhere on that ray is a point that every other view
//! sees within its outline. Where none is, the deepest comes short of it by a number of pixels, the *gap*; this is the
//! silhouette coherence of Hernández, Schmitt and Cipolla 2007 (*Silhouette Coherence for Camera Calibration under Circular
//! Motion*), measured between pixels instead of by the overlap of areas, which saturates where errors are small.

use std::cell::Cell;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::hull::Sphere;
use super::partners::partners;
use super::silhouette::Silhouette;

/// Places on each outline that are looked at.
const OUTLINE: usize = 160;
/// Pixels inside and beside each mask that are looked at.
const PIXELS: usize = 320;
/// What rounding to pixels explains.
const TOLERANCE: f32 = 1.0;
/// How far from a mask what the others allow is counted, pixels.
const BESIDE: f32 = 12.0;
/// Gaps are counted up to this, so that one wild view does not make the mean.
const MOST_GAP: f32 = 8.0;
/// Views that are looked at before it is asked whether that is enough.
const AT_ONCE: usize = 6;
/// Steps along a ray, before those that look closer.
const COARSE: usize = 72;

/// How one view fits the others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Coherence {
    /// Share of the mask that the hull of the other views misses by more than a pixel.
    pub missing: f64,
    /// What that hull covers beside the mask by more than a pixel and up to 12, as a share of the mask. It is above 0 for good views
    /// too: a hull is larger than the object, the more so the fewer the views.
    pub excess: f64,
    /// Mean gap between the outline and what the others allow, pixels of an image of at most 320: about 0.1 for exact views.
    pub gap: f64,
}

/// The silhouettes of a set of views, and where the object is.
pub(super) struct Outlines<'a> {
    pub(super) views: &'a [Silhouette],
    pub(super) sphere: Sphere,
}

impl Outlines<'_> {
    /// Each view against its [partners]; none where its mask is empty.
    pub(super) fn coherence(&self) -> Vec<Option<Coherence>> {
        (0..self.views.len()).into_par_iter().map(|k| self.of(k)).collect()
    }

    fn of(&self, k: usize) -> Option<Coherence> {
        let view = &self.views[k];
        if view.area == 0 {
            return None;
        }
        let others = self.others(k);
        let share = |range, wanted: &dyn Fn(f32) -> bool, enough: f32| {
            let (count, pixels) = view.pixels(range, PIXELS);
            let found =
                pixels.iter().filter(|p| wanted(self.deepest(k, **p, &others, enough).0)).count();
            count as f64 * found as f64 / pixels.len().max(1) as f64 / view.area as f64
        };
        Some(Coherence {
            missing: share(f32::NEG_INFINITY..0.0, &|d| d > TOLERANCE, TOLERANCE),
            excess: share(TOLERANCE..BESIDE, &|d| d <= 0.0, 0.0),
            gap: self.gaps(k, OUTLINE).map(|(gap, _)| f64::from(gap)).sum::<f64>()
                / view.outline(OUTLINE).len().max(1) as f64,
        })
    }

    /// The mean gap over all outlines, of at most so many places on each. Where it is sure to be more than `most` some number above that.
    pub(super) fn mean_gap(&self, places: usize, most: f64) -> f64 {
        let count: usize = self.views.iter().map(|view| view.outline(places).len()).sum();
        let mut sum = 0.0;
        for first in (0..self.views.len()).step_by(AT_ONCE) {
            let some = first..self.views.len().min(first + AT_ONCE);
            let gaps = |k: usize| self.gaps(k, places).map(|(gap, _)| f64::from(gap)).sum::<f64>();
            let sums: Vec<f64> = some.into_par_iter().map(gaps).collect();
            sum = sums.iter().fold(sum, |sum, more| sum + more);
            // No gap is negative.
            if sum > most * count as f64 {
                break;
            }
        }
        if count == 0 { f64::from(MOST_GAP) } else { sum / count as f64 }
    }

    /// For each pair of views how much of the first one's outline the second is the one to refuse, pixels of gap in the mean.
    pub(super) fn blame(&self) -> Vec<Vec<f64>> {
        let count = self.views.len();
        (0..count)
            .into_par_iter()
            .map(|k| {
                let mut row = vec![0.0; count];
                let mut places = 0.0f64;
                for (gap, by) in self.gaps(k, OUTLINE) {
                    places += 1.0;
                    if let Some(by) = by {
                        row[by] += f64::from(gap);
                    }
                }
                for blame in &mut row {
                    *blame /= places.max(1.0);
                }
                row
            })
            .collect()
    }

    /// The gap at each place of a view's outline, and the view that leaves it.
    fn gaps(&self, k: usize, places: usize) -> impl Iterator<Item = (f32, Option<usize>)> {
        let others = self.others(k);
        self.views[k].outline(places).map(move |place| {
            let (depth, by) = self.deepest(k, place, &others, 0.0);
            (depth.clamp(0.0, MOST_GAP), by)
        })
    }

    /// The [partners] of a view that have a mask, those first that look from elsewhere: they refuse soonest.
    fn others(&self, k: usize) -> Vec<usize> {
        let forward = self.views[k].camera.forward();
        let mut order: Vec<(f64, usize)> = partners(k, self.views.len())
            .filter(|&i| self.views[i].area > 0)
            .map(|i| (forward.dot(&self.views[i].camera.forward()).abs(), i))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        order.into_iter().map(|(_, i)| i).collect()
    }

    /// The least, along the ray of a place in view `k`, of the largest distance that any other view has there (negative where
    /// all see the point within their outlines), and the view that has it. `enough` ends the search.
    fn deepest(
        &self,
        k: usize,
        [column, row]: [f64; 2],
        others: &[usize],
        enough: f32,
    ) -> (f32, Option<usize>) {
        let view = &self.views[k];
        let ray = view.camera.ray(column, row);
        let Sphere { center, radius } = self.sphere;
        let middle: f64 = (0..3).map(|a| (center[a] - ray.origin[a]) * ray.direction[a]).sum();
        let best = Cell::new((f32::INFINITY, None, middle));
        let visit = |t: f64| -> bool {
            if t <= 0.0 && view.camera.is_perspective() {
                return false;
            }
            let p = std::array::from_fn(|a| ray.origin[a] + t * ray.direction[a]);
            let (mut worst, mut by) = (f32::NEG_INFINITY, None);
            for &i in others {
                let d = self.views[i].at(p);
                if d > worst {
                    (worst, by) = (d, Some(i));
                    if worst >= best.get().0 {
                        return false;
                    }
                }
            }
            best.set((worst, by, t));
            worst <= enough
        };
        let step = 2.0 * radius / COARSE as f64;
        // From the middle outwards: most objects are there.
        let found = (0..COARSE).any(|s| {
            let side = if s % 2 == 0 { 0.5 } else { -0.5 };
            visit(middle + side * step * (s + 1 - s % 2) as f64)
        });
        if !found && best.get().0.is_finite() {
            let mut width = step / 2.0;
            for _ in 0..4 {
                let at = best.get().2;
                if visit(at - width) || visit(at + width) {
                    break;
                }
                width /= 2.0;
            }
        }
        (best.get().0, best.get().1)
    }
}
