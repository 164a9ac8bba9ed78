//! The register tile: the one micro-kernel of convolution, its gradients and Winograd products.
//!
//! A tile is up to 14 rows by two vectors of columns, held in registers while it sums
//!
//! ```text
//! y[i][j] (+)= Σ_run Σ_k  a[run + i·a_row + k·a_k] · b[run + k·b_k + j]
//! ```
//!
//! With 32 registers (AVX-512) 28 accumulators leave room for two vectors of `b` and the
//! broadcasts of `a`, which come straight from memory. 14 divides 14, 28, 56, 112 and 224.

use pulp::{Simd, WithSimd};

use crate::kernels::activation::Activation;
use crate::kernels::isa::Isa;
use crate::kernels::lane::Lane;

/// Operands of one tile. Addresses are those of its first element.
#[derive(Clone, Copy, Debug)]
pub struct Tile<'a, F> {
    /// Where each run begins: steps from `a` and from `b`.
    pub(crate) runs: &'a [[usize; 2]],
    /// Products in each run.
    pub(crate) len: usize,
    pub(crate) a: *const F,
    /// Step of `a` between rows of the tile; 1 in the tiles whose rows are contiguous.
    pub(crate) a_row: usize,
    /// Step of `a` between products of a run; 1 in the tiles whose products are contiguous.
    pub(crate) a_k: usize,
    pub(crate) b: *const F,
    /// Step of `b` between products of a run.
    pub(crate) b_k: usize,
    pub(crate) y: *mut F,
    /// Step of `y` between rows of the tile.
    pub(crate) y_row: usize,
    /// Columns that exist; the others are not written. `b` is read for whole vectors.
    pub(crate) columns: usize,
    /// Whether to add to `y`.
    pub(crate) add: bool,
    /// One number for each column, or null.
    pub(crate) bias: *const F,
    /// One that is [applied in the store](Activation::in_store).
    pub(crate) activation: Activation,
}

/// How the elements of `a` lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rows {
    /// Products of a run are contiguous: a convolution reads its input.
    Strided,
    /// Rows of the tile are contiguous: the gradient of a weight reads the input.
    Contiguous,
}

struct Run<'a, F, const MR: usize, const NV: usize, const UNIT: bool>(&'a Tile<'a, F>);

impl<F: Lane, const MR: usize, const NV: usize, const UNIT: bool> WithSimd
    for Run<'_, F, MR, NV, UNIT>
{
    type Output = ();

    // No closures here or in any vector kernel: one that is not inlined is compiled without the
    // vector instructions. No masked loads either: pulp's are jumps that spill all registers.
    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let t = self.0;
        let lanes = F::lanes::<S>();
        let zero = F::splat(s, F::zero());
        let mut acc = [[zero; NV]; MR];
        let (a_row, a_k) = if UNIT { (1, t.a_k) } else { (t.a_row, 1) };
        let (len, b_k) = (t.len, t.b_k);
        for &[a_run, b_run] in t.runs {
            let (mut a, mut b) = (t.a.wrapping_add(a_run), t.b.wrapping_add(b_run));
            for _ in 0..len {
                let mut columns = [zero; NV];
                for v in 0..NV {
                    // SAFETY: whoever made the tile promises that all its runs lie within its
                    // operands, and whole vectors of `b` too.
                    columns[v] = unsafe { F::load(s, b.wrapping_add(v * lanes)) };
                }
                for i in 0..MR {
                    // SAFETY: as above.
                    let x = F::splat(s, unsafe { *a.wrapping_add(i.wrapping_mul(a_row)) });
                    for v in 0..NV {
                        acc[i][v] = F::fma(s, x, columns[v], acc[i][v]);
                    }
                }
                a = a.wrapping_add(a_k);
                b = b.wrapping_add(b_k);
            }
        }
        let full = t.columns == NV * lanes;
        let mut bias = [zero; NV];
        if !t.bias.is_null() {
            for v in 0..NV {
                let from = t.bias.wrapping_add(v * lanes);
                let count = t.columns.saturating_sub(v * lanes).min(lanes);
                // SAFETY: there is one number for each column.
                bias[v] = unsafe { F::load_first(s, count, from) };
            }
        }
        for i in 0..MR {
            for v in 0..NV {
                let y = t.y.wrapping_add(i * t.y_row + v * lanes);
                let count = t.columns.saturating_sub(v * lanes).min(lanes);
                let mut x = F::plus(s, acc[i][v], bias[v]);
                if t.add {
                    // SAFETY: the tile's rows and columns lie within `y`.
                    let old =
                        unsafe { if full { F::load(s, y) } else { F::load_first(s, count, y) } };
                    x = F::plus(s, x, old);
                }
                match t.activation {
                    Activation::Relu => x = F::larger(s, zero, x),
                    Activation::LeakyRelu(slope) => {
                        // The larger of the two, as the slope is at most 1.
                        x = F::larger(s, F::times(s, F::constant(s, slope), x), x);
                    }
                    _ => {}
                }
                // SAFETY: as above.
                unsafe { if full { F::store(s, y, x) } else { F::store_first(s, count, y, x) } }
            }
        }
    }
}

