//! How far away each pixel's surface is, from what several photographs show alike.
//!
//! A surface before a camera is moved away from it step by step; at each step the neighbouring photographs are drawn as that surface
//! would show them to the camera. Where they agree with its own photograph, window by window, is the surface that was photographed. They
//! are compared by normalised cross-correlation, which does not see how bright a photograph is or how much contrast it has: so light
//! may stand still while the object turns. Of several neighbours the best few count, since not all see what the camera sees.
//!
//! At first these surfaces are planes, and the search is along all of each ray that the fitted mesh encloses: what masks allow and no
//! outline shows. Later they are the mesh itself, moved by a few pixels, whose slant the windows then share.
//!
//! # References
//! Collins 1996, *A space-sweep approach to true multi-image matching*; Kang, Szeliski and Chai 2001, *Handling occlusions in dense
//! multi-view stereo* (the best of the neighbours); Merrell et al. 2007, *Real-time visibility-based fusion of depth maps*
//! (confirmation and contradiction by other views).

use std::ops::Range;

use diff_raster::Faces;
use mesh_core::vector::dot;
use rayon::prelude::*;

use super::correlation::{Sums, Windows};
use super::gray_image::{Drawn, GrayImage};

/// Neighbours that an image is compared with, and how many of them count.
const NEIGHBORS: (usize, usize) = (5, 2);
/// Angles between the directions of neighbours, in radians, at least and at most.
const ANGLES: [f32; 2] = [0.07, 0.9];
/// The angle that is liked best.
const LIKED: f32 = 0.4;
/// How far a point moves in the farthest neighbour from one plane to the next, in pixels.
const STEP: f32 = 0.8;
/// Planes at least and at most.
const PLANES: [usize; 2] = [8, 256];
/// Surfaces before the mesh, and as many behind it.
const AROUND: usize = 4;
/// The correlation from which on photographs agree.
const AGREES: f32 = 0.7;
/// By how much a peak is higher than all that is farther from it than [`NEAR`] surfaces: of planes, where depth is all that is to be had,
/// and around the mesh, which may be right already.
const DISTINCT: [f32; 2] = [0.0, 0.1];
/// Surfaces beside a peak that may be nearly as high.
const NEAR: usize = 2;
/// How far other depth maps may be off a point that they confirm, in pixels of it.
const TOLERANCE: f32 = 1.5;
/// Other depth maps that must confirm a point.
const CONFIRMATIONS: usize = 1;

/// The depth of each pixel along the optical axis; NaN where none was found.
pub(super) type DepthMap = Vec<f32>;

/// Of the rays that the mesh encloses, all views' depths.
pub(super) fn sweep(
    images: &[GrayImage],
    positions: &[[f32; 3]],
    faces: &[[u32; 3]],
) -> Vec<DepthMap> {
    let over = |faces: &[[u32; 3]]| Faces::of_valid(positions.len(), faces);
    let backs: Vec<[u32; 3]> = faces.iter().map(|&[a, b, c]| [a, c, b]).collect();
    let (fronts, backs) = (over(faces), over(&backs));
    of_each(images, |image, neighbors| {
        let mut drawn = Drawn::default();
        let mut range = vec![[f32::INFINITY, f32::NEG_INFINITY]; image.mask.len()];
        for (end, faces) in [&fronts, &backs].into_iter().enumerate() {
            image.draw(positions, faces, &mut drawn);
            for (pixel, range) in range.iter_mut().enumerate() {
                if let (true, Some((_, depth))) = (image.mask[pixel], drawn.at(pixel)) {
                    range[end] = depth;
                }
            }
        }
        let planes = planes(image, neighbors, &range);
        let surface = |plane: usize, _: usize| planes[plane];
        let counts = |plane: usize, pixel: usize| {
            // One plane before the mesh too, so that the mesh itself can be a peak.
            let [near, far] = range[pixel];
            let next = planes.get(plane + 1).copied().unwrap_or(f32::INFINITY);
            near < far && next >= near && planes[plane] <= far
        };
        best(image, neighbors, planes.len(), &surface, &counts, DISTINCT[0])
    })
}

