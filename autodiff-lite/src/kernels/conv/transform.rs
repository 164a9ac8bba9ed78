//! The linear maps around Winograd's products, vectorised over channels, which must fill whole
//! vectors.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use crate::kernels::activation::Activation;
use crate::kernels::blocks::{Shared, for_each_block};
use crate::kernels::isa::Isa;
use crate::kernels::lane::Lane;

use super::ConvSizes;
use super::grid::{Grid, POINTS};

/// What the transforms ask of the numbers of channels.
const WHOLE: &str = "channels must fill whole vectors";

/// `Bᵀ x`.
#[inline(always)]
fn source<F: Lane, S: Simd>(s: S, d: [F::Vector<S>; 6]) -> [F::Vector<S>; 6] {
    let (m4, m5, m1) = (F::constant(s, -4.0), F::constant(s, -5.0), F::constant(s, -1.0));
    let (a, b) = (F::fma(s, m4, d[2], d[4]), F::fma(s, m4, d[1], d[3]));
    let (e, f) = (F::fma(s, m1, d[2], d[4]), F::minus(s, d[3], d[1]));
    [
        F::fma(s, F::constant(s, 4.0), d[0], F::fma(s, m5, d[2], d[4])),
        F::plus(s, a, b),
        F::minus(s, a, b),
        F::fma(s, F::constant(s, 2.0), f, e),
        F::fma(s, F::constant(s, -2.0), f, e),
        F::fma(s, F::constant(s, 4.0), d[1], F::fma(s, m5, d[3], d[5])),
    ]
}

/// `A g`: the four gradients of a line of outputs, at six points.
#[inline(always)]
fn spread<F: Lane, S: Simd>(s: S, d: [F::Vector<S>; 4]) -> [F::Vector<S>; 6] {
    let (e, o) = (F::plus(s, d[0], d[2]), F::plus(s, d[1], d[3]));
    let e2 = F::fma(s, F::constant(s, 4.0), d[2], d[0]);
    let o2 = F::fma(s, F::constant(s, 8.0), d[3], F::plus(s, d[1], d[1]));
    [d[0], F::plus(s, e, o), F::minus(s, e, o), F::plus(s, e2, o2), F::minus(s, e2, o2), d[3]]
}

/// Six points of a line: of sources, or of gradients if there are four.
#[inline(always)]
fn points<F: Lane, S: Simd, const SIDE: usize>(
    s: S,
    line: [F::Vector<S>; SIDE],
) -> [F::Vector<S>; 6] {
    if SIDE == 6 {
        let mut d = [line[0]; 6];
        d.copy_from_slice(&line);
        source::<F, S>(s, d)
    } else {
        let mut d = [line[0]; 4];
        d.copy_from_slice(&line);
        spread::<F, S>(s, d)
    }
}

/// `Aᵀ m`.
#[inline(always)]
fn collect<F: Lane, S: Simd>(s: S, m: [F::Vector<S>; 6]) -> [F::Vector<S>; 4] {
    let (s1, d1) = (F::plus(s, m[1], m[2]), F::minus(s, m[1], m[2]));
    let (s2, d2) = (F::plus(s, m[3], m[4]), F::minus(s, m[3], m[4]));
    [
        F::plus(s, m[0], F::plus(s, s1, s2)),
        F::fma(s, F::constant(s, 2.0), d2, d1),
        F::fma(s, F::constant(s, 4.0), s2, s1),
        F::plus(s, m[5], F::fma(s, F::constant(s, 8.0), d2, d1)),
    ]
}

/// `G w`.
#[inline(always)]
fn filter<F: Lane, S: Simd>(s: S, g: [F::Vector<S>; 3]) -> [F::Vector<S>; 6] {
    let even = F::times(s, F::constant(s, -1.0 / 6.0), F::plus(s, g[0], g[2]));
    let odd = F::times(s, F::constant(s, -1.0 / 6.0), g[1]);
    let even2 =
        F::fma(s, F::constant(s, 1.0 / 24.0), g[0], F::times(s, F::constant(s, 1.0 / 6.0), g[2]));
    let odd2 = F::times(s, F::constant(s, 1.0 / 12.0), g[1]);
    [
        F::times(s, F::constant(s, 0.25), g[0]),
        F::plus(s, even, odd),
        F::minus(s, even, odd),
        F::plus(s, even2, odd2),
        F::minus(s, even2, odd2),
        g[2],
    ]
}

