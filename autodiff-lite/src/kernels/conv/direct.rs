//! The direct form: register tiles that read the input in place.

use crate::kernels::activation::Activation;
use crate::kernels::blocks::{SERIAL_BELOW, Shared, for_each_block};
use crate::kernels::extent::{reach, work};
use crate::kernels::isa::Isa;
use crate::kernels::lane::Lane;
use crate::kernels::tile::{Rows, Tile, Tiles, balanced};

use super::ConvSizes;
use super::operands::{Operands, finish};
use super::pack::{Frame, Roles, Tap, pack, packed_len};

/// One product over a grid of output pixels.
struct Sweep<'a, F> {
    tiles: Tiles,
    input: &'a [F],
    /// Steps of the input between images, output rows and output pixels.
    in_steps: [usize; 3],
    runs: &'a [[usize; 2]],
    len: usize,
    weights: &'a [F],
    images: usize,
    /// Rows and columns of the grid.
    grid: [usize; 2],
    channels: usize,
    /// First element of the grid in the output, and steps between images, rows and pixels.
    out_start: usize,
    out_steps: [usize; 3],
    bias: Option<&'a [F]>,
    activation: Activation,
}

impl<F: Lane> Sweep<'_, F> {
    fn run(&self, out: &mut [F]) {
        let columns = self.tiles.columns();
        self.check(out.len());
        let products = self.runs.len() * self.len;
        let panel = products * columns;
        let blocks = self.channels.div_ceil(columns);
        let rows = self.images * self.grid[0];
        let flops = work(&[2, rows, self.grid[1], products, self.channels]);
        // A task is a chunk of rows for one block of channels. Chunks are long enough to be worth
        // a task and, where the weights of a block fill a good part of the L2 cache, to reuse
        // them; but there are enough of them to share out.
        let per_row = work(&[2, self.grid[1], products, columns.min(self.channels)]).max(1);
        let reuse = if panel * size_of::<F>() > 128 * 1024 { 8 } else { 1 };
        let chunk = 4_000_000_usize.div_ceil(per_row).max(reuse);
        let shared = Shared::new(out);
        // Small weights stay in L1 all together: each row is written whole, not in stripes.
        let together = panel * blocks * size_of::<F>() <= 32 * 1024;
        let (tasks, together) = if together { (1, blocks) } else { (blocks, 1) };
        let chunk = (chunk / together).min((rows * tasks).div_ceil(16)).clamp(1, rows.max(1));
        for_each_block(rows.div_ceil(chunk) * tasks, flops >= SERIAL_BELOW, |task| {
            let (first, task) = (task / tasks * chunk, task % tasks);
            for row in first..(first + chunk).min(rows) {
                for block in task * together..(task + 1) * together {
                    let weights = &self.weights[block * panel..(block + 1) * panel];
                    self.row(row, block, weights, shared);
                }
            }
        });
    }

    /// That the runs of all pixels of the grid lie in the input, and the grid in the output.
    fn check(&self, output: usize) {
        let grid = [self.images, self.grid[0], self.grid[1]];
        if let Some(last) = self.runs.iter().map(|run| run[0]).max() {
            let [images, rows, columns] = self.in_steps;
            let input =
                reach([grid[0], grid[1], grid[2], 2, self.len], [images, rows, columns, last, 1]);
            assert!(input <= self.input.len(), "a window beyond the input");
        }
        let [images, rows, columns] = self.out_steps;
        let pixels = reach([grid[0], grid[1], grid[2], self.channels], [images, rows, columns, 1]);
        let inside = self.out_start <= output && pixels <= output - self.out_start;
        assert!(pixels == 0 || inside, "a pixel beyond the output");
        assert!(self.bias.is_none_or(|bias| bias.len() == self.channels));
    }

    /// One row of output pixels, for one block of channels.
    #[inline]
    fn row(&self, row: usize, block: usize, weights: &[F], out: Shared<F>) {
        let (n, y) = (row / self.grid[0], row % self.grid[0]);
        let columns = self.tiles.columns();
        let channel = block * columns;
        let present = columns.min(self.channels - channel);
        let input = n * self.in_steps[0] + y * self.in_steps[1];
        let output = self.out_start + n * self.out_steps[0] + y * self.out_steps[1] + channel;
        balanced(self.grid[1], self.tiles.rows, |x, pixels| {
            let tile = Tile {
                runs: self.runs,
                len: self.len,
                a: self.input[input + x * self.in_steps[2]..].as_ptr(),
                a_row: self.in_steps[2],
                a_k: 1,
                b: weights.as_ptr(),
                b_k: columns,
                y: out.at(output + x * self.out_steps[2], present),
                y_row: self.out_steps[2],
                columns: present,
                add: false,
                bias: self.bias.map_or(std::ptr::null(), |b| b[channel..].as_ptr()),
                activation: self.activation,
            };
            let kernel = self.tiles.get::<F>(Rows::Strided, pixels, present);
            // SAFETY: the runs of all pixels of the grid lie in the framed input and the grid in the
            // output, as was checked; the packed block holds all products, and each task writes its
            // own pixels and channels.
            unsafe { kernel(self.tiles.isa, &tile) }
        });
    }
}

