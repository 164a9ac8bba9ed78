//! The loops around the tile.

use std::ops::Range;

use crate::kernels::blocks::{Shared, for_each_block};
use crate::kernels::extent::elements;
use crate::kernels::isa::Isa;
use crate::kernels::lane::Lane;
use crate::kernels::workspace;

use super::blocks::{Cuts, part};
use super::strip::{Packing, Part, Strips};
use super::tile::{Layout, MOST_ROWS, Tile};
use super::{Finish, Joined, Matrix, pack, scale};

/// Bytes of a register and of a cache line.
const LINE: usize = 64;

/// Numbers of packed panels that are held at once.
const MOST_PACKED: usize = 1 << 24;

/// One product, or several joined ones.
pub(super) struct Sweep<'a, F> {
    isa: Isa,
    joined: Joined,
    k: usize,
    /// Numbers in a vector.
    lanes: usize,
    cuts: Cuts,
    strips: Strips,
    /// Most products of a slab.
    longest: usize,
    alpha: F,
    beta: F,
    a: &'a [Matrix<'a, F>],
    b: &'a [Matrix<'a, F>],
    c: Vec<Shared<F>>,
    finish: Option<Finish<'a, F>>,
}

impl<'a, F: Lane> Sweep<'a, F> {
    /// Of matrices that are as long as their sizes say, of which there are as many as `joined` says, and of a type that has
    /// tiles.
    ///
    /// # Safety
    /// The machine has the instructions of `isa`, AVX-512.
    pub(super) unsafe fn new(
        isa: Isa,
        joined: Joined,
        sizes: [usize; 3],
        alpha: F,
        a: &'a [Matrix<'a, F>],
        b: &'a [Matrix<'a, F>],
        beta: F,
        c: &mut [&mut [F]],
        finish: Option<Finish<'a, F>>,
    ) -> Self {
        let lanes = LINE / size_of::<F>();
        let terms = [a.len().max(b.len()), c.len()];
        let cuts = Cuts::new(sizes, terms, [MOST_ROWS, 2 * lanes]);
        let longest = sizes[1].div_ceil(cuts.slabs);
        let met = cuts.panels.div_ceil(cuts.across);
        let strips = Strips::new(a, MOST_ROWS, longest, met);
        let c = c.iter_mut().map(|c| Shared::new(c)).collect();
        Self {
            isa,
            joined,
            k: sizes[1],
            lanes,
            cuts,
            strips,
            longest,
            alpha,
            beta,
            a,
            b,
            c,
            finish,
        }
    }

    pub(super) fn run(&self) {
        if self.cuts.packs_alone {
            self.blocks(0..self.cuts.panels, &[], 0);
            return;
        }
        let panel = elements(&[self.k, 2 * self.lanes, self.b.len()]);
        let most = (MOST_PACKED / panel).clamp(1, self.cuts.panels);
        let passes = self.cuts.panels.div_ceil(most);
        for pass in 0..passes {
            let panels = part(self.cuts.panels, passes, pass);
            let each = elements(&[panels.len(), 2 * self.lanes, self.k]);
            workspace::with(elements(&[each, self.b.len()]), |packed: &mut [F]| {
                for (b, to) in self.b.iter().zip(packed.chunks_exact_mut(each)) {
                    self.pack(*b, 0..self.k, &panels, self.cuts.parallel, to);
                }
                self.blocks(panels, packed, each);
            });
        }
    }

    /// Packs the products `slab` of panels.
    fn pack(
        &self,
        b: Matrix<'_, F>,
        slab: Range<usize>,
        panels: &Range<usize>,
        parallel: bool,
        to: &mut [F],
    ) {
        let columns = self.cuts.columns(panels);
        let first = slab.start * b.steps[0] + columns.start * b.steps[1];
        let b = Matrix { data: &b.data[first..], ..b };
        // SAFETY: [`Sweep::new`] was promised the instructions.
        unsafe { pack::panels(self.isa, self.lanes, [slab.len(), columns.len()], b, parallel, to) };
    }

    /// All blocks that have these panels, which are packed, those of further terms `each` numbers later, or not at all.
    fn blocks(&self, panels: Range<usize>, packed: &[F], each: usize) {
        let (count, panel) = (self.cuts.down * self.cuts.across, 2 * self.lanes * self.k);
        for_each_block(count * self.c.len(), self.cuts.parallel, |task| {
            let [strips, across] = self.cuts.block(task % count, panels.len());
            if strips.is_empty() || across.is_empty() {
                return;
            }
            let block = Block {
                sweep: self,
                c: self.c[task / count],
                strips,
                panels: panels.start + across.start..panels.start + across.end,
                packed: packed.get(across.start * panel..).unwrap_or_default(),
                each,
            };
            block.run(task / count);
        });
    }
}

/// What one task makes: these strips and panels of one product.
struct Block<'s, 'a, F> {
    sweep: &'s Sweep<'a, F>,
    c: Shared<F>,
    strips: Range<usize>,
    panels: Range<usize>,
    /// Begins with the first of the panels; those of a further term lie `each` numbers on. Empty if this block packs its
    /// panels itself, slab by slab.
    packed: &'s [F],
    each: usize,
}

/// A few strips of one slab of one term, and which B they meet.
struct Step<'a, F> {
    part: Part<'a, F>,
    strips: Range<usize>,
    b: usize,
}

