//! What the outline of the mesh is pulled towards in one view.

use datasets::View;
use mesh_core::vector::affine;
use mesh_core::{Camera, Mask, bilinear, iou};

use super::contour::Surface;
use super::distance::Blur;

/// How far inside the centre of a pixel of the mask is at least, in pixels, and how far outside that of another.
const SURE: f32 = 0.1;

/// One view as the shape sees it: the mask's signed distance around the object, and the camera.
///
/// Only the box around the object is kept, so that memory and time follow the object's size in
/// the image rather than the image's.
#[derive(Clone, Debug)]
pub(crate) struct Target {
    /// What the view is called in its source.
    pub(crate) name: String,
    /// First column of the box in the view.
    pub(crate) left: usize,
    /// First row of the box in the view.
    pub(crate) top: usize,
    /// Columns of the box.
    pub(crate) width: usize,
    /// Rows of the box.
    pub(crate) height: usize,
    /// Whether the lens divides by depth.
    pub(crate) perspective: bool,
    /// The camera of the box.
    camera: Camera,
    /// Rows x, y, depth of the camera over world points, to pixels of the box.
    world: [[f64; 4]; 3],
    /// The same over the normalised coordinates in which the shape is fitted.
    rows: [[f32; 4]; 3],
    /// Where the camera is in these and 1, or the direction towards it and 0.
    eye: [f32; 4],
    /// Signed distances at pixel centres in units of `unit` pixels; two bytes each, since this is
    /// what a hundred large views cost.
    distance: Vec<i16>,
    unit: f32,
    /// The mask itself, a bit per pixel.
    mask: Vec<u8>,
}

impl Target {
    /// Measures the mask of a view; `None` where the mask is empty.
    ///
    /// Distances are cut at `reach` times the longer side of the mask's box; `margin`, in the same unit, is kept around it.
    pub(super) fn new(view: &View, blur: Blur, reach: f32, margin: f32) -> Option<Self> {
        let [top, left, rows, columns] = view.mask_bounds()?;
        let size = rows.max(columns) as f32;
        let pad = (margin * size).ceil().max(4.0) as usize;
        let (bottom, right) =
            ((top + rows + pad).min(view.mask.height), (left + columns + pad).min(view.mask.width));
        let (top, left) = (top.saturating_sub(pad), left.saturating_sub(pad));
        let (height, width) = (bottom - top, right - left);
        let mask = Mask::at_least(&view.mask.cropped(left, top, width, height), 1);
        let reach = (reach * size).max(2.0);
        let unit = reach / f32::from(i16::MAX);
        let mut bits = vec![0u8; mask.data.len().div_ceil(8)];
        for (pixel, _) in mask.data.iter().enumerate().filter(|(_, m)| **m) {
            bits[pixel / 8] |= 1 << (pixel % 8);
        }
        let camera = view.camera.cropped(left, top, width, height);
        let mut target = Self {
            name: view.name.clone(),
            left,
            top,
            width,
            height,
            perspective: camera.is_perspective(),
            world: camera.pixel_projection(),
            camera,
            rows: [[0.0; 4]; 3],
            eye: [0.0; 4],
            distance: quantized(&mask, blur, unit),
            unit,
            mask: bits,
        };
        target.place([0.0; 3], 1.0);
        Some(target)
    }

    /// Measures the mask anew.
    pub(super) fn measure(&mut self, blur: Blur) {
        self.distance = quantized(&self.mask(), blur, self.unit);
    }

    /// The camera of the box.
    pub(super) fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Takes another camera of the same box; [`place`](Self::place) is to follow.
    pub(super) fn set_camera(&mut self, camera: Camera) {
        self.world = camera.pixel_projection();
        self.camera = camera;
    }

