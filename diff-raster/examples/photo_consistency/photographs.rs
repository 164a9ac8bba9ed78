//! Photographs of one object, in pairs that show the same from two sides, and what they say of a surface.

use autodiff_lite::ndarray::Array1;
use autodiff_lite::{Padding, Tape, Tensor, Var};
use diff_raster::{Frame, Renderer};

/// Differences of colour below this count by their squares, those above by their size.
const NOISE: f32 = 0.02;
/// How much farther than what the second photograph sees a point may be and still be seen there, as a share of its distance.
const HIDDEN: f32 = 0.01;

/// Pairs of photographs with their cameras: `images [P, H, W, 3]`, `masks [P, H, W]` and `matrices [P, 3, 4]`, the first of each pair
/// and the second.
pub(crate) struct Pairs {
    pub(crate) images: [Tensor<f32>; 2],
    pub(crate) masks: [Tensor<f32>; 2],
    pub(crate) matrices: [Tensor<f32>; 2],
}

impl Pairs {
    /// Of photographs `[N, H, W, 3]` with masks `[N, H, W]` and cameras `[N, 3, 4]`, these.
    pub(crate) fn of(
        images: &Tensor<f32>,
        masks: &Tensor<f32>,
        matrices: &Tensor<f32>,
        pairs: &[[usize; 2]],
    ) -> Self {
        let chosen = |all: &Tensor<f32>, end: usize| {
            let size: usize = all.shape()[1..].iter().product();
            let parts = pairs.iter().map(|pair| &all.as_slice()[pair[end] * size..][..size]);
            let mut shape = all.shape().to_vec();
            shape[0] = pairs.len();
            tensor(parts.flatten().copied().collect(), &shape)
        };
        let both = |all: &Tensor<f32>| [chosen(all, 0), chosen(all, 1)];
        Self { images: both(images), masks: both(masks), matrices: both(matrices) }
    }

    /// At half the size: each pixel the mean of four.
    pub(crate) fn halved(&self) -> Self {
        Self {
            images: self.images.each_ref().map(halved),
            masks: self.masks.each_ref().map(halved),
            matrices: self.matrices.clone(),
        }
    }

    /// Height and width.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.images[0].shape()[1], self.images[0].shape()[2]]
    }

    /// How far the photographs are from showing this surface, positions `[V, 3]`: the mean difference of colour between where the first
    /// of a pair sees a point and where the second does, and how much the outlines differ.
    ///
    /// Each pixel of the first sees a point of the surface: the corners' positions, interpolated. That this point stays on the
    /// pixel's ray when a vertex moves is the gradient of barycentric coordinates, DIB-R's equations 3 and 4; where the second
    /// photograph shows it then follows by its camera.
    pub(crate) fn losses<'t>(
        &self,
        tape: &'t Tape<f32>,
        renderer: &Renderer<f32>,
        positions: Var<'t, f32>,
    ) -> [Var<'t, f32>; 2] {
        let [first, second] = self.matrices.each_ref().map(|m| tape.constant(m.clone()));
        let frames = [first, second].map(|matrices| renderer.frame(positions.project(matrices)));
        let [height, width] = self.size();
        let count = self.images[0].shape()[0];
        let points = frames[0].interpolate(positions).reshape(&[count, height * width, 3]);
        let seen = points.project(second);
        // Rows count downwards.
        let flip = tape.constant(tensor(vec![1.0, -1.0], &[2]));
        let places = seen.slice_axis(2, 0..2) * flip;
        let [own, other] = self.images.each_ref().map(|images| tape.constant(images.clone()));
        let shown = other.bilinear_sample(places, Padding::Border, false);
        let visible = self.visible(&frames, seen, places);
        let share = visible.as_slice().iter().sum::<f32>().max(1.0);
        let apart = (shown - own.reshape(&[count, height * width, 3])) * tape.constant(visible);
        let noise = (apart.square() + NOISE * NOISE).sqrt() - NOISE;
        let colors = noise.sum().scale(1.0 / (3.0 * share));
        let outlines = frames.each_ref().map(Frame::antialiased_silhouette);
        let [a, b] = self.masks.each_ref().map(|masks| tape.constant(masks.clone()));
        [colors, (outlines[0] - a).square().mean() + (outlines[1] - b).square().mean()]
    }

    /// Which points of the first photograph's pixels the second sees. `[P, H W, 1]`
    fn visible<'t>(
        &self,
        frames: &[Frame<'t, f32>; 2],
        seen: Var<'t, f32>,
        places: Var<'t, f32>,
    ) -> Tensor<f32> {
        let nearest = frames[1].depth(f32::INFINITY).value();
        let drawn = frames[0].mask();
        let (seen, places) = (seen.value(), places.value());
        let [count, height, width] = *nearest.shape() else { unreachable!("depths are [P, H, W]") };
        let pixels = height * width;
        let at = |point: usize| {
            let [x, y] = [places.as_slice()[2 * point], places.as_slice()[2 * point + 1]];
            let [column, row] = [0.5 * (x + 1.0) * width as f32, 0.5 * (y + 1.0) * height as f32];
            let inside =
                column >= 0.0 && row >= 0.0 && column < width as f32 && row < height as f32;
            inside.then(|| point / pixels * pixels + row as usize * width + column as usize)
        };
        // Beside the object a pixel has something of what is behind it.
        let whole = |view: usize, pixel: usize| self.masks[view].as_slice()[pixel] > 0.999;
        let visible = |point: usize| {
            let sees = |pixel: usize| {
                let far = (1.0 + HIDDEN) * nearest.as_slice()[pixel];
                whole(1, pixel) && far.is_finite() && seen.as_slice()[3 * point + 2] <= far
            };
            let visible = drawn[point] > 0.0 && whole(0, point) && at(point).is_some_and(sees);
            f32::from(u8::from(visible))
        };
        tensor((0..count * pixels).map(visible).collect(), &[count, pixels, 1])
    }
}

/// Elements, the last axis running fastest, of this shape.
pub(crate) fn tensor(elements: Vec<f32>, shape: &[usize]) -> Tensor<f32> {
    Tensor::from(Array1::from_vec(elements)).into_shape(shape)
}

/// `[N, H, W]` or `[N, H, W, C]`, each pixel the mean of four.
fn halved(all: &Tensor<f32>) -> Tensor<f32> {
    let mut shape = all.shape().to_vec();
    let channels = shape.get(3).copied().unwrap_or(1);
    let width = shape[2];
    (shape[1], shape[2]) = (shape[1] / 2, shape[2] / 2);
    let (h, w) = (shape[1], shape[2]);
    let old = |n: usize, i: usize, j: usize, c: usize| {
        all.as_slice()[((n * all.shape()[1] + i) * width + j) * channels + c]
    };
    let mut data = Vec::with_capacity(shape.iter().product());
    for k in 0..shape[0] * h * w * channels {
        let (c, j, i) = (k % channels, k / channels % w, k / channels / w % h);
        let n = k / channels / w / h;
        let four = [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[a, b]| old(n, 2 * i + a, 2 * j + b, c));
        data.push(0.25 * four.iter().sum::<f32>());
    }
    tensor(data, &shape)
}
