//! Points of a surface that pixels see, kept while the surface moves little.

use std::sync::Arc;

use diff_raster::Faces;
use mesh_core::vector::{norm, sub};
use rayon::prelude::*;

use super::gray_image::{Drawn, GrayImage};
use super::stereo::DepthMap;

/// How far a vertex may move before it is drawn anew what pixels see, in pixels. Drawing is most of a step's cost; at a pixel the
/// hollow of a bowl is half as far off again, at three five times.
const FARTHEST: f32 = 0.3;

/// A point of the surface that a pixel saw when it was drawn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) pixel: u32,
    pub(super) face: u32,
    /// Shares of the face's first two corners.
    shares: [f32; 2],
}

impl Sample {
    /// Shares of the face's corners.
    #[inline]
    pub(super) fn shares(&self) -> [f32; 3] {
        let [a, b] = self.shares;
        [a, b, 1.0 - a - b]
    }

    /// Where it is, if the corners of its face are there.
    #[inline]
    pub(super) fn point(&self, corners: [[f32; 3]; 3]) -> [f32; 3] {
        let shares = self.shares();
        std::array::from_fn(|k| (0..3).map(|c| shares[c] * corners[c][k]).sum())
    }
}

/// What the pixels of all views that have a depth see of a mesh.
#[derive(Debug)]
pub(super) struct Samples {
    faces: Arc<Faces>,
    /// Of the finest view, in the fitted frame.
    pixel: f32,
    drawn_at: Vec<[f32; 3]>,
    of_views: Vec<Vec<Sample>>,
}

impl Samples {
    /// Of no mesh yet.
    pub(super) fn new(images: &[GrayImage], faces: Arc<Faces>) -> Self {
        let width = |image: &GrayImage| image.width_at(image.homogeneous([0.0; 3])[2]);
        let pixel = images.iter().map(width).fold(f32::INFINITY, f32::min);
        Self { faces, pixel, drawn_at: Vec::new(), of_views: Vec::new() }
    }

    /// Those of the mesh as it is: of each view, in the order of pixels.
    pub(super) fn at(
        &mut self,
        positions: &[[f32; 3]],
        images: &[GrayImage],
        maps: &[DepthMap],
    ) -> &[Vec<Sample>] {
        if !self.are_near(positions) {
            let of_view = |sight: &mut Drawn, (image, map): (&GrayImage, &DepthMap)| {
                image.draw(positions, &self.faces, sight);
                let known = (0..map.len()).filter(|&pixel| !map[pixel].is_nan());
                known.filter_map(|pixel| sight.sample(pixel)).collect()
            };
            let drawn = images.par_iter().zip(maps).map_init(Drawn::default, of_view);
            self.of_views = drawn.collect();
            self.drawn_at.clear();
            self.drawn_at.extend_from_slice(positions);
        }
        &self.of_views
    }

    /// Whether no vertex is farther than [`FARTHEST`] from where it was drawn.
    fn are_near(&self, positions: &[[f32; 3]]) -> bool {
        let mut moved = positions.iter().zip(&self.drawn_at);
        self.drawn_at.len() == positions.len()
            && moved.all(|(&p, &q)| norm(sub(p, q)) <= FARTHEST * self.pixel)
    }
}

impl Drawn {
    /// What a pixel sees.
    fn sample(&self, pixel: usize) -> Option<Sample> {
        let (face, _) = self.at(pixel)?;
        let shares = [0, 1].map(|k| self.fragments.barycentric[3 * pixel + k]);
        Some(Sample { pixel: pixel as u32, face, shares })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::primitives::icosphere;
    use synth::{Orbit, RenderOptions, render_views};

    use super::super::distance::Blur;
    use super::super::target::Target;
    use super::*;

    /// By hand: a ball a unit in radius is seen where its rays meet it, and what is kept moves with the surface until a vertex has moved
    /// by a third of a pixel.
    #[test]
    fn what_pixels_see_is_kept_while_the_surface_moves_little() {
        let ball = icosphere(4);
        let orbit = Orbit { count: 3, width: 64, height: 64, ..Orbit::default() };
        let views =
            render_views(&ball, &orbit.cameras(), &RenderOptions::default(), &|_, _| {}).unwrap();
        let targets = views.iter().map(|v| Target::new(v, Blur::plain(1.0), 0.15, 0.3).unwrap());
        let pairs = targets.zip(&views);
        let images: Vec<GrayImage> = pairs.map(|(t, v)| GrayImage::new(&t, v, 64)).collect();
        let maps: Vec<DepthMap> = images.iter().map(|image| vec![1.0; image.mask.len()]).collect();
        let scaled = |factor: f32| -> Vec<[f32; 3]> {
            ball.positions.iter().map(|p| p.map(|v| factor * v)).collect()
        };
        let faces = Faces::of_valid(ball.positions.len(), &ball.faces);
        let mut samples = Samples::new(&images, faces);
        let pixel = samples.pixel;
        assert!((0.04..0.08).contains(&pixel), "some thirty pixels wide: {pixel}");
        let seen = |samples: &[Vec<Sample>], positions: &[[f32; 3]]| -> Vec<(u32, f32)> {
            let corners = |s: &Sample| ball.faces[s.face as usize].map(|v| positions[v as usize]);
            let radius = |s: &Sample| (s.pixel, norm(s.point(corners(s))));
            samples[0].iter().map(radius).collect()
        };
        let first = seen(samples.at(&scaled(1.0), &images, &maps), &scaled(1.0));
        let inside = images[0].mask.iter().filter(|&&m| m).count();
        assert!(first.len().abs_diff(inside) < inside / 20, "{} of {inside}", first.len());
        assert!(first.iter().all(|(_, radius)| (0.99..=1.0).contains(radius)));
        let near = scaled(1.0 + 0.9 * FARTHEST * pixel);
        let kept = seen(samples.at(&near, &images, &maps), &near);
        assert!(kept.iter().map(|s| s.0).eq(first.iter().map(|s| s.0)), "drawn anew too soon");
        assert!(kept.iter().zip(&first).all(|(now, then)| now.1 > then.1), "left behind");
        let far = scaled(1.0 + 1.5 * pixel);
        let anew = seen(samples.at(&far, &images, &maps), &far);
        assert!(anew.len() > first.len(), "not drawn anew");
    }
}