/// Of the neighbourhood of the mesh, all views' depths.
pub(super) fn around(
    images: &[GrayImage],
    positions: &[[f32; 3]],
    faces: &[[u32; 3]],
) -> Vec<DepthMap> {
    let faces = Faces::of_valid(positions.len(), faces);
    of_each(images, |image, neighbors| {
        let mut drawn = Drawn::default();
        image.draw(positions, &faces, &mut drawn);
        let depth: Vec<f32> = (0..image.mask.len())
            .map(|pixel| drawn.at(pixel).map_or(f32::NAN, |(_, depth)| depth))
            .collect();
        let middle = depth.iter().copied().find(|d| !d.is_nan()).unwrap_or(1.0);
        // How much depth moves a point by a step in the neighbour in which it moves most.
        let unit = image.width_at(middle) * image.depth_per_unit();
        let step = STEP * unit / shift(image, neighbors, middle, middle + unit).max(0.05);
        let surface = |k: usize, pixel: usize| depth[pixel] + (k as f32 - AROUND as f32) * step;
        // What is best at the end of the search is not a peak.
        let counts = |k: usize, pixel: usize| k > 0 && k < 2 * AROUND && !depth[pixel].is_nan();
        best(image, neighbors, 2 * AROUND + 1, &surface, &counts, DISTINCT[1])
    })
}

/// How well views agree about the mesh: the mean, over pixels that show something, of the correlation with the neighbours that agree
/// best.
pub(super) fn agreement(images: &[GrayImage], positions: &[[f32; 3]], faces: &[[u32; 3]]) -> f64 {
    let faces = Faces::of_valid(positions.len(), faces);
    let one = |view: usize| {
        let (image, neighbors) = (&images[view], neighbors(images, view));
        let kept = NEIGHBORS.1.min(neighbors.len());
        let mut drawn = Drawn::default();
        image.draw(positions, &faces, &mut drawn);
        let depth = |pixel: usize| drawn.at(pixel).map_or(f32::NAN, |(_, depth)| depth);
        let (own, mut sums) = (Windows::new(image), Sums::default());
        let mut warped = vec![0.0; image.mask.len()];
        let mut scores: Vec<Vec<f32>> = vec![warped.clone(); neighbors.len()];
        let rows = 0..image.size[1];
        for (other, score) in neighbors.iter().zip(&mut scores) {
            warp(image, other, rows.clone(), &depth, &mut warped);
            own.correlate(&warped, rows.clone(), &mut sums, score);
        }
        let mut sum = [0.0; 2];
        for pixel in (0..image.mask.len()).filter(|_| kept > 0) {
            if image.mask[pixel] && own.is_textured(pixel) && !depth(pixel).is_nan() {
                let score = f64::from(mean_of_best(&scores, pixel, kept));
                sum = [sum[0] + score, sum[1] + 1.0];
            }
        }
        sum
    };
    let sums: Vec<[f64; 2]> = (0..images.len()).into_par_iter().map(one).collect();
    let [sum, count] = [0, 1].map(|k| sums.iter().map(|sum| sum[k]).sum::<f64>());
    sum / count.max(1.0)
}

/// Depths view by view, and of these what others confirm.
fn of_each(
    images: &[GrayImage],
    found: impl Fn(&GrayImage, &[&GrayImage]) -> DepthMap + Sync,
) -> Vec<DepthMap> {
    let all = 0..images.len();
    let one = |k: usize| found(&images[k], &neighbors(images, k));
    let maps: Vec<DepthMap> = all.clone().into_par_iter().with_max_len(1).map(one).collect();
    all.into_par_iter().map(|k| confirmed(images, &maps, k)).collect()
}

/// The views that a view is compared with: near enough to show the same, far enough apart for depth to be seen.
fn neighbors(images: &[GrayImage], view: usize) -> Vec<&GrayImage> {
    let from = images[view].from;
    let mut found: Vec<(f32, usize)> = images
        .iter()
        .enumerate()
        .map(|(k, other)| (dot(from, other.from).clamp(-1.0, 1.0).acos(), k))
        .filter(|&(angle, k)| k != view && (ANGLES[0]..=ANGLES[1]).contains(&angle))
        .map(|(angle, k)| ((angle / LIKED).ln().abs(), k))
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found.iter().take(NEIGHBORS.0).map(|&(_, k)| &images[k]).collect()
}

/// How far a point before the middle of an image moves in the neighbour in which it moves most, in pixels.
fn shift(image: &GrayImage, neighbors: &[&GrayImage], near: f32, far: f32) -> f32 {
    let [x, y] = image.size.map(|s| 0.5 * s as f32);
    let ends = [near, far].map(|depth| image.point(x, y, depth));
    let one = |other: &&GrayImage| {
        let [a, b] = ends.map(|p| other.project(p));
        (a[0] - b[0]).hypot(a[1] - b[1])
    };
    neighbors.iter().map(one).fold(0.0, f32::max)
}

