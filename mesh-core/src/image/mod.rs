//! Images: `f32` for arithmetic, bytes for what files hold, planar depth and disparity; PNG, JPEG, EXR and PFM.

mod bilinear;
mod blur;
mod color;
#[cfg(feature = "images")]
mod decoded;
mod depth;
#[cfg(feature = "images")]
mod error;
#[cfg(feature = "images")]
mod exif;
#[cfg(feature = "exr")]
mod exr;
#[cfg(feature = "images")]
mod file;
mod ground;
#[cfg(feature = "images")]
mod jpeg;
#[cfg(feature = "images")]
mod pfm;
#[cfg(feature = "images")]
mod png;
mod resize;

pub use bilinear::{bilinear, bilinear_repeat};
pub use color::{linear_to_srgb, srgb_to_linear};
pub use depth::{DepthMap, DisparityMap};
#[cfg(feature = "images")]
pub use error::ImageError;
#[cfg(feature = "exr")]
pub use exr::{decode_depth, decode_depth_with, encode_depth, encode_exr, read_depth, write_depth};
#[cfg(feature = "files")]
pub(crate) use file::is_known_kind;
#[cfg(feature = "images")]
pub use file::{
    StoredImage, decode_depth_png, decode_depth_png_with, decode_image, decode_image_with,
    encode_png, read_depth_png, read_image, read_image_with, write_png,
};
pub use ground::GroundPlane;
#[cfg(feature = "images")]
pub use pfm::{decode_pfm, decode_pfm_with, encode_pfm, read_pfm, write_pfm};

/// Pixels of any kind of number, `[H, W, C]`, row-major, row 0 at the top.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pixels<T> {
    /// Number of rows.
    pub height: usize,
    /// Number of columns.
    pub width: usize,
    /// Number of channels, the fastest index.
    pub channels: usize,
    /// `height * width * channels` values.
    pub data: Vec<T>,
}

/// An image of floats; sRGB in `[0, 1]`.
pub type Image = Pixels<f32>;

/// An image of bytes: how views are kept, at a quarter of the memory.
pub type ByteImage = Pixels<u8>;

impl<T: Copy + Default> Pixels<T> {
    /// An image filled with zeros.
    pub fn new(height: usize, width: usize, channels: usize) -> Self {
        Self { height, width, channels, data: vec![T::default(); height * width * channels] }
    }

    /// The channels of the pixel at row `i`, column `j`.
    pub fn pixel(&self, i: usize, j: usize) -> &[T] {
        let start = (i * self.width + j) * self.channels;
        &self.data[start..start + self.channels]
    }

    /// The part that starts at column `x`, row `y`.
    ///
    /// # Panics
    /// If the part leaves the image.
    #[must_use]
    pub fn cropped(&self, x: usize, y: usize, width: usize, height: usize) -> Self {
        let [rows, columns, channels] = self.shape();
        assert!(
            x + width <= columns && y + height <= rows,
            "cropped: {width} x {height} at column {x}, row {y} of an image {columns} x {rows}"
        );
        let row = |i: usize| &self.data[(i * columns + x) * channels..][..width * channels];
        let data = (y..y + height).flat_map(row).copied().collect();
        Self { height, width, channels, data }
    }

    /// Copies another image of as many channels onto this one, its first pixel to row `top`, column `left`.
    ///
    /// # Panics
    /// If it leaves this image, or has other channels.
    pub fn paste(&mut self, other: &Self, [top, left]: [usize; 2]) {
        let [rows, columns, channels] = self.shape();
        let [height, width, others] = other.shape();
        assert!(
            top + height <= rows && left + width <= columns && others == channels,
            "paste: {width} x {height} x {others} at column {left}, row {top} of an image {columns} x {rows} x {channels}"
        );
        let line = width * channels;
        for (i, row) in other.data.chunks_exact(line.max(1)).enumerate() {
            self.data[((top + i) * columns + left) * channels..][..line].copy_from_slice(row);
        }
    }

    fn shape(&self) -> [usize; 3] {
        [self.height, self.width, self.channels]
    }
}

impl Image {
    /// The nearest bytes: values outside `[0, 1]` are clamped, NaN becomes 0.
    pub fn to_bytes(&self) -> ByteImage {
        let byte = |v: &f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        ByteImage {
            height: self.height,
            width: self.width,
            channels: self.channels,
            data: self.data.iter().map(byte).collect(),
        }
    }
}

