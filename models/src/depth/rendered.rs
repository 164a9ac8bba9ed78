//! The rendered-depth loss: what the predicted mesh's depth from the image's camera says about it.

use std::sync::Arc;

use autodiff_lite::{Tape, Var};
use diff_raster::{Renderer, Scratch, Settings};
use losses::{
    DepthMean, Robustness, ScaleShiftInvariant, depth_gradients, depth_l1_trimmed, disparity,
    log_depth,
};
use ndarray::Array3;

use super::config::{DepthKind, DepthLossKind, RefineConfig};
use super::packed::Packed;
use super::scenes::Scene;
use crate::stacked::stacked;

/// Scales of the gradient term, as MiDaS has them.
const SCALES: usize = 4;
/// The half of a common factor that Eigen's loss forgives.
const LAMBDA: f64 = 0.5;
/// The correlation below which least squares may not turn the depths inside out.
const LEAST_CORRELATION: f64 = 0.1;

/// What disparities count, in units of their own deviation, beside depths in lengths of an object, whose deviation is
/// about a tenth: one weight then serves both.
const DEVIATIONS: f32 = 0.1;

/// How soft outlines are where coverage counts, NDC: uncovered pixels pull from a tenth of the image away. The
/// rasteriser's own default reaches less than a pixel at 64 pixels.
const SOFTNESS: f64 = 300.0;
const REACH: f64 = 0.2;

/// What is to be drawn beside depth.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted<'t> {
    pub(super) silhouette: bool,
    /// Colours `[1, ΣV, 3]`.
    pub(super) colors: Option<Var<'t>>,
}

/// Drawings of a batch, each from the camera of its image.
pub(super) struct Drawn<'t> {
    /// `[N, S, S]`, `+∞` where nothing is seen.
    pub(super) depth: Var<'t>,
    /// `[N, S, S]`.
    pub(super) silhouette: Option<Var<'t>>,
    /// `[N, S, S, 3]`, black where nothing is seen.
    pub(super) image: Option<Var<'t>>,
    /// `[N, S, S]`: 1 where something is seen.
    covered: Vec<f32>,
}

/// Draws predicted meshes `[1, ΣV, 3]`, seen by cameras `[N, 3, 4]`, in the memory of earlier drawings.
pub(super) fn draw<'t>(
    scratch: &Scratch,
    packed: &Packed,
    positions: Var<'t>,
    cameras: Var<'t>,
    side: usize,
    wanted: Wanted<'t>,
) -> Drawn<'t> {
    let tape = positions.tape();
    let (mut depths, mut silhouettes, mut images) = (Vec::new(), Vec::new(), Vec::new());
    let mut covered = Vec::new();
    let settings = Settings { sigma_inv: SOFTNESS, box_length: REACH, ..Settings::new(side, side) };
    for (k, shape) in packed.shapes.iter().enumerate() {
        let own = packed.part(positions, k).insert_axis(0);
        let projected = own.project(cameras.slice_axis(0, k..k + 1));
        let renderer = Renderer::new(Arc::clone(shape.drawn()), settings.clone());
        let frame = renderer.with_scratch(scratch).frame(projected);
        depths.push(frame.depth(f32::INFINITY));
        if wanted.silhouette {
            silhouettes.push(frame.soft_silhouette());
        }
        if let Some(colors) = wanted.colors {
            images.push(frame.interpolate(packed.part(colors, k).insert_axis(0)));
            covered.extend(frame.mask());
        }
    }
    let joined = |parts: &[Var<'t>]| (!parts.is_empty()).then(|| tape.concat(parts, 0));
    Drawn {
        depth: tape.concat(&depths, 0),
        silhouette: joined(&silhouettes),
        image: joined(&images),
        covered,
    }
}