    /// Sets the frame of [`project`](Self::project): world point = `center + radius * point`.
    pub(crate) fn place(&mut self, center: [f64; 3], radius: f64) {
        for (row, world) in self.rows.iter_mut().zip(&self.world) {
            let offset: f64 = (0..3).map(|k| world[k] * center[k]).sum::<f64>() + world[3];
            for k in 0..3 {
                row[k] = (world[k] * radius) as f32;
            }
            row[3] = offset as f32;
        }
        let (at, ahead) = (self.camera.center(), self.camera.forward());
        self.eye = if self.perspective {
            let [x, y, z] = [0, 1, 2].map(|k| ((at[k] - center[k]) / radius) as f32);
            [x, y, z, 1.0]
        } else {
            [-ahead.x as f32, -ahead.y as f32, -ahead.z as f32, 0.0]
        };
    }

    /// From where the view looks, as [`Planes::facing`](super::planes::Planes::facing) has it.
    pub(super) fn eye(&self) -> [f32; 4] {
        self.eye
    }

    /// Whether every corner is in front of the camera, or its rays are parallel.
    pub(super) fn has_before_it(&self, surface: Surface<'_>) -> bool {
        let before = |&p: &[f32; 3]| {
            let seen = self.project(p);
            self.is_before(seen)
        };
        // Nearly always their box is.
        surface.planes.least(&self.rows[2]) > 0.0 || surface.positions.iter().all(before)
    }

    /// Column and row in pixels of the box, and depth (in world units, positive in front).
    #[inline]
    pub(crate) fn project(&self, p: [f32; 3]) -> [f32; 3] {
        let [x, y, depth] = affine(&self.rows, p);
        if self.perspective { [x / depth, y / depth, depth] } else { [x, y, depth] }
    }

    /// Whether what is projected there can be seen. Parallel rays have no beginning, so that a camera may stand in the object.
    #[inline]
    pub(super) fn is_before(&self, [column, row, depth]: [f32; 3]) -> bool {
        (depth > 0.0 || !self.perspective) && column.is_finite() && row.is_finite()
    }

    /// Rows x, y, depth over the fitted frame of a part of the box, whose pixels are `shrink` times as long.
    pub(super) fn rows_of_part(&self, left: usize, top: usize, shrink: usize) -> [[f32; 4]; 3] {
        let [x, y, depth] = self.rows;
        let one = if self.perspective { depth } else { [0.0, 0.0, 0.0, 1.0] };
        let part = |row: [f32; 4], from: usize| {
            std::array::from_fn(|k| (row[k] - from as f32 * one[k]) / shrink as f32)
        };
        [part(x, left), part(y, top), depth]
    }

    /// Gradient at a point from the gradient at its projection.
    #[inline]
    pub(super) fn pull(&self, projected: [f32; 3], g: [f32; 2]) -> [f32; 3] {
        let [rx, ry, rw] = &self.rows;
        if self.perspective {
            let [x, y, depth] = projected;
            let along = x * g[0] + y * g[1];
            std::array::from_fn(|k| (g[0] * rx[k] + g[1] * ry[k] - along * rw[k]) / depth)
        } else {
            std::array::from_fn(|k| g[0] * rx[k] + g[1] * ry[k])
        }
    }

    /// Pixels per unit length of the fitted frame, at a depth.
    pub(crate) fn pixels_per_unit(&self, depth: f32) -> f32 {
        let r = &self.rows[0];
        let along = self.rows[2];
        // The part of the x row that is across the optical axis.
        let dot = r[0] * along[0] + r[1] * along[1] + r[2] * along[2];
        let axis = along[0] * along[0] + along[1] * along[1] + along[2] * along[2];
        let across: f32 = (0..3).map(|k| (r[k] - dot / axis * along[k]).powi(2)).sum();
        if self.perspective { across.sqrt() / depth } else { across.sqrt() }
    }

    /// Signed distance in pixels at a point of the box, bilinear between pixel centres; the
    /// border's value beyond it.
    #[inline]
    pub(crate) fn distance(&self, column: f32, row: f32) -> f32 {
        let at = |row: usize, column: usize| [f32::from(self.distance[row * self.width + column])];
        let [distance] = bilinear([self.width, self.height], [column - 0.5, row - 0.5], at);
        self.unit * distance
    }

