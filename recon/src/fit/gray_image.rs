//! A view as stereo compares it: how bright each pixel of the object is, and where that pixel looks.

use std::sync::Arc;

use datasets::View;
use diff_raster::{Faces, Fragments, NONE, Scratch, Settings, rasterize_into};
use mesh_core::bilinear;
use mesh_core::vector::{affine, dot, norm, sub};
use ndarray::ArrayView3;

use super::target::Target;

/// Pixels that are kept around the mask.
const MARGIN: usize = 4;

/// The part of a view that shows the object, averaged down to a side of so many pixels, and the camera of this grid.
#[derive(Clone, Debug)]
pub(super) struct GrayImage {
    /// Columns, and rows.
    pub(super) size: [usize; 2],
    /// Where the camera is, seen from the middle of the fitted frame; of length 1.
    pub(super) from: [f32; 3],
    /// How bright each pixel is, from 0 to 1.
    pub(super) brightness: Vec<f32>,
    /// Whether the mask has most of the pixel.
    pub(super) mask: Vec<bool>,
    pub(super) perspective: bool,
    /// From the fitted frame to `[x w, y w, depth]` of this grid, `w` being the depth where the lens divides by it, else 1.
    rows: [[f32; 4]; 3],
    /// From there back.
    inverse: [[f32; 3]; 3],
}

/// What a view shows of a mesh, in memory that is kept.
#[derive(Default)]
pub(super) struct Drawn {
    pub(super) fragments: Fragments,
    scratch: Scratch,
    ndc: Vec<f32>,
}

impl GrayImage {
    /// A view whose object is at most `side` pixels wide and high.
    pub(super) fn new(target: &Target, view: &View, side: usize) -> Self {
        let [top, left, bottom, right] = bounds(target);
        let shrink = (right - left).max(bottom - top).div_ceil(side).max(1);
        let pad = MARGIN * shrink;
        let (top, left) = (top.saturating_sub(pad), left.saturating_sub(pad));
        let bottom = (bottom + pad).min(target.height);
        let right = (right + pad).min(target.width);
        let size = [(right - left).div_ceil(shrink), (bottom - top).div_ceil(shrink)];
        let rows = target.rows_of_part(left, top, shrink);
        let mut image = Self {
            size,
            from: [0.0; 3],
            brightness: vec![0.0; size[0] * size[1]],
            mask: vec![false; size[0] * size[1]],
            perspective: target.perspective,
            rows,
            inverse: inverse(&rows),
        };
        image.from = image.direction();
        let color = &view.color;
        let (mut counts, mut inside) =
            (vec![0u32; size[0] * size[1]], vec![0u32; size[0] * size[1]]);
        for row in top..bottom {
            let source = ((target.top + row) * color.width + target.left) * 3;
            for column in left..right {
                let to = (row - top) / shrink * size[0] + (column - left) / shrink;
                let bytes = &color.data[source + 3 * column..];
                let gray = |k: usize| f32::from(bytes[k]) / 255.0;
                image.brightness[to] += 0.299 * gray(0) + 0.587 * gray(1) + 0.114 * gray(2);
                counts[to] += 1;
                inside[to] += u32::from(target.in_mask(row * target.width + column));
            }
        }
        for (k, &count) in counts.iter().enumerate() {
            image.brightness[k] /= count.max(1) as f32;
            image.mask[k] = 2 * inside[k] > count;
        }
        image
    }

    /// Where the camera is, seen from the origin.
    fn direction(&self) -> [f32; 3] {
        let away = if self.perspective {
            self.rows.map(|row| row[3])
        } else {
            // Along the optical axis, on which x and y stay what they are.
            [0.0, 0.0, 1.0]
        };
        let d = times(&self.inverse, away).map(|v| -v);
        let length = dot(d, d).sqrt().max(1e-20);
        d.map(|v| v / length)
    }

    /// The point of the fitted frame at a place of the grid and a depth.
    #[inline]
    pub(super) fn point(&self, x: f32, y: f32, depth: f32) -> [f32; 3] {
        let w = if self.perspective { depth } else { 1.0 };
        let q = [x * w, y * w, depth];
        times(&self.inverse, std::array::from_fn(|k| q[k] - self.rows[k][3]))
    }

    /// Before the division by depth.
    #[inline]
    pub(super) fn homogeneous(&self, p: [f32; 3]) -> [f32; 3] {
        affine(&self.rows, p)
    }

    /// The place on the grid of a point, and its depth.
    #[inline]
    pub(super) fn project(&self, p: [f32; 3]) -> [f32; 3] {
        let [x, y, depth] = self.homogeneous(p);
        if self.perspective { [x / depth, y / depth, depth] } else { [x, y, depth] }
    }

