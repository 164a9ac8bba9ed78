//! Hollows: what no outline shows, but photographs agree about.
//!
//! Outlines are right wherever the surface bulges, and leave a bowl filled to its rim. Once they agree, depth is found for each view by
//! [`stereo`], and the surface moves along its normals until it lies where the views see it; outlines and the bending
//! energy hold it as before.

use datasets::View;
use diff_raster::Faces;
use mesh_core::vector::dot;
use mesh_core::{face_normals, untangle, vertex_normals};
use rayon::prelude::*;
use serde::Serialize;

use super::config::FitConfig;
use super::error::FitError;
use super::gray_image::GrayImage;
use super::samples::{Sample, Samples};
use super::shape::Shape;
use super::stereo::{self, DepthMap};
use super::target::Target;
use crate::bake::color;
use crate::bake::exposure::Exposure;
use crate::bake::sight::{Photographed, Sight};

/// One way of following depths.
#[derive(Clone, Copy, Debug)]
struct Stage {
    /// The object's longer side in the images that are compared, in pixels.
    side: usize,
    /// Steps, at most.
    steps: usize,
    /// Length of the first, as a share of a level's first step; they fall to a tenth of it.
    share: f32,
    /// Distances that say nothing, in pixels of the views.
    sure: f32,
}

/// Towards depths of planes: far.
const COARSE: Stage = Stage { side: 96, steps: 150, share: 1.0, sure: 0.5 };
/// Towards depths around the mesh: near.
const FINE: Stage = Stage { side: 256, steps: 30, share: 0.2, sure: 0.0 };
/// How often depths are found anew at each.
const ROUNDS: usize = 2;
/// Weight of a pixel of depth beside one of outline.
const WEIGHT: f32 = 0.05;
/// Steps over which it is judged whether the surface still comes nearer.
const WINDOW: usize = 10;
/// The least share by which it must.
const TOLERANCE: f64 = 0.003;
/// By how much the views must agree better, as a correlation: a hollow brings 0.005 and more, a ball without one 0.001.
const GAIN: f64 = 0.003;
/// How much mask IoU that may cost.
const LOSS: f64 = 0.005;
/// By how much the squared error of its colours in the views that are not fitted may grow: half a decibel. A surface that follows
/// noise agrees better with what it was moved by, and shows others less.
const FADES: f64 = 1.12;
/// How far a pixel pulls at most, in pixels of its view.
const FARTHEST: f32 = 4.0;
/// Surfaces seen at a slant of which the cosine is less say little about depth.
const SLANT: f32 = 0.2;
/// Views whose pulls are summed one after the other; the sums are added in order.
const CHUNK: usize = 4;

/// How well photographs agree about what they show of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PhotoConsistency {
    /// Mean correlation, from -1 to 1, of each view with what its neighbours show at the surface that outlines made.
    pub before: f64,
    /// The same after the surface was moved to where photographs agree.
    pub after: f64,
    /// Whether it stayed there: it does where they agree better, at no cost to the outlines and to the colours of held-out views.
    pub kept: bool,
}

/// Photographs, and what a fit measures of their masks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Photographs<'a> {
    pub(super) targets: &'a [Target],
    pub(super) views: &'a [&'a View],
}

