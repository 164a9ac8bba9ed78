//! Which face of a mesh each sample of an image shows.

use std::sync::Arc;

use diff_raster::{Faces, Fragments, Scratch, Settings, rasterize_into};
use mesh_core::Camera;
use mesh_core::vector::{affine, widen};
use ndarray::ArrayView3;

/// Samples that a thread draws at a time, 20 bytes each: nine of each pixel of an image of 1300 x 1300.
const SAMPLES: usize = 1 << 24;

/// What a thread keeps from one view to the next.
#[derive(Default)]
pub(super) struct Sketch {
    /// The samples of the part that was drawn last, row by row.
    pub(super) fragments: Fragments,
    projected: Vec<f32>,
    scratch: Scratch,
}

impl Sketch {
    /// Takes `times` by `times` samples of each pixel in a part of a camera's image, one of its [`bands`].
    pub(super) fn draw(
        &mut self,
        camera: &Camera,
        [top, left, rows, columns]: [usize; 4],
        positions: &[[f32; 3]],
        faces: &Arc<Faces>,
        times: usize,
    ) {
        let part = camera.cropped(left, top, columns, rows);
        project(&part, positions, &mut self.projected);
        let settings = Settings {
            perspective: part.is_perspective(),
            ..Settings::new(part.height * times, part.width * times)
        }
        .near_within(self.projected.iter().skip(2).step_by(3).copied());
        let projected = ArrayView3::from_shape((1, positions.len(), 3), &self.projected)
            .expect("three numbers per vertex");
        rasterize_into(projected, faces, &settings, &self.scratch, &mut self.fragments);
    }
}

/// The part of a camera's image where the mesh can be, in bands of rows that have few enough samples to be held: their top, left, rows
/// and columns. The rest of a large image costs nothing.
pub(super) fn bands(
    camera: &Camera,
    positions: &[[f32; 3]],
    times: usize,
) -> impl Iterator<Item = [usize; 4]> {
    bands_of(footprint(camera, positions), times, SAMPLES)
}

/// A part of an image in bands of at most so many samples, or of one row.
fn bands_of(
    [top, left, rows, columns]: [usize; 4],
    times: usize,
    most: usize,
) -> impl Iterator<Item = [usize; 4]> {
    let high = (most / (columns * times * times).max(1)).max(1);
    let rows = if columns == 0 { 0 } else { rows };
    (0..rows).step_by(high).map(move |row| [top + row, left, high.min(rows - row), columns])
}

/// The pixels that the mesh can touch: first row, first column, rows, columns.
///
/// The whole image where a vertex is not in front of the camera, since its projection then says
/// nothing.
fn footprint(camera: &Camera, positions: &[[f32; 3]]) -> [usize; 4] {
    let (height, width) = (camera.height, camera.width);
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for p in positions {
        let p = camera.project(p.map(f64::from));
        let known = p.column.is_finite() && p.row.is_finite();
        if !known || (camera.is_perspective() && p.depth <= 0.0) {
            return [0, 0, height, width];
        }
        for (k, v) in [p.row, p.column].into_iter().enumerate() {
            (low[k], high[k]) = (low[k].min(v), high[k].max(v));
        }
    }
    // A pixel to spare on each side, for the rounding of the rasteriser.
    let first = |k: usize, size: usize| (low[k] - 1.0).clamp(0.0, size as f64) as usize;
    let last = |k: usize, size: usize| (high[k] + 2.0).clamp(0.0, size as f64) as usize;
    let (top, left) = (first(0, height), first(1, width));
    [top, left, last(0, height).saturating_sub(top), last(1, width).saturating_sub(left)]
}

/// NDC and planar depth of every vertex.
fn project(camera: &Camera, positions: &[[f32; 3]], out: &mut Vec<f32>) {
    let rows = camera.projection();
    let perspective = camera.is_perspective();
    out.clear();
    out.reserve(3 * positions.len());
    for &p in positions {
        let [x, y, w] = affine(&rows, widen(p));
        let by = if perspective { w } else { 1.0 };
        out.extend([(x / by) as f32, (y / by) as f32, w as f32]);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::primitives;

    use super::*;

    #[test]
    fn bands_show_what_the_whole_does() {
        let ball = primitives::icosphere(3);
        let faces = Arc::new(Faces::of(&ball).unwrap());
        let camera = Camera::look_at([0.3, 0.4, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.8, 80, 60);
        let draw = |most: usize| {
            let (mut sketch, mut shown) = (Sketch::default(), Vec::new());
            let whole = footprint(&camera, &ball.positions);
            let mut next = whole[0];
            for band in bands_of(whole, 3, most) {
                assert!(band[0] == next && band[2] * band[3] * 9 <= most);
                next += band[2];
                sketch.draw(&camera, band, &ball.positions, &faces, 3);
                shown.extend_from_slice(&sketch.fragments.face);
            }
            assert_eq!(next, whole[0] + whole[2]);
            shown
        };
        let (whole, bands) = (draw(SAMPLES), draw(80 * 9 * 5));
        let other = whole.iter().zip(&bands).filter(|(a, b)| a != b).count();
        // Rounding may move an edge across a sample's centre.
        assert!(whole.len() == bands.len() && other < 10, "{other} of {}", whole.len());
        // A row is drawn however long it is.
        assert_eq!(
            bands_of([2, 3, 2, 100], 15, 9).collect::<Vec<_>>(),
            [[2, 3, 1, 100], [3, 3, 1, 100]]
        );
        assert_eq!(bands_of([2, 3, 5, 0], 3, SAMPLES).count(), 0);
    }
}