    /// From a point to where it is seen from, of length 1.
    #[inline]
    pub(super) fn towards(&self, x: f32, y: f32) -> [f32; 3] {
        let d = if self.perspective { [x, y, 1.0] } else { [0.0, 0.0, 1.0] };
        let d = times(&self.inverse, d);
        let length = dot(d, d).sqrt().max(1e-20);
        d.map(|v| -v / length)
    }

    /// How bright it is at a place, between the pixels' centres.
    #[inline]
    pub(super) fn at(&self, x: f32, y: f32) -> f32 {
        let at = |i: usize, j: usize| [self.brightness[i * self.size[0] + j]];
        bilinear(self.size, [x - 0.5, y - 0.5], at)[0]
    }

    /// How wide a pixel is at a depth, in the fitted frame.
    pub(super) fn width_at(&self, depth: f32) -> f32 {
        let [x, y] = self.size.map(|s| 0.5 * s as f32);
        let [a, b] = [x, x + 1.0].map(|x| self.point(x, y, depth));
        norm(sub(a, b))
    }

    /// Depth along the optical axis to a unit length of the fitted frame.
    pub(super) fn depth_per_unit(&self) -> f32 {
        self.rows[2][..3].iter().map(|v| v * v).sum::<f32>().sqrt()
    }

    /// Draws the mesh on the grid.
    pub(super) fn draw(&self, positions: &[[f32; 3]], faces: &Arc<Faces>, drawn: &mut Drawn) {
        let [w, h] = self.size;
        drawn.ndc.clear();
        drawn.ndc.extend(positions.iter().flat_map(|&p| {
            let [x, y, depth] = self.project(p);
            [2.0 * x / w as f32 - 1.0, 1.0 - 2.0 * y / h as f32, depth]
        }));
        let settings = Settings {
            perspective: self.perspective,
            cull_back_faces: true,
            ..Settings::new(h, w)
        }
        .near_within(drawn.ndc.iter().skip(2).step_by(3).copied());
        let ndc = ArrayView3::from_shape((1, positions.len(), 3), &drawn.ndc)
            .expect("three numbers per vertex");
        rasterize_into(ndc, faces, &settings, &drawn.scratch, &mut drawn.fragments);
    }
}

impl Drawn {
    /// The face and its depth at a pixel.
    #[inline]
    pub(super) fn at(&self, pixel: usize) -> Option<(u32, f32)> {
        let face = self.fragments.face[pixel];
        (face != NONE).then(|| (face, self.fragments.depth[pixel]))
    }
}

/// First row and column of the mask in the target's box, and the first after it.
fn bounds(target: &Target) -> [usize; 4] {
    let mut bounds = [target.height, target.width, 0, 0];
    for row in 0..target.height {
        for column in 0..target.width {
            if target.in_mask(row * target.width + column) {
                let [top, left, bottom, right] = bounds;
                bounds =
                    [top.min(row), left.min(column), bottom.max(row + 1), right.max(column + 1)];
            }
        }
    }
    bounds
}

#[inline]
fn times(m: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    m.map(|row| dot(row, v))
}

/// The inverse of the left three columns, by cofactors.
fn inverse(m: &[[f32; 4]; 3]) -> [[f32; 3]; 3] {
    let at = |i: usize, j: usize| f64::from(m[i % 3][j % 3]);
    let minor = |i: usize, j: usize| {
        at(i + 1, j + 1) * at(i + 2, j + 2) - at(i + 1, j + 2) * at(i + 2, j + 1)
    };
    let determinant: f64 = (0..3).map(|j| at(0, j) * minor(0, j)).sum();
    std::array::from_fn(|i| std::array::from_fn(|j| (minor(j, i) / determinant) as f32))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::{ByteImage, Camera};

    use super::super::distance::Blur;
    use super::*;

    #[test]
    fn a_view_that_is_a_pixel_wide_or_high_is_as_bright_as_its_line() {
        for [height, width] in [[1, 1], [1, 6], [6, 1]] {
            let camera =
                Camera::look_at([0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.6, width, height);
            let data = (0..height * width).flat_map(|k| [40 * k as u8; 3]).collect();
            let color = ByteImage { height, width, channels: 3, data };
            let mut mask = ByteImage::new(height, width, 1);
            mask.data.fill(255);
            let view = View { name: String::new(), color, mask, camera, depth: None, crop: None };
            let target = Target::new(&view, Blur::plain(1.0), 0.5, 4.0).unwrap();
            let image = GrayImage::new(&target, &view, 64);
            let at = |k: f32| if width > 1 { image.at(k, 0.5) } else { image.at(0.5, k) };
            for (k, &bright) in image.brightness.iter().enumerate() {
                assert_eq!(at(k as f32 + 0.5), bright, "{height} x {width}, {k}");
            }
            assert_eq!(at(50.0), *image.brightness.last().unwrap());
        }
    }
}