/// A compiled tile of one height and width.
pub(crate) type TileFn<F> = unsafe fn(Isa, &Tile<'_, F>);

/// Rows of a tile on 16 registers: 12 accumulators, two vectors of `b` and a broadcast.
const FEW_ROWS: usize = 6;

/// # Safety
/// All that the tile reads and writes lies within its operands, and the machine has the
/// instructions.
unsafe fn run<F: Lane, const MR: usize, const NV: usize, const UNIT: bool>(
    isa: Isa,
    tile: &Tile<'_, F>,
) {
    let kernel = Run::<F, MR, NV, UNIT>(tile);
    // High tiles are compiled for AVX-512 alone.
    if const { MR <= FEW_ROWS } {
        // SAFETY: [`Tiles::new`] asked.
        unsafe { isa.run_unchecked(kernel) }
    } else {
        // SAFETY: as above.
        unsafe { isa.run_wide(kernel) }
    }
}

/// The tiles of one instruction set: what the sweeps are cut for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tiles {
    pub(crate) isa: Isa,
    /// Most rows of a tile.
    pub(crate) rows: usize,
    /// Numbers in one vector.
    pub(crate) lanes: usize,
}

struct Lanes<F>(std::marker::PhantomData<F>);

impl<F: Lane> WithSimd for Lanes<F> {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        F::lanes::<S>()
    }
}

impl Tiles {
    pub(crate) fn new<F: Lane>(isa: Isa) -> Self {
        let rows = match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => 14,
            _ => FEW_ROWS,
        };
        Self { isa, rows, lanes: isa.run(Lanes::<F>(std::marker::PhantomData)) }
    }

    /// Columns of a full tile: what weights are packed for.
    pub(crate) fn columns(self) -> usize {
        2 * self.lanes
    }

    /// The tile of `rows` rows that covers `columns` columns.
    pub(crate) fn get<F: Lane>(self, layout: Rows, rows: usize, columns: usize) -> TileFn<F> {
        F::tile(layout, rows, columns > self.lanes)
    }
}

/// Where the tiles of one type are compiled: here, not in each crate that convolves.
pub trait Tiled: Sized {
    /// The tile of `rows` rows and one vector of columns, or two.
    fn tile(layout: Rows, rows: usize, two: bool) -> unsafe fn(Isa, &Tile<'_, Self>);
}

macro_rules! tiled {
    ($float:ident: $($mr:literal)*) => {
        impl Tiled for $float {
            fn tile(layout: Rows, rows: usize, two: bool) -> TileFn<Self> {
                let table: &[TileFn<Self>] = match (layout, two) {
                    (Rows::Strided, true) => &[$(run::<$float, $mr, 2, false>),*],
                    (Rows::Strided, false) => &[$(run::<$float, $mr, 1, false>),*],
                    (Rows::Contiguous, true) => &[$(run::<$float, $mr, 2, true>),*],
                    (Rows::Contiguous, false) => &[$(run::<$float, $mr, 1, true>),*],
                };
                table[rows - 1]
            }
        }
    };
}

tiled!(f32: 1 2 3 4 5 6 7 8 9 10 11 12 13 14);
tiled!(f64: 1 2 3 4 5 6 7 8 9 10 11 12 13 14);

/// Cuts `len` into the fewest balanced parts of at most `most`, and calls `f(start, size)`.
#[inline(always)]
pub(crate) fn balanced(len: usize, most: usize, mut f: impl FnMut(usize, usize)) {
    let parts = len.div_ceil(most);
    let mut start = 0;
    for part in 0..parts {
        let size = (len - start) / (parts - part);
        f(start, size);
        start += size;
    }
}