/// The depths of the planes: a point moves by [`STEP`] from one to the next where it moves most.
fn planes(image: &GrayImage, neighbors: &[&GrayImage], range: &[[f32; 2]]) -> Vec<f32> {
    let known = range.iter().filter(|r| r[0] < r[1]);
    let [near, far] = known
        .fold([f32::INFINITY, f32::NEG_INFINITY], |[near, far], r| [near.min(r[0]), far.max(r[1])]);
    if near >= far {
        return Vec::new();
    }
    let longest = shift(image, neighbors, near, far);
    let count = ((longest / STEP).ceil() as usize).clamp(PLANES[0], PLANES[1]);
    let between = |k: usize| {
        let share = k as f32 / (count - 1) as f32;
        if image.perspective {
            1.0 / (1.0 / near + share * (1.0 / far - 1.0 / near))
        } else {
            near + share * (far - near)
        }
    };
    (0..count).map(between).collect()
}

/// The depth of each pixel at which the neighbours agree best, of `count` surfaces from the nearest to the farthest; `counts` says which
/// of them a pixel is searched on.
fn best(
    image: &GrayImage,
    neighbors: &[&GrayImage],
    count: usize,
    surface: &dyn Fn(usize, usize) -> f32,
    counts: &dyn Fn(usize, usize) -> bool,
    distinct: f32,
) -> DepthMap {
    let [w, h] = image.size;
    let (kept, own) = (NEIGHBORS.1.min(neighbors.len()), Windows::new(image));
    let mut map = vec![f32::NAN; w * h];
    if kept == 0 {
        return map;
    }
    let (mut warped, mut sums) = (vec![0.0; w * h], Sums::default());
    let mut scores: Vec<Vec<f32>> = vec![vec![0.0; w * h]; neighbors.len()];
    // Surface by surface, each pixel's; NaN where it is not searched.
    let mut all = vec![f32::NAN; count * w * h];
    for (k, found) in all.chunks_exact_mut(w * h).enumerate() {
        let searched = |row: &usize| {
            let mut pixels = row * w..(row + 1) * w;
            pixels.any(|pixel| image.mask[pixel] && counts(k, pixel))
        };
        let (Some(first), Some(last)) = ((0..h).find(searched), (0..h).rfind(searched)) else {
            continue;
        };
        let rows = first..last + 1;
        for (other, score) in neighbors.iter().zip(&mut scores) {
            let depth = |pixel: usize| surface(k, pixel);
            warp(image, other, own.reached(&rows), &depth, &mut warped);
            own.correlate(&warped, rows.clone(), &mut sums, score);
        }
        for pixel in (first * w..(last + 1) * w).filter(|&p| image.mask[p] && counts(k, p)) {
            found[pixel] = mean_of_best(&scores, pixel, kept);
        }
    }
    for pixel in (0..w * h).filter(|&pixel| image.mask[pixel] && own.is_textured(pixel)) {
        let score = |k: usize| all[k * w * h + pixel];
        if let Some(place) = peak(count, distinct, score) {
            map[pixel] = between(place, |k| surface(k, pixel));
        }
    }
    map
}

/// Where, counted in surfaces, the scores have a peak that is high enough and the only one; what is NaN was not searched.
fn peak(count: usize, distinct: f32, score: impl Fn(usize) -> f32) -> Option<f32> {
    let searched = || (0..count).filter(|&k| !score(k).is_nan());
    let best = searched().max_by(|&a, &b| score(a).total_cmp(&score(b)))?;
    let top = score(best);
    let away = searched().filter(|k| k.abs_diff(best) > NEAR).map(&score);
    // What an edge shows along itself, or a pattern again and again, is no depth.
    if top < AGREES || away.fold(f32::NEG_INFINITY, f32::max) > top - distinct {
        return None;
    }
    // The end of the search is no peak, but where it begins at the mesh.
    let at = |k: Option<usize>| k.filter(|&k| k < count).map_or(f32::NAN, &score);
    let (before, after) = (at(best.checked_sub(1)), at(Some(best + 1)));
    let (rise, bend) = (0.5 * (after - before), before + after - 2.0 * top);
    let offset = if bend < 0.0 { (-rise / bend).clamp(-0.5, 0.5) } else { 0.0 };
    Some(best as f32 + offset)
}

/// What is between two surfaces, at a place between them.
fn between(place: f32, depth: impl Fn(usize) -> f32) -> f32 {
    let k = place as usize;
    let (here, share) = (depth(k), place - k as f32);
    if share > 0.0 { here + share * (depth(k + 1) - here) } else { here }
}

