//! Masks: from alpha, from images of masks, and what is mended in them.

use mesh_core::{ByteImage, Mask};

use crate::morphology::{dilate, erode};
use crate::options::ReadOptions;

/// The mask that an image's alpha gives, 255 = object; `None` where there is no alpha to speak
/// of: no such channel, or one that is opaque everywhere.
pub fn mask_from_alpha(image: &ByteImage) -> Option<ByteImage> {
    let c = image.channels;
    if c != 2 && c != 4 {
        return None;
    }
    let alpha = || image.data.iter().skip(c - 1).step_by(c);
    if alpha().all(|&a| a == 255) {
        return None;
    }
    let data = alpha().map(|&a| if a >= 128 { 255 } else { 0 }).collect();
    Some(ByteImage { height: image.height, width: image.width, channels: 1, data })
}

/// A mask from an image file: the alpha where it says something, else the grey value, above half of white. An image of 0 and 1 alone is
/// one of labels; where no grey is so bright, the brightest channel counts, as in masks of pure red on black.
pub(crate) fn mask_from_image(image: &ByteImage) -> ByteImage {
    mask_from_alpha(image).unwrap_or_else(|| {
        let c = image.channels;
        let gray = |p: &[u8]| {
            if c >= 3 { (p[0] as u16 + p[1] as u16 + p[2] as u16) / 3 } else { p[0] as u16 }
        };
        let strongest = |p: &[u8]| u16::from(strongest(p));
        let pixels = || image.data.chunks_exact(c);
        let parts = |of: &dyn Fn(&[u8]) -> u16, least: u16| {
            let object = pixels().filter(|p| of(p) >= least).count();
            object > 0 && object < image.height * image.width
        };
        let least = if brightest(image) == 1 { 1 } else { 128 };
        let is_bright = pixels().any(|p| gray(p) >= least);
        // A picture that is coloured all over parts nothing.
        let of: &dyn Fn(&[u8]) -> u16 =
            if !is_bright && parts(&strongest, least) { &strongest } else { &gray };
        let data = pixels().map(|p| if of(p) >= least { 255 } else { 0 }).collect();
        ByteImage { height: image.height, width: image.width, channels: 1, data }
    })
}

/// The largest value of an image of a mask, alpha aside.
pub(crate) fn brightest(image: &ByteImage) -> u8 {
    image.data.chunks_exact(image.channels).map(strongest).max().unwrap_or(0)
}

/// The largest of a pixel's colours.
fn strongest(pixel: &[u8]) -> u8 {
    let colors = if pixel.len() >= 3 { 3 } else { 1 };
    pixel[..colors].iter().copied().max().unwrap_or(0)
}

/// Clears every part of the mask but the largest; the first found wins a tie.
pub(crate) fn keep_largest_part(mask: &mut ByteImage) {
    let largest = Mask::at_least(mask, 1).largest_component();
    for (value, &kept) in mask.data.iter_mut().zip(&largest.data) {
        *value = if kept { 255 } else { 0 };
    }
}

/// Makes object of what it surrounds: background that no way leads out of.
pub(crate) fn fill_holes(mask: &mut ByteImage) {
    let holes = Mask::at_least(mask, 1).holes();
    for (value, _) in mask.data.iter_mut().zip(&holes.data).filter(|(_, hole)| **hole) {
        *value = 255;
    }
}

/// What the options mend in a mask, 255 = object: it is dilated, eroded, left with its largest part, and its holes are filled,
/// each where [`ReadOptions`] say so, in this order. Readers do so with the masks that they find; this is for masks that are made of
/// what was read.
pub fn clean_mask(mask: &mut ByteImage, options: &ReadOptions) {
    dilate(mask, options.dilate);
    erode(mask, options.erode);
    if options.largest_part {
        keep_largest_part(mask);
    }
    if options.fill_holes {
        fill_holes(mask);
    }
}

/// Turns the object into the background and back.
pub(crate) fn invert(mask: &mut ByteImage) {
    mask.data.iter_mut().for_each(|m| *m = 255 - *m);
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// An image of 8 by 10 pixels.
    pub(crate) fn picture(channels: usize, pixel: impl Fn(usize, usize) -> [u8; 4]) -> ByteImage {
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
    fn labels_of_0_and_1_are_a_mask() {
        let of = |data: Vec<u8>| {
            mask_from_image(&ByteImage { height: 1, width: 3, channels: 1, data }).data
        };
        assert_eq!(of(vec![0, 1, 0]), [0, 255, 0]);
        assert_eq!(of(vec![0, 1, 2]), [0; 3]);
        assert_eq!(of(vec![1, 127, 128]), [0, 0, 255]);
        let colored = |data: Vec<u8>| {
            mask_from_image(&ByteImage { height: 1, width: 2, channels: 3, data }).data
        };
        assert_eq!(colored(vec![0, 0, 0, 255, 0, 0]), [0, 255]);
        assert_eq!(colored(vec![0, 0, 0, 1, 0, 0]), [0, 255]);
        // White is the object before a colour, and a colour alone is the background.
        assert_eq!(colored(vec![0, 0, 255, 255, 255, 255]), [0, 255]);
        assert_eq!(colored(vec![0, 0, 255, 0, 0, 255]), [0, 0]);
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
    fn the_largest_part_stays_and_holes_are_filled() {
        let text = ["#........#", "..####....", "..#..#....", "..####..##", "........#."];
        let data = text.concat().bytes().map(|b| if b == b'#' { 255 } else { 0 }).collect();
        let mut mask = ByteImage { height: 5, width: 10, channels: 1, data };
        let drawn = |mask: &ByteImage| -> Vec<String> {
            let sign = |&m: &u8| if m == 255 { '#' } else { '.' };
            mask.data.chunks(10).map(|row| row.iter().map(sign).collect()).collect()
        };
        keep_largest_part(&mut mask);
        let ring = ["..........", "..####....", "..#..#....", "..####....", ".........."];
        assert_eq!(drawn(&mask), ring);
        fill_holes(&mut mask);
        assert_eq!(drawn(&mask)[2], "..####....");
        // What is open to the frame is no hole, and nothing has none.
        let mut bay =
            ByteImage { height: 2, width: 3, channels: 1, data: vec![255, 0, 255, 255, 255, 255] };
        fill_holes(&mut bay);
        assert_eq!(bay.data, [255, 0, 255, 255, 255, 255]);
        let mut nothing = ByteImage::new(2, 2, 1);
        keep_largest_part(&mut nothing);
        fill_holes(&mut nothing);
        assert_eq!(nothing.data, [0; 4]);
    }
}
