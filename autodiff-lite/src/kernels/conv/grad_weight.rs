//! The gradient of the weight, by the same tile: products run over pixels.

use std::ops::Range;

use crate::kernels::activation::Activation;
use crate::kernels::blocks::{SERIAL_BELOW, SERIAL_ELEMENTS, Shared, for_each_block};
use crate::kernels::extent::{elements, reach, work};
use crate::kernels::isa::Isa;
use crate::kernels::lane::Lane;
use crate::kernels::tile::{Rows, Tile, Tiles, balanced};

use super::ConvSizes;
use super::direct::framed_input;

/// Taps of one run of the window, and how many runs there are.
fn runs(s: &ConvSizes) -> (usize, usize) {
    if s.dilation[1] == 1 { (s.kernel[1], s.kernel[0]) } else { (1, s.kernel[0] * s.kernel[1]) }
}

/// Output channels rounded up to whole vectors, so that the tiles read no further.
fn padded_channels(s: &ConvSizes, lanes: usize) -> usize {
    s.out_channels.next_multiple_of(lanes)
}

/// Parts that the rows of pixels are summed in. Fixed, so that rounding does not depend on the
/// threads.
///
/// Large weights are shared out among the threads and summed in one part. A small one (the first
/// layer's) is a few tiles in all, which read all pixels anew each: there the rows are shared
/// out instead, and each part reads its pixels once.
fn shards(s: &ConvSizes) -> usize {
    let rows = work(&[s.batch, s.output[0]]);
    if work(&[s.in_channels, s.kernel[1]]) <= 32 && s.out_channels <= 128 {
        rows.clamp(1, 8)
    } else {
        1
    }
}

/// Numbers in one part of the sums.
fn sums_len(s: &ConvSizes, lanes: usize) -> usize {
    elements(&[s.in_channels, s.kernel[0], s.kernel[1], padded_channels(s, lanes)])
}

pub(super) fn scratch<F: Lane>(s: &ConvSizes, isa: Isa) -> usize {
    let lanes = Tiles::new::<F>(isa).lanes;
    let channels = padded_channels(s, lanes);
    let copy = if channels == s.out_channels {
        0
    } else {
        elements(&[s.batch, s.output[0], s.output[1], channels])
    };
    framed_input(s).len() + copy + elements(&[shards(s), sums_len(s, lanes)])
}

/// Pixels of one task.
const CHUNK: usize = 1024;

/// `gy` itself or, in `copy`, `gy` with zeros in the channels that were added.
fn widened<'a, F: Lane>(gy: &'a [F], copy: &'a mut [F], channels: [usize; 2]) -> &'a [F] {
    if channels[0] == channels[1] {
        return gy;
    }
    let pixels = gy.len() / channels[0];
    let shared = Shared::new(copy);
    for_each_block(pixels.div_ceil(CHUNK), gy.len() >= SERIAL_ELEMENTS, |block| {
        let (first, count) = (block * CHUNK, CHUNK.min(pixels - block * CHUNK));
        // SAFETY: each block is a range of pixels of its own.
        let to = unsafe { shared.slice(first * channels[1], count * channels[1]) };
        let from = gy[first * channels[0]..].chunks_exact(channels[0]);
        for (to, from) in to.chunks_exact_mut(channels[1]).zip(from) {
            to[..channels[0]].copy_from_slice(from);
            to[channels[0]..].fill(F::zero());
        }
    });
    copy
}

/// `gw[o][i][ky][kx] = Σ_pixels x[pixel + (ky, kx)][i] gy[pixel][o]`.
pub(super) fn run<F: Lane>(
    s: &ConvSizes,
    isa: Isa,
    x: &[F],
    gy: &[F],
    gw: &mut [F],
    scratch: &mut [F],
) {
    let tiles = Tiles::new::<F>(isa);
    let columns = tiles.columns();
    let frame = framed_input(s);
    let (framed, rest) = scratch.split_at_mut(frame.len());
    let input = frame.fill(x, framed);
    let channels = padded_channels(s, tiles.lanes);
    let (shards, sums_len) = (shards(s), sums_len(s, tiles.lanes));
    let (sums, rest) = rest.split_at_mut(shards * sums_len);
    if s.output_len() == 0 || sums_len == 0 {
        gw.fill(F::zero());
        return;
    }
    let copy_len =
        if channels == s.out_channels { 0 } else { s.output_len() / s.out_channels * channels };
    let gy = widened(gy, &mut rest[..copy_len], [s.out_channels, channels]);
    let (taps, run_count) = runs(s);
    let line = frame.framed[1] * s.in_channels;
    // Rows of pixels whose lines of both operands stay in the L1 cache while tiles sweep them.
    let touched = s.output[1] * (16 + columns) * size_of::<F>();
    let sweep = Sweep {
        s,
        tiles,
        input,
        line,
        image: frame.framed[0] * line,
        gy,
        channels,
        m: taps * s.in_channels,
        block: (32 * 1024 / touched.max(1)).clamp(1, s.output[0]),
    };
    sweep.check();
    let parallel = s.flops() >= SERIAL_BELOW;
    let (m, rows) = (sweep.m, s.batch * s.output[0]);
    let blocks = channels.div_ceil(columns);
    let shared = Shared::new(sums);
    if shards > 1 {
        for_each_block(shards, parallel, |shard| {
            let rows = rows * shard / shards..rows * (shard + 1) / shards;
            let part = Part { rows, runs: 0..run_count, blocks: 0..blocks, tiles: 0..m };
            sweep.run(&part, shared.at(shard * sums_len, sums_len));
        });
        let (sums, others) = sums.split_at_mut(sums_len);
        for other in others.chunks_exact(sums_len) {
            for (sum, &x) in sums.iter_mut().zip(other) {
                *sum += x;
            }
        }
    } else {
        // A task owns a run, a block of o and a range of whole tiles; few enough that its
        // operands are read seldom, enough of them to share out.
        let tile_count = m.div_ceil(tiles.rows);
        let ranges = 8_usize.div_ceil(run_count * blocks).min(tile_count).max(1);
        for_each_block(run_count * blocks * ranges, parallel, |task| {
            let (run, task) = (task / (blocks * ranges), task % (blocks * ranges));
            let (block, range) = (task / ranges, task % ranges);
            let tiles = m * range / ranges..m * (range + 1) / ranges;
            let part = Part { rows: 0..rows, runs: run..run + 1, blocks: block..block + 1, tiles };
            // Tasks write sums of their own: other runs, blocks or tiles.
            sweep.run(&part, shared.at(0, sums_len));
        });
    }
    unpack(s, &sums[..sums_len], channels, gw);
}

