//! A plain backdrop: what it looks like, and the object before it.
//!
//! The colour is that of the border. Where several images are at hand it is what their borders have in common, and
//! rows and columns at the sides that are alike in all of them, and of another colour, are the bars or the frame of a
//! video and no backdrop. An image whose border is mostly of other colours has no plain backdrop, and is refused.

use mesh_core::{ByteImage, MedianOfEven};

use crate::error::ViewsProblem;
use crate::mask::keep_largest_part;

/// How much of a border may differ from a backdrop: an object may be cut by the frame.
const MOST_OTHER: f64 = 0.5;
/// How much of a side may be a bar.
const MOST_BAR: f64 = 0.25;

/// Rows above and below, columns left and right.
pub(crate) type Bars = [usize; 4];

/// A background of one colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Backdrop {
    /// sRGB.
    pub(crate) color: [u8; 3],
    /// How far a channel may differ from it.
    pub(crate) tolerance: u8,
    /// What at the sides is no part of the scene.
    pub(crate) bars: Bars,
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
pub fn mask_from_backdrop(image: &ByteImage, color: Option<[u8; 3]>, tolerance: u8) -> ByteImage {
    Backdrop::of(image, color, tolerance, [0; 4]).object(image)
}

impl Backdrop {
    /// That of one image; without a colour it is the median of the border inside of the bars.
    pub(crate) fn of(image: &ByteImage, color: Option<[u8; 3]>, tolerance: u8, bars: Bars) -> Self {
        let most = [image.height, image.height, image.width, image.width];
        let wide = (0..4).any(|k| 2 * bars[k] >= most[k]);
        let bars = if wide { [0; 4] } else { bars };
        let color = color.unwrap_or_else(|| border_median(image, bars));
        Self { color, tolerance, bars }
    }

    /// What several images of one scene have in common; nothing where their borders have no colour in common, or
    /// they are not of one size.
    pub(crate) fn common(images: &[ByteImage], tolerance: u8) -> Option<Self> {
        let first = images.first()?;
        let size = |p: &ByteImage| [p.height, p.width];
        if images.iter().any(|p| size(p) != size(first)) {
            return None;
        }
        let bars = bars_of_all(images, tolerance);
        let inner: Vec<_> = images.iter().map(|p| border_median(p, bars)).collect();
        let color = std::array::from_fn(|k| median(inner.iter().map(|c| c[k])));
        let agree = inner.iter().filter(|c| close(**c, color, tolerance)).count();
        (2 * agree > images.len()).then_some(())?;
        // Bars of the backdrop's own colour are backdrop.
        let is_bar = |corner: [u8; 3]| !close(corner, color, tolerance);
        let sides = side_colors(first);
        let bars = std::array::from_fn(|k| if is_bar(sides[k]) { bars[k] } else { 0 });
        Some(Self { color, tolerance, bars })
    }

    /// The mask of what differs from it, 255 = object.
    ///
    /// # Errors
    /// If most of the image's border differs too.
    pub(crate) fn mask(&self, image: &ByteImage) -> Result<ByteImage, ViewsProblem> {
        let (mut other, mut all) = (0_usize, 0_usize);
        for pixel in border(image, self.bars) {
            all += 1;
            other += usize::from(!close(pixel, self.color, self.tolerance));
        }
        let share = other as f64 / all.max(1) as f64;
        if share > MOST_OTHER {
            let (color, tolerance) = (self.color, self.tolerance);
            return Err(ViewsProblem::BusyBackdrop { share, color, tolerance });
        }
        Ok(self.object(image))
    }

    fn object(&self, image: &ByteImage) -> ByteImage {
        let (height, width, c) = (image.height, image.width, image.channels);
        assert!(c >= 3 && height * width > 0, "a backdrop needs a colour image, got {c} channels");
        let [top, bottom, left, right] = self.bars;
        let is_object = |(k, p): (usize, &[u8])| {
            let (i, j) = (k / width, k % width);
            let inside = i >= top && i + bottom < height && j >= left && j + right < width;
            u8::from(inside && !close([p[0], p[1], p[2]], self.color, self.tolerance)) * 255
        };
        let data = image.data.chunks_exact(c).enumerate().map(is_object).collect();
        let mut mask = ByteImage { height, width, channels: 1, data };
        keep_largest_part(&mut mask);
        mask
    }
}

fn close(a: [u8; 3], b: [u8; 3], tolerance: u8) -> bool {
    (0..3).all(|k| a[k].abs_diff(b[k]) <= tolerance)
}

/// The pixels around the inside of bars.
fn border(image: &ByteImage, [top, bottom, left, right]: Bars) -> impl Iterator<Item = [u8; 3]> {
    let (height, width) = (image.height, image.width);
    let rows = top..height.saturating_sub(bottom);
    let columns = left..width.saturating_sub(right);
    let last = rows.end.saturating_sub(1);
    rows.flat_map(move |i| {
        // All of the first and the last row, the two ends of the others.
        let long = columns.len().saturating_sub(1).max(1);
        columns.clone().step_by(if i == top || i == last { 1 } else { long }).map(move |j| (i, j))
    })
    .map(move |(i, j)| pixel(image, i, j))
}

