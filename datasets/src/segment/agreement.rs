//! Masks of a network, or of any program that sees one image at a time, made to agree.

use mesh_core::{ByteImage, Camera};
use rayon::prelude::*;

use super::dissent::{Dissent, MOST, NOWHERE, Silhouette};
use super::region::Region;
use super::{LEAST, SegmentError};
use crate::mask::{fill_holes, keep_largest_part};
use crate::view::View;

/// Longer sides are averaged down to this; what is put right is larger than a pixel of it.
const LONGEST: usize = 256;
/// Cells along each side of the hull.
const SIDE: usize = 112;
/// Share of the other views that may be wrong about a place.
const TOLERANCE: f64 = 0.1;
/// What is put right in one view may tell of another.
const ROUNDS: usize = 2;

/// How much of the masks was put right, in pixels of all views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Agreement {
    /// Pixels that no longer are object: the other views' hull does not cover them.
    pub dropped: usize,
    /// Pixels that now are: the other views' hull shows them, and the mask had a gap there.
    pub filled: usize,
}

/// Keeps of each mask the largest part and fills its holes: all that can be done where there are no cameras.
pub fn tidy(mask: &mut ByteImage) {
    keep_largest_part(mask);
    fill_holes(mask);
}

/// Makes the masks of views agree through their cameras, each first [tidied](tidy).
///
/// A pixel stays where the visual hull of the other views' masks covers it. What the hull shows and the mask misses is
/// filled where it is a gap, that is wider than twice the rim by which a hull of so few views is too large everywhere;
/// the rim itself is left to the image. A tenth of the views may be wrong about a place.
///
/// # Errors
/// Fewer than three views, masks without a common place, or none at all.
///
/// # Cost
/// About 0.1 s of a core per view.
pub fn agree(views: &mut [View]) -> Result<Agreement, SegmentError> {
    if views.len() < LEAST {
        return Err(SegmentError::FewViews { found: views.len() });
    }
    views.par_iter_mut().for_each(|view| {
        keep_largest_part(&mut view.mask);
        // Holes may be real: the hull knows.
    });
    let seen: Vec<(&Camera, [usize; 4])> =
        views.iter().filter_map(|v| Some((&v.camera, v.mask_bounds()?))).collect();
    if seen.is_empty() {
        return Err(SegmentError::NoObject);
    }
    let region = Region::around_masks(&seen).ok_or(SegmentError::NoRegion)?;
    let tolerance = ((TOLERANCE * views.len() as f64) as usize).clamp(1, usize::from(MOST)) as u16;
    let mut sum = Agreement::default();
    for _ in 0..ROUNDS {
        let small: Vec<Silhouette> = views.par_iter().map(small).collect();
        let dissent = Dissent::count(&small, &region, SIDE);
        let Some(bounds) = dissent.bounds(tolerance) else { return Err(SegmentError::NoObject) };
        let dissent = Dissent::count(&small, &bounds, SIDE);
        let found = corrections(&small, &dissent, tolerance);
        let changes: Vec<Agreement> = views
            .par_iter_mut()
            .zip(&small)
            .zip(&found)
            .map(|((view, small), found)| found.apply(view, small))
            .collect();
        sum.dropped += changes.iter().map(|c| c.dropped).sum::<usize>();
        sum.filled += changes.iter().map(|c| c.filled).sum::<usize>();
    }
    Ok(sum)
}

fn small(view: &View) -> Silhouette {
    let (mask, camera) = view.mask_within(LONGEST, &view.camera);
    Silhouette { camera, mask }
}

/// What the other views make of one.
pub(super) struct Correction {
    /// Whether the others' hull covers a pixel.
    pub(super) covered: Vec<bool>,
    /// What it covers and the mask misses, where that is wider than the hull is too large everywhere.
    pub(super) gap: Vec<bool>,
}

