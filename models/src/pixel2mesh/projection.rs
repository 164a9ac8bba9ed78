//! The camera that the published codes project every vertex with, whatever camera took the image.

use autodiff_lite::{Tape, Var};
use ndarray::Array3;

/// Half of the side that the published numbers are of, pixels.
const HALF: f64 = 112.0;

/// From the camera's frame to the image plane, the same for `n` images: `[N, 3, 4]`. Focal length and middle in pixels of an
/// image of 224, the middle counted from the left and from the top.
pub(super) fn published_lens(tape: &Tape, n: usize, [focal, middle]: [f64; 2]) -> Var<'_> {
    let (f, c) = ((focal / HALF) as f32, (middle / HALF - 1.0) as f32);
    // The camera looks along -z; rows grow downwards.
    let rows = [[f, 0.0, -c, 0.0], [0.0, f, c, 0.0], [0.0, 0.0, -1.0, 0.0]];
    tape.constant(Array3::from_shape_fn((n, 3, 4), |(_, i, j)| rows[i][j]))
}

#[cfg(test)]
mod tests {
    use ndarray::arr3;

    use super::*;

    /// The published formulas `h = 248 y / z + 111.5` and `w = 248 x / -z + 111.5`, rows and columns of 224 pixels.
    #[test]
    fn it_is_the_published_formula() {
        let tape = Tape::eval();
        let [x, y, z] = [0.11_f32, -0.07, -0.8];
        let seen =
            tape.constant(arr3(&[[[x, y, z]]])).project(published_lens(&tape, 1, [248.0, 111.5]));
        let seen = seen.value();
        let (h, w) = (248.0 * y / z + 111.5, 248.0 * x / -z + 111.5);
        assert!((112.0 * (seen[[0, 0, 0]] + 1.0) - w).abs() < 1e-3);
        assert!((112.0 * (1.0 - seen[[0, 0, 1]]) - h).abs() < 1e-3);
        assert_eq!(seen[[0, 0, 2]], -z);
    }
}