fn pixel(image: &ByteImage, i: usize, j: usize) -> [u8; 3] {
    let at = (i * image.width + j) * image.channels;
    [image.data[at], image.data[at + 1], image.data[at + 2]]
}

fn border_median(image: &ByteImage, bars: Bars) -> [u8; 3] {
    let pixels: Vec<[u8; 3]> = border(image, bars).collect();
    std::array::from_fn(|k| median(pixels.iter().map(|p| p[k])))
}

/// The lower median; 0 of nothing.
fn median(values: impl Iterator<Item = u8>) -> u8 {
    mesh_core::median(values.map(f32::from), MedianOfEven::Lower).map_or(0, |value| value as u8)
}

/// The colours of the four sides' middles.
fn side_colors(image: &ByteImage) -> [[u8; 3]; 4] {
    let (h, w) = (image.height - 1, image.width - 1);
    [(0, w / 2), (h, w / 2), (h / 2, 0), (h / 2, w)].map(|(i, j)| pixel(image, i, j))
}

/// How many rows and columns at the sides are of one colour in every image, and of the same one in all.
fn bars_of_all(images: &[ByteImage], tolerance: u8) -> Bars {
    let first = &images[0];
    let (height, width) = (first.height, first.width);
    let sides = side_colors(first);
    let plain = |side: usize, line: usize| {
        images.iter().all(|p| {
            let along = if side < 2 { width } else { height };
            (0..along).all(|k| {
                let (i, j) = match side {
                    0 => (line, k),
                    1 => (height - 1 - line, k),
                    2 => (k, line),
                    _ => (k, width - 1 - line),
                };
                close(pixel(p, i, j), sides[side], tolerance)
            })
        })
    };
    std::array::from_fn(|side| {
        let most = (MOST_BAR * if side < 2 { height } else { width } as f64) as usize;
        (0..most).take_while(|&line| plain(side, line)).count()
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::mask::tests::picture;

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

    /// A square of 8 by 8 at a place, on grey of 40 by 30 pixels, between bars above and below and left.
    fn filmed([i0, j0]: [usize; 2], bars: bool) -> ByteImage {
        let mut image = ByteImage::new(30, 40, 3);
        for i in 0..30 {
            for j in 0..40 {
                let object = (i0..i0 + 8).contains(&i) && (j0..j0 + 8).contains(&j);
                let bar = bars && (!(4..27).contains(&i) || j < 3);
                let color = match (bar, object) {
                    (true, _) => [2, 0, 1],
                    (_, true) => [220, 220, 220],
                    _ => [(115 + (i + j) % 7) as u8, 120, 125],
                };
                image.data[(i * 40 + j) * 3..][..3].copy_from_slice(&color);
            }
        }
        image
    }

    #[test]
    fn bars_of_a_video_are_no_backdrop() {
        let places = [[8, 8], [10, 20], [14, 12]];
        let views = places.map(|place| filmed(place, true));
        let backdrop = Backdrop::common(&views, 24).unwrap();
        assert_eq!(backdrop.bars, [4, 3, 3, 0]);
        assert!(close(backdrop.color, [118, 120, 125], 3), "{backdrop:?}");
        for (view, [i0, j0]) in views.iter().zip(places) {
            let mask = backdrop.mask(view).unwrap();
            assert_eq!(mask.data.iter().filter(|&&m| m != 0).count(), 64);
            assert_eq!(mask.data[i0 * 40 + j0], 255);
        }
        // By itself the border says black, and all the rest would be the object.
        let alone = mask_from_backdrop(&views[0], Some([2, 0, 1]), 24);
        assert!(alone.data.iter().filter(|&&m| m != 0).count() > 700);
    }

    #[test]
    fn a_plain_backdrop_has_no_bars_however_wide_it_is() {
        let views = [[11, 6], [11, 14], [11, 22]].map(|place| filmed(place, false));
        assert_eq!(Backdrop::common(&views, 24).unwrap().bars, [0; 4]);
        // One that is still: what surrounds it is one colour, and it is another.
        let still = [filmed([11, 14], false), filmed([11, 14], false)];
        let backdrop = Backdrop::common(&still, 24).unwrap();
        assert_eq!(backdrop.mask(&still[0]).unwrap().data.iter().filter(|&&m| m != 0).count(), 64);
    }

    #[test]
    fn a_busy_background_is_refused_with_its_share() {
        let busy = picture(3, |i, j| {
            let value = |k: usize| ((i * 97 + j * 61 + k * 151) % 256) as u8;
            [value(0), value(1), value(2), 0]
        });
        let color = border_median(&busy, [0; 4]);
        let refused = Backdrop { color, tolerance: 24, bars: [0; 4] }.mask(&busy).unwrap_err();
        let ViewsProblem::BusyBackdrop { share, .. } = refused else { panic!("{refused}") };
        assert!(share > 0.8, "{share}");
        assert!(Backdrop::common(&[busy.clone(), filmed([8, 8], true)], 24).is_none());
    }
}
