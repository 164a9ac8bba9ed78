//! What the outline and measured depth say of vertices: features beside their places.

use autodiff_lite::{Tape, Var};
use ndarray::arr1;
use nets::{MapSampling, pool_features};

use super::config::DepthKind;
use super::scenes::Scene;

/// Outlines farther than this share of the image's side are all the same.
const FAR: f32 = 0.125;
/// What differences of depth are multiplied by, in units of half of the volume.
const GAIN: f32 = 4.0;

/// For vertices at `place`, as stages are told it: the distance from the outline, -1 deep inside and 1 far outside; with
/// measured depth how far the vertex is behind what is seen at its pixel (negative before it), -1 to 1, and whether something
/// is seen there, 0 to 1.
///
/// The difference of a predicted depth and a measured one is what a refinement has to take away, as the completion of 2.5-D
/// sketches does (Wu et al. 2017, *MarrNet*).
///
/// # Shapes
/// `place [N, V, 3]` → `[N, V, 1 or 3]`.
pub(super) fn depth_residuals<'t>(
    place: Var<'t>,
    scenes: &[&Scene],
    (depth, blind): (DepthKind, bool),
) -> Var<'t> {
    let tape = place.tape();
    let map = maps(tape, scenes, depth.residuals(), blind);
    let down = tape.constant(arr1(&[1.0, -1.0]));
    let points = place.slice_axis(2, 0..2).mul(down);
    let read = pool_features(&[map], points, MapSampling::Bilinear);
    if depth.residuals() == 1 {
        return read;
    }
    let [outline, seen, surface] = [0, 1, 2].map(|k| read.slice_axis(2, k..k + 1));
    // Both sides weighted by what is seen: beside the outline half a pixel counts half.
    let behind = place.slice_axis(2, 2..3).mul(seen) - surface;
    tape.concat(&[outline, behind.scale(GAIN).clamp(-1.0, 1.0), seen], 2)
}

/// `[N, S, S, 1]`, the outline; or `[N, S, S, 3]`: then whether depth is known, and depth, -1 near to 1 far, where it is.
fn maps<'t>(tape: &'t Tape, scenes: &[&Scene], columns: usize, blind: bool) -> Var<'t> {
    let side = scenes[0].image.camera.width;
    let mut map = tape.array(&[scenes.len(), side, side, columns]);
    let values = map.as_slice_mut();
    values.fill(0.0);
    let scenes = if blind { &[] } else { scenes };
    for (out, scene) in values.chunks_exact_mut(side * side * columns).zip(scenes) {
        let targets = &scene.depth_targets;
        for (p, pixel) in out.chunks_exact_mut(columns).enumerate() {
            pixel[0] = (targets.outline[p] / (FAR * side as f32)).clamp(-1.0, 1.0);
            if columns == 3 && targets.channel[p] > 0.0 {
                pixel[1] = 1.0;
                pixel[2] = 1.0 - 2.0 * targets.channel[p];
            }
        }
    }
    tape.constant(map)
}