/// Whether taps follow each other without gaps, so that they make one run.
fn contiguous(taps: &[Tap]) -> bool {
    taps.windows(2).all(|pair| pair[1].offset == pair[0].offset + 1)
}

/// The runs of a window, and the taps in the order of their products.
fn window(
    taps: &[Vec<Tap>; 2],
    row: usize,
    channels: usize,
    columns: usize,
) -> (Vec<[usize; 2]>, usize, Vec<(usize, usize)>) {
    let merge = contiguous(&taps[1]);
    let len = if merge { taps[1].len() * channels } else { channels };
    let (mut runs, mut order) = (Vec::new(), Vec::new());
    for y in &taps[0] {
        for (i, x) in taps[1].iter().enumerate() {
            if i == 0 || !merge {
                runs.push([(y.offset * row + x.offset) * channels, runs.len() * len * columns]);
            }
            order.push((y.k, x.k));
        }
    }
    (runs, len, order)
}

fn forward_frame(s: &ConvSizes) -> Frame {
    Frame {
        batch: s.batch,
        size: s.input,
        channels: s.in_channels,
        before: s.padding,
        framed: [s.input[0] + 2 * s.padding[0], s.input[1] + 2 * s.padding[1]],
    }
}

fn forward_roles(s: &ConvSizes) -> Roles {
    let area = s.kernel[0] * s.kernel[1];
    Roles { summed: [s.in_channels, area], output: [s.out_channels, s.in_channels * area] }
}

fn grad_roles(s: &ConvSizes) -> Roles {
    let area = s.kernel[0] * s.kernel[1];
    Roles { summed: [s.out_channels, s.in_channels * area], output: [s.in_channels, area] }
}

/// The input with its padding, for the gradient of the weight.
pub(super) fn framed_input(s: &ConvSizes) -> Frame {
    forward_frame(s)
}

pub(super) fn forward_scratch<F: Lane>(s: &ConvSizes, isa: Isa) -> usize {
    let columns = Tiles::new::<F>(isa).columns();
    forward_frame(s).len() + packed_len(s.kernel[0] * s.kernel[1], &forward_roles(s), columns)
}

pub(super) fn forward<F: Lane>(s: &ConvSizes, isa: Isa, operands: Operands<'_, F>) {
    let Operands { from: x, w, bias, activation, to: y, scratch } = operands;
    let tiles = Tiles::new::<F>(isa);
    let columns = tiles.columns();
    let frame = forward_frame(s);
    let (framed, rest) = scratch.split_at_mut(frame.len());
    let input = frame.fill(x, framed);
    let row = frame.framed[1];
    let taps = [0, 1].map(|axis| {
        let tap = |k| Tap { offset: k * s.dilation[axis], k };
        (0..s.kernel[axis]).map(tap).collect::<Vec<_>>()
    });
    let (runs, len, order) = window(&taps, row, s.in_channels, columns);
    let roles = forward_roles(s);
    let weights = &mut rest[..packed_len(order.len(), &roles, columns)];
    pack(w, s.kernel, &order, &roles, columns, weights);
    let line = row * s.in_channels;
    Sweep {
        tiles,
        input,
        in_steps: [frame.framed[0] * line, s.stride[0] * line, s.stride[1] * s.in_channels],
        runs: &runs,
        len,
        weights,
        images: s.batch,
        grid: s.output,
        channels: s.out_channels,
        out_start: 0,
        out_steps: [
            s.output[0] * s.output[1] * s.out_channels,
            s.output[1] * s.out_channels,
            s.out_channels,
        ],
        bias,
        activation,
    }
    .run(y);
    finish(activation, y);
}

/// The input pixels whose distance from the windows' corners leaves the same rest when divided
/// by the stride: along one axis, their gradient is a convolution of stride 1.
#[derive(Clone, Debug)]
struct Class {
    /// First pixel of the class, and how many there are.
    first: usize,
    count: usize,
    /// Output position that the first tap of the first pixel reads; may be negative.
    origin: isize,
    taps: Vec<Tap>,
}

