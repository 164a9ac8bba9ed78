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
    /// A packed strip, as its [`Layout`] says, with room for [`MOST_ROWS`] rows.
    pub(super) a: *const F,
    /// Rows of two whole vectors, the first at the beginning of a cache line.
    pub(super) b: *const F,
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

/// How a packed strip of A lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Products of a row are contiguous, rows [`ROW_STEP`] apart.
    Rows,
    /// Rows are contiguous, products [`PRODUCT_STEP`] apart: of a transposed A.
    Products,
}

/// The tile with its rows written out, one name for the sums of each. In loops over an array of them the compiler of a build
/// with debug assertions keeps all sums in memory, and so did that of a release where the loop was long: 36 % of the peak.
macro_rules! rows {
    ($self:ident, $s:ident, $mr:ident, $nv:ident, $rows:ident; $($i:literal $sum:ident),*) => {
        let (s, t) = ($s, $self.0);
        let lanes = F::lanes::<S>();
        let (row, product) = if $rows { (ROW_STEP, 1) } else { (1, PRODUCT_STEP) };
        let zero = F::splat(s, F::zero());
        $(let mut $sum = [zero; $nv];)*
        let mut a = t.a;
        let mut b = t.b.cast::<F::Vector<S>>();
        // A row of C with each part of the sum: all rows at once would keep the lines of B waiting.
        for part in 0..$mr {
            near(t.c.wrapping_add(part.wrapping_mul(t.c_step)), t.columns);
            t.next.advance(s, t.pieces);
            for _ in 0..(t.len + part) / $mr {
                // SAFETY: whoever made the tile promises so many rows of two whole vectors, the first at a cache line.
                let (low, high) = unsafe { (*b, *b.wrapping_add(1)) };
                b = b.wrapping_add(2);
                $(if $i < $mr {
                    // SAFETY: and a packed strip of so many rows and products.
                    let x = F::splat(s, unsafe { *a.wrapping_add($i * row) });
                    $sum[0] = F::fma(s, x, low, $sum[0]);
                    if $nv > 1 {
                        $sum[$nv - 1] = F::fma(s, x, high, $sum[$nv - 1]);
                    }
                })*
                a = a.wrapping_add(product);
            }
        }
        let alpha = F::splat(s, t.alpha);
        // Each way to store is on its own: a branch for each vector would take longer.
        if t.columns != $nv * lanes {
            let mut sums = [[[F::zero(); MOST_LANES]; $nv]; $mr];
            $(if $i < $mr {
                for v in 0..$nv {
                    let x = F::times(s, $sum[v], alpha);
                    // SAFETY: no register is longer than that.
                    unsafe { F::store(s, sums[$i % $mr][v].as_mut_ptr(), x) };
                }
            })*
            // SAFETY: the tile's rows and columns lie within C.
            unsafe { store_part(&t, lanes, $nv, sums.as_flattened().as_flattened()) };
        } else if t.add {
            $(if $i < $mr {
                let c = t.c.wrapping_add(usize::wrapping_mul($i, t.c_step));
                for v in 0..$nv {
                    let c = c.wrapping_add(v * lanes);
                    let x = F::times(s, $sum[v], alpha);
                    // SAFETY: as above.
                    unsafe { F::store(s, c, F::plus(s, x, F::load(s, c))) };
                }
            })*
        } else {
            $(if $i < $mr {
                let c = t.c.wrapping_add(usize::wrapping_mul($i, t.c_step));
                for v in 0..$nv {
                    let x = F::times(s, $sum[v], alpha);
                    // SAFETY: as above.
                    unsafe { F::store(s, c.wrapping_add(v * lanes), x) };
                }
            })*
        }
    };
}

struct Run<'a, 'm, F, const MR: usize, const NV: usize, const ROWS: bool>(Tile<'a, 'm, F>);

impl<F: Lane, const MR: usize, const NV: usize, const ROWS: bool> WithSimd
    for Run<'_, '_, F, MR, NV, ROWS>
{
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        rows!(self, s, MR, NV, ROWS;
            0 s0, 1 s1, 2 s2, 3 s3, 4 s4, 5 s5, 6 s6, 7 s7, 8 s8, 9 s9, 10 s10, 11 s11, 12 s12, 13 s13);
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
unsafe fn run<F: Lane, const MR: usize, const NV: usize, const ROWS: bool>(
    isa: Isa,
    tile: Tile<'_, '_, F>,
) {
    // SAFETY: the caller's promise.
    unsafe { isa.run_wide(Run::<'_, '_, F, MR, NV, ROWS>(tile)) }
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
                    (Layout::Rows, true) => &[$(run::<$float, $mr, 2, true>),*],
                    (Layout::Rows, false) => &[$(run::<$float, $mr, 1, true>),*],
                    (Layout::Products, true) => &[$(run::<$float, $mr, 2, false>),*],
                    (Layout::Products, false) => &[$(run::<$float, $mr, 1, false>),*],
                };
                table.get(rows - 1).copied()
            }
        }
    };
}

multiplied!(f32: 1 2 3 4 5 6 7 8 9 10 11 12 13 14);
