//! Packing the next strip of A while tiles are summed.
//!
//! A strip holds the products of one slab for as many rows as a tile has. What it takes to pack one, loads and stores,
//! is idle while the tiles multiply: they copy a few vectors with each part of their sums, and so the packing of A costs
//! little. On its own it took 5 % of a product of 192 columns on a Zen 4; on an Emerald Rapids it took 11 % even so, and
//! where a strip meets few panels it is read where it is.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use crate::kernels::isa::Isa;
use crate::kernels::lane::Lane;

use super::Matrix;
use super::tile::{Layout, PRODUCT_STEP, ROW_STEP};

/// Bytes of a cache line.
const LINE: usize = 64;

/// Strips of a transposed A that are packed together: neighbours share its pages and cache lines.
const GROUP: usize = 8;

/// Most panels that a strip meets where it is; if there are more, packing it is paid back.
const FEW_PANELS: usize = 8;

/// Whether the rows of A lie such that those of a strip are in different sets of the L1 cache, which come around every 4096 bytes:
/// far from every half of it.
fn spread<F>(a: &Matrix<'_, F>) -> bool {
    let (half, step) = (2048, a.steps[0] * size_of::<F>() % 2048);
    a.steps[1] == 1 && step.min(half - step) >= 192
}

/// How strips of A lie.
#[derive(Clone, Copy, Debug)]
pub(super) struct Strips {
    pub(super) layout: Layout,
    /// Most rows of a strip.
    pub(super) rows: usize,
    /// Numbers of one.
    pub(super) len: usize,
    /// How many are packed together.
    pub(super) together: usize,
}

impl Strips {
    /// For matrices `a`, slabs of at most so many products, and so many panels that a strip meets.
    pub(super) fn new<F>(a: &[Matrix<'_, F>], rows: usize, products: usize, panels: usize) -> Self {
        if panels <= FEW_PANELS && a.iter().all(spread) {
            Self { layout: Layout::InPlace, rows, len: 0, together: 1 }
        } else if a[0].steps[0] == 1 && a[0].steps[1] != 1 {
            let len = products * PRODUCT_STEP;
            Self { layout: Layout::Products, rows, len, together: GROUP }
        } else {
            Self { layout: Layout::Rows, rows, len: rows * ROW_STEP, together: 1 }
        }
    }
}

/// Rows and products of A: of one strip, or of several if A is transposed.
#[derive(Clone, Debug)]
pub(super) struct Part<'a, F> {
    pub(super) a: Matrix<'a, F>,
    pub(super) rows: Range<usize>,
    pub(super) slab: Range<usize>,
}

/// Runs of pieces of a few vectors: steps from run to run and from piece to piece, in A and in the strips.
#[derive(Clone, Copy, Debug)]
struct Runs {
    count: usize,
    step: [usize; 2],
    pieces: usize,
    piece: [usize; 2],
    /// Numbers of a piece, but for the last one of a run.
    len: usize,
    /// Numbers of a run, and the step between them in A.
    all: usize,
    inner: usize,
}

impl<'a, F: Lane> Part<'a, F> {
    /// A from the first number of this part on, which is a strip that is read where it is.
    ///
    /// # Panics
    /// If it reaches past the end of A.
    pub(super) fn in_place(&self) -> &'a [F] {
        let strip = &self.a.data[self.start()..];
        let reach = (self.rows.len() - 1) * self.a.steps[0] + self.slab.len();
        assert!(reach <= strip.len(), "a strip beyond the end");
        strip
    }

    fn start(&self) -> usize {
        self.rows.start * self.a.steps[0] + self.slab.start * self.a.steps[1]
    }

    fn runs(&self, lanes: usize, strips: Strips) -> Runs {
        let (rows, products, [row, product]) = (self.rows.len(), self.slab.len(), self.a.steps);
        match strips.layout {
            Layout::InPlace | Layout::Rows => Runs {
                count: rows,
                step: [row, ROW_STEP],
                pieces: products.div_ceil(lanes),
                piece: [lanes; 2],
                len: lanes,
                all: products,
                inner: product,
            },
            Layout::Products => Runs {
                count: products,
                step: [product, PRODUCT_STEP],
                pieces: rows.div_ceil(strips.rows),
                piece: [strips.rows, strips.len],
                len: strips.rows,
                all: rows,
                inner: row,
            },
        }
    }

    /// What is left to do to have this part in `to`; `soon` is the one after it. Runs whose last vector would reach past
    /// the end of A are there already, and all if their numbers do not lie together.
    ///
    /// # Panics
    /// If the part is not within A, or the strips are longer than `to`.
    pub(super) fn pack<'m>(
        &self,
        lanes: usize,
        strips: Strips,
        soon: Option<&Self>,
        to: &'m mut [F],
    ) -> Packing<'m, F> {
        let runs = self.runs(lanes, strips);
        if strips.layout == Layout::InPlace {
            return Packing {
                runs,
                safe: runs.count,
                soon: self.in_place().as_ptr(),
                ..Packing::none()
            };
        }
        let (start, data, last) = (self.start(), self.a.data, runs.pieces - 1);
        let vectors = runs.len.div_ceil(lanes);
        let whole = (runs.count - 1) * runs.step[1] + last * runs.piece[1] + vectors * lanes;
        assert!(whole <= to.len(), "a strip beyond the end");
        let end = start + (runs.count - 1) * runs.step[0] + (runs.all - 1) * runs.inner;
        assert!(end < data.len(), "a part beyond the end");
        // From the first number of a run to the end of its last vector.
        let reach = last * runs.piece[0] + vectors * lanes;
        let safe = match data.len().checked_sub(start + reach) {
            Some(room) if runs.inner == 1 => {
                room.checked_div(runs.step[0]).map_or(runs.count, |count| runs.count.min(count + 1))
            }
            _ => 0,
        };
        for run in safe..runs.count {
            let mut from = data[start + run * runs.step[0]..].iter().step_by(runs.inner.max(1));
            for piece in 0..runs.pieces {
                let count = runs.len.min(runs.all - piece * runs.len);
                let to = &mut to[run * runs.step[1] + piece * runs.piece[1]..][..count];
                to.iter_mut().zip(&mut from).for_each(|(to, &from)| *to = from);
            }
        }
        let soon = soon.map_or(std::ptr::null(), |soon| soon.a.data[soon.start()..].as_ptr());
        Packing {
            from: data[start..].as_ptr(),
            to: to.as_mut_ptr(),
            soon,
            runs,
            vectors,
            run: 0,
            safe,
            at: 0,
            strips: std::marker::PhantomData,
        }
    }
}

