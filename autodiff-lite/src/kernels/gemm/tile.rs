//! The register tile of matrix products: up to 14 rows by two vectors of columns, summed in registers.
//!
//! Both operands are packed, so that the inner loop reads on and all its addresses are constants away from two
//! registers. On a Zen 4 the tile reaches 98 to 99.7 % of the peak from 128 products on.

use pulp::{Simd, WithSimd};

use crate::kernels::isa::Isa;
use crate::kernels::lane::{Lane, MOST_LANES};

use super::strip::{Packing, near};

/// Most products that a packed strip of A holds.
pub(super) const MOST_PRODUCTS: usize = 320;

/// Step between the rows of a strip that is packed row by row: a cache line more than their length, so that they do
/// not all begin in the same sets of the cache.
pub(super) const ROW_STEP: usize = MOST_PRODUCTS + 16;

/// Step between the products of a strip that is packed product by product: at least the rows of a tile.
pub(super) const PRODUCT_STEP: usize = 16;

/// Most rows of a tile: with two vectors of columns 28 of 32 registers are sums.
pub(super) const MOST_ROWS: usize = 14;

/// Operands of one tile. Addresses are those of its first element.
#[derive(Debug)]
pub struct Tile<'a, 'm, F> {
    /// Products to sum.
    pub(super) len: usize,
    /// A strip, as its [`Layout`] says.
    pub(super) a: *const F,
    /// Step between the rows of a strip that is read where it is.
    pub(super) a_step: usize,
    /// Rows of whole vectors.
    pub(super) b: *const F,
    pub(super) b_step: usize,
    pub(super) c: *mut F,
    pub(super) c_step: usize,
    /// Columns that exist; the others are not written.
    pub(super) columns: usize,
    /// What the sum is multiplied by.
    pub(super) alpha: F,
    /// Whether to add to C.
    pub(super) add: bool,
    /// What is packed meanwhile, and how many of its pieces with each row of C.
    pub(super) next: &'a mut Packing<'m, F>,
    pub(super) pieces: usize,
}

/// How a strip of A lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Where it is: products of a row are contiguous, rows as far apart as those of A.
    InPlace,
    /// Packed: products of a row are contiguous, rows [`ROW_STEP`] apart.
    Rows,
    /// Packed: rows are contiguous, products [`PRODUCT_STEP`] apart: of a transposed A.
    Products,
}

/// Layouts as numbers, which the compiler takes where it does not take an enum.
const IN_PLACE: usize = Layout::InPlace as usize;
const ROWS: usize = Layout::Rows as usize;
const PRODUCTS: usize = Layout::Products as usize;

struct Run<'a, 'm, F, const MR: usize, const NV: usize, const LAYOUT: usize>(Tile<'a, 'm, F>);

impl<F: Lane, const MR: usize, const NV: usize, const LAYOUT: usize> WithSimd
    for Run<'_, '_, F, MR, NV, LAYOUT>
{
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let t = self.0;
        let lanes = F::lanes::<S>();
        let (row, product) = match LAYOUT {
            IN_PLACE => (t.a_step, 1),
            ROWS => (ROW_STEP, 1),
            _ => (1, PRODUCT_STEP),
        };
        let mut acc = [[F::splat(s, F::zero()); NV]; MR];
        let (mut a, mut b) = (t.a, t.b);
        // A row of C with each part of the sum: all rows at once would keep the lines of B waiting.
        for part in 0..MR {
            near(t.c.wrapping_add(part * t.c_step), t.columns);
            t.next.advance(s, t.pieces);
            let products = (t.len + part) / MR;
            for _ in 0..products {
                let mut columns = [F::splat(s, F::zero()); NV];
                for v in 0..NV {
                    // SAFETY: whoever made the tile promises rows of whole vectors.
                    columns[v] = unsafe { F::load(s, b.wrapping_add(v * lanes)) };
                }
                for i in 0..MR {
                    // SAFETY: and a packed strip of so many rows and products.
                    let x = F::splat(s, unsafe { *a.wrapping_add(i * row) });
                    for v in 0..NV {
                        acc[i][v] = F::fma(s, x, columns[v], acc[i][v]);
                    }
                }
                a = a.wrapping_add(product);
                b = b.wrapping_add(t.b_step);
            }
        }
        let alpha = F::splat(s, t.alpha);
        for i in 0..MR {
            for v in 0..NV {
                acc[i][v] = F::times(s, acc[i][v], alpha);
            }
        }
        // Each way to store is on its own, and short: loops that are not unrolled would put the accumulators on the
        // stack, for the sum too (37 % of the peak instead of 98).
        if t.columns != NV * lanes {
            let mut sums = [[[F::zero(); MOST_LANES]; NV]; MR];
            for i in 0..MR {
                for v in 0..NV {
                    // SAFETY: no register is longer than that.
                    unsafe { F::store(s, sums[i][v].as_mut_ptr(), acc[i][v]) };
                }
            }
            // SAFETY: the tile's rows and columns lie within C.
            unsafe { store_part(&t, lanes, NV, sums.as_flattened().as_flattened()) };
        } else if t.add {
            for i in 0..MR {
                for v in 0..NV {
                    let c = t.c.wrapping_add(i * t.c_step + v * lanes);
                    // SAFETY: as above.
                    unsafe { F::store(s, c, F::plus(s, acc[i][v], F::load(s, c))) };
                }
            }
        } else {
            for i in 0..MR {
                for v in 0..NV {
                    let c = t.c.wrapping_add(i * t.c_step + v * lanes);
                    // SAFETY: as above.
                    unsafe { F::store(s, c, acc[i][v]) };
                }
            }
        }
    }
}

