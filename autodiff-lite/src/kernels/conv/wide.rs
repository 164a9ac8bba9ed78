//! Winograd's form for many channels, whose transformed weights no cache holds: 512 by 512 of them
//! are 38 MB.
//!
//! Here the blocks of tiles are large, and a task owns a panel of the outputs: it transforms the
//! weights of a few summed channels, multiplies them with all tiles of the block, and drops them.
//! So transformed weights and products never leave the L2 cache; what is read again by each panel
//! are the transformed tiles. The gradient of the weight is cut into squares of channels, each of
//! which is summed, transformed back and written while it is in that cache.

use crate::kernels::activation::Activation;
use crate::kernels::blocks::{SERIAL_BELOW, Shared, for_each_block};
use crate::kernels::isa::Isa;
use crate::kernels::lane::Lane;
use crate::kernels::tile::{Rows, Tile, Tiles, balanced};
use crate::kernels::workspace;

use super::ConvSizes;
use super::grid::{Grid, POINTS};
use super::operands::{Operands, finish};
use super::transform::{
    GatherTiles, Read, ScatterTiles, TransformWeights, WeightGradient, WeightPanel,
};
use super::winograd::applies;

/// Channels that lie together in a block of transformed tiles.
const WIDTH: usize = 64;

/// Most tiles of a block for images, so that the products of a panel stay in the L2 cache.
const SWEPT: usize = 112;

/// Most tiles of a block for the gradient of the weight.
const SUMMED: usize = 224;

/// Tiles that a task transforms.
const GATHERED: usize = 4;

/// Whether the form is written for the sizes.
pub(super) fn applies_to(s: &ConvSizes) -> bool {
    applies(s) && s.in_channels.is_multiple_of(WIDTH) && s.out_channels.is_multiple_of(WIDTH)
}

/// Whether it is the fastest form for the output and the gradient of the input.
pub(super) fn pays(s: &ConvSizes) -> bool {
    applies_to(s)
        && s.in_channels * s.out_channels > 256 * 256
        && Grid::new(s.batch, s.output).tiles() >= 8
        && Grid::new(s.batch, s.input).tiles() >= 8
}

/// Whether it is the fastest form for the gradient of the weight.
pub(super) fn grad_weight_pays(s: &ConvSizes) -> bool {
    applies_to(s)
        && s.in_channels * s.out_channels > 128 * 128
        && Grid::new(s.batch, s.output).tiles() >= 8
}

/// Tiles in each block: the fewest blocks of equal length.
fn block_tiles(s: &ConvSizes, most: usize) -> usize {
    let count = Grid::new(s.batch, s.output).tiles().max(1);
    count.div_ceil(count.div_ceil(most))
}

/// Numbers of scratch for the sizes of a forward sweep.
pub(super) fn scratch(s: &ConvSizes) -> usize {
    POINTS * block_tiles(s, SWEPT) * s.in_channels
}

/// Numbers of scratch for the gradient of the weight.
pub(super) fn grad_weight_scratch(s: &ConvSizes) -> usize {
    POINTS * block_tiles(s, SUMMED) * (s.in_channels + s.out_channels)
}

/// As [`Conv::forward`](super::Conv::forward).
pub(super) fn forward<F: Lane>(s: &ConvSizes, isa: Isa, operands: Operands<'_, F>) {
    sweep(s, isa, &TransformWeights::forward(s, operands.w), operands);
}

/// As [`Conv::grad_input`](super::Conv::grad_input).
pub(super) fn grad_input<F: Lane>(s: &ConvSizes, isa: Isa, operands: Operands<'_, F>) {
    sweep(&s.transposed(), isa, &TransformWeights::grad_input(s, operands.w), operands);
}

impl<F: Lane> Read<'_, F> {
    /// Transforms the tiles `first .. first + count` into a block.
    fn gather<const SIDE: usize>(self, isa: Isa, first: usize, count: usize, out: &mut [F]) {
        let block = out.len() / (POINTS * self.channels);
        let out = Shared::new(out);
        let parallel = count * self.channels >= 1024;
        for_each_block(count.div_ceil(GATHERED), parallel, |task| {
            let at = task * GATHERED;
            workspace::with(POINTS * self.channels, |border: &mut [F]| {
                isa.run(GatherTiles::<F, SIDE> {
                    read: self,
                    first: first + at,
                    count: GATHERED.min(count - at),
                    block,
                    at,
                    width: WIDTH,
                    out,
                    border,
                });
            });
        });
    }
}

