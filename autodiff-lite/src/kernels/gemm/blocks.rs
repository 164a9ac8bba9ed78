//! How a product is cut: slabs of products, strips and panels, and blocks of both for tasks.
//!
//! An element is the sum of its slabs' sums, each a chain of fused multiply-adds in order. Slabs follow from the sizes
//! alone; strips, panels and blocks change no bit, so the number of blocks may follow that of the threads.

use std::ops::Range;

use crate::kernels::blocks::SERIAL_BELOW;
use crate::kernels::extent::work;
use crate::kernels::threads;

use super::tile::MOST_PRODUCTS;

/// Most rows of a block: one of A's strips after the other meets panels that are in the L2 cache.
const ROWS: usize = 224;

/// Most rows of a product whose blocks have all of them: panels are packed slab by slab, and are in the L2 cache then.
const LOW: usize = 1024;

/// Most columns of a block, so that a slab of their panels fits into half an L2 cache of 1 MiB.
const COLUMNS: usize = 512;

/// Part `i` of `count` nearly equal parts of `len`, the longer ones first.
pub(super) fn part(len: usize, count: usize, i: usize) -> Range<usize> {
    let (size, longer) = (len / count, len % count);
    let start = |i: usize| i * size + i.min(longer);
    start(i)..start(i + 1)
}

/// The cuts of one product, or of several of the same sizes that are made together.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cuts {
    /// Rows and columns of C.
    pub(super) m: usize,
    pub(super) n: usize,
    /// Strips of A and panels of B.
    pub(super) strips: usize,
    pub(super) panels: usize,
    /// Rows of a strip and columns of a panel.
    height: usize,
    width: usize,
    /// Slabs of the products.
    pub(super) slabs: usize,
    /// Blocks of strips and of panels.
    pub(super) down: usize,
    pub(super) across: usize,
    /// Whether each block packs its own panels, because there is no other that has them. What one core packs another reads
    /// slowly: with two threads an encoder layer went from 55.0 to 53.3 ms.
    pub(super) packs_alone: bool,
    /// Whether blocks go to several threads.
    pub(super) parallel: bool,
}

impl Cuts {
    /// For `terms` products in all, that are summed to `outputs` matrices, by tiles of `height` rows and `width` columns.
    pub(super) fn new(
        [m, k, n]: [usize; 3],
        [terms, outputs]: [usize; 2],
        [height, width]: [usize; 2],
    ) -> Self {
        let flops = work(&[2, m, k, n, terms]);
        let parallel = flops >= SERIAL_BELOW;
        let threads = if parallel { threads::available() } else { 1 };
        let (strips, panels) = (m.div_ceil(height), n.div_ceil(width));
        let packs_alone = m <= LOW && (threads == 1 || panels * outputs >= 4 * threads);
        let mut cuts = Self {
            m,
            n,
            strips,
            panels,
            height,
            width,
            slabs: k.div_ceil(MOST_PRODUCTS),
            down: if packs_alone { 1 } else { m.div_ceil(ROWS) },
            across: n.div_ceil(COLUMNS),
            packs_alone,
            parallel,
        };
        if threads > 1 {
            // Small enough to end at about the same time, large enough to be worth a hop.
            let each = if packs_alone { 2 } else { 4 };
            let wanted = (each * threads).min(flops / (SERIAL_BELOW / 2));
            while cuts.down * cuts.across * outputs < wanted && cuts.split() {}
        }
        cuts
    }

    /// Cuts finer: rows first, as each block of columns packs A again.
    fn split(&mut self) -> bool {
        if self.packs_alone {
            if self.panels < 2 * self.across {
                return false;
            }
            self.across += 1;
        } else if self.strips >= 4 * self.down {
            self.down += 1;
        } else if self.panels >= 2 * self.across {
            self.across += 1;
        } else if self.strips >= 2 * self.down {
            self.down += 1;
        } else {
            return false;
        }
        true
    }

    /// The strips of block `i`, and which of `panels` it has.
    pub(super) fn block(&self, i: usize, panels: usize) -> [Range<usize>; 2] {
        [part(self.strips, self.down, i / self.across), part(panels, self.across, i % self.across)]
    }

    /// The rows of a strip.
    pub(super) fn rows(&self, strip: usize) -> Range<usize> {
        strip * self.height..self.m.min((strip + 1) * self.height)
    }

    /// The columns of panels.
    pub(super) fn columns(&self, panels: &Range<usize>) -> Range<usize> {
        panels.start * self.width..self.n.min(panels.end * self.width)
    }
}