/// Writes the columns of a tile that has not all of them. `sums` has room for [`MOST_LANES`] numbers in each vector.
///
/// # Safety
/// The tile's rows and columns lie within C.
#[inline(never)]
unsafe fn store_part<F: Lane>(t: &Tile<'_, '_, F>, lanes: usize, vectors: usize, sums: &[F]) {
    for (i, sums) in sums.chunks_exact(vectors * MOST_LANES).enumerate() {
        for j in 0..t.columns {
            let c = t.c.wrapping_add(i * t.c_step + j);
            let sum = sums[j / lanes * MOST_LANES + j % lanes];
            // SAFETY: the caller's promise.
            unsafe { *c = if t.add { *c + sum } else { sum } };
        }
    }
}

/// A compiled tile of one height and width.
pub(super) type TileFn<F> = unsafe fn(Isa, Tile<'_, '_, F>);

/// # Safety
/// All that the tile reads and writes lies within its operands, and the machine has the instructions.
unsafe fn run<F: Lane, const MR: usize, const NV: usize, const LAYOUT: usize>(
    isa: Isa,
    tile: Tile<'_, '_, F>,
) {
    // SAFETY: the caller's promise.
    unsafe { isa.run_wide(Run::<'_, '_, F, MR, NV, LAYOUT>(tile)) }
}

/// Where the tiles of one type are compiled: here, not in each crate that multiplies.
pub trait Multiplied: Sized {
    /// The tile of `rows` rows and one vector of columns, or two; for AVX-512 alone. None of a type whose products are
    /// left to the `gemm` crate.
    fn product_tile(
        layout: Layout,
        rows: usize,
        two: bool,
    ) -> Option<unsafe fn(Isa, Tile<'_, '_, Self>)>;
}

impl Multiplied for f64 {
    fn product_tile(_: Layout, _: usize, _: bool) -> Option<TileFn<Self>> {
        None
    }
}

macro_rules! multiplied {
    ($float:ident: $($mr:literal)*) => {
        impl Multiplied for $float {
            fn product_tile(layout: Layout, rows: usize, two: bool) -> Option<TileFn<Self>> {
                let table: &[TileFn<Self>] = match (layout, two) {
                    (Layout::InPlace, true) => &[$(run::<$float, $mr, 2, IN_PLACE>),*],
                    (Layout::InPlace, false) => &[$(run::<$float, $mr, 1, IN_PLACE>),*],
                    (Layout::Rows, true) => &[$(run::<$float, $mr, 2, ROWS>),*],
                    (Layout::Rows, false) => &[$(run::<$float, $mr, 1, ROWS>),*],
                    (Layout::Products, true) => &[$(run::<$float, $mr, 2, PRODUCTS>),*],
                    (Layout::Products, false) => &[$(run::<$float, $mr, 1, PRODUCTS>),*],
                };
                table.get(rows - 1).copied()
            }
        }
    };
}

multiplied!(f32: 1 2 3 4 5 6 7 8 9 10 11 12 13 14);
