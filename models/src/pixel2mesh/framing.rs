//! Photographs framed as the images that were learned.

use datasets::View;
use mesh_core::{Components, Mask};

use crate::predict::assumed_camera;
use crate::square::square;

/// How much wider than the object the square is that is cut around it: of 3D-R2N2's renderings half have 1.41 to 1.83.
const MARGIN: f64 = 1.6;
/// The longer side of an object's box in images that were learned, as a share of the image's side: 19 of 20 lie between.
const SHARES: [f64; 2] = [0.44, 0.8];
/// And how far from the image's middle that of the box may be, in image sides.
const BESIDE: f64 = 0.07;
/// Parts of a mask that have less than this share of it are specks, which say nothing of where the object is.
const SPECK: f64 = 0.01;

/// An image without a camera, cut to a square around the object: where it is not square, which would squeeze the object, and where the
/// object is larger, smaller or farther from the middle than those that were learned. Nothing where it is as they were.
pub(super) fn framed(view: &View) -> Option<View> {
    let [left, top, right, bottom] = bounds(view)?;
    let [columns, rows] = [right - left, bottom - top];
    let [width, height] = [view.color.width as f64, view.color.height as f64];
    let share = rows.max(columns) / width;
    let beside = |low: f64, size: f64| ((low + 0.5 * size) / width - 0.5).abs() < BESIDE;
    let is_near = beside(left, columns) && beside(top, rows);
    if width == height && is_near && (SHARES[0]..=SHARES[1]).contains(&share) {
        return None;
    }
    let cut = square(view.clone(), [left, top, right, bottom], MARGIN);
    let camera = assumed_camera(cut.color.width, cut.color.height);
    Some(View { camera, ..cut })
}

/// The object's box, pixels: left, top, right, bottom.
fn bounds(view: &View) -> Option<[f64; 4]> {
    let mask = Mask::at_least(&view.mask, 1);
    let Components { labels, sizes } = mask.components();
    let least = SPECK * mask.count() as f64;
    let is_part = |label: u32| label > 0 && sizes[label as usize - 1] as f64 >= least;
    let mut bounds: Option<[f64; 4]> = None;
    for pixel in (0..labels.len()).filter(|&pixel| is_part(labels[pixel])) {
        let [x, y] = [pixel % mask.width, pixel / mask.width].map(|n| n as f64);
        let [left, top, right, bottom] = bounds.unwrap_or([x, y, x, y]);
        bounds = Some([left.min(x), top.min(y), right.max(x + 1.0), bottom.max(y + 1.0)]);
    }
    bounds
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::ByteImage;

    use super::*;

    /// A view with a box for an object.
    fn view([width, height]: [usize; 2], [left, top, right, bottom]: [usize; 4]) -> View {
        let mut mask = ByteImage::new(height, width, 1);
        for i in top..bottom {
            mask.data[i * width + left..i * width + right].fill(255);
        }
        let (color, camera) = (ByteImage::new(height, width, 3), assumed_camera(width, height));
        View { name: "a".into(), color, mask, camera, depth: None, crop: None }
    }

    #[test]
    fn objects_come_into_the_middle_of_a_square() {
        // Half of the side, in the middle: as it is.
        assert!(framed(&view([100, 100], [25, 30, 75, 70])).is_none());
        // So it is with a speck in a corner.
        let mut speckled = view([100, 100], [25, 30, 75, 70]);
        speckled.mask.data[0] = 255;
        assert!(framed(&speckled).is_none());
        let others = [
            ([160, 100], [50, 30, 110, 70]),
            ([100, 100], [0, 30, 50, 70]),
            ([100, 100], [45, 45, 55, 55]),
            ([100, 100], [0, 5, 100, 95]),
        ];
        for (size, bounds) in others {
            let whole = view(size, bounds);
            let cut = framed(&whole).unwrap();
            assert_eq!(cut.color.width, cut.color.height);
            assert_eq!(cut.mask_pixels(), whole.mask_pixels());
            let [top, left, rows, columns] = cut.mask_bounds().unwrap().map(|n| n as f64);
            let side = cut.color.width as f64;
            assert!((rows.max(columns) * MARGIN / side - 1.0).abs() < 0.1);
            for (low, size) in [(top, rows), (left, columns)] {
                assert!((low + 0.5 * size - 0.5 * side).abs() <= 1.0);
            }
            assert_eq!(cut.camera, assumed_camera(side as usize, side as usize));
            // Nothing is left to be done.
            assert!(framed(&cut).is_none());
        }
    }
}
