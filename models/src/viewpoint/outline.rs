//! How well an outline fits.

/// Intersection over union of pixels that are seen and pixels that should be: pairs of the two, pixel by pixel; 0 of none.
pub(crate) fn overlap(pixels: impl Iterator<Item = (bool, bool)>) -> f64 {
    let (mut both, mut either) = (0_usize, 0_usize);
    for (a, b) in pixels {
        both += usize::from(a && b);
        either += usize::from(a || b);
    }
    both as f64 / either.max(1) as f64
}