impl Photographs<'_> {
    /// The mean squared error, over all pixels of these masks, of what a surface shows with the colours that `others` give it: black
    /// where it shows nothing. A surface that is dented follows noise, and shows at its rims.
    fn color_error(&self, shape: &Shape, others: &Self) -> f64 {
        let Shape { positions, faces, topology, .. } = shape;
        let even = Exposure::even(others.views.len());
        let photographed = Photographed::new(others.views, others.targets, positions, faces);
        let colors = color::vertex_colors(&photographed, topology, &even, None);
        let drawn = Faces::of_valid(positions.len(), faces);
        let one = |(target, view): (&Target, &&View)| {
            let mut sight = Sight::default();
            sight.look(target, positions, &drawn);
            let (mut sum, mut count) = (0.0, 0.0);
            let pixels = (0..target.height).flat_map(|i| (0..target.width).map(move |j| (i, j)));
            for (i, j) in pixels {
                if target.distance(j as f32 + 0.5, i as f32 + 0.5) > 0.0 {
                    continue;
                }
                let shown = sight.color(i * target.width + j, faces, &colors).unwrap_or([0.0; 3]);
                let pixel = view.color.pixel(target.top + i, target.left + j);
                let of = |c: usize| f32::from(pixel[c]) / 255.0;
                sum += (0..3).map(|c| f64::from(shown[c] - of(c)).powi(2)).sum::<f64>();
                count += 1.0;
            }
            [sum, count]
        };
        let each: Vec<[f64; 2]> = self.targets.par_iter().zip(self.views).map(one).collect();
        let [sum, count] = [0, 1].map(|k| each.iter().map(|sums| sums[k]).sum::<f64>());
        sum / count.max(1.0)
    }
}

/// Moves the surface to where photographs see it, if they agree better about it then, those that are `held_out` show its colours as
/// well as before, and nothing of it passes through itself; nothing if there are no depths to be found.
///
/// # Errors
/// As [`Shape::step`].
pub(super) fn hollow(
    shape: &mut Shape,
    fitted: Photographs<'_>,
    held_out: Photographs<'_>,
    config: &FitConfig,
    step: usize,
    cancelled: &dyn Fn() -> bool,
) -> Result<Option<PhotoConsistency>, FitError> {
    let Photographs { targets, views } = fitted;
    let scored = if held_out.views.is_empty() { fitted } else { held_out };
    let images = |side: usize| -> Vec<GrayImage> {
        let pairs = targets.par_iter().zip(views);
        pairs.map(|(target, view)| GrayImage::new(target, view, side)).collect()
    };
    let [coarse, fine] = [COARSE, FINE].map(|stage| images(stage.side));
    let agreement = |shape: &Shape| stereo::agreement(&fine, &shape.positions, &shape.faces);
    let colors = |shape: &Shape| scored.color_error(shape, &fitted);
    let given = (shape.positions.clone(), agreement(shape), shape.mask_iou(targets), colors(shape));
    for round in 1..=ROUNDS {
        if cancelled() {
            shape.place(given.0);
            return Ok(None);
        }
        let maps = stereo::sweep(&coarse, &shape.positions, &shape.faces);
        if maps.iter().flatten().all(|depth| depth.is_nan()) {
            // Of a second round too: what the first did was not judged.
            shape.place(given.0);
            return Ok(None);
        }
        let seen = Seen { targets, images: &coarse, maps: &maps };
        // What is left after the first is near.
        let stage = Stage { share: COARSE.share / (round * round) as f32, ..COARSE };
        follow(shape, &seen, stage, config, step, cancelled)?;
    }
    for _ in 0..ROUNDS {
        if cancelled() {
            break;
        }
        let maps = stereo::around(&fine, &shape.positions, &shape.faces);
        let seen = Seen { targets, images: &fine, maps: &maps };
        follow(shape, &seen, FINE, config, step, cancelled)?;
    }
    let mut mended = shape.positions.clone();
    let sound = untangle(&mut mended, &shape.faces, &shape.topology).is_some();
    shape.place(mended);
    let (positions, before, iou, error) = given;
    let after = agreement(shape);
    let kept = sound
        && after >= before + GAIN
        && shape.mask_iou(targets) >= iou - LOSS
        && colors(shape) <= FADES * error;
    if !kept {
        shape.place(positions);
    }
    Ok(Some(PhotoConsistency { before, after, kept }))
}

/// Views, and how far away they see the surface.
struct Seen<'a> {
    targets: &'a [Target],
    images: &'a [GrayImage],
    maps: &'a [DepthMap],
}

