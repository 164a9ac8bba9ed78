//! The gradient of the aggregation, face by face.

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};

use super::face::{Constants, FaceRow, Ready, Shown, Touch, vanishing_exp};
use super::source::Source;
use super::state::{ImageState, Layout, State};
use super::{CHUNK, CLEAR, Colors, PEAK, Scene, TOTAL};
use crate::SoftRas;
use crate::kernels::distance::nearest;
use crate::kernels::gather::gather;
use crate::kernels::lanes::{Job, Lanes, MAX_LANES, dispatch, three};
use crate::kernels::setup::BAND_ROWS;

/// Planes of a pixel's part in the gradient, before those of the channels, which hold `∂L/∂C / Σ W`:
/// `∂L/∂A Π (1 - D)`, and the product of that of the channels with the pixel's colour.
const ALPHA: usize = 0;
const MEAN: usize = 1;
const PULLS: usize = 2;

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
    let scene = Scene { renderer, colors, channels };
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
        weigh_pixels(&scene, state, [&images[range.clone()], &grad[range]]);
        pull_image(&scene, scene.colors_of(n), state, of_colors, out);
    });
}

impl<F: Real> Scene<'_, F> {
    /// The planes of pixels' parts in the gradient.
    fn pulls(&self) -> Layout {
        Layout::new(PULLS + self.channels, self.renderer.settings.width)
    }
}

/// What the gradient of each face needs to know of a pixel.
fn weigh_pixels<F: Real>(
    scene: &Scene<'_, F>,
    state: &mut ImageState<F>,
    [images, grad]: [&[F]; 2],
) {
    let (settings, c) = (&scene.renderer.settings, scene.channels);
    let (sums, pulls) = (scene.sums(), scene.pulls());
    state.pulls.resize(pulls.len(settings.height), F::zero());
    let bands = state.pulls.par_chunks_mut(pulls.band()).zip(state.sums.par_chunks(sums.band()));
    bands.enumerate().for_each(|(band, (to, from))| {
        let first = band * BAND_ROWS;
        for row in 0..BAND_ROWS.min(settings.height - first) {
            for column in 0..settings.width {
                let at = ((first + row) * settings.width + column) * (c + 1);
                let (image, grad) = (&images[at..=at + c], &grad[at..=at + c]);
                let at = row * sums.stride() + column;
                let scale = F::one() / from[at + TOTAL * sums.plane()];
                let mut mean = F::zero();
                for channel in 0..c {
                    let pull = grad[channel] * scale;
                    mean += pull * image[channel];
                    to[at + (PULLS + channel) * pulls.plane()] = pull;
                }
                to[at + ALPHA * pulls.plane()] = grad[c] * from[at + CLEAR * sums.plane()];
                to[at + MEAN * pulls.plane()] = mean;
            }
        }
    });
}

fn pull_image<F: Real>(
    scene: &Scene<'_, F>,
    colors: &[F],
    state: &mut ImageState<F>,
    of_colors: &mut [F],
    out: &mut [F],
) {
    let ImageState { faces, sums, pulls, grads, of_corners, .. } = state;
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
    let arch = scene.renderer.settings.instructions.arch();
    let pull = |chunk: usize, grads: &mut [[F; 9]], own: &mut [F]| {
        let first = chunk * CHUNK;
        let faces = &faces[first..first + grads.len()];
        dispatch(arch, Pull { scene, colors, faces, first, planes: [sums, pulls], grads, own });
    };
    if per_face.is_empty() || own == 0 {
        let chunks = grads.par_chunks_mut(CHUNK).enumerate();
        chunks.for_each(|(i, grads)| pull(i, grads, &mut []));
    } else {
        let chunks = grads.par_chunks_mut(CHUNK).zip(per_face.par_chunks_mut(CHUNK * own));
        chunks.enumerate().for_each(|(i, (grads, own))| pull(i, grads, own));
    }
    let (all, grads, of_corners) = (scene.renderer.faces.as_ref(), &*grads, &*of_corners);
    gather(all, 3, out, |corner| Some(&grads[corner as usize / 3][corner as usize % 3 * 3..][..3]));
    if let (Colors::Vertices(_), false) = (scene.colors, of_colors.is_empty()) {
        gather(all, c, of_colors, |corner| Some(&of_corners[corner as usize * c..][..c]));
    }
}