/// `Gᵀ m`.
#[inline(always)]
fn unfilter<F: Lane, S: Simd>(s: S, m: [F::Vector<S>; 6]) -> [F::Vector<S>; 3] {
    let (s1, d1) = (F::plus(s, m[1], m[2]), F::minus(s, m[2], m[1]));
    let (s2, d2) = (F::plus(s, m[3], m[4]), F::minus(s, m[3], m[4]));
    let sixth = F::times(s, F::constant(s, -1.0 / 6.0), s1);
    [
        F::fma(s, F::constant(s, 0.25), m[0], F::fma(s, F::constant(s, 1.0 / 24.0), s2, sixth)),
        F::fma(s, F::constant(s, 1.0 / 6.0), d1, F::times(s, F::constant(s, 1.0 / 12.0), d2)),
        F::plus(s, m[5], F::fma(s, F::constant(s, 1.0 / 6.0), s2, sixth)),
    ]
}

/// An image that is read tile by tile.
#[derive(Clone, Copy)]
pub(super) struct Read<'a, F> {
    pub(super) grid: Grid,
    pub(super) image: &'a [F],
    pub(super) size: [usize; 2],
    pub(super) padding: [usize; 2],
    pub(super) channels: usize,
}

impl<'a, F> Read<'a, F> {
    /// The input, each tile as the windows of 4x4 outputs see it.
    pub(super) fn input(s: &ConvSizes, image: &'a [F]) -> Self {
        let grid = Grid::new(s.batch, s.output);
        Self { grid, image, size: s.input, padding: s.padding, channels: s.in_channels }
    }

    /// The gradient of the output.
    pub(super) fn output(s: &ConvSizes, image: &'a [F]) -> Self {
        let grid = Grid::new(s.batch, s.output);
        Self { grid, image, size: s.output, padding: [0; 2], channels: s.out_channels }
    }
}

/// Reads tiles of `SIDE x SIDE` pixels and writes them, transformed, as
/// `[channels / width][36][block][width]`: six to a side by `Bᵀ x B`, four to a side by `A g Aᵀ`.
pub(super) struct GatherTiles<'a, F, const SIDE: usize> {
    pub(super) read: Read<'a, F>,
    pub(super) first: usize,
    pub(super) count: usize,
    /// Tiles of a block, and the place of the first one in it.
    pub(super) block: usize,
    pub(super) at: usize,
    /// Channels that lie together: whole vectors.
    pub(super) width: usize,
    /// The block; its other tiles are not touched.
    pub(super) out: Shared<F>,
    /// Room for one tile, copied with zeros around where it crosses the border.
    pub(super) border: &'a mut [F],
}

impl<F: Lane, const SIDE: usize> GatherTiles<'_, F, SIDE> {
    /// Copies a tile that crosses the border of the image.
    #[inline(always)]
    fn copy(&mut self, n: usize, corner: [isize; 2]) {
        let Read { image, size: [h, w], channels: c, .. } = self.read;
        for r in 0..SIDE {
            let y = corner[0] + r as isize;
            for q in 0..SIDE {
                let x = corner[1] + q as isize;
                let to = &mut self.border[(r * SIDE + q) * c..][..c];
                if y < 0 || x < 0 || y >= h as isize || x >= w as isize {
                    to.fill(F::zero());
                } else {
                    let from = ((n * h + y as usize) * w + x as usize) * c;
                    to.copy_from_slice(&image[from..from + c]);
                }
            }
        }
    }
}

impl<F: Lane, const SIDE: usize> WithSimd for GatherTiles<'_, F, SIDE> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, s: S) {
        let Read { grid, image, size, padding, channels: c } = self.read;
        let lanes = F::lanes::<S>();
        assert!(c.is_multiple_of(lanes) && self.width.is_multiple_of(lanes), "{WHOLE}");
        let point_step = self.block * self.width;
        for tile in 0..self.count {
            let [n, y, x] = grid.corner(self.first + tile);
            let corner = [y as isize - padding[0] as isize, x as isize - padding[1] as isize];
            let inside =
                (0..2).all(|axis| corner[axis] >= 0 && corner[axis] as usize + SIDE <= size[axis]);
            let (base, row, pixel) = if inside {
                let at = ((n * size[0] + corner[0] as usize) * size[1] + corner[1] as usize) * c;
                let reach = ((SIDE - 1) * size[1] + SIDE) * c;
                (image[at..at + reach].as_ptr(), size[1] * c, c)
            } else {
                self.copy(n, corner);
                (self.border[..SIDE * SIDE * c].as_ptr(), SIDE * c, c)
            };
            let mut channel = 0;
            while channel < c {
                let place = channel / self.width * POINTS * point_step
                    + (self.at + tile) * self.width
                    + channel % self.width;
                let out = self.out.at(place, (POINTS - 1) * point_step + lanes);
                let zero = F::splat(s, F::zero());
                let mut half = [[zero; SIDE]; 6];
                for q in 0..SIDE {
                    let mut line = [zero; SIDE];
                    for r in 0..SIDE {
                        let from = base.wrapping_add(r * row + q * pixel + channel);
                        // SAFETY: the tile lies in the image or in its copy.
                        line[r] = unsafe { F::load(s, from) };
                    }
                    let points = points::<F, S, SIDE>(s, line);
                    for r in 0..6 {
                        half[r][q] = points[r];
                    }
                }
                for r in 0..6 {
                    let points = points::<F, S, SIDE>(s, half[r]);
                    for q in 0..6 {
                        let to = out.wrapping_add((r * 6 + q) * point_step);
                        // SAFETY: the point's row for this tile lies in the block, and is this
                        // call's alone.
                        unsafe { F::store(s, to, points[q]) }
                    }
                }
                channel += lanes;
            }
        }
    }
}