/// What the others make of each view, where so many may be wrong about a place.
pub(super) fn corrections(
    views: &[Silhouette],
    dissent: &Dissent,
    tolerance: u16,
) -> Vec<Correction> {
    let covered: Vec<Vec<bool>> =
        views.par_iter().map(|view| covered(view, dissent, tolerance)).collect();
    let missing = |(view, covered): (&Silhouette, &Vec<bool>)| -> Vec<bool> {
        covered.iter().zip(&view.mask.data).map(|(c, m)| *c && !*m).collect()
    };
    let missing: Vec<Vec<bool>> = views.iter().zip(&covered).map(missing).collect();
    let count = |images: &[Vec<bool>]| images.iter().flatten().filter(|m| **m).count() as f64;
    let outlines: usize = views.par_iter().map(|view| view.mask.outline().count()).sum();
    // Every hull of silhouettes is too large by a rim that depends on how many there are.
    let rim = count(&missing) / (outlines as f64).max(1.0);
    let radius = (2.0 * rim).ceil() as usize + 1;
    views
        .par_iter()
        .zip(covered)
        .zip(missing)
        .map(|((view, covered), missing)| {
            let size = [view.camera.height, view.camera.width];
            // Wide, or far from the hull's own edge, where the rim is: a hole.
            let beside: Vec<bool> = covered.iter().map(|c| !c).collect();
            let near_edge = spread(&beside, size, radius, false);
            let wide = opened(&missing, size, radius);
            let gap =
                (0..missing.len()).map(|k| missing[k] && (wide[k] || !near_edge[k])).collect();
            Correction { covered, gap }
        })
        .collect()
}

/// The pixels that the others' hull covers.
fn covered(view: &Silhouette, dissent: &Dissent, tolerance: u16) -> Vec<bool> {
    let grown = view.mask.dilated();
    let seen = dissent.seen_by(&view.camera);
    let allowed =
        |(n, own): (u16, &bool)| n != NOWHERE && n.saturating_sub(u16::from(!own)) <= tolerance;
    seen.into_iter().zip(&grown.data).map(allowed).collect()
}

impl Correction {
    /// Puts one mask right, of any size.
    fn apply(&self, view: &mut View, small: &Silhouette) -> Agreement {
        let (h, w) = (small.camera.height, small.camera.width);
        let (height, width) = (view.mask.height, view.mask.width);
        let mut done = Agreement::default();
        for (at, m) in view.mask.data.iter_mut().enumerate() {
            let (i, j) = (at / width, at % width);
            let k = (2 * i + 1) * h / (2 * height) * w + (2 * j + 1) * w / (2 * width);
            if *m != 0 && !self.covered[k] {
                *m = 0;
                done.dropped += 1;
            } else if *m == 0 && self.gap[k] {
                *m = 255;
                done.filled += 1;
            }
        }
        done
    }
}

/// The pixels that a square of this radius reaches which fits in.
fn opened(image: &[bool], [height, width]: [usize; 2], radius: usize) -> Vec<bool> {
    let invert = |image: &[bool]| -> Vec<bool> { image.iter().map(|m| !m).collect() };
    // What is beyond the border is not known to fit.
    let shrunk = invert(&spread(&invert(image), [height, width], radius, true));
    spread(&shrunk, [height, width], radius, false)
}