/// The gradients of some faces' corners, `x y z x y z x y z` each; those of their colours are added to `own`.
struct Pull<'a, F: Real> {
    scene: &'a Scene<'a, F>,
    colors: &'a [F],
    faces: &'a [Ready<F>],
    first: usize,
    planes: [&'a [F]; 2],
    grads: &'a mut [[F; 9]],
    own: &'a mut [F],
}

impl<F: Real> Job<F> for Pull<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes<F = F>>(self, l: L) {
        let Self { scene, colors, faces, first, planes, grads, own } = self;
        let renderer = scene.renderer;
        let k = Constants::of(l, &renderer.settings);
        let layouts = [scene.sums(), scene.pulls()];
        let each = own.len() / faces.len();
        let of_corners = matches!(scene.colors, Colors::Vertices(_));
        let mut lanes = vec![F::zero(); if of_corners { each * MAX_LANES } else { 0 }];
        for (i, (ready, grads)) in faces.iter().zip(grads).enumerate() {
            let own = &mut own[i * each..(i + 1) * each];
            let mut face = FacePull {
                scene,
                colors,
                face: first + i,
                planes,
                layouts,
                sums: [l.zero(); 9],
                lanes: &mut lanes,
                own: &mut *own,
            };
            face.run(l, &k, ready);
            for (grad, sum) in grads.iter_mut().zip(face.sums) {
                *grad = l.sum(sum);
            }
            for (own, lanes) in own.iter_mut().zip(lanes.chunks_exact_mut(MAX_LANES)) {
                *own += l.sum(l.load(lanes));
                lanes.fill(F::zero());
            }
        }
    }
}

/// The gradient of one face while its pixels are looked at.
struct FacePull<'a, L: Lanes> {
    scene: &'a Scene<'a, L::F>,
    colors: &'a [L::F],
    face: usize,
    planes: [&'a [L::F]; 2],
    layouts: [Layout; 2],
    sums: [L::V; 9],
    /// Of the corners' colours, [`MAX_LANES`] numbers each, added up at the end.
    lanes: &'a mut [L::F],
    /// Of the texels' colours.
    own: &'a mut [L::F],
}