/// Writes `activation(Aᵀ m A + bias)` of each tile to the image.
pub(super) struct ScatterTiles<'a, F> {
    pub(super) grid: Grid,
    pub(super) first: usize,
    pub(super) count: usize,
    pub(super) block: usize,
    /// `[36][block][width]`: `channels` of all channels of the image.
    pub(super) products: &'a [F],
    pub(super) width: usize,
    pub(super) channels: Range<usize>,
    pub(super) all: usize,
    pub(super) size: [usize; 2],
    pub(super) bias: Option<&'a [F]>,
    pub(super) activation: Activation,
    pub(super) out: Shared<F>,
}

impl<F: Lane> WithSimd for ScatterTiles<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let (c, lanes) = (self.all, F::lanes::<S>());
        assert!(self.channels.len().is_multiple_of(lanes), "{WHOLE}");
        assert!(self.channels.len() <= self.width, "more channels than products");
        let point_step = self.block * self.width;
        let zero = F::splat(s, F::zero());
        let slope = match self.activation {
            Activation::LeakyRelu(slope) => F::constant(s, slope),
            _ => zero,
        };
        for tile in 0..self.count {
            let [n, y, x] = self.grid.corner(self.first + tile);
            let [rows, cols] = [4.min(self.size[0] - y), 4.min(self.size[1] - x)];
            let reach = (POINTS - 1) * point_step + self.width;
            let from = self.products[tile * self.width..][..reach].as_ptr();
            let out = ((n * self.size[0] + y) * self.size[1] + x) * c + self.channels.start;
            let mut channel = 0;
            while channel < self.channels.len() {
                let mut half = [[zero; 6]; 4];
                for q in 0..6 {
                    let mut line = [zero; 6];
                    for r in 0..6 {
                        let from = from.wrapping_add((r * 6 + q) * point_step + channel);
                        // SAFETY: the point's row for this tile lies in the products.
                        line[r] = unsafe { F::load(s, from) };
                    }
                    let column = collect::<F, S>(s, line);
                    for r in 0..4 {
                        half[r][q] = column[r];
                    }
                }
                let mut bias = zero;
                if let Some(b) = self.bias {
                    let from = b[self.channels.start + channel..][..lanes].as_ptr();
                    // SAFETY: there is one number for each channel.
                    bias = unsafe { F::load(s, from) };
                }
                let reach = ((rows - 1) * self.size[1] + cols - 1) * c + lanes;
                let to = self.out.at(out + channel, reach);
                for r in 0..4 {
                    let line = collect::<F, S>(s, half[r]);
                    if r >= rows {
                        break;
                    }
                    for q in 0..4 {
                        let mut value = F::plus(s, line[q], bias);
                        match self.activation {
                            Activation::Relu => value = F::larger(s, zero, value),
                            Activation::LeakyRelu(_) => {
                                value = F::larger(s, F::times(s, slope, value), value);
                            }
                            _ => {}
                        }
                        if q < cols {
                            let to = to.wrapping_add((r * self.size[1] + q) * c);
                            // SAFETY: the pixel lies in the image and in this tile alone.
                            unsafe { F::store(s, to, value) }
                        }
                    }
                }
                channel += lanes;
            }
        }
    }
}

/// `G w Gᵀ` of all weights, packed as `[36][panel of outputs][summed][columns]`.
pub(super) struct TransformWeights<'a, F> {
    pub(super) w: &'a [F],
    /// Number and step of the channels that are summed over.
    pub(super) summed: [usize; 2],
    /// Number and step of the output's channels.
    pub(super) outputs: [usize; 2],
    /// Whether the window is turned by half a circle.
    pub(super) flip: bool,
}

impl<'a, F: Lane> TransformWeights<'a, F> {
    /// Those of the output.
    pub(super) fn forward(s: &ConvSizes, w: &'a [F]) -> Self {
        let outputs = [s.out_channels, 9 * s.in_channels];
        Self { w, summed: [s.in_channels, 9], outputs, flip: false }
    }

