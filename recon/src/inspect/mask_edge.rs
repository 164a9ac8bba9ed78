//! Where images change beside the masks' edges: masks that are too large or too small fit together as well as right ones, but
//! their edges do not lie where the colours change.

use mesh_core::{ByteImage, MedianOfEven, bilinear, median};
use rayon::prelude::*;

use super::silhouette::Silhouette;

/// Places on each outline that are looked at.
const PLACES: usize = 200;
/// How far beside the edge is looked, pixels.
const REACH: f32 = 6.0;
/// Steps of a pixel in which is looked.
const PER_PIXEL: usize = 2;
/// The largest change must be so many times the median one, or it is the object's pattern or the background's.
const CLEAR: f32 = 2.5;

/// How far outside of the masks' edges the colours change most, pixels of the silhouettes: negative where masks are too large. The
/// median over the views that tell; none where less than half do.
pub(super) fn offset(colors: &[&ByteImage], silhouettes: &[Silhouette]) -> Option<f64> {
    let found: Vec<f64> = colors
        .par_iter()
        .zip(silhouettes)
        .filter_map(|(color, silhouette)| of_view(color, silhouette))
        .collect();
    let enough = 2 * found.len() >= colors.len().max(1);
    median(found, MedianOfEven::Upper).filter(|_| enough)
}

fn of_view(color: &ByteImage, silhouette: &Silhouette) -> Option<f64> {
    let steps = 2 * (REACH * PER_PIXEL as f32) as usize + 1;
    let mut profile = vec![0.0f32; steps];
    // Where the colours begin in what is judged.
    let begin = silhouette.window.begin_of_view().map(|v| v as f32);
    for place in silhouette.outline(PLACES) {
        let [x, y] = place.map(|v| v as f32);
        let at = |dx: f32, dy: f32| silhouette.between([x + dx, y + dy]);
        let (gx, gy) = (at(1.0, 0.0) - at(-1.0, 0.0), at(0.0, 1.0) - at(0.0, -1.0));
        let long = gx.hypot(gy);
        if long < 0.5 {
            continue; // a thin part, or a corner: there is no one direction outwards
        }
        let sample = |offset: f32| {
            let place = [x + offset * gx / long, y + offset * gy / long];
            let scale = silhouette.scale as f32;
            let place: [f32; 2] = std::array::from_fn(|k| place[k] * scale - 0.5 - begin[k]);
            bilinear::<3>([color.width, color.height], place, |i, j| {
                let pixel = color.pixel(i, j);
                std::array::from_fn(|c| f32::from(pixel[c]))
            })
        };
        for (k, sum) in profile.iter_mut().enumerate() {
            let offset = k as f32 / PER_PIXEL as f32 - REACH;
            let (inner, outer) = (sample(offset - 0.5), sample(offset + 0.5));
            *sum += inner.iter().zip(outer).map(|(a, b)| (a - b).abs()).sum::<f32>();
        }
    }
    let peak = (0..steps).max_by(|&a, &b| profile[a].total_cmp(&profile[b]))?;
    let floor = median(profile.iter().copied(), MedianOfEven::Upper)?;
    if profile[peak] <= CLEAR * floor.max(f32::MIN_POSITIVE) {
        return None;
    }
    // The middle of the peak, as far as it is above half.
    let half = 0.5 * (profile[peak] + floor);
    let low = (0..=peak).rev().take_while(|&k| profile[k] >= half).last()?;
    let high = (peak..steps).take_while(|&k| profile[k] >= half).last()?;
    let (mut sum, mut weight) = (0.0, 0.0);
    for (k, &value) in profile.iter().enumerate().take(high + 1).skip(low) {
        let above = f64::from(value - floor);
        sum += above * (k as f64 / PER_PIXEL as f64 - f64::from(REACH));
        weight += above;
    }
    (weight > 0.0).then(|| sum / weight)
}
