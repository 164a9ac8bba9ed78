//! The gradient of the aggregation, face by face.

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};

use super::face::{Constants, Ready, SUM_GUARD, Shown, Touch};
use super::state::{ImageState, State};
use super::{CHUNK, Colors, Scene, Sources};
use crate::SoftRas;
use crate::kernels::gather::gather;

/// The gradients of [`softras`](super::softras), added to `of_projected [N, V, 3]` and `of_colors` (the shape of the
/// colours; empty if nobody wants it).
///
/// `images` is what it gave, `grad` the gradient of that, and `state` of the same call.
///
/// # Panics
/// If a slice is too short.
pub fn softras_grad<F: Real>(
    renderer: &SoftRas<F>,
    colors: Colors<'_, F>,
    channels: usize,
    state: &mut State<F>,
    [images, grad]: [&[F]; 2],
    of_projected: &mut [F],
    of_colors: &mut [F],
) {
    let scene = Scene::new(renderer, colors, channels);
    let pixels = renderer.settings.height * renderer.settings.width * (channels + 1);
    let positions = 3 * renderer.faces.vertex_count();
    let wanted = !of_colors.is_empty();
    let stride = if wanted { scene.stride() } else { 0 };
    // Chunks of no length are not allowed; then there is nothing to add to either.
    if pixels == 0 || positions == 0 || (wanted && stride == 0) {
        return;
    }
    let mut none: Vec<&mut [F]> = Vec::new();
    let mut parts: Vec<&mut [F]> = if wanted {
        of_colors.chunks_exact_mut(stride).collect()
    } else {
        none.resize_with(state.images.len(), Default::default);
        none
    };
    let states = state.images.par_iter_mut().zip(parts.par_iter_mut());
    let batch = states.zip(of_projected.par_chunks_mut(positions));
    batch.enumerate().for_each(|(n, ((state, of_colors), out))| {
        let range = pixels * n..pixels * (n + 1);
        let planes = [&images[range.clone()], &grad[range]];
        pull_image(&scene, scene.colors_of(n), state, planes, of_colors, out);
    });
}

fn pull_image<F: Real>(
    scene: &Scene<'_, F>,
    colors: &[F],
    state: &mut ImageState<F>,
    planes: [&[F]; 2],
    of_colors: &mut [F],
    out: &mut [F],
) {
    let ImageState { faces, sums, grads, of_corners, .. } = state;
    let c = scene.channels;
    grads.resize(faces.len(), [F::zero(); 9]);
    // Each face has colours of its own, or a copy for each of its corners.
    let own = match scene.colors {
        Colors::Vertices(_) => {
            of_corners.clear();
            of_corners
                .resize(if of_colors.is_empty() { 0 } else { faces.len() * 3 * c }, F::zero());
            3 * c
        }
        Colors::Texels(_, side) => side * side * c,
    };
    let per_face: &mut [F] = match scene.colors {
        Colors::Vertices(_) => &mut *of_corners,
        Colors::Texels(..) => &mut *of_colors,
    };
    let pull = |first: usize, grads: &mut [[F; 9]], per_face: &mut [F]| {
        for (i, grads) in grads.iter_mut().enumerate() {
            let face = first + i;
            let wanted = if per_face.is_empty() { 0..0 } else { i * own..(i + 1) * own };
            *grads =
                pull_face(scene, colors, (face, &faces[face]), sums, planes, &mut per_face[wanted]);
        }
    };
    if per_face.is_empty() || own == 0 {
        let chunks = grads.par_chunks_mut(CHUNK).enumerate();
        chunks.for_each(|(i, grads)| pull(i * CHUNK, grads, &mut []));
    } else {
        let chunks = grads.par_chunks_mut(CHUNK).zip(per_face.par_chunks_mut(CHUNK * own));
        chunks.enumerate().for_each(|(i, (grads, own))| pull(i * CHUNK, grads, own));
    }
    let (all, grads, of_corners) = (scene.renderer.faces.as_ref(), &*grads, &*of_corners);
    gather(all, 3, out, |corner| Some(&grads[corner as usize / 3][corner as usize % 3 * 3..][..3]));
    if let (Colors::Vertices(_), false) = (scene.colors, of_colors.is_empty()) {
        gather(all, c, of_colors, |corner| Some(&of_corners[corner as usize * c..][..c]));
    }
}

