//! Images: `f32` for arithmetic, bytes for what files hold.

/// An image of floats, `[H, W, C]`, row-major, row 0 at the top; sRGB in `[0, 1]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image {
    /// Number of rows.
    pub height: usize,
    /// Number of columns.
    pub width: usize,
    /// Number of channels, the fastest index.
    pub channels: usize,
    /// `height * width * channels` values.
    pub data: Vec<f32>,
}

/// An image of bytes, `[H, W, C]`: how views are kept, at a quarter of the memory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ByteImage {
    /// Number of rows.
    pub height: usize,
    /// Number of columns.
    pub width: usize,
    /// Number of channels, the fastest index.
    pub channels: usize,
    /// `height * width * channels` values.
    pub data: Vec<u8>,
}

impl Image {
    /// An image filled with zeros.
    pub fn new(height: usize, width: usize, channels: usize) -> Self {
        Self { height, width, channels, data: vec![0.0; height * width * channels] }
    }
}

impl ByteImage {
    /// An image filled with zeros.
    pub fn new(height: usize, width: usize, channels: usize) -> Self {
        Self { height, width, channels, data: vec![0; height * width * channels] }
    }
}