impl ByteImage {
    /// One channel as an image of its own.
    ///
    /// # Panics
    /// If there is no such channel.
    #[must_use]
    pub fn channel(&self, index: usize) -> Self {
        assert!(index < self.channels, "channel: index {index} of {} channels", self.channels);
        let data = self.data.iter().skip(index).step_by(self.channels).copied().collect();
        Self { height: self.height, width: self.width, channels: 1, data }
    }

    /// The alpha channel of a grey or colour image; `None` where there is none.
    pub fn alpha(&self) -> Option<Self> {
        matches!(self.channels, 2 | 4).then(|| self.channel(self.channels - 1))
    }

    /// Three channels: grey is repeated, alpha is dropped with the colours under it kept.
    #[must_use]
    pub fn to_rgb(&self) -> Self {
        let data = match self.channels {
            3 => self.data.clone(),
            1 | 2 => self.data.chunks_exact(self.channels).flat_map(|p| [p[0]; 3]).collect(),
            n => self.data.chunks_exact(n).flat_map(|p| [p[0], p[1], p[2]]).collect(),
        };
        Self { height: self.height, width: self.width, channels: 3, data }
    }

    /// [`to_rgb`](Self::to_rgb) as floats, without bytes in between.
    #[cfg(feature = "files")]
    pub(crate) fn to_rgb_floats(&self) -> Image {
        let Self { height, width, channels, .. } = *self;
        let taken = if channels < 3 { [0; 3] } else { [0, 1, 2] };
        let mut data = Vec::with_capacity(height * width * 3);
        for pixel in self.data.chunks_exact(channels) {
            data.extend(taken.map(|c| f32::from(pixel[c]) / 255.0));
        }
        Image { height, width, channels: 3, data }
    }

    /// Three channels: the image over a background, where alpha says how much of each.
    ///
    /// Blending is done on the sRGB bytes, as browsers do; alpha is straight.
    #[must_use]
    pub fn over(&self, background: [u8; 3]) -> Self {
        let Some(alpha) = self.alpha() else { return self.to_rgb() };
        let mut rgb = self.to_rgb();
        for (pixel, a) in rgb.data.chunks_exact_mut(3).zip(alpha.data) {
            let a = u32::from(a);
            for (v, b) in pixel.iter_mut().zip(background) {
                *v = ((u32::from(*v) * a + u32::from(b) * (255 - a) + 127) / 255) as u8;
            }
        }
        rgb
    }
}

impl From<&ByteImage> for Image {
    fn from(bytes: &ByteImage) -> Self {
        Self {
            height: bytes.height,
            width: bytes.width,
            channels: bytes.channels,
            data: bytes.data.iter().map(|&b| f32::from(b) / 255.0).collect(),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn bytes_survive_the_way_through_floats() {
        let data: Vec<u8> = (0..=255).collect();
        let bytes = ByteImage { height: 16, width: 16, channels: 1, data };
        assert_eq!(Image::from(&bytes).to_bytes(), bytes);
        let odd = Image { height: 1, width: 3, channels: 1, data: vec![-1.0, 7.0, f32::NAN] };
        assert_eq!(odd.to_bytes().data, [0, 255, 0]);
    }

    #[test]
    fn what_is_pasted_is_what_is_cropped() {
        let part = ByteImage { height: 2, width: 1, channels: 3, data: (1..=6).collect() };
        let mut image = ByteImage::new(4, 3, 3);
        image.paste(&part, [1, 2]);
        assert_eq!(image.cropped(2, 1, 1, 2), part);
        assert_eq!(image.data.iter().map(|&v| usize::from(v)).sum::<usize>(), 21);
    }

    #[test]
    fn crops_and_channels_take_the_right_pixels() {
        let data = (0..2 * 3 * 4).collect();
        let image = ByteImage { height: 2, width: 3, channels: 4, data };
        assert_eq!(image.cropped(1, 1, 2, 1).data, image.data[16..24]);
        assert_eq!(image.pixel(1, 1), &image.data[16..20]);
        assert_eq!(image.alpha().unwrap().data, [3, 7, 11, 15, 19, 23]);
        assert_eq!(image.to_rgb().data[3..6], [4, 5, 6]);
        let gray = ByteImage { height: 1, width: 1, channels: 2, data: vec![100, 51] };
        assert_eq!(gray.over([0, 200, 255]).data, [20, 180, 224]);
    }
}