/// The loss of rendered depths against what is known of the scenes' depth; a scalar, zero where nothing is known.
///
/// Pixels count that are inside of the silhouette, whose depth is known, that are not of a floor which an estimator made
/// up, and where the mesh is seen; no other gets a gradient. With `coverage` those where it is not seen count through a
/// silhouette that is soft at its outline.
pub(super) fn depth_difference<'t>(
    drawn: &Drawn<'t>,
    scenes: &[&Scene],
    config: &RefineConfig,
) -> Var<'t> {
    let coverage = drawn
        .silhouette
        .filter(|_| config.coverage > 0.0)
        .map(|silhouette| uncovered(silhouette, scenes).scale(config.coverage as f32));
    if let Some(coverage) = coverage.filter(|_| config.coverage_alone) {
        return coverage;
    }
    let tape = drawn.depth.tape();
    let target = images(tape, scenes, |scene| scene.depth_targets.target.clone());
    let mask = images(tape, scenes, |scene| floats(&scene.depth_targets.compared));
    let rendered = drawn.depth;
    let (trim, gradients, mean) = (config.depth_trim, config.depth_gradients, DepthMean::Images);
    let invariant = |robustness| {
        let loss =
            ScaleShiftInvariant { robustness, gradient_weight: gradients, scales: SCALES, mean };
        loss.loss(disparity(rendered), target, mask).scale(DEVIATIONS)
    };
    let edges =
        |a: Var<'t>, b: Var<'t>| depth_gradients(a, b, mask, SCALES, mean).scale(gradients as f32);
    let loss = match kind(config) {
        DepthLossKind::Aligned => {
            invariant(Robustness::LeastSquares { least_correlation: LEAST_CORRELATION })
        }
        DepthLossKind::Trimmed => invariant(Robustness::Trimmed { share: trim }),
        DepthLossKind::Log => {
            let data = log_depth(rendered, target, mask, LAMBDA, mean);
            data + edges(rendered.ln(), target.ln())
        }
        DepthLossKind::Auto | DepthLossKind::Plain => {
            // Half of the mean, as MiDaS counts it.
            let data = depth_l1_trimmed(rendered, target, mask, trim, mean).scale(2.0);
            data + edges(rendered, target)
        }
    };
    match coverage {
        Some(coverage) => loss + coverage,
        None => loss,
    }
}

/// The share of the silhouettes where a mesh is not seen, softly. What it covers beyond them does not count here, as in
/// the measure of depth errors: against that stands the Chamfer distance.
fn uncovered<'t>(silhouette: Var<'t>, scenes: &[&Scene]) -> Var<'t> {
    let weights = images(silhouette.tape(), scenes, |scene| {
        let mask = &scene.image.mask;
        let total: f32 = mask.iter().map(|&m| f32::from(m)).sum();
        let share = (total.max(1.0) * scenes.len() as f32).recip();
        mask.iter().map(|&m| share * f32::from(m)).collect()
    });
    (silhouette * weights).sum().neg().add_scalar(1.0)
}

/// The mean absolute difference of rendered colours from the image, where both show the object.
pub(super) fn pixel_difference<'t>(drawn: &Drawn<'t>, scenes: &[&Scene]) -> Option<Var<'t>> {
    let image = drawn.image?;
    let tape = image.tape();
    let [n, side, _, _] = image.dims();
    let pixels = scenes.iter().map(|scene| &scene.image.pixels[..]);
    let target = stacked(tape, pixels, &[n, side, side, 3]);
    let object = scenes.iter().flat_map(|scene| scene.image.mask.iter());
    let both: Vec<f32> = drawn
        .covered
        .iter()
        .zip(object)
        .map(|(&covered, &m)| if m > 127 { covered } else { 0.0 })
        .collect();
    let share = both.iter().sum::<f32>() / both.len() as f32;
    let mask = stacked(tape, std::iter::once(&both[..]), &[n, side, side, 1]);
    // A mean over the pixels that count, not over all.
    Some(losses::l1(image, target, Some(mask)).scale(share.max(1e-3).recip()))
}

/// How depths are compared.
fn kind(config: &RefineConfig) -> DepthLossKind {
    match (config.depth_loss, config.depth) {
        (DepthLossKind::Auto, DepthKind::Estimated) => DepthLossKind::Aligned,
        (DepthLossKind::Auto, _) => DepthLossKind::Plain,
        (asked, _) => asked,
    }
}

fn floats(bits: &[bool]) -> Vec<f32> {
    bits.iter().map(|&bit| f32::from(u8::from(bit))).collect()
}

fn images<'t>(tape: &'t Tape, scenes: &[&Scene], of: impl Fn(&Scene) -> Vec<f32>) -> Var<'t> {
    let side = scenes[0].image.camera.width;
    let parts: Vec<f32> = scenes.iter().flat_map(|scene| of(scene)).collect();
    let array = Array3::from_shape_vec((scenes.len(), side, side), parts);
    tape.constant(array.expect("every scene has an image of this side"))
}
