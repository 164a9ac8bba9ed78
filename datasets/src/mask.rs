//! Masks: from alpha, from files, from a plain backdrop.

use mesh_core::ByteImage;

/// The mask that an image's alpha gives, 255 = object; `None` where there is no alpha to speak
/// of: no such channel, or one that is opaque everywhere.
pub fn mask_from_alpha(picture: &ByteImage) -> Option<ByteImage> {
    let c = picture.channels;
    if c != 2 && c != 4 {
        return None;
    }
    let alpha = || picture.data.iter().skip(c - 1).step_by(c);
    if alpha().all(|&a| a == 255) {
        return None;
    }
    let data = alpha().map(|&a| if a >= 128 { 255 } else { 0 }).collect();
    Some(ByteImage { height: picture.height, width: picture.width, channels: 1, data })
}

/// The mask of everything that differs from a plain backdrop, 255 = object.
///
/// `color` is the backdrop's; `None` takes the median of the border, channel by channel. A pixel
/// is backdrop where no channel differs by more than `tolerance`. Of the rest the largest part
/// that hangs together (over edges of pixels) is the object, so that specks do not count. Holes
/// stay: a handle may have one.
///
/// # Panics
/// If the image has fewer than 3 channels or no pixel.
pub fn mask_from_backdrop(picture: &ByteImage, color: Option<[u8; 3]>, tolerance: u8) -> ByteImage {
    let (height, width, c) = (picture.height, picture.width, picture.channels);
    assert!(c >= 3 && height * width > 0, "a backdrop needs a colour picture, got {c} channels");
    let backdrop = color.unwrap_or_else(|| border_median(picture));
    let data = picture
        .data
        .chunks_exact(c)
        .map(|p| (0..3).any(|k| p[k].abs_diff(backdrop[k]) > tolerance) as u8 * 255)
        .collect();
    let mut mask = ByteImage { height, width, channels: 1, data };
    keep_largest_part(&mut mask);
    mask
}

fn border_median(picture: &ByteImage) -> [u8; 3] {
    let (height, width, c) = (picture.height, picture.width, picture.channels);
    let mut histograms = [[0usize; 256]; 3];
    let mut count = 0;
    for i in 0..height {
        let whole = i == 0 || i + 1 == height;
        for j in (0..width).step_by(if whole { 1 } else { (width - 1).max(1) }) {
            let pixel = &picture.data[(i * width + j) * c..];
            (0..3).for_each(|k| histograms[k][pixel[k] as usize] += 1);
            count += 1;
        }
    }
    histograms.map(|histogram| {
        let mut below = 0;
        histogram
            .iter()
            .position(|&n| {
                below += n;
                2 * below >= count
            })
            .map_or(0, |value| value as u8)
    })
}

/// Clears every part of the mask but the largest; the first found wins a tie.
fn keep_largest_part(mask: &mut ByteImage) {
    let (height, width) = (mask.height, mask.width);
    let mut part = vec![0u32; height * width];
    let mut stack = Vec::new();
    let (mut parts, mut best, mut best_size) = (0u32, 0u32, 0usize);
    for start in 0..height * width {
        if mask.data[start] == 0 || part[start] != 0 {
            continue;
        }
        parts += 1;
        let mut size = 0usize;
        part[start] = parts;
        stack.push(start);
        while let Some(at) = stack.pop() {
            size += 1;
            let (i, j) = (at / width, at % width);
            let mut visit = |next: usize| {
                if mask.data[next] != 0 && part[next] == 0 {
                    part[next] = parts;
                    stack.push(next);
                }
            };
            if i > 0 {
                visit(at - width);
            }
            if i + 1 < height {
                visit(at + width);
            }
            if j > 0 {
                visit(at - 1);
            }
            if j + 1 < width {
                visit(at + 1);
            }
        }
        if size > best_size {
            (best, best_size) = (parts, size);
        }
    }
    for (m, &p) in mask.data.iter_mut().zip(&part) {
        *m = if best != 0 && p == best { 255 } else { 0 };
    }
}

/// Turns the object into the background and back.
pub(crate) fn invert(mask: &mut ByteImage) {
    mask.data.iter_mut().for_each(|m| *m = 255 - *m);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(channels: usize, pixel: impl Fn(usize, usize) -> [u8; 4]) -> ByteImage {
        let mut image = ByteImage::new(8, 10, channels);
        for i in 0..8 {
            for j in 0..10 {
                let at = (i * 10 + j) * channels;
                image.data[at..at + channels].copy_from_slice(&pixel(i, j)[..channels]);
            }
        }
        image
    }

    #[test]
    fn alpha_is_a_mask_only_where_something_is_transparent() {
        assert!(mask_from_alpha(&picture(3, |_, _| [9; 4])).is_none());
        assert!(mask_from_alpha(&picture(4, |_, _| [9, 9, 9, 255])).is_none());
        let half = mask_from_alpha(&picture(4, |_, j| [9, 9, 9, if j < 5 { 200 } else { 100 }]));
        let half = half.expect("there is alpha");
        assert_eq!(half.data[..10], [255, 255, 255, 255, 255, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn a_backdrop_leaves_the_largest_part() {
        let inside = |i: usize, j: usize| (2..6).contains(&i) && (3..7).contains(&j);
        let image = picture(3, |i, j| {
            if inside(i, j) || (i, j) == (1, 9) {
                [200, 30, 30, 0]
            } else {
                [(118 + (i + j) % 5) as u8, 120, 122, 0]
            }
        });
        for color in [None, Some([120, 120, 120])] {
            let mask = mask_from_backdrop(&image, color, 10);
            for i in 0..8 {
                for j in 0..10 {
                    assert_eq!(mask.data[i * 10 + j] == 255, inside(i, j), "row {i} column {j}");
                }
            }
        }
    }

    #[test]
    fn a_picture_of_nothing_has_an_empty_mask() {
        let mask = mask_from_backdrop(&picture(3, |_, _| [7; 4]), None, 0);
        assert!(mask.data.iter().all(|&m| m == 0));
        let one = ByteImage { height: 1, width: 1, channels: 3, data: vec![1, 2, 3] };
        assert_eq!(mask_from_backdrop(&one, None, 0).data, [0]);
    }
}