    /// Those of the gradient of the input: sides exchanged, the window turned by half a circle.
    pub(super) fn grad_input(s: &ConvSizes, w: &'a [F]) -> Self {
        let summed = [s.out_channels, 9 * s.in_channels];
        Self { w, summed, outputs: [s.in_channels, 9], flip: true }
    }

    pub(super) fn run(&self, isa: Isa, columns: usize, out: &mut [F]) {
        let panels = self.outputs[0].div_ceil(columns);
        let parallel = self.summed[0] * self.outputs[0] >= 2048;
        let out = Shared::new(out);
        // A task is one panel of eight summed channels.
        let chunks = self.summed[0].div_ceil(8);
        for_each_block(panels * chunks, parallel, |task| {
            let (panel, chunk) = (task / chunks, task % chunks);
            let summed = chunk * 8..(chunk * 8 + 8).min(self.summed[0]);
            let start = (panel * self.summed[0] + summed.start) * columns;
            let point_step = panels * self.summed[0] * columns;
            isa.run(WeightPanel { weights: self, columns, panel, summed, point_step, start, out });
        });
    }
}

/// `G w Gᵀ` of some summed channels for one panel of outputs, as `[36][summed][columns]`.
pub(super) struct WeightPanel<'a, F> {
    pub(super) weights: &'a TransformWeights<'a, F>,
    pub(super) columns: usize,
    pub(super) panel: usize,
    pub(super) summed: Range<usize>,
    /// Where the first point begins in `out`, and the numbers between points; this call alone
    /// writes them.
    pub(super) start: usize,
    pub(super) point_step: usize,
    pub(super) out: Shared<F>,
}

impl<F: Lane> WithSimd for WeightPanel<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let WeightPanel { weights, columns, panel, summed, start, point_step, out } = self;
        let out = out.at(start, (POINTS - 1) * point_step + summed.len() * columns);
        let summed_step = weights.summed[1];
        let [outputs, output_step] = weights.outputs;
        let lanes = F::lanes::<S>();
        for c in summed.clone() {
            // Nine taps of all columns of the panel; zero where there is no such output.
            let mut taps = [[F::zero(); 64]; 9];
            for j in 0..columns.min(outputs - panel * columns) {
                let from = (panel * columns + j) * output_step + c * summed_step;
                for (k, &w) in weights.w[from..from + 9].iter().enumerate() {
                    taps[if weights.flip { 8 - k } else { k }][j] = w;
                }
            }
            for v in 0..columns / lanes {
                let zero = F::splat(s, F::zero());
                let mut half = [[zero; 3]; 6];
                for q in 0..3 {
                    let mut line = [zero; 3];
                    for r in 0..3 {
                        let from = taps[r * 3 + q][v * lanes..].as_ptr();
                        // SAFETY: a row of `taps` holds the columns of any width.
                        line[r] = unsafe { F::load(s, from) };
                    }
                    let column = filter::<F, S>(s, line);
                    for r in 0..6 {
                        half[r][q] = column[r];
                    }
                }
                for r in 0..6 {
                    let line = filter::<F, S>(s, half[r]);
                    for q in 0..6 {
                        let at = (r * 6 + q) * point_step + (c - summed.start) * columns;
                        let to = out.wrapping_add(at + v * lanes);
                        // SAFETY: there is room for all points, as was checked.
                        unsafe { F::store(s, to, line[q]) }
                    }
                }
            }
        }
    }
}

/// `taps[9][len] = Gᵀ (Σ_shards sums[36][len]) G`.
pub(super) struct WeightGradient<'a, F> {
    pub(super) shards: usize,
    pub(super) sums: &'a [F],
    pub(super) len: usize,
    pub(super) taps: &'a mut [F],
}

impl<F: Lane> WithSimd for WeightGradient<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let lanes = F::lanes::<S>();
        let zero = F::splat(s, F::zero());
        let mut at = 0;
        while at < self.len {
            let mut half = [[zero; 6]; 3];
            for q in 0..6 {
                let mut line = [zero; 6];
                for r in 0..6 {
                    for shard in 0..self.shards {
                        let point = shard * POINTS + r * 6 + q;
                        let from = self.sums[point * self.len + at..][..lanes].as_ptr();
                        // SAFETY: a whole vector.
                        line[r] = F::plus(s, line[r], unsafe { F::load(s, from) });
                    }
                }
                let column = unfilter::<F, S>(s, line);
                for r in 0..3 {
                    half[r][q] = column[r];
                }
            }
            for r in 0..3 {
                let line = unfilter::<F, S>(s, half[r]);
                for q in 0..3 {
                    let to = self.taps[(r * 3 + q) * self.len + at..][..lanes].as_mut_ptr();
                    // SAFETY: a whole vector.
                    unsafe { F::store(s, to, line[q]) }
                }
            }
            at += lanes;
        }
    }
}