/// Moves the surface towards depths until it comes no nearer.
fn follow(
    shape: &mut Shape,
    seen: &Seen<'_>,
    stage: Stage,
    config: &FitConfig,
    step: usize,
    cancelled: &dyn Fn() -> bool,
) -> Result<(), FitError> {
    let all: Vec<usize> = (0..seen.targets.len()).collect();
    let drawn = Faces::of_valid(shape.positions.len(), &shape.faces);
    let mut samples = Samples::new(seen.images, drawn);
    let mut distances = Vec::with_capacity(stage.steps);
    for k in 0..stage.steps {
        let samples = samples.at(&shape.positions, seen.images, seen.maps);
        let (pulls, distance) = seen.pulls(samples, &shape.positions, &shape.faces, stage.sure);
        let stays = |before: f64| distance > (1.0 - TOLERANCE) * before;
        let before = k.checked_sub(WINDOW).map(|before| distances[before]);
        if before.is_some_and(stays) || cancelled() {
            break;
        }
        distances.push(distance);
        let rate = stage.share * config.learning_rate * 0.1f32.powf(k as f32 / stage.steps as f32);
        shape.losses(seen.targets, &all, config, step)?;
        shape.add(&pulls);
        shape.descend(rate, step)?;
        if config.relax_every.is_some_and(|every| (k + 1).is_multiple_of(every)) {
            shape.relax(config.relax);
        }
    }
    Ok(())
}