impl<'a, F: Lane> Block<'_, 'a, F> {
    /// Goes through terms, their slabs, and the strips of each.
    fn run(&self, product: usize) {
        let s = self.sweep;
        let terms = if s.joined == Joined::Sum { s.b.len() } else { 1 };
        let groups = self.strips.len().div_ceil(s.strips.together);
        let count = terms * s.cuts.slabs * groups;
        if s.beta != F::zero() && s.beta != F::one() {
            self.strips
                .clone()
                .for_each(|strip| self.each_row(strip, |part, _| scale(s.beta, part)));
        }
        let room = s.strips.len * s.strips.together.min(self.strips.len());
        let slab = if s.cuts.packs_alone { self.panels.len() * 2 * s.lanes * s.longest } else { 0 };
        workspace::with(2 * room + slab, |memory: &mut [F]| {
            let (mut here, memory) = memory.split_at_mut(room);
            let (mut there, mine) = memory.split_at_mut(room);
            let mut first = self.at(product, 0, groups).part.pack(s.lanes, s.strips, None, here);
            // SAFETY: [`Sweep::new`] was promised the instructions.
            unsafe { first.finish(s.isa) };
            for i in 0..count {
                let at = |i| (i < count).then(|| self.at(product, i, groups));
                let [next, soon] = [at(i + 1), at(i + 2)];
                let mut next = next.map_or_else(Packing::none, |next| {
                    let soon = soon.as_ref().map(|soon| &soon.part);
                    next.part.pack(s.lanes, s.strips, soon, there)
                });
                let step = self.at(product, i, groups);
                let (panels, panel_step) = if s.cuts.packs_alone {
                    if i % groups == 0 {
                        s.pack(s.b[step.b], step.part.slab.clone(), &self.panels, false, mine);
                    }
                    (&*mine, step.part.slab.len() * 2 * s.lanes)
                } else {
                    let first = step.b * self.each + step.part.slab.start * 2 * s.lanes;
                    (&self.packed[first..], s.k * 2 * s.lanes)
                };
                let tiles = step.strips.len() * self.panels.len() * s.strips.rows;
                let pieces = next.pieces().div_ceil(tiles);
                for (j, strip) in step.strips.clone().enumerate() {
                    let (a, a_step) = match s.strips.layout {
                        Layout::InPlace => (step.part.in_place(), step.part.a.steps[0]),
                        _ => (&here[j * s.strips.len..][..s.strips.len], 0),
                    };
                    let add = i >= groups || s.beta != F::zero();
                    let strip_of = Strip { rows: s.cuts.rows(strip), a, a_step, add };
                    let len = step.part.slab.len();
                    self.tiles(&strip_of, len, panels, panel_step, (&mut next, pieces));
                    if let (true, Some(finish)) = (i + groups >= count, s.finish) {
                        self.each_row(strip, |part, [row, column]| {
                            finish(part, [product, row, column]);
                        });
                    }
                }
                // SAFETY: as above.
                unsafe { next.finish(s.isa) };
                std::mem::swap(&mut here, &mut there);
            }
        });
    }

    fn at(&self, product: usize, i: usize, groups: usize) -> Step<'a, F> {
        let (s, together) = (self.sweep, self.sweep.strips.together);
        let (term, slab) = (i / groups / s.cuts.slabs, i / groups % s.cuts.slabs);
        let [a, b] = match s.joined {
            Joined::Sum => [term, term],
            Joined::Rows => [product, 0],
            Joined::Columns => [0, product],
        };
        let first = self.strips.start + i % groups * together;
        let strips = first..self.strips.end.min(first + together);
        let rows = s.cuts.rows(strips.start).start..s.cuts.rows(strips.end - 1).end;
        let part = Part { a: s.a[a], rows, slab: part(s.k, s.cuts.slabs, slab) };
        Step { part, strips, b }
    }

    /// Calls `f` with each row of a strip in this block, its row and first column.
    fn each_row(&self, strip: usize, f: impl Fn(&mut [F], [usize; 2])) {
        let columns = self.sweep.cuts.columns(&self.panels);
        for row in self.sweep.cuts.rows(strip) {
            let start = row * self.sweep.cuts.n + columns.start;
            // SAFETY: these rows and columns are this block's.
            f(unsafe { self.c.slice(start, columns.len()) }, [row, columns.start]);
        }
    }

    /// Multiplies a packed strip of `len` products and all panels, `panel_step` numbers apart, and meanwhile packs so many
    /// pieces with each row of C.
    fn tiles(
        &self,
        strip: &Strip<'_, F>,
        len: usize,
        panels: &[F],
        panel_step: usize,
        (next, pieces): (&mut Packing<'_, F>, usize),
    ) {
        let (s, cuts, width) = (self.sweep, &self.sweep.cuts, 2 * self.sweep.lanes);
        let rows = &strip.rows;
        assert!(len <= s.longest, "a strip beyond the end");
        for (i, panel) in self.panels.clone().enumerate() {
            let columns = cuts.columns(&(panel..panel + 1));
            let reach = (rows.len() - 1) * cuts.n + columns.len();
            let tile = Tile {
                len,
                a: strip.a.as_ptr(),
                a_step: strip.a_step,
                b: panels[i * panel_step..][..len * width].as_ptr(),
                b_step: width,
                c: self.c.at(rows.start * cuts.n + columns.start, reach),
                c_step: cuts.n,
                columns: columns.len(),
                alpha: s.alpha,
                add: strip.add,
                next: &mut *next,
                pieces,
            };
            let run = F::product_tile(s.strips.layout, rows.len(), columns.len() > s.lanes);
            let run = run.expect("whoever swept asked for this type's tiles");
            // SAFETY: the strip and the slab of the panel are as long as the tile reads, its rows and columns lie in C
            // and are this block's, and the machine has the instructions of `isa`.
            unsafe { run(s.isa, tile) };
        }
    }
}

/// A strip, its rows of C, and whether to add to them.
struct Strip<'m, F> {
    rows: Range<usize>,
    a: &'m [F],
    a_step: usize,
    add: bool,
}