/// Pixel `i` gets `Σ_k gy[o] w[k]` over the taps `k` with `o stride + k dilation = i + padding`.
fn classes(s: &ConvSizes, axis: usize) -> Vec<Class> {
    let (stride, dilation) = (s.stride[axis], s.dilation[axis]);
    let (padding, size) = (s.padding[axis], s.input[axis]);
    let mut all = Vec::new();
    for rest in 0..stride {
        // i + padding = stride q + rest, with i from the first that is not negative.
        let q = padding.saturating_sub(rest).div_ceil(stride);
        let first = stride * q + rest - padding;
        if first >= size {
            continue;
        }
        // o = q + (rest - k dilation) / stride, in ascending order of o.
        let taps: Vec<(isize, usize)> = (0..s.kernel[axis])
            .rev()
            .filter(|k| (k * dilation) % stride == rest)
            .map(|k| (q as isize + (rest as isize - (k * dilation) as isize) / stride as isize, k))
            .collect();
        let origin = taps.first().map_or(0, |t| t.0);
        all.push(Class {
            first,
            count: (size - first).div_ceil(stride),
            origin,
            taps: taps.iter().map(|&(o, k)| Tap { offset: (o - origin) as usize, k }).collect(),
        });
    }
    all
}

/// The frame of `gy` that all classes read within.
fn grad_frame(s: &ConvSizes, classes: &[Vec<Class>; 2]) -> Frame {
    let mut before = [0; 2];
    let mut framed = s.output;
    for axis in 0..2 {
        let used = || classes[axis].iter().filter(|c| !c.taps.is_empty());
        let low = used().map(|c| c.origin).min().unwrap_or(0).min(0);
        let end = |c: &Class| {
            let last = c.taps.last().map_or(0, |t| t.offset);
            c.origin + (c.count + last) as isize
        };
        let high = used().map(end).max().unwrap_or(0).max(s.output[axis] as isize);
        before[axis] = low.unsigned_abs();
        framed[axis] = (high - low) as usize;
    }
    Frame { batch: s.batch, size: s.output, channels: s.out_channels, before, framed }
}

pub(super) fn grad_input_scratch<F: Lane>(s: &ConvSizes, isa: Isa) -> usize {
    let columns = Tiles::new::<F>(isa).columns();
    let classes = [classes(s, 0), classes(s, 1)];
    let most = |axis: usize| classes[axis].iter().map(|c| c.taps.len()).max().unwrap_or(0);
    grad_frame(s, &classes).len() + packed_len(most(0) * most(1), &grad_roles(s), columns)
}

pub(super) fn grad_input<F: Lane>(s: &ConvSizes, isa: Isa, operands: Operands<'_, F>) {
    let Operands { from: gy, w, bias, activation, to: gx, scratch } = operands;
    let tiles = Tiles::new::<F>(isa);
    let columns = tiles.columns();
    let classes = [classes(s, 0), classes(s, 1)];
    let frame = grad_frame(s, &classes);
    let (framed, rest) = scratch.split_at_mut(frame.len());
    let input = frame.fill(gy, framed);
    let row = frame.framed[1];
    let (line, roles) = (row * s.out_channels, grad_roles(s));
    let out_line = s.input[1] * s.in_channels;
    for vertical in &classes[0] {
        for across in &classes[1] {
            let taps = [vertical.taps.clone(), across.taps.clone()];
            let (mut runs, len, order) = window(&taps, row, s.out_channels, columns);
            let weights = &mut rest[..packed_len(order.len(), &roles, columns)];
            pack(w, s.kernel, &order, &roles, columns, weights);
            if !runs.is_empty() {
                let y = (vertical.origin + frame.before[0] as isize) as usize;
                let x = (across.origin + frame.before[1] as isize) as usize;
                for run in &mut runs {
                    run[0] += (y * row + x) * s.out_channels;
                }
            }
            Sweep {
                tiles,
                input,
                // A class without taps is zero (or bias): its pixels must not step anywhere.
                in_steps: if runs.is_empty() {
                    [0; 3]
                } else {
                    [frame.framed[0] * line, line, s.out_channels]
                },
                runs: &runs,
                len,
                weights,
                images: s.batch,
                grid: [vertical.count, across.count],
                channels: s.in_channels,
                out_start: vertical.first * out_line + across.first * s.in_channels,
                out_steps: [
                    s.input[0] * out_line,
                    s.stride[0] * out_line,
                    s.stride[1] * s.in_channels,
                ],
                bias,
                activation,
            }
            .run(gx);
        }
    }
    finish(activation, gx);
}