/// What all tasks read.
struct Sweep<'a, F> {
    s: &'a ConvSizes,
    tiles: Tiles,
    input: &'a [F],
    /// Steps between rows and images of the framed input.
    line: usize,
    image: usize,
    gy: &'a [F],
    /// Channels of `gy` as it lies.
    channels: usize,
    /// Numbers in a run of the window.
    m: usize,
    /// Rows of pixels that are swept together.
    block: usize,
}

/// What one task sums: over which rows of pixels (of all images), and which part of the sums.
struct Part {
    rows: Range<usize>,
    runs: Range<usize>,
    blocks: Range<usize>,
    /// Numbers of a run.
    tiles: Range<usize>,
}

impl<F: Lane> Sweep<'_, F> {
    /// That all windows lie in the framed input and all pixels in the gradient.
    fn check(&self) {
        let s = self.s;
        let taps = if s.dilation[1] == 1 { 1 } else { s.kernel[1] };
        let input = reach(
            [s.batch, s.output[0], s.output[1], s.kernel[0], taps, self.m],
            [
                self.image,
                s.stride[0] * self.line,
                s.stride[1] * s.in_channels,
                s.dilation[0] * self.line,
                s.dilation[1] * s.in_channels,
                1,
            ],
        );
        assert!(input <= self.input.len(), "a window beyond the input");
        let pixels = elements(&[s.batch, s.output[0], s.output[1], self.channels]);
        assert!(pixels <= self.gy.len(), "a pixel beyond the gradient");
    }

    /// Writes the sums of a part; those of all parts lie as `[run][m][channels]` from `sums`.
    fn run(&self, part: &Part, sums: *mut F) {
        let (s, line) = (self.s, self.line);
        let columns = self.tiles.columns();
        let out_line = s.output[1] * self.channels;
        let mut lines = Vec::with_capacity(self.block);
        let mut row = part.rows.start;
        while row < part.rows.end {
            let (n, y) = (row / s.output[0], row % s.output[0]);
            let count = self.block.min(s.output[0] - y).min(part.rows.end - row);
            lines.clear();
            lines.extend((0..count).map(|r| [r * s.stride[0] * line, r * out_line]));
            for run in part.runs.clone() {
                let (ky, kx) = if s.dilation[1] == 1 {
                    (run, 0)
                } else {
                    (run / s.kernel[1], run % s.kernel[1])
                };
                let a = n * self.image
                    + (y * s.stride[0] + ky * s.dilation[0]) * line
                    + kx * s.dilation[1] * s.in_channels;
                for block in part.blocks.clone() {
                    let channel = block * columns;
                    let present = columns.min(self.channels - channel);
                    balanced(part.tiles.len(), self.tiles.rows, |start, size| {
                        let at = part.tiles.start + start;
                        let tile = Tile {
                            runs: &lines,
                            len: s.output[1],
                            a: self.input[a + at..].as_ptr(),
                            a_row: 1,
                            a_k: s.stride[1] * s.in_channels,
                            b: self.gy[row * out_line + channel..].as_ptr(),
                            b_k: self.channels,
                            y: sums.wrapping_add((run * self.m + at) * self.channels + channel),
                            y_row: self.channels,
                            columns: present,
                            add: row > part.rows.start,
                            bias: std::ptr::null(),
                            activation: Activation::None,
                        };
                        let kernel = self.tiles.get::<F>(Rows::Contiguous, size, present);
                        // SAFETY: pixels of the block lie in both images and runs of the window in
                        // the framed input, as was checked; each part writes sums of its own.
                        unsafe { kernel(self.tiles.isa, &tile) }
                    });
                }
            }
            row += count;
        }
    }
}

/// `[KH, KW, I, O]`, rows of `O` being `row` long, to `[O, I, KH, KW]`.
pub(super) fn unpack<F: Lane>(s: &ConvSizes, sums: &[F], row: usize, gw: &mut [F]) {
    let area = s.kernel[0] * s.kernel[1];
    let per_output = s.in_channels * area;
    if per_output == 0 {
        return;
    }
    let parallel = gw.len() >= 64 * 1024;
    let shared = Shared::new(gw);
    for_each_block(s.out_channels.div_ceil(16), parallel, |block| {
        let (first, last) = (block * 16, (block * 16 + 16).min(s.out_channels));
        // SAFETY: each block is a range of outputs of its own.
        let part = unsafe { shared.slice(first * per_output, (last - first) * per_output) };
        for i in 0..s.in_channels {
            for tap in 0..area {
                let from = &sums[(tap * s.in_channels + i) * row..][first..last];
                for (o, &from) in from.iter().enumerate() {
                    part[o * per_output + i * area + tap] = from;
                }
            }
        }
    });
}
