//! Planar depth per pixel.

/// Planar depth per pixel, in world units; `+inf` where nothing is seen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DepthMap {
    /// Number of rows.
    pub height: usize,
    /// Number of columns.
    pub width: usize,
    /// `height * width` depths, row-major, row 0 at the top.
    pub data: Vec<f32>,
}

impl DepthMap {
    /// The depth at another size, of each pixel that of the nearest one: averages across an edge lie in the air.
    ///
    /// # Panics
    /// If it has no pixels and the other has.
    #[must_use]
    pub fn resized(&self, height: usize, width: usize) -> Self {
        let nearest = |k: usize, from: usize, to: usize| (2 * k + 1) * from / (2 * to);
        let pixel = |k: usize| {
            let (row, column) =
                (nearest(k / width, self.height, height), nearest(k % width, self.width, width));
            self.data[row * self.width + column]
        };
        Self { height, width, data: (0..height * width).map(pixel).collect() }
    }
}

/// One over the depth per pixel, larger where it is nearer; `+inf` where nothing is known.
///
/// What MiDaS and its like estimate is of an unknown scale, shifted by an unknown amount.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DisparityMap {
    /// Number of rows.
    pub height: usize,
    /// Number of columns.
    pub width: usize,
    /// `height * width` disparities, row-major, row 0 at the top.
    pub data: Vec<f32>,
}

/// Files write "nothing here" as 1e10 (Blender), infinity, or the largest half float; depths of real
/// scenes end well below the first.
#[cfg(feature = "exr")]
const FAR: f32 = 1e9;
/// The largest half float, which is what a writer of halves makes of 1e10.
#[cfg(feature = "exr")]
const LARGEST_HALF: f32 = 65504.0;

/// The depth of a pixel as a file holds it: `+inf` for each of the markers of a hole.
#[cfg(feature = "exr")]
pub(super) fn from_file(value: f32) -> f32 {
    if value.is_finite() && value < FAR && value != LARGEST_HALF { value } else { f32::INFINITY }
}

/// The depth of a pixel as files hold it: 1e10, Blender's marker, where nothing is seen.
#[cfg(feature = "exr")]
pub(super) fn to_file(value: f32) -> f32 {
    if value.is_finite() { value } else { 1e10 }
}
