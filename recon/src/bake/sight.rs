//! Which part of the surface each pixel of a view shows.

use std::sync::Arc;

use datasets::View;
use diff_raster::{Faces, Fragments, NONE, Scratch, Settings, rasterize_into};
use mesh_core::vector::{cross, interpolate, norm, sub};
use ndarray::ArrayView3;
use rayon::prelude::*;

use crate::fit::target::Target;

/// Samples of all views that are kept, at most, 32 bytes each; more are drawn anew each time.
const KEPT: usize = 1 << 21;

/// A look at the mesh from one view after the other, in memory that is kept.
#[derive(Default)]
pub(crate) struct Sight {
    ndc: Vec<f32>,
    pub(crate) projected: Vec<[f32; 3]>,
    pub(crate) fragments: Fragments,
    scratch: Scratch,
}

/// A pixel that shows the surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    pub(crate) face: u32,
    pub(crate) barycentric: [f32; 3],
    /// What the photograph shows there, sRGB.
    pub(crate) color: [f32; 3],
    /// How much it should count: little where the surface is seen at a slant or the mask ends.
    pub(crate) weight: f32,
}

impl Sample {
    /// What vertex colours are at the pixel.
    pub(crate) fn interpolate(&self, faces: &[[u32; 3]], colors: &[[f32; 3]]) -> [f32; 3] {
        let corners = faces[self.face as usize].map(|v| colors[v as usize]);
        interpolate(self.barycentric, &corners)
    }
}

/// A surface and the photographs of it: `views` and `targets` correspond.
pub(crate) struct Photographed<'a> {
    pub(crate) views: &'a [&'a View],
    pub(crate) targets: &'a [Target],
    pub(crate) positions: &'a [[f32; 3]],
    pub(crate) faces: &'a [[u32; 3]],
    pub(crate) drawn: Arc<Faces>,
    /// The samples of each view; none where they are too many.
    kept: Vec<Vec<Sample>>,
}

impl<'a> Photographed<'a> {
    pub(crate) fn new(
        views: &'a [&'a View],
        targets: &'a [Target],
        positions: &'a [[f32; 3]],
        faces: &'a [[u32; 3]],
    ) -> Self {
        let drawn = Faces::of_valid(positions.len(), faces);
        let mut seen = Self { views, targets, positions, faces, drawn, kept: Vec::new() };
        if targets.iter().map(Target::mask_area).sum::<usize>() <= KEPT {
            let kept = |sight: &mut Sight, view: usize| {
                let mut samples = Vec::with_capacity(targets[view].mask_area());
                seen.samples(sight, view, |sample| samples.push(sample));
                samples
            };
            seen.kept = (0..targets.len()).into_par_iter().map_init(Sight::default, kept).collect();
        }
        seen
    }

    /// Calls `visit` with every pixel of a view that shows the surface.
    pub(crate) fn samples(&self, sight: &mut Sight, view: usize, visit: impl FnMut(Sample)) {
        if let Some(kept) = self.kept.get(view) {
            return kept.iter().copied().for_each(visit);
        }
        let target = &self.targets[view];
        sight.look(target, self.positions, &self.drawn);
        sight.samples(target, self.views[view], self.positions, self.faces, visit);
    }
}

impl Sight {
    /// Draws the faces that look at the camera into the box of a target.
    pub(crate) fn look(&mut self, target: &Target, positions: &[[f32; 3]], faces: &Arc<Faces>) {
        self.draw(target, positions, faces, true);
    }

    /// Draws all faces, also from behind.
    pub(super) fn look_at_both_sides(
        &mut self,
        target: &Target,
        positions: &[[f32; 3]],
        faces: &Arc<Faces>,
    ) {
        self.draw(target, positions, faces, false);
    }

    fn draw(
        &mut self,
        target: &Target,
        positions: &[[f32; 3]],
        faces: &Arc<Faces>,
        cull_back_faces: bool,
    ) {
        let (w, h) = (target.width as f32, target.height as f32);
        self.projected.clear();
        self.projected.extend(positions.iter().map(|&p| target.project(p)));
        self.ndc.clear();
        self.ndc.extend(
            self.projected.iter().flat_map(|q| [2.0 * q[0] / w - 1.0, 1.0 - 2.0 * q[1] / h, q[2]]),
        );
        let settings = Settings {
            perspective: target.perspective,
            cull_back_faces,
            ..Settings::new(target.height, target.width)
        }
        .near_within(self.projected.iter().map(|q| q[2]));
        let ndc = ArrayView3::from_shape((1, positions.len(), 3), &self.ndc)
            .expect("three numbers per vertex");
        rasterize_into(ndc, faces, &settings, &self.scratch, &mut self.fragments);
    }

    /// What a pixel of the last [`look`](Self::look) shows of the colours of vertices; `None` where it does not show the surface.
    pub(crate) fn color(
        &self,
        pixel: usize,
        faces: &[[u32; 3]],
        colors: &[[f32; 3]],
    ) -> Option<[f32; 3]> {
        let face = self.fragments.face[pixel];
        if face == NONE {
            return None;
        }
        let shares = std::array::from_fn(|k| self.fragments.barycentric[3 * pixel + k]);
        Some(interpolate(shares, &faces[face as usize].map(|v| colors[v as usize])))
    }

    /// How squarely a face is seen, 0 to 1.
    #[inline]
    pub(crate) fn facing(&self, target: &Target, positions: &[[f32; 3]], face: [u32; 3]) -> f32 {
        let [a, b, c] = face.map(|v| self.projected[v as usize]);
        let seen = self.doubled_area(face);
        let [p, q, r] = face.map(|v| positions[v as usize]);
        let normal = cross(sub(q, p), sub(r, p));
        let area = norm(normal);
        let scale = target.pixels_per_unit((a[2] + b[2] + c[2]) / 3.0);
        (seen / (area * scale * scale).max(1e-20)).clamp(0.0, 1.0)
    }

    /// Twice a face's area in the last [`look`](Self::look), pixels; negative from behind.
    #[inline]
    pub(super) fn doubled_area(&self, face: [u32; 3]) -> f32 {
        let [a, b, c] = face.map(|v| self.projected[v as usize]);
        (b[1] - a[1]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[1] - a[1])
    }

    /// Calls `visit` with every pixel of the last [`look`](Self::look) that shows the surface.
    fn samples(
        &self,
        target: &Target,
        view: &View,
        positions: &[[f32; 3]],
        faces: &[[u32; 3]],
        mut visit: impl FnMut(Sample),
    ) {
        for row in 0..target.height {
            let source = ((target.top + row) * view.color.width + target.left) * 3;
            for column in 0..target.width {
                let pixel = row * target.width + column;
                let face = self.fragments.face[pixel];
                if face == NONE {
                    continue;
                }
                let distance = target.distance(column as f32 + 0.5, row as f32 + 0.5);
                if distance > 0.0 {
                    continue;
                }
                // Pixels on the mask's edge are mixed with what is behind.
                let border = (-distance - 0.4).clamp(0.01, 1.0);
                let facing = self.facing(target, positions, faces[face as usize]);
                let bytes = &view.color.data[source + 3 * column..];
                visit(Sample {
                    face,
                    barycentric: std::array::from_fn(|k| self.fragments.barycentric[3 * pixel + k]),
                    color: std::array::from_fn(|k| f32::from(bytes[k]) / 255.0),
                    weight: border * (0.02 + facing * facing),
                });
            }
        }
    }
}