    /// Whether a pixel of the box, counted row by row, is in the mask.
    pub(super) fn in_mask(&self, pixel: usize) -> bool {
        self.mask[pixel / 8] >> (pixel % 8) & 1 == 1
    }

    /// Intersection over union of the mask and the pixels of the box that are covered.
    pub(crate) fn iou(&self, covered: &[bool]) -> f64 {
        let pixels = covered.iter().enumerate();
        iou(pixels.map(|(pixel, &covered)| (covered, self.in_mask(pixel)))).unwrap_or(0.0)
    }

    /// Pixels of the mask.
    pub(crate) fn mask_area(&self) -> usize {
        self.mask.iter().map(|byte| byte.count_ones() as usize).sum()
    }

    /// The mask of the box.
    fn mask(&self) -> Mask {
        let (height, width) = (self.height, self.width);
        Mask { height, width, data: (0..height * width).map(|pixel| self.in_mask(pixel)).collect() }
    }

    /// Whether the mask encloses background that is somewhere further than `far` pixels from it.
    pub(super) fn shows_a_hole(&self, far: f32) -> bool {
        let holes = self.mask().holes();
        let deep =
            |(&hole, &distance): (&bool, &i16)| hole && f32::from(distance) * self.unit > far;
        holes.data.iter().zip(&self.distance).any(deep)
    }

    /// How many lines apart the outline is sampled so that an edge of this length is met about four
    /// times: large images cost a coarse mesh no more than small ones.
    pub(super) fn lines_between_samples(&self, edge: f32) -> usize {
        let depth = self.project([0.0; 3])[2];
        let pixels = edge * self.pixels_per_unit(depth);
        ((0.25 * pixels) as usize).clamp(1, 64)
    }

    /// Depth, in world units, per unit length of the fitted frame along the optical axis.
    pub(crate) fn depth_per_unit(&self) -> f32 {
        self.rows[2][..3].iter().map(|v| v * v).sum::<f32>().sqrt()
    }
}

/// Signed distances in units of `unit` pixels.
fn quantized(mask: &Mask, blur: Blur, unit: f32) -> Vec<i16> {
    let reach = unit * f32::from(i16::MAX);
    let sure = if blur.keeps_thin { 0.5 * SURE } else { SURE };
    blur.distance(mask)
        .data
        .into_iter()
        .zip(&mask.data)
        // What is a pixel wide would be blurred away: what the mask says of a pixel holds.
        .map(|(d, &inside)| if inside { d.min(-sure) } else { d.max(sure) })
        .map(|d| (d.clamp(-reach, reach) / unit).round() as i16)
        .collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::ByteImage;

    use super::*;

    /// A view whose middle pixels are the object.
    fn view(height: usize, width: usize) -> View {
        let camera =
            Camera::look_at([0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.6, width, height);
        let mut mask = ByteImage::new(height, width, 1);
        let pixels = mask.data.len();
        mask.data[pixels / 3..pixels.div_ceil(2)].fill(255);
        View {
            crop: None,
            name: String::new(),
            color: ByteImage::new(height, width, 3),
            mask,
            camera,
            depth: None,
        }
    }

    #[test]
    fn distances_in_a_view_that_is_a_pixel_wide_or_high_follow_its_line() {
        for [height, width] in [[1, 1], [1, 12], [12, 1]] {
            let target = Target::new(&view(height, width), Blur::plain(1.0), 0.5, 4.0).unwrap();
            let at =
                |k: f32| if width > 1 { target.distance(k, 0.5) } else { target.distance(0.5, k) };
            let pixel = |k: usize| target.unit * f32::from(target.distance[k]);
            for k in 0..target.distance.len() {
                assert_eq!(at(k as f32 + 0.5), pixel(k), "{height} x {width}, {k}");
            }
            // The border's value beyond it, across the line too.
            assert_eq!(at(-3.0), pixel(0));
            assert_eq!(target.distance(7.0, 9.0), at(if width > 1 { 7.0 } else { 9.0 }));
        }
    }
}