/// The pixels within this many rows and columns of one that is set; `beyond` says what is outside of the image.
fn spread(image: &[bool], [height, width]: [usize; 2], radius: usize, beyond: bool) -> Vec<bool> {
    let line = |count: usize, get: &dyn Fn(usize) -> bool| -> Vec<bool> {
        let mut sums = vec![0usize; count + 1];
        (0..count).for_each(|k| sums[k + 1] = sums[k] + usize::from(get(k)));
        (0..count)
            .map(|k| {
                let cut = k < radius || k + radius >= count;
                let (from, to) = (k.saturating_sub(radius), (k + radius + 1).min(count));
                sums[to] > sums[from] || beyond && cut
            })
            .collect()
    };
    let mut rows = vec![false; image.len()];
    for i in 0..height {
        let found = line(width, &|j| image[i * width + j]);
        rows[i * width..][..width].copy_from_slice(&found);
    }
    let mut out = vec![false; image.len()];
    for j in 0..width {
        for (i, m) in line(height, &|i| rows[i * width + j]).into_iter().enumerate() {
            out[i * width + j] = m;
        }
    }
    out
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn what_is_thin_is_no_gap() {
        let text = ["........", ".####...", ".####..#", ".####...", "......##"];
        let image: Vec<bool> = text.concat().bytes().map(|b| b == b'#').collect();
        let found = opened(&image, [5, 8], 1);
        let wanted = ["........", ".####...", ".####...", ".####...", "........"];
        let wanted: Vec<bool> = wanted.concat().bytes().map(|b| b == b'#').collect();
        assert_eq!(found, wanted);
        assert_eq!(opened(&image, [5, 8], 0), image);
    }

    /// A ball of radius 0.7 with a rod through it, from around.
    fn views(count: usize) -> Vec<View> {
        (0..count)
            .map(|i| {
                let (sin, cos) = (i as f64 * std::f64::consts::TAU / count as f64).sin_cos();
                let eye = [4.0 * sin, [1.5, -1.5, 0.2][i % 3], 4.0 * cos];
                let camera = Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.6, 80, 70);
                let inside = |k: usize| {
                    let ray = camera.ray((k % 80) as f64 + 0.5, (k / 80) as f64 + 0.5);
                    let along: f64 = (0..3).map(|a| -ray.origin[a] * ray.direction[a]).sum();
                    let apart = ray.origin.iter().map(|o| o * o).sum::<f64>() - along * along;
                    let rod = |t: f64| {
                        let p: [f64; 3] =
                            std::array::from_fn(|a| ray.origin[a] + t * ray.direction[a]);
                        p[1].abs() < 1.0 && p[0].hypot(p[2]) < 0.15
                    };
                    apart < 0.49 || (-60..60).any(|k| rod(along + 0.02 * f64::from(k)))
                };
                let data = (0..70 * 80).map(|k| if inside(k) { 255 } else { 0 }).collect();
                let mask = ByteImage { height: 70, width: 80, channels: 1, data };
                let color = ByteImage::new(70, 80, 3);
                View { name: i.to_string(), color, mask, camera, depth: None, crop: None }
            })
            .collect()
    }

    fn off(a: &View, b: &View) -> usize {
        a.mask.data.iter().zip(&b.mask.data).filter(|(a, b)| a != b).count()
    }

    #[test]
    fn views_put_each_other_right() {
        let truth = views(24);
        let mut spoiled = truth.clone();
        let mut paint =
            |view: usize, rows: std::ops::Range<usize>, columns: std::ops::Range<usize>, value| {
                for i in rows {
                    spoiled[view].mask.data[i * 80..][columns.clone()].fill(value);
                }
            };
        // A bite, a hole, and something else that hangs on the object.
        paint(2, 25..45, 20..36, 0);
        paint(5, 30..40, 36..46, 0);
        paint(9, 36..52, 50..80, 255);
        let before: usize = truth.iter().zip(&spoiled).map(|(a, b)| off(a, b)).sum();
        let found = agree(&mut spoiled).unwrap();
        let after: usize = truth.iter().zip(&spoiled).map(|(a, b)| off(a, b)).sum();
        assert!(before > 500, "{before}");
        // What is left lies in the rim by which a hull is too large.
        assert!(after < before / 4, "{before} pixels were wrong, {after} are: {found:?}");
        assert!(found.dropped > 200 && found.filled > 250, "{found:?}");
        for (k, (a, b)) in truth.iter().zip(&spoiled).enumerate() {
            assert!(off(a, b) < 90, "view {k}: {}", off(a, b));
        }
    }

    #[test]
    fn what_agrees_is_left_alone() {
        let truth = views(12);
        let mut same = truth.clone();
        let found = agree(&mut same).unwrap();
        assert!(found.dropped + found.filled < 20, "{found:?}");
        assert_eq!(agree(&mut same[..2]).unwrap_err(), SegmentError::FewViews { found: 2 });
        for view in &mut same {
            view.mask.data.fill(0);
        }
        assert_eq!(agree(&mut same).unwrap_err(), SegmentError::NoObject);
    }
}
