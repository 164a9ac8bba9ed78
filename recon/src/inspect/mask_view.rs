//! A mask and its camera, small and ready to be asked what lies inside.

use std::sync::Arc;

use datasets::View;
use mesh_core::nalgebra::{Matrix3, Vector3};
use mesh_core::vector::affine;
use mesh_core::{Camera, Lens, Mask};

use super::reading::Reading;

/// Longer sides are averaged down to this: enough to judge by, little enough to search with.
const LONGEST: usize = 192;

/// A mask and its camera as one reading has them.
#[derive(Clone, Debug)]
pub(crate) struct MaskView {
    pub(crate) camera: Camera,
    /// Rows X, Y, W of the projection to normalised device coordinates.
    rows: [[f64; 4]; 3],
    mask: Arc<[bool]>,
    /// The mask and the pixels next to it: what rounding may have taken away.
    grown: Arc<[bool]>,
    /// Whether the object leaves the image, so that what is outside is not known.
    open: bool,
}

impl MaskView {
    /// The view as it is given, made small.
    pub(crate) fn new(view: &View) -> Self {
        Self::seen_by(view, &view.camera)
    }

    /// The same where its camera is another.
    pub(crate) fn seen_by(view: &View, camera: &Camera) -> Self {
        let (mask, camera) = view.mask_within(LONGEST, camera);
        Self::from_parts(camera, mask.data)
    }

    fn from_parts(camera: Camera, data: Vec<bool>) -> Self {
        let mask = Mask { height: camera.height, width: camera.width, data };
        let (grown, open) = (mask.dilated().data.into(), mask.touches_border());
        Self { rows: camera.projection(), camera, mask: mask.data.into(), grown, open }
    }

    /// The same image under another reading.
    pub(crate) fn under(&self, reading: Reading) -> Self {
        let w = self.camera.width;
        let mut camera = self.camera.clone();
        let axes = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let inverse = |camera: &mut Camera| {
            let turned = camera.rotation.transpose();
            camera.translation = -(turned * camera.translation);
            camera.rotation = turned;
        };
        let opencv = |camera: &mut Camera| {
            camera.rotation = axes * camera.rotation;
            camera.translation = axes * camera.translation;
        };
        match reading {
            Reading::AsGiven => {}
            Reading::FlippedY => {
                let rows = self.mask.chunks_exact(w).rev();
                return Self::from_parts(camera, rows.flatten().copied().collect());
            }
            Reading::FlippedX => {
                let rows = self.mask.chunks_exact(w);
                return Self::from_parts(
                    camera,
                    rows.flat_map(|r| r.iter().rev()).copied().collect(),
                );
            }
            Reading::Turned => {
                return Self::from_parts(camera, self.mask.iter().rev().copied().collect());
            }
            Reading::OpenCvAxes => opencv(&mut camera),
            Reading::InversePose => inverse(&mut camera),
            Reading::InverseOpenCvPose => {
                // The file's pose was taken for world to camera in OpenGL's axes.
                inverse(&mut camera);
                opencv(&mut camera);
            }
            Reading::Focal(factor) => {
                if let Lens::Perspective { fx, fy, .. } = &mut camera.lens {
                    *fx *= factor;
                    *fy *= factor;
                }
            }
        }
        Self { rows: camera.projection(), camera, ..self.clone() }
    }

    /// Whether a point may be of the object, for all that this image says.
    pub(crate) fn allows(&self, p: [f64; 3]) -> bool {
        let [x, y, depth] = affine(&self.rows, p);
        let over = if self.camera.is_perspective() {
            if depth <= 0.0 {
                return false;
            }
            depth
        } else {
            1.0
        };
        let (w, h) = (self.camera.width, self.camera.height);
        let (column, row) = ((1.0 + x / over) * 0.5 * w as f64, (1.0 - y / over) * 0.5 * h as f64);
        if column >= 0.0 && row >= 0.0 && column < w as f64 && row < h as f64 {
            self.grown[row as usize * w + column as usize]
        } else {
            self.open
        }
    }

    /// Whether the object touches the border of the image.
    pub(crate) fn is_open(&self) -> bool {
        self.open
    }

    /// Share of the border's pixels that the mask covers.
    pub(crate) fn border_share(&self) -> f64 {
        let (h, w) = (self.camera.height, self.camera.width);
        let at = |i: usize, j: usize| usize::from(self.mask[i * w + j]);
        let across: usize = (0..w).map(|j| at(0, j) + at(h - 1, j)).sum();
        let down: usize = (0..h).map(|i| at(i, 0) + at(i, w - 1)).sum();
        (across + down) as f64 / (2 * (w + h)) as f64
    }

    /// At most so many pixels of the mask, evenly spread, as positions in the image.
    pub(crate) fn pixels(&self, most: usize) -> Vec<[f64; 2]> {
        let w = self.camera.width;
        let inside: Vec<usize> = (0..self.mask.len()).filter(|&k| self.mask[k]).collect();
        let count = inside.len().min(most);
        (0..count)
            .map(|k| inside[(2 * k + 1) * inside.len() / (2 * count)])
            .map(|at| [(at % w) as f64 + 0.5, (at / w) as f64 + 0.5])
            .collect()
    }

    /// The corners of the mask's box: left, top, right, bottom; `None` for an empty mask.
    pub(crate) fn bounds(&self) -> Option<[f64; 4]> {
        let w = self.camera.width;
        let mut bounds: Option<[usize; 4]> = None;
        for (k, _) in self.mask.iter().enumerate().filter(|(_, m)| **m) {
            let (i, j) = (k / w, k % w);
            let b = bounds.get_or_insert([j, i, j, i]);
            *b = [b[0].min(j), b[1].min(i), b[2].max(j), b[3].max(i)];
        }
        bounds.map(|[l, t, r, b]| [l as f64, t as f64, r as f64 + 1.0, b as f64 + 1.0])
    }
}