/// The gradient of a face's corners `x y z x y z x y z`; that of its colours is added to `own`.
fn pull_face<F: Real>(
    scene: &Scene<'_, F>,
    colors: &[F],
    (face, ready): (usize, &Ready<F>),
    sums: &[[F; 3]],
    [images, grad]: [&[F]; 2],
    own: &mut [F],
) -> [F; 9] {
    let (k, c) = (&scene.constants, scene.channels);
    let (width, centers) = (scene.renderer.settings.width, &scene.renderer.centers);
    let (zero, one) = (F::zero(), F::one());
    let mut out = [zero; 9];
    let rows = ready.pixels.rows.map(|r| r as usize);
    let columns = ready.pixels.columns.map(|c| c as usize);
    for row in rows[0]..rows[1] {
        let y = centers.row(row);
        for column in columns[0]..columns[1] {
            let Some(touch) = ready.touch(k, centers.x[column], y) else { continue };
            let at = row * width + column;
            let [clear, peak, total] = sums[at];
            let g = &grad[at * (c + 1)..(at + 1) * (c + 1)];
            // By the argument of the sigmoid: Π / (1 - D) · D (1 - D).
            let mut of_argument = g[c] * clear * touch.covered;
            let shown = if c == 0 { None } else { ready.shown(k, touch.raw) };
            if let Some(shown) = shown {
                let share =
                    touch.covered * ((shown.height - peak) * k.per_gamma).fast_exp() / total;
                let sources = Sources::of(scene, face, ready, &shown);
                let image = &images[at * (c + 1)..at * (c + 1) + c];
                let mut along = zero;
                for channel in 0..c {
                    along += g[channel] * (sources.color(colors, channel) - image[channel]);
                }
                of_argument += along * share * (one - touch.covered);
                // By the weights of the corners' colours.
                let mut of_blend = [zero; 3];
                for (i, &(from, weight)) in sources.parts[..sources.count].iter().enumerate() {
                    let to = if sources.count == 3 { i * c } else { from % own.len().max(1) };
                    for channel in 0..c {
                        let g = g[channel] * share;
                        if !own.is_empty() {
                            own[to + channel] += g * weight;
                        }
                        of_blend[i] += g * colors[from + channel];
                    }
                }
                let of_blend = if sources.count == 3 { of_blend } else { [zero; 3] };
                let of_depth = -(along * share * k.per_gamma * k.per_range);
                pull_weights(k, ready, &touch, &shown, of_blend, of_depth, &mut out);
            }
            // d(d²) = -2 away · (nearest point).
            let pull = -(of_argument * touch.derivative) * F::from_f64(2.0);
            for corner in 0..3 {
                for axis in 0..2 {
                    out[3 * corner + axis] += pull * touch.nearest[corner] * touch.away[axis];
                }
            }
        }
    }
    out
}

/// Adds what comes through the barycentric coordinates and the depths of the corners.
#[inline]
fn pull_weights<F: Real>(
    k: &Constants<F>,
    ready: &Ready<F>,
    touch: &Touch<F>,
    shown: &Shown<F>,
    of_blend: [F; 3],
    of_depth: F,
    out: &mut [F; 9],
) {
    let (zero, one) = (F::zero(), F::one());
    let (z, cut, depth) = (&ready.depths, &shown.cut, shown.depth);
    let (mut of_cut, mut of_depth) = (of_blend, of_depth);
    if k.perspective {
        for i in 0..3 {
            let part = of_blend[i] / z[i];
            of_depth += part * cut[i];
            of_cut[i] = part * depth;
            out[3 * i + 2] += -(part * cut[i] * depth / z[i]);
        }
    }
    // depth = 1 / Σ c / z
    for i in 0..3 {
        let derivative = of_depth * depth * depth / z[i];
        of_cut[i] += -derivative;
        out[3 * i + 2] += derivative * cut[i] / z[i];
    }
    let guarded = shown.sum <= F::from_f64(SUM_GUARD);
    let mean =
        if guarded { zero } else { of_cut[0] * cut[0] + of_cut[1] * cut[1] + of_cut[2] * cut[2] };
    // How the coordinates grow with x and y, times what is pulled.
    let mut derivative = [zero; 2];
    for i in 0..3 {
        if touch.raw[i] > zero && touch.raw[i] < one {
            let of_raw = (of_cut[i] - mean) / shown.sum;
            derivative[0] += of_raw * ready.weights[i][0];
            derivative[1] += of_raw * ready.weights[i][1];
        }
    }
    for corner in 0..3 {
        for axis in 0..2 {
            out[3 * corner + axis] += -(touch.raw[corner] * derivative[axis]);
        }
    }
}