impl<L: Lanes> FacePull<'_, L> {
    #[inline(always)]
    fn run(&mut self, l: L, k: &Constants<L>, ready: &Ready<L::F>) {
        let renderer = self.scene.renderer;
        let centers = &renderer.centers;
        let columns = ready.pixels.columns.map(|c| c as usize);
        for row in ready.rows_within([0, renderer.settings.height]) {
            let line = FaceRow::new(l, ready, centers.row(row));
            for column in (columns[0]..columns[1]).step_by(L::N) {
                let count = (columns[1] - column).min(L::N);
                let within = l.first(count);
                let x = l.load(&centers.x[column..]);
                let Some(touch) = line.touch(l, k, x, within) else { continue };
                let at = [0, 1].map(|i| self.layouts[i].at(row, column));
                let alpha = l.load(&self.planes[1][at[1] + ALPHA * self.layouts[1].plane()..]);
                // By the argument of the sigmoid: Π / (1 - D) · D (1 - D).
                let mut of_argument = l.mul(alpha, touch.covered);
                if self.scene.channels > 0 {
                    let more = self.pull_colors(l, k, ready, &line, &touch, at);
                    of_argument = l.add(of_argument, more);
                }
                let of_argument = l.select(touch.reached, of_argument, l.zero());
                // d(d²) = -2 away · (nearest point).
                let twice = l.splat(L::F::from_f64(-2.0));
                let pull = l.mul(l.mul(of_argument, twice), touch.derivative(l, k));
                let near = nearest(l, &line.edges, x);
                for axis in 0..2 {
                    let pull = l.mul(pull, near.away[axis]);
                    for corner in 0..3 {
                        let sum = &mut self.sums[3 * corner + axis];
                        *sum = l.fma(near.weights[corner], pull, *sum);
                    }
                }
            }
        }
    }

    /// Adds what comes through the colours; gives that of the sigmoid's argument.
    #[inline(always)]
    fn pull_colors(
        &mut self,
        l: L,
        k: &Constants<L>,
        ready: &Ready<L::F>,
        line: &FaceRow<L>,
        touch: &Touch<L>,
        at: [usize; 2],
    ) -> L::V {
        let zero = l.zero();
        let shown = line.shown(l, k, touch);
        if !l.any(shown.seen) {
            return zero;
        }
        let peak = l.load(&self.planes[0][at[0] + PEAK * self.layouts[0].plane()..]);
        let below = l.min(l.sub(shown.height, peak), zero);
        let share = l.mul(touch.covered, vanishing_exp(l, l.mul(below, k.per_gamma)));
        let source = self.scene.source(l, k, self.face, line, &shown);
        let plane = self.layouts[1].plane();
        let mean = l.load(&self.planes[1][at[1] + MEAN * plane..]);
        let mut along = l.sub(zero, mean);
        let mut of_blend = [zero; 3];
        for channel in 0..self.scene.channels {
            let g = l.load(&self.planes[1][at[1] + (PULLS + channel) * plane..]);
            along = l.fma(g, source.color(l, self.colors, channel), along);
            let g = l.select(shown.seen, l.mul(g, share), zero);
            self.add_color(l, &source, channel, g, l.bits(shown.seen));
            if let Source::Corners(from, _) = &source {
                for (of_blend, &from) in of_blend.iter_mut().zip(from) {
                    *of_blend = l.fma(g, l.splat(self.colors[from + channel]), *of_blend);
                }
            }
        }
        let along = l.select(shown.seen, l.mul(along, share), zero);
        let of_depth = l.sub(zero, l.mul(l.mul(along, k.per_gamma), k.per_range));
        self.pull_weights(l, k, ready, line, &shown, of_blend, of_depth);
        l.mul(along, touch.clear)
    }

    /// Adds to the gradient of the face's colours.
    #[inline(always)]
    fn add_color(&mut self, l: L, source: &Source<L>, channel: usize, g: L::V, seen: u32) {
        if self.own.is_empty() {
            return;
        }
        let c = self.scene.channels;
        match source {
            Source::Corners(_, weights) => {
                for (corner, &weight) in weights.iter().enumerate() {
                    let lanes = &mut self.lanes[(corner * c + channel) * MAX_LANES..];
                    let sum = l.load(lanes);
                    l.store(lanes, l.fma(g, weight, sum));
                }
            }
            Source::Texels(from) => {
                let first = self.face * self.own.len();
                let mut lanes = [L::F::from_f64(0.0); MAX_LANES];
                l.store(&mut lanes, g);
                for (i, &from) in from[..L::N].iter().enumerate() {
                    if seen >> i & 1 == 1 {
                        self.own[from - first + channel] += lanes[i];
                    }
                }
            }
        }
    }

    /// Adds what comes through the barycentric coordinates and the depths of the corners.
    #[inline(always)]
    fn pull_weights(
        &mut self,
        l: L,
        k: &Constants<L>,
        ready: &Ready<L::F>,
        line: &FaceRow<L>,
        shown: &Shown<L>,
        of_blend: [L::V; 3],
        of_depth: L::V,
    ) {
        let (zero, one) = (l.zero(), l.one());
        let (z, cut, depth) = (line.per_depth(), &shown.cut, shown.depth);
        let (mut of_cut, mut of_depth) = (of_blend, of_depth);
        if k.perspective {
            for i in 0..3 {
                let part = l.mul(of_blend[i], z[i]);
                let along = l.mul(part, cut[i]);
                of_depth = l.add(of_depth, along);
                of_cut[i] = l.mul(part, depth);
                let sum = &mut self.sums[3 * i + 2];
                *sum = l.fnma(along, l.mul(depth, z[i]), *sum);
            }
        }
        // depth = 1 / Σ c / z
        let square = l.mul(of_depth, l.mul(depth, depth));
        for i in 0..3 {
            let derivative = l.mul(square, z[i]);
            of_cut[i] = l.sub(of_cut[i], derivative);
            let sum = &mut self.sums[3 * i + 2];
            *sum = l.fma(derivative, l.mul(cut[i], z[i]), *sum);
        }
        let mean = three!(i => l.mul(of_cut[i], cut[i]));
        let mean = l.add(l.add(mean[0], mean[1]), mean[2]);
        let mean = l.select(shown.summed, mean, zero);
        // How the coordinates grow with x and y, times what is pulled.
        let mut derivative = [zero; 2];
        for i in 0..3 {
            let free = l.and(l.lt(zero, shown.raw[i]), l.lt(shown.raw[i], one));
            let of_raw = l.mul(l.sub(of_cut[i], mean), shown.per_sum);
            let of_raw = l.select(free, of_raw, zero);
            for axis in 0..2 {
                derivative[axis] = l.fma(of_raw, l.splat(ready.weights[i][axis]), derivative[axis]);
            }
        }
        for corner in 0..3 {
            for axis in 0..2 {
                let sum = &mut self.sums[3 * corner + axis];
                *sum = l.fnma(shown.raw[corner], derivative[axis], *sum);
            }
        }
    }
}
