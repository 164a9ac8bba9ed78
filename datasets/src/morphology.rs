//! Dilation and erosion of masks by a disk.
//!
//! # References
//! Haralick, Sternberg, Zhuang 1987, *Image Analysis Using Mathematical Morphology*. What is beyond the image is
//! background to a dilation and object to an erosion, so that the frame neither adds nor takes anything.

use mesh_core::ByteImage;

/// Makes object of every pixel within `radius` pixels of the object.
pub(crate) fn dilate(mask: &mut ByteImage, radius: usize) {
    spread(mask, radius, 255);
}

/// Makes background of every pixel within `radius` pixels of the background.
pub(crate) fn erode(mask: &mut ByteImage, radius: usize) {
    spread(mask, radius, 0);
}

/// Gives `value` to every pixel whose distance to one of that value is at most `radius`; about `2 radius` steps a pixel.
fn spread(mask: &mut ByteImage, radius: usize, value: u8) {
    if radius == 0 {
        return;
    }
    let (height, width) = (mask.height, mask.width);
    // No two pixels are further apart; a caller may ask for any number.
    let radius = radius.min(height + width);
    let aside: Vec<usize> =
        mask.data.chunks(width.max(1)).flat_map(|row| distances(row, value, radius + 1)).collect();
    // How far aside the disk reaches, so many rows up or down.
    let reach: Vec<usize> = (0..=radius).map(|up| (radius * radius - up * up).isqrt()).collect();
    for i in 0..height {
        let rows = i.saturating_sub(radius)..(i + radius + 1).min(height);
        for j in 0..width {
            let near = |row: usize| aside[row * width + j] <= reach[row.abs_diff(i)];
            if rows.clone().any(near) {
                mask.data[i * width + j] = value;
            }
        }
    }
}

/// Of each pixel of a row the distance to the next one of the value, at most `most`.
fn distances(row: &[u8], value: u8, most: usize) -> Vec<usize> {
    let mut out = vec![most; row.len()];
    let mut walk = |order: &mut dyn Iterator<Item = usize>| {
        let mut since = most;
        for j in order {
            since = if row[j] == value { 0 } else { (since + 1).min(most) };
            out[j] = out[j].min(since);
        }
    };
    walk(&mut (0..row.len()));
    walk(&mut (0..row.len()).rev());
    out
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// By its definition, pixel by pixel.
    fn plain(mask: &ByteImage, radius: usize, value: u8) -> Vec<u8> {
        let width = mask.width;
        let near = |at: usize| {
            (0..mask.data.len()).any(|other| {
                let rows = (at / width).abs_diff(other / width);
                let columns = (at % width).abs_diff(other % width);
                mask.data[other] == value && rows * rows + columns * columns <= radius * radius
            })
        };
        (0..mask.data.len()).map(|at| if near(at) { value } else { mask.data[at] }).collect()
    }

    proptest! {
        #[test]
        fn a_disk_reaches_as_far_as_its_radius(
            set in proptest::collection::vec(proptest::bool::weighted(0.2), 9 * 13),
            radius in 0_usize..6,
        ) {
            let data = set.into_iter().map(|set| if set { 255 } else { 0 }).collect();
            let mask = ByteImage { height: 9, width: 13, channels: 1, data };
            let (mut more, mut less) = (mask.clone(), mask.clone());
            dilate(&mut more, radius);
            erode(&mut less, radius);
            prop_assert_eq!(more.data, plain(&mask, radius, 255));
            prop_assert_eq!(less.data, plain(&mask, radius, 0));
        }
    }

    #[test]
    fn a_disk_of_any_radius_covers_the_image() {
        let mut mask = ByteImage::new(9, 13, 1);
        mask.data[20] = 255;
        let (mut whole, mut none) = (mask.clone(), mask.clone());
        dilate(&mut whole, usize::MAX);
        erode(&mut none, 1 << 40);
        assert!(whole.data.iter().all(|&m| m == 255) && none.data.iter().all(|&m| m == 0));
        // Where there is none of a value, none spreads.
        let empty = ByteImage::new(9, 13, 1);
        let mut same = empty.clone();
        dilate(&mut same, usize::MAX);
        assert_eq!(same, empty);
    }

    #[test]
    fn closing_fills_what_is_narrow_and_leaves_the_frame() {
        let mut mask = ByteImage { height: 9, width: 20, channels: 1, data: vec![255; 180] };
        // A crack of two columns, and a bay of twelve that the frame cuts.
        for row in mask.data.chunks_mut(20) {
            row[2..4].fill(0);
            row[8..].fill(0);
        }
        dilate(&mut mask, 2);
        erode(&mut mask, 2);
        for row in mask.data.chunks(20) {
            assert!(row[..8].iter().all(|&m| m == 255) && row[8..].iter().all(|&m| m == 0));
        }
    }
}
