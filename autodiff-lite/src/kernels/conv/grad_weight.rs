//! The gradient of the weight, by the same tile: products run over pixels.

use crate::kernels::activation::Activation;
use crate::kernels::blocks::{SERIAL_BELOW, SERIAL_ELEMENTS, Shared, for_each_block};
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

pub(super) fn scratch<F: Lane>(s: &ConvSizes, isa: Isa) -> usize {
    let channels = padded_channels(s, Tiles::new::<F>(isa).lanes);
    let copy =
        if channels == s.out_channels { 0 } else { s.batch * s.output[0] * s.output[1] * channels };
    let sums = s.in_channels * s.kernel[0] * s.kernel[1] * channels;
    framed_input(s).len() + copy + sums
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
    let (line, image) =
        (frame.framed[1] * s.in_channels, frame.framed[0] * frame.framed[1] * s.in_channels);
    let channels = padded_channels(s, tiles.lanes);
    let (in_step, out_line) = (s.stride[1] * s.in_channels, s.output[1] * channels);
    let sums_len = s.in_channels * s.kernel[0] * s.kernel[1] * channels;
    let (sums, rest) = rest.split_at_mut(sums_len);

    // Sums lie as [tap][i][o]; a part is what one tile covers of a run, times a block of o.
    let (taps, run_count) = runs(s);
    let m = taps * s.in_channels;
    // Rows of pixels whose lines of both operands stay in the L1 cache while parts sweep them.
    let touched = s.output[1] * (16 + columns) * size_of::<F>();
    let block = (32 * 1024 / touched.max(1)).clamp(1, s.output[0].max(1));

    // A task owns a run, a block of o and a range of whole tiles; few enough that its operands
    // are read seldom, enough of them to share out.
    let blocks = channels.div_ceil(columns);
    let tile_count = m.div_ceil(tiles.rows);
    let ranges = 8_usize.div_ceil(run_count * blocks).min(tile_count).max(1);
    if s.output_len() == 0 {
        gw.fill(F::zero());
        return;
    }
    let copy_len =
        if channels == s.out_channels { 0 } else { s.output_len() / s.out_channels * channels };
    let gy = widened(gy, &mut rest[..copy_len], [s.out_channels, channels]);
    let shared = Shared::new(sums);
    let sums_of = |task: usize| {
        let (run, task) = (task / (blocks * ranges), task % (blocks * ranges));
        let (channel, range) = (task / ranges * columns, task % ranges);
        let present = columns.min(channels - channel);
        let (ky, kx) =
            if s.dilation[1] == 1 { (run, 0) } else { (run / s.kernel[1], run % s.kernel[1]) };
        let origin = ky * s.dilation[0] * line + kx * s.dilation[1] * s.in_channels;
        let (first, last) = (m * range / ranges, m * (range + 1) / ranges);
        let mut rows = Vec::with_capacity(block);
        let mut fresh = true;
        for n in 0..s.batch {
            let mut y = 0;
            while y < s.output[0] {
                let count = block.min(s.output[0] - y);
                rows.clear();
                rows.extend((0..count).map(|r| [r * s.stride[0] * line, r * out_line]));
                let a = origin + n * image + y * s.stride[0] * line;
                let b = (n * s.output[0] + y) * out_line + channel;
                balanced(last - first, tiles.rows, |start, size| {
                    let at = first + start;
                    let tile = Tile {
                        runs: &rows,
                        len: s.output[1],
                        a: input[a + at..].as_ptr(),
                        a_row: 1,
                        a_k: in_step,
                        b: gy[b..].as_ptr(),
                        b_k: channels,
                        // SAFETY: the tile lies in the sums, as `at < m` and `channel < O`.
                        y: unsafe { shared.at((run * m + at) * channels + channel) },
                        y_row: channels,
                        columns: present,
                        add: !fresh,
                        bias: std::ptr::null(),
                        activation: Activation::None,
                    };
                    let kernel = tiles.get::<F>(Rows::Contiguous, size, present);
                    // SAFETY: pixels of the block lie in both images, a run of the window lies
                    // in the framed input, and each task writes sums of its own.
                    unsafe { kernel(isa, &tile) }
                });
                fresh = false;
                y += count;
            }
        }
    };
    for_each_block(run_count * blocks * ranges, s.flops() >= SERIAL_BELOW, sums_of);
    unpack(s, sums, channels, gw);
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
