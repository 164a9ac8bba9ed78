//! What decoders put out, before it is an image or depth.

use super::ByteImage;
use super::exif::Orientation;

/// Pixels as a file has them.
#[derive(Debug)]
pub(super) struct Decoded {
    pub(super) height: usize,
    pub(super) width: usize,
    /// Grey, grey and alpha, RGB or RGBA.
    pub(super) channels: usize,
    /// Whether a channel is two bytes, the larger first, instead of one.
    pub(super) deep: bool,
    pub(super) data: Vec<u8>,
    /// How the scene lies in it.
    pub(super) orientation: Orientation,
}

impl Decoded {
    /// With the top of the scene in row 0.
    pub(super) fn upright(self) -> Self {
        use Orientation as O;
        let orientation = self.orientation;
        if orientation == O::TopLeft {
            return self;
        }
        let Self { height: h, width: w, channels, deep, ref data, .. } = self;
        // The row and the column from which a pixel comes.
        let from = |i: usize, j: usize| match orientation {
            O::TopLeft => (i, j),
            O::TopRight => (i, w - 1 - j),
            O::BottomRight => (h - 1 - i, w - 1 - j),
            O::BottomLeft => (h - 1 - i, j),
            O::LeftTop => (j, i),
            O::RightTop => (h - 1 - j, i),
            O::RightBottom => (h - 1 - j, w - 1 - i),
            O::LeftBottom => (j, w - 1 - i),
        };
        let (height, width) = if orientation.is_lying() { (w, h) } else { (h, w) };
        let pixel = channels << u8::from(deep);
        let mut upright = Vec::with_capacity(data.len());
        for (i, j) in (0..height).flat_map(|i| (0..width).map(move |j| (i, j))) {
            let (row, column) = from(i, j);
            upright.extend_from_slice(&data[(row * w + column) * pixel..][..pixel]);
        }
        Self { height, width, channels, deep, data: upright, orientation: O::TopLeft }
    }

    /// In bytes: 16 bits a channel are rounded to 8, in place.
    pub(super) fn into_bytes(self) -> ByteImage {
        let Self { height, width, channels, deep, mut data, .. } = self;
        if deep {
            let half = data.len() / 2;
            for k in 0..half {
                let value = u32::from(u16::from_be_bytes([data[2 * k], data[2 * k + 1]]));
                data[k] = ((value + 128) / 257) as u8;
            }
            data.truncate(half);
            data.shrink_to_fit();
        }
        ByteImage { height, width, channels, data }
    }

    /// In bytes, as the numbers that they are where 16 bits a channel hold no colour above 255: labels, or a mask of 8 bits that somebody
    /// stored so, of which rounding would leave nothing. Alpha is rounded all the same.
    pub(super) fn into_labels(self) -> ByteImage {
        let Self { height, width, channels, deep, ref data, .. } = self;
        let colors = if channels % 2 == 0 { channels - 1 } else { channels };
        let is_high = |pixel: &[u8]| (0..colors).any(|c| pixel[2 * c] != 0);
        if !deep || data.chunks_exact(2 * channels).any(is_high) {
            return self.into_bytes();
        }
        let low: Vec<u8> = data.iter().skip(1).step_by(2).copied().collect();
        let mut image = self.into_bytes();
        for (k, (to, from)) in image.data.iter_mut().zip(low).enumerate() {
            if k % channels < colors {
                *to = from;
            }
        }
        ByteImage { height, width, ..image }
    }

    /// Whether any pixel's colours differ; alpha aside, all grey pictures have equal ones.
    pub(super) fn is_colored(&self) -> bool {
        let size = 1 << u8::from(self.deep);
        let differs = |pixel: &[u8]| {
            let (red, others) = pixel.split_at(size);
            others[..2 * size].chunks_exact(size).any(|other| other != red)
        };
        self.channels > 2 && self.data.chunks_exact(self.channels * size).any(differs)
    }

    /// Height, width, and the file's own numbers: the first channel's.
    pub(super) fn into_gray(self) -> (usize, usize, impl Iterator<Item = u16>) {
        let Self { height, width, channels, deep, data, .. } = self;
        let size = channels << u8::from(deep);
        let gray = move |k: usize| {
            let pixel = &data[k * size..(k + 1) * size];
            if deep { u16::from_be_bytes([pixel[0], pixel[1]]) } else { u16::from(pixel[0]) }
        };
        (height, width, (0..height * width).map(gray))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the stored first pixel and its neighbour in the first row are seen, by the table of the standard.
    #[test]
    fn each_orientation_puts_row_and_column_where_its_name_says() {
        let (h, w) = (2, 3);
        // Corner of the first pixel, corner to which the first row leads.
        let corners = [
            ((0, 0), (0, 1)),
            ((0, 1), (0, 0)),
            ((1, 1), (1, 0)),
            ((1, 0), (1, 1)),
            ((0, 0), (1, 0)),
            ((0, 1), (1, 1)),
            ((1, 1), (0, 1)),
            ((1, 0), (0, 0)),
        ];
        for deep in [false, true] {
            for (orientation, (first, last)) in Orientation::ALL.into_iter().zip(corners) {
                let channels = 2;
                let size = channels << u8::from(deep);
                let data: Vec<u8> = (0..h * w * size).map(|k| k as u8).collect();
                let data_of = data.clone();
                let stored =
                    Decoded { height: h, width: w, channels, deep, data: data_of, orientation };
                let seen = stored.upright();
                let at = |(i, j): (usize, usize)| {
                    let (i, j) = (i * (seen.height - 1), j * (seen.width - 1));
                    &seen.data[(i * seen.width + j) * size..][..size]
                };
                assert_eq!(at(first), &data[..size], "{orientation:?}");
                assert_eq!(at(last), &data[(w - 1) * size..w * size], "{orientation:?}");
            }
        }
    }
}
