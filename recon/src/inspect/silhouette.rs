//! A mask as a signed distance with its camera: how far inside the object's outline a point is seen.

use std::sync::Arc;

use datasets::View;
use mesh_core::vector::affine;
use mesh_core::{Camera, bilinear};
use rayon::prelude::*;

use super::window::Window;

/// Blur of the distance, pixels: what makes the edge known between pixels.
const BLUR: f32 = 0.7;
/// Steps of the stored distance in a pixel: one byte each, up to 15.9 pixels.
const STEPS: f32 = 8.0;

/// One view's outline.
#[derive(Clone, Debug)]
pub(super) struct Silhouette {
    pub(super) camera: Camera,
    /// Rows x, y, depth of the camera over world points, to pixels.
    rows: [[f64; 4]; 3],
    /// Signed distance to the outline in eighths of a pixel, negative inside.
    distance: Arc<[i8]>,
    /// Places on the outline; those on the image's border are not of it.
    outline: Arc<[[f64; 2]]>,
    /// Whether the object leaves the image, so that what is outside is not known.
    open: bool,
    /// Pixels of the mask.
    pub(super) area: usize,
    /// Pixels of the view's image to one of these.
    pub(super) scale: f64,
    /// Which part of that image this is.
    pub(super) window: Window,
}

impl Silhouette {
    /// Those of several views.
    pub(super) fn all(views: &[View]) -> Vec<Self> {
        views.par_iter().map(Self::new).collect()
    }

    pub(super) fn new(view: &View) -> Self {
        Self::seen_by(view, &view.camera)
    }

    /// The same where the view's camera is another.
    pub(super) fn seen_by(view: &View, camera: &Camera) -> Self {
        let window = Window::of(view);
        let (mask, camera) = (window.mask(view), window.camera(camera));
        let distance: Arc<[i8]> = mask
            .signed_distance(BLUR)
            .data
            .into_iter()
            .map(|d| (STEPS * d).round().clamp(-127.0, 127.0) as i8)
            .collect();
        Self {
            rows: camera.pixel_projection(),
            outline: outline(&distance, mask.height, mask.width).into(),
            distance,
            open: mask.touches_border(),
            area: mask.count(),
            scale: window.scale(),
            window,
            camera,
        }
    }

    /// The same mask seen by another camera.
    pub(super) fn with(&self, camera: Camera) -> Self {
        Self { rows: camera.pixel_projection(), camera, ..self.clone() }
    }

    /// Signed distance in pixels of where a world point is seen, negative inside of the outline: bilinear, up to 15.9. What is
    /// behind the camera or outside of the image is far outside, unless the object goes on there.
    pub(super) fn at(&self, p: [f64; 3]) -> f32 {
        const FAR: f32 = 127.0 / STEPS;
        let [x, y, depth] = affine(&self.rows, p);
        let over = if self.camera.is_perspective() { depth } else { 1.0 };
        if over <= 0.0 {
            return FAR;
        }
        let (w, h) = (self.camera.width, self.camera.height);
        let (column, row) = ((x / over) as f32, (y / over) as f32);
        if !(column >= 0.0 && row >= 0.0 && column <= w as f32 && row <= h as f32) {
            return if self.open { -FAR } else { FAR };
        }
        self.between([column, row])
    }

    /// Signed distance in pixels at a place in the image.
    #[inline]
    pub(super) fn between(&self, [column, row]: [f32; 2]) -> f32 {
        let (width, height) = (self.camera.width, self.camera.height);
        let at = |i: usize, j: usize| [f32::from(self.distance[i * width + j])];
        bilinear([width, height], [column - 0.5, row - 0.5], at)[0] / STEPS
    }

    /// Places on the outline, at most so many, evenly spread.
    pub(super) fn outline(&self, most: usize) -> impl ExactSizeIterator<Item = [f64; 2]> {
        spread(&self.outline, most)
    }

    /// Middles of pixels whose distance, in pixels, lies in a range: how many there are, and at most so many of them, evenly spread.
    pub(super) fn pixels(
        &self,
        range: std::ops::Range<f32>,
        most: usize,
    ) -> (usize, Vec<[f64; 2]>) {
        let w = self.camera.width;
        let inside = |d: &i8| range.contains(&(f32::from(*d) / STEPS));
        let found: Vec<[f64; 2]> = self
            .distance
            .iter()
            .enumerate()
            .filter(|(_, d)| inside(d))
            .map(|(k, _)| [(k % w) as f64 + 0.5, (k / w) as f64 + 0.5])
            .collect();
        (found.len(), spread(&found, most).collect())
    }
}

/// Where the distance changes its sign between two pixels, beside or below each other.
fn outline(distance: &[i8], h: usize, w: usize) -> Vec<[f64; 2]> {
    let mut found = Vec::new();
    for i in 0..h {
        for j in 0..w {
            let here = distance[i * w + j];
            for (a, b) in [(i, j + 1), (i + 1, j)] {
                if a < h && b < w && (here <= 0) != (distance[a * w + b] <= 0) {
                    let [from, to] = [here, distance[a * w + b]].map(f64::from);
                    let t = from / (from - to);
                    let [di, dj] = [a - i, b - j].map(|d| t * d as f64 + 0.5);
                    found.push([j as f64 + dj, i as f64 + di]);
                }
            }
        }
    }
    found
}

fn spread(found: &[[f64; 2]], most: usize) -> impl ExactSizeIterator<Item = [f64; 2]> {
    let count = found.len().min(most);
    (0..count).map(move |k| found[(2 * k + 1) * found.len() / (2 * count)])
}