/// Another image as a surface before this camera shows it, in some rows.
fn warp(
    image: &GrayImage,
    other: &GrayImage,
    rows: Range<usize>,
    depth: &dyn Fn(usize) -> f32,
    out: &mut [f32],
) {
    let w = image.size[0];
    for row in rows {
        // Along a row, points at one depth are linear before the other camera's division.
        let place = |x: f32, depth: f32| other.homogeneous(image.point(x, row as f32 + 0.5, depth));
        let mut known = f32::NAN;
        let (mut start, mut increment) = ([0.0; 3], [0.0; 3]);
        for column in 0..w {
            let pixel = row * w + column;
            if !image.mask[pixel] {
                continue;
            }
            let depth = depth(pixel);
            if depth.is_nan() {
                out[pixel] = 0.0;
                continue;
            }
            let q: [f32; 3] = if depth == known {
                std::array::from_fn(|k| start[k] + column as f32 * increment[k])
            } else {
                let next = pixel + 1;
                let q = place(column as f32 + 0.5, depth);
                // A plane: what follows is at the same depth.
                if next < out.len() {
                    known = depth;
                    let [a, b] = [0.5, 1.5].map(|x| place(x, depth));
                    start = a;
                    increment = std::array::from_fn(|k| b[k] - a[k]);
                }
                q
            };
            let divisor = if other.perspective { q[2] } else { 1.0 };
            out[pixel] = other.at(q[0] / divisor, q[1] / divisor);
        }
    }
}

/// Mean of the `kept` largest scores of a pixel.
fn mean_of_best(scores: &[Vec<f32>], pixel: usize, kept: usize) -> f32 {
    let mut all = [f32::NEG_INFINITY; NEIGHBORS.0];
    for (slot, score) in all.iter_mut().zip(scores) {
        *slot = score[pixel];
    }
    all.sort_unstable_by(|a, b| b.total_cmp(a));
    all[..kept].iter().sum::<f32>() / kept as f32
}

/// What enough other depth maps confirm of one, and no more contradict.
fn confirmed(images: &[GrayImage], maps: &[DepthMap], view: usize) -> DepthMap {
    let (own, mut map) = (&images[view], maps[view].clone());
    let others: Vec<usize> = (0..maps.len())
        .filter(|&k| k != view && dot(own.from, images[k].from) > ANGLES[1].cos())
        .collect();
    let w = own.size[0];
    for (pixel, depth) in map.iter_mut().enumerate().filter(|(_, depth)| !depth.is_nan()) {
        let point = own.point((pixel % w) as f32 + 0.5, (pixel / w) as f32 + 0.5, *depth);
        let (mut confirmed, mut contradicted) = (0, 0);
        for &other in &others {
            let (image, map) = (&images[other], &maps[other]);
            let [x, y, there] = image.project(point);
            let [w, h] = image.size;
            if !(x >= 0.0 && y >= 0.0 && x < w as f32 && y < h as f32) {
                continue;
            }
            let found = map[y as usize * w + x as usize];
            if found.is_nan() {
                continue;
            }
            let off = (found - there) / (image.width_at(there) * image.depth_per_unit());
            confirmed += usize::from(off.abs() <= TOLERANCE);
            // It sees through the point.
            contradicted += usize::from(off > 2.0 * TOLERANCE);
        }
        if confirmed < CONFIRMATIONS || contradicted > confirmed {
            *depth = f32::NAN;
        }
    }
    map
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: a parabola's top, and what is too low, too broad, or not alone.
    #[test]
    fn peaks_are_high_sharp_and_alone() {
        let scores = |top: f32| move |k: usize| 0.9 - 0.1 * (k as f32 - top).powi(2);
        let found = peak(9, 0.1, scores(4.25));
        assert!(found.is_some_and(|place| (place - 4.25).abs() < 1e-5), "{found:?}");
        assert_eq!(peak(9, 0.1, |k| scores(4.0)(k) - 0.3), None, "low");
        assert_eq!(peak(9, 0.1, |k| 0.9 - 0.001 * (k as f32 - 4.0).powi(2)), None, "broad");
        assert_eq!(peak(9, 0.1, |k| if k == 0 { 0.85 } else { scores(4.0)(k) }), None, "another");
        assert_eq!(peak(9, 0.1, |_| f32::NAN), None, "nothing searched");
        // Nothing is known before the first.
        assert_eq!(peak(9, 0.1, |k| if k < 4 { f32::NAN } else { scores(4.0)(k) }), Some(4.0));
        assert_eq!(between(1.25, |k| 10.0 * k as f32), 12.5);
        assert_eq!(between(2.0, |k| 10.0 * k as f32), 20.0);
    }
}