impl Seen<'_> {
    /// The weighted gradient at each vertex of half the squared distance, in pixels of the views, of the surface to the depths, along
    /// its normals; and the mean distance.
    fn pulls(
        &self,
        samples: &[Vec<Sample>],
        positions: &[[f32; 3]],
        faces: &[[u32; 3]],
        sure: f32,
    ) -> (Vec<[f32; 3]>, f64) {
        let of_faces = face_normals(positions, faces);
        let of_vertices = vertex_normals(positions, faces);
        let views: Vec<usize> = (0..self.maps.len()).collect();
        let part = |views: &[usize]| {
            let (mut sums, mut distance) = (vec![0.0; positions.len()], [0.0; 2]);
            for &view in views {
                for sample in &samples[view] {
                    let corners = faces[sample.face as usize];
                    let point = sample.point(corners.map(|v| positions[v as usize]));
                    let (pixel, normal) = (sample.pixel as usize, of_faces[sample.face as usize]);
                    let Some((scale, off)) = self.off(view, pixel, point, normal) else {
                        continue;
                    };
                    distance = [distance[0] + f64::from(off.abs()), distance[1] + 1.0];
                    let pull = scale * (off.abs() - sure).clamp(0.0, FARTHEST).copysign(off);
                    for (v, share) in corners.into_iter().zip(sample.shares()) {
                        sums[v as usize] += share * pull;
                    }
                }
            }
            (sums, distance)
        };
        let parts: Vec<(Vec<f32>, [f64; 2])> = views.par_chunks(CHUNK).map(part).collect();
        let total = |v: usize| WEIGHT * parts.iter().map(|(sums, _)| sums[v]).sum::<f32>();
        let pulls = of_vertices.iter().enumerate();
        let pulls = pulls.map(|(v, normal)| normal.map(|n| total(v) * n)).collect();
        let [sum, count] =
            [0, 1].map(|k| parts.iter().map(|(_, distance)| distance[k]).sum::<f64>());
        (pulls, sum / count.max(1.0))
    }

    /// What a movement of a point along its normal counts in pixels, and how far it is nearer than its pixel's depth, in pixels; nothing
    /// of what is seen at a slant.
    fn off(
        &self,
        view: usize,
        pixel: usize,
        point: [f32; 3],
        normal: [f32; 3],
    ) -> Option<(f32, f32)> {
        let (image, depth) = (&self.images[view], self.maps[view][pixel]);
        let w = image.size[0];
        let towards = image.towards((pixel % w) as f32 + 0.5, (pixel / w) as f32 + 0.5);
        let facing = dot(towards, normal);
        let there = image.homogeneous(point)[2];
        let scale = self.targets[view].pixels_per_unit(there);
        let off = facing * (depth - there) / image.depth_per_unit() * scale;
        (facing >= SLANT).then_some((facing * scale, off))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use std::cell::Cell;

    use mesh_core::primitives::icosphere;
    use synth::{Orbit, RenderOptions, render_views};

    use super::*;
    use crate::fit::distance::Blur;
    use crate::fit::gray_image::Drawn;

    #[test]
    fn who_cancels_does_not_wait_for_depths() {
        let ball = icosphere(2).colored([0.5; 3]);
        let orbit = Orbit { count: 6, width: 48, height: 48, ..Orbit::default() };
        let views =
            render_views(&ball, &orbit.cameras(), &RenderOptions::default(), &|_, _| {}).unwrap();
        let measured = |view| Target::new(view, Blur::plain(1.0), 0.15, 0.3).unwrap();
        let targets: Vec<Target> = views.iter().map(measured).collect();
        let views: Vec<&View> = views.iter().collect();
        let config = FitConfig::default();
        let mut shape = Shape::of(ball.positions.clone(), ball.faces, &config);
        let (fitted, asked) = (Photographs { targets: &targets, views: &views }, Cell::new(0));
        let cancelled = || {
            asked.set(asked.get() + 1);
            true
        };
        let held_out = Photographs { targets: &[], views: &[] };
        let found = hollow(&mut shape, fitted, held_out, &config, 0, &cancelled).unwrap();
        assert!(found.is_none() && shape.positions == ball.positions);
        assert_eq!(asked.get(), 1);
    }

    /// By hand: a ball that is a tenth too large is pulled inwards everywhere, by a tenth of its radius, and one that is right stays.
    #[test]
    fn a_ball_is_pulled_to_the_depths_of_a_smaller_one() {
        let ball = icosphere(3);
        let orbit =
            Orbit { count: 12, width: 64, height: 64, distance: [4.0; 2], ..Orbit::default() };
        let options = RenderOptions { depth: true, ..RenderOptions::default() };
        let views = render_views(&ball, &orbit.cameras(), &options, &|_, _| {}).unwrap();
        let targets: Vec<Target> = views
            .iter()
            .map(|view| Target::new(view, Blur::plain(1.0), 0.15, 0.3).unwrap())
            .collect();
        let images: Vec<GrayImage> =
            targets.iter().zip(&views).map(|(t, view)| GrayImage::new(t, view, 256)).collect();
        let faces = Faces::of_valid(ball.positions.len(), &ball.faces);
        let depths = |radius: f32| -> Vec<DepthMap> {
            let positions: Vec<[f32; 3]> =
                ball.positions.iter().map(|p| p.map(|v| radius * v)).collect();
            let map = |image: &GrayImage| {
                let mut drawn = Drawn::default();
                image.draw(&positions, &faces, &mut drawn);
                (0..image.mask.len())
                    .map(|pixel| drawn.at(pixel).map_or(f32::NAN, |(_, depth)| depth))
                    .collect()
            };
            images.iter().map(map).collect()
        };
        let pulled = |radius: f32| {
            let maps = depths(radius);
            let seen = Seen { targets: &targets, images: &images, maps: &maps };
            let mut samples = Samples::new(&images, faces.clone());
            let samples = samples.at(&ball.positions, &images, &maps);
            seen.pulls(samples, &ball.positions, &ball.faces, 0.0)
        };
        let (pulls, distance) = pulled(0.9);
        let scale = targets[0].pixels_per_unit(3.0);
        assert!(
            (distance / f64::from(0.1 * scale) - 1.0).abs() < 0.15,
            "{distance} of {}",
            0.1 * scale
        );
        // Steps go against the gradient.
        assert!(pulls.iter().zip(&ball.positions).all(|(g, p)| dot(*g, *p) > 0.0));
        let (pulls, distance) = pulled(1.0);
        assert!(distance < 1e-3 && pulls.iter().flatten().all(|g| g.abs() < 1e-2), "{distance}");
    }
}
