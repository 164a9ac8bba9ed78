//! Which face of a mesh each sample of an image shows.

use std::sync::Arc;

use diff_raster::{Faces, Fragments, Scratch, Settings, rasterize_into};
use mesh_core::Camera;
use mesh_core::vector::{affine, widen};
use ndarray::ArrayView3;

/// What a thread keeps from one view to the next.
#[derive(Default)]
pub(super) struct Sketch {
    /// The samples of the part that was drawn last, row by row.
    pub(super) fragments: Fragments,
    projected: Vec<f32>,
    scratch: Scratch,
}

impl Sketch {
    /// Takes `times` by `times` samples of each pixel in the part of a camera's image where the mesh can be: its top, left, rows
    /// and columns; none where it is nowhere. The rest of a large image costs nothing.
    pub(super) fn draw(
        &mut self,
        camera: &Camera,
        positions: &[[f32; 3]],
        faces: &Arc<Faces>,
        times: usize,
    ) -> Option<[usize; 4]> {
        let [top, left, rows, columns] = footprint(camera, positions);
        if rows * columns == 0 {
            return None;
        }
        let part = camera.cropped(left, top, columns, rows);
        let settings = Settings {
            perspective: part.is_perspective(),
            ..Settings::new(part.height * times, part.width * times)
        };
        project(&part, positions, &mut self.projected);
        let projected = ArrayView3::from_shape((1, positions.len(), 3), &self.projected)
            .expect("three numbers per vertex");
        rasterize_into(projected, faces, &settings, &self.scratch, &mut self.fragments);
        Some([top, left, rows, columns])
    }
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
