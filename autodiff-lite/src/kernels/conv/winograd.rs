//! Winograd's minimal filtering F(4x4, 3x3): 36 products where the direct form takes 144.
//!
//! ```text
//! y  = Aᵀ [ (G w Gᵀ) ⊙ (Bᵀ x B) ] A          for each tile of 4x4 outputs, 6x6 inputs
//! gw = Gᵀ [ Σ_tiles (A gy Aᵀ) ⊙ (Bᵀ x B) ] G
//! ```
//!
//! The elementwise products, summed over channels (or over tiles), are 36 matrix products by the
//! register tile of the direct form. A block of tiles goes through all three steps while it is
//! in the L2 cache.
//!
//! Lavin and Gray 2016, *Fast Algorithms for Convolutional Neural Networks*, section 4.3.

use crate::kernels::activation::Activation;
use crate::kernels::blocks::{SERIAL_BELOW, Shared, for_each_block};
use crate::kernels::isa::Isa;
use crate::kernels::lane::Lane;
use crate::kernels::tile::{Rows, Tile, Tiles, balanced};
use crate::kernels::workspace;

use super::grid::{Grid, POINTS};
use super::operands::{Operands, finish};
use super::transform::{GatherTiles, Read, ScatterTiles, TransformWeights, WeightGradient};
use super::{ConvSizes, grad_weight as direct};

/// Parts that the tiles are summed in for the gradient of the weight. Fixed, so that rounding
/// does not depend on the number of threads.
const SHARDS: usize = 4;

/// Whether the sizes are such that Winograd is the faster form: 3x3 without stride or dilation,
/// whole vectors of channels, weights that stay in cache, enough tiles to amortise them.
pub(super) fn pays(s: &ConvSizes) -> bool {
    applies(s)
        && s.in_channels * s.out_channels <= 256 * 256
        && Grid::new(s.batch, s.output).tiles() >= 64
        && Grid::new(s.batch, s.input).tiles() >= 64
}

/// Whether the form is written for the sizes at all: channels must fill whole vectors.
pub(super) fn applies(s: &ConvSizes) -> bool {
    s.kernel == [3; 2]
        && s.stride == [1; 2]
        && s.dilation == [1; 2]
        && s.padding[0] <= 2
        && s.padding[1] <= 2
        && s.in_channels.is_multiple_of(16)
        && s.out_channels.is_multiple_of(16)
}

/// Whether the gradient of the weight pays too: its sums must stay in cache.
pub(super) fn grad_weight_pays(s: &ConvSizes) -> bool {
    s.in_channels * s.out_channels <= 128 * 128
}

/// Tiles of one block: both transformed sides stay in half of a 1 MiB L2 cache.
fn block_tiles<F>(channels: usize, tiles: usize) -> usize {
    let fit = 512 * 1024 / (POINTS * channels * size_of::<F>()).max(1);
    // Whole register tiles, and enough blocks to share out.
    (fit / 14 * 14).min(tiles.div_ceil(16)).clamp(14, 112)
}

fn weights_len(summed: usize, outputs: usize) -> usize {
    // Packed for at most 32 columns, whatever the width.
    POINTS * summed * outputs.next_multiple_of(32)
}

/// Numbers of scratch for the sizes of a forward sweep.
pub(super) fn scratch(s: &ConvSizes) -> usize {
    weights_len(s.in_channels, s.out_channels)
}

/// Numbers of scratch for the gradient of the weight.
pub(super) fn grad_weight_scratch(s: &ConvSizes) -> usize {
    (SHARDS * POINTS + 9) * s.in_channels * s.out_channels
}

/// As [`Conv::forward`](super::Conv::forward).
pub(super) fn forward<F: Lane>(s: &ConvSizes, isa: Isa, operands: Operands<'_, F>) {
    sweep(s, isa, &TransformWeights::forward(s, operands.w), operands);
}

/// As [`Conv::grad_input`](super::Conv::grad_input): the forward form with sides exchanged and
/// the window turned by half a circle.
pub(super) fn grad_input<F: Lane>(s: &ConvSizes, isa: Isa, operands: Operands<'_, F>) {
    sweep(&s.transposed(), isa, &TransformWeights::grad_input(s, operands.w), operands);
}

