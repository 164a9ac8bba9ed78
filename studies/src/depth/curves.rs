//! Two losses over the steps of their trainings, in one image.

use std::path::Path;

use mesh_core::ByteImage;
use train::RunFolder;

/// Size of the image, pixels.
const SIZE: [usize; 2] = [240, 420];
/// Pixels around the curves.
const MARGIN: usize = 12;
/// Points of a curve: means over as many equal parts of the training.
const POINTS: usize = 60;
/// Colours of the curves, which stay apart for most kinds of colour vision.
const COLORS: [[u8; 3]; 2] = [[0, 114, 178], [213, 94, 0]];

/// The mean of a term of the loss in each of 60 parts of a training; none where there is no log of one.
pub(super) fn curve(run: &Path, term: &str) -> Option<Vec<f64>> {
    let all = RunFolder::at(run).term(term).ok()?;
    let part = all.len().div_ceil(POINTS).max(1);
    let means = all.chunks(part).map(|part| part.iter().sum::<f64>() / part.len() as f64);
    Some(means.collect()).filter(|means: &Vec<f64>| means.len() > 1)
}

/// Both curves, the first blue and the second orange, from the lowest to the highest value on a logarithmic scale, a grey
/// line at each power of ten.
pub(super) fn overlaid(curves: [&[f64]; 2]) -> ByteImage {
    let [height, width] = SIZE;
    let mut image = ByteImage { height, width, channels: 3, data: vec![255; 3 * height * width] };
    let logs = curves.map(|curve| curve.iter().map(|v| v.max(1e-12).log10()).collect::<Vec<_>>());
    let all = || logs.iter().flatten().copied().filter(|x| x.is_finite());
    let (low, high) =
        (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
    if low > high {
        return image;
    }
    let span = (high - low).max(1e-6);
    let row = |x: f64| MARGIN as f64 + (high - x) / span * (height - 2 * MARGIN - 1) as f64;
    let mut line = low.ceil();
    while line <= high {
        (MARGIN..width - MARGIN).for_each(|j| put(&mut image, row(line), j, [216; 3]));
        line += 1.0;
    }
    for (curve, color) in logs.iter().zip(COLORS) {
        let last = (curve.len() - 1).max(1) as f64;
        for j in MARGIN..width - MARGIN {
            let at = (j - MARGIN) as f64 / (width - 2 * MARGIN - 1) as f64 * last;
            let (i, share) = (at as usize, at.fract());
            let next = curve[(i + 1).min(curve.len() - 1)];
            let value = curve[i] + share * (next - curve[i]);
            if value.is_finite() {
                let at = row(value);
                put(&mut image, at, j, color);
                put(&mut image, at + 1.0, j, color);
            }
        }
    }
    image
}

fn put(image: &mut ByteImage, row: f64, column: usize, color: [u8; 3]) {
    let row = (row.round().max(0.0) as usize).min(image.height - 1);
    let at = 3 * (row * image.width + column);
    image.data[at..at + 3].copy_from_slice(&color);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lower_loss_is_drawn_lower() {
        let (worse, better) = (vec![1.0; 10], vec![0.1; 10]);
        let image = overlaid([&worse, &better]);
        let first = |color: [u8; 3]| image.data.chunks_exact(3).position(|p| p == color);
        let (blue, orange) = (first(COLORS[0]), first(COLORS[1]));
        assert!(blue.is_some() && orange.is_some());
        assert!(blue < orange, "{blue:?} {orange:?}");
        let _ = overlaid([&[f64::NAN; 2], &[f64::NAN; 2]]);
    }
}