/// Strips that are being packed.
#[derive(Debug)]
pub(super) struct Packing<'m, F> {
    /// The run that is being copied; what follows it in the part after this one is asked for.
    from: *const F,
    to: *mut F,
    soon: *const F,
    runs: Runs,
    /// Of a piece.
    vectors: usize,
    /// Which run and piece are next, and how many runs there are to copy.
    run: usize,
    safe: usize,
    at: usize,
    strips: std::marker::PhantomData<&'m mut [F]>,
}

impl<F: Lane> Packing<'_, F> {
    /// Nothing to do.
    pub(super) fn none() -> Self {
        let none = [0; 2];
        let runs = Runs { count: 0, step: none, pieces: 0, piece: none, len: 0, all: 0, inner: 0 };
        Self {
            from: std::ptr::null(),
            to: std::ptr::null_mut(),
            soon: std::ptr::null(),
            runs,
            vectors: 0,
            run: 0,
            safe: 0,
            at: 0,
            strips: std::marker::PhantomData,
        }
    }

    /// How many pieces there are to copy.
    pub(super) fn pieces(&self) -> usize {
        self.safe * self.runs.pieces
    }

    /// Copies the next pieces, and asks for what lies in the same places of the part after it.
    #[inline(always)]
    pub(super) fn advance<S: Simd>(&mut self, s: S, pieces: usize) {
        let lanes = F::lanes::<S>();
        for _ in 0..pieces {
            if self.run >= self.safe {
                return;
            }
            let [from, to] = self.runs.piece.map(|step| self.at * step);
            fetch::<_, false>(self.soon.wrapping_add(from));
            let (from, to) = (self.from.wrapping_add(from), self.to.wrapping_add(to));
            for v in 0..self.vectors {
                // SAFETY: whole vectors of these runs lie in A and in the strips, as [`Part::pack`] saw.
                unsafe {
                    let x = F::load(s, from.wrapping_add(v * lanes));
                    F::store(s, to.wrapping_add(v * lanes), x);
                }
            }
            self.at += 1;
            if self.at == self.runs.pieces {
                (self.at, self.run) = (0, self.run + 1);
                self.from = self.from.wrapping_add(self.runs.step[0]);
                self.soon = self.soon.wrapping_add(self.runs.step[0]);
                self.to = self.to.wrapping_add(self.runs.step[1]);
            }
        }
    }

    /// Copies the rest.
    ///
    /// # Safety
    /// The machine has the instructions.
    pub(super) unsafe fn finish(&mut self, isa: Isa) {
        if self.run < self.safe {
            // SAFETY: the caller's promise.
            unsafe { isa.run_wide(Finish(self)) };
        }
    }
}

struct Finish<'p, 'm, F>(&'p mut Packing<'m, F>);

impl<F: Lane> WithSimd for Finish<'_, '_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        self.0.advance(s, usize::MAX);
    }
}

/// Asks for a part of a row of C, into the L1 cache.
#[inline(always)]
pub(super) fn near<F>(c: *const F, columns: usize) {
    fetch::<_, true>(c);
    if columns > LINE / size_of::<F>() {
        fetch::<_, true>(c.wrapping_add(LINE / size_of::<F>()));
    }
}

/// Asks for a line of memory, into the L1 cache or only into the L2 cache.
#[inline(always)]
fn fetch<F, const L1: bool>(at: *const F) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _MM_HINT_T1, _mm_prefetch};
        // SAFETY: a hint; of an address that is none the processor thinks nothing.
        unsafe {
            if L1 {
                _mm_prefetch::<_MM_HINT_T0>(at.cast());
            } else {
                _mm_prefetch::<_MM_HINT_T1>(at.cast());
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = at;
}