fn sweep<F: Lane>(
    s: &ConvSizes,
    isa: Isa,
    weights: &TransformWeights<'_, F>,
    operands: Operands<'_, F>,
) {
    let Operands { from: x, bias, activation, to: y, scratch, .. } = operands;
    let tiles = Tiles::new::<F>(isa);
    let columns = tiles.columns();
    let (ci, co) = (s.in_channels, s.out_channels);
    let grid = Grid::new(s.batch, s.output);
    let read = Read::input(s, x);
    let (count, block) = (grid.tiles(), block_tiles(s, SWEPT));
    let sources = &mut scratch[..POINTS * block * ci];
    let out = Shared::new(y);
    let parallel = s.flops() >= SERIAL_BELOW;
    for first in (0..count).step_by(block) {
        let here = block.min(count - first);
        read.gather::<6>(isa, first, here, sources);
        let sources = &*sources;
        for_each_block(co.div_ceil(columns), parallel, |panel| {
            let channels = panel * columns..co.min((panel + 1) * columns);
            workspace::with(POINTS * columns * (WIDTH + block), |memory: &mut [F]| {
                let (packed, products) = memory.split_at_mut(POINTS * WIDTH * columns);
                for part in 0..ci / WIDTH {
                    isa.run(WeightPanel {
                        weights,
                        columns,
                        panel,
                        summed: part * WIDTH..(part + 1) * WIDTH,
                        start: 0,
                        point_step: WIDTH * columns,
                        out: Shared::new(packed),
                    });
                    for point in 0..POINTS {
                        balanced(here, tiles.rows, |start, rows| {
                            let source = ((part * POINTS + point) * block + start) * WIDTH;
                            let tile = Tile {
                                runs: &[[0, 0]],
                                len: WIDTH,
                                a: sources[source..].as_ptr(),
                                a_row: WIDTH,
                                a_k: 1,
                                b: packed[point * WIDTH * columns..].as_ptr(),
                                b_k: columns,
                                y: products[(point * block + start) * columns..].as_mut_ptr(),
                                y_row: columns,
                                columns: channels.len(),
                                add: part > 0,
                                bias: std::ptr::null(),
                                activation: Activation::None,
                            };
                            let kernel = tiles.get::<F>(Rows::Strided, rows, channels.len());
                            // SAFETY: rows and columns lie in this block's sources, in the
                            // packed weights and in this task's products.
                            unsafe { kernel(isa, &tile) }
                        });
                    }
                }
                isa.run(ScatterTiles {
                    grid,
                    first,
                    count: here,
                    block,
                    products,
                    width: columns,
                    channels,
                    all: co,
                    size: s.output,
                    bias,
                    activation,
                    out,
                });
            });
        });
    }
    finish(activation, y);
}

/// As [`Conv::grad_weight`](super::Conv::grad_weight).
pub(super) fn grad_weight<F: Lane>(
    s: &ConvSizes,
    isa: Isa,
    x: &[F],
    gy: &[F],
    gw: &mut [F],
    scratch: &mut [F],
) {
    let (ci, co) = (s.in_channels, s.out_channels);
    let grid = Grid::new(s.batch, s.output);
    let (input, output) = (Read::input(s, x), Read::output(s, gy));
    let (count, block) = (grid.tiles(), block_tiles(s, SUMMED));
    let (sources, rest) = scratch.split_at_mut(POINTS * block * ci);
    let gradients = &mut rest[..POINTS * block * co];
    let gw = Shared::new(gw);
    let parallel = s.flops() >= SERIAL_BELOW;
    for first in (0..count).step_by(block) {
        let here = block.min(count - first);
        input.gather::<6>(isa, first, here, sources);
        output.gather::<4>(isa, first, here, gradients);
        let square = Square { isa, sources, gradients, block, here };
        for_each_block(ci / WIDTH * (co / WIDTH), parallel, |task| {
            let [i, o] = [task % (ci / WIDTH), task / (ci / WIDTH)];
            workspace::with((POINTS + 9) * WIDTH * WIDTH, |memory: &mut [F]| {
                let taps = square.taps(i, o, memory);
                for (k, output) in (o * WIDTH..(o + 1) * WIDTH).enumerate() {
                    // SAFETY: each task has weights of its own.
                    let to = unsafe { gw.slice((output * ci + i * WIDTH) * 9, 9 * WIDTH) };
                    for (i, to) in to.chunks_exact_mut(9).enumerate() {
                        for (tap, to) in to.iter_mut().enumerate() {
                            let from = taps[(tap * WIDTH + i) * WIDTH + k];
                            *to = if first == 0 { from } else { *to + from };
                        }
                    }
                }
            });
        });
    }
}

/// One block of both transformed images, to be summed over its tiles.
struct Square<'a, F> {
    isa: Isa,
    sources: &'a [F],
    gradients: &'a [F],
    /// Tiles that there is room for, and those that there are.
    block: usize,
    here: usize,
}

impl<F: Lane> Square<'_, F> {
    /// The gradient of the weights between the `i`-th inputs and the `o`-th outputs, as
    /// `[9][WIDTH][WIDTH]`.
    fn taps<'m>(&self, i: usize, o: usize, memory: &'m mut [F]) -> &'m [F] {
        let tiles = Tiles::new::<F>(self.isa);
        let columns = tiles.columns();
        let (sums, taps) = memory.split_at_mut(POINTS * WIDTH * WIDTH);
        for point in 0..POINTS {
            let a = &self.sources[(i * POINTS + point) * self.block * WIDTH..];
            let b = &self.gradients[(o * POINTS + point) * self.block * WIDTH..];
            for panel in 0..WIDTH.div_ceil(columns) {
                balanced(WIDTH, tiles.rows, |start, rows| {
                    let sum = (point * WIDTH + start) * WIDTH + panel * columns;
                    let tile = Tile {
                        runs: &[[0, 0]],
                        len: self.here,
                        a: a[start..].as_ptr(),
                        a_row: 1,
                        a_k: WIDTH,
                        b: b[panel * columns..].as_ptr(),
                        b_k: WIDTH,
                        y: sums[sum..].as_mut_ptr(),
                        y_row: WIDTH,
                        columns: columns.min(WIDTH),
                        add: false,
                        bias: std::ptr::null(),
                        activation: Activation::None,
                    };
                    let kernel = tiles.get::<F>(Rows::Contiguous, rows, tile.columns);
                    // SAFETY: rows and columns lie in both blocks and in the sums.
                    unsafe { kernel(self.isa, &tile) }
                });
            }
        }
        self.isa.run(WeightGradient { shards: 1, sums, len: WIDTH * WIDTH, taps });
        taps
    }
}