fn sweep<F: Lane>(s: &ConvSizes, isa: Isa, w: &TransformWeights<'_, F>, operands: Operands<'_, F>) {
    let Operands { from: x, bias, activation, to: y, scratch, .. } = operands;
    let tiles = Tiles::new::<F>(isa);
    let columns = tiles.columns();
    let (ci, co) = (s.in_channels, s.out_channels);
    let panel = ci * columns;
    let panels = co.div_ceil(columns);
    let weights = &mut scratch[..POINTS * panels * panel];
    w.run(isa, columns, weights);
    let weights = &*weights;

    let grid = Grid::new(s.batch, s.output);
    let count = grid.tiles();
    let block = block_tiles::<F>(ci + co, count);
    let out = Shared::new(y);
    for_each_block(count.div_ceil(block), s.flops() >= SERIAL_BELOW, |b| {
        let first = b * block;
        let here = block.min(count - first);
        workspace::with(POINTS * (block * (ci + co) + ci), |memory: &mut [F]| {
            let (sources, rest) = memory.split_at_mut(POINTS * block * ci);
            let (products, border) = rest.split_at_mut(POINTS * block * co);
            isa.run(GatherTiles::<F, 6> {
                read: Read::input(s, x),
                first,
                count: here,
                block,
                at: 0,
                width: ci,
                out: Shared::new(sources),
                border,
            });
            for point in 0..POINTS {
                for p in 0..panels {
                    let present = columns.min(co - p * columns);
                    balanced(here, tiles.rows, |start, rows| {
                        let tile = Tile {
                            runs: &[[0, 0]],
                            len: ci,
                            a: sources[(point * block + start) * ci..].as_ptr(),
                            a_row: ci,
                            a_k: 1,
                            b: weights[(point * panels + p) * panel..].as_ptr(),
                            b_k: columns,
                            y: products[(point * block + start) * co + p * columns..].as_mut_ptr(),
                            y_row: co,
                            columns: present,
                            add: false,
                            bias: std::ptr::null(),
                            activation: Activation::None,
                        };
                        let kernel = tiles.get::<F>(Rows::Strided, rows, present);
                        // SAFETY: rows and columns lie in this block's sources, in the packed
                        // panel and in this block's products.
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
                width: co,
                channels: 0..co,
                all: co,
                size: s.output,
                bias,
                activation,
                out,
            });
        });
    });
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
    let tiles = Tiles::new::<F>(isa);
    let columns = tiles.columns();
    let (ci, co) = (s.in_channels, s.out_channels);
    let (sums, rest) = scratch.split_at_mut(SHARDS * POINTS * ci * co);
    let taps = &mut rest[..9 * ci * co];
    let grid = Grid::new(s.batch, s.output);
    let count = grid.tiles();
    // Each block reads and writes all sums, which are larger than the transformed tiles: fewer,
    // longer blocks than forward.
    let most = count.div_ceil(SHARDS).max(1);
    let block = most.div_ceil(most.div_ceil(112));
    let shared = Shared::new(sums);
    for_each_block(SHARDS, s.flops() >= SERIAL_BELOW, |shard| {
        let (begin, end) = (count * shard / SHARDS, count * (shard + 1) / SHARDS);
        // SAFETY: each shard has sums of its own.
        let sums = unsafe { shared.slice(shard * POINTS * ci * co, POINTS * ci * co) };
        if begin == end {
            sums.fill(F::zero());
        }
        let border_len = POINTS * ci.max(co);
        workspace::with(POINTS * block * (ci + co) + border_len, |memory: &mut [F]| {
            let (sources, rest) = memory.split_at_mut(POINTS * block * ci);
            let (gradients, border) = rest.split_at_mut(POINTS * block * co);
            let mut first = begin;
            while first < end {
                let here = block.min(end - first);
                isa.run(GatherTiles::<F, 6> {
                    read: Read::input(s, x),
                    first,
                    count: here,
                    block,
                    at: 0,
                    width: ci,
                    out: Shared::new(sources),
                    border,
                });
                isa.run(GatherTiles::<F, 4> {
                    read: Read::output(s, gy),
                    first,
                    count: here,
                    block,
                    at: 0,
                    width: co,
                    out: Shared::new(gradients),
                    border,
                });
                for point in 0..POINTS {
                    for p in 0..co.div_ceil(columns) {
                        let channel = p * columns;
                        let present = columns.min(co - channel);
                        balanced(ci, tiles.rows, |start, rows| {
                            let tile = Tile {
                                runs: &[[0, 0]],
                                len: here,
                                a: sources[point * block * ci + start..].as_ptr(),
                                a_row: 1,
                                a_k: ci,
                                b: gradients[point * block * co + channel..].as_ptr(),
                                b_k: co,
                                y: sums[(point * ci + start) * co + channel..].as_mut_ptr(),
                                y_row: co,
                                columns: present,
                                add: first > begin,
                                bias: std::ptr::null(),
                                activation: Activation::None,
                            };
                            let kernel = tiles.get::<F>(Rows::Contiguous, rows, present);
                            // SAFETY: rows and columns lie in both transformed blocks and in
                            // this shard's sums.
                            unsafe { kernel(isa, &tile) }
                        });
                    }
                }
                first += here;
            }
        });
    });
    isa.run(WeightGradient { shards: SHARDS, sums, len: ci * co, taps });
    direct::unpack(s, taps, co, gw);
}
