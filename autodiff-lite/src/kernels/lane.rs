//! The numbers that vectors are made of: one source for `f32` and `f64` kernels.

use bytemuck::Pod;
use ndarray::NdFloat;
use pulp::Simd;

use crate::kernels::gemm::library::Crate;
use crate::kernels::gemm::tile::Multiplied;
use crate::kernels::tile::Tiled;
use crate::kernels::transcendental::Transcendental;

/// Lanes of the widest register.
pub const MOST_LANES: usize = 16;

/// A number that fills the lanes of a vector: `f32` and `f64`.
///
/// Forwards to the methods that pulp names once per type, so that a kernel is written once. All
/// of it inlines into the kernel.
pub trait Lane: NdFloat + Default + Pod + Transcendental + Tiled + Multiplied + Crate {
    /// A register of numbers.
    type Vector<S: Simd>: Copy;

    /// Numbers in a register.
    fn lanes<S: Simd>() -> usize;
    /// The same number in each lane.
    fn splat<S: Simd>(s: S, x: Self) -> Self::Vector<S>;
    /// A whole register.
    ///
    /// # Safety
    /// `from` is valid for reads of [`lanes`](Self::lanes) numbers; alignment does not matter.
    unsafe fn load<S: Simd>(s: S, from: *const Self) -> Self::Vector<S>;
    /// A whole register.
    ///
    /// # Safety
    /// `to` is valid for writes of [`lanes`](Self::lanes) numbers; alignment does not matter.
    unsafe fn store<S: Simd>(s: S, to: *mut Self, x: Self::Vector<S>);
    /// The first `count` lanes; zero in the others.
    ///
    /// Goes through memory: a kernel does this at the end of a row, never in its inner loop.
    ///
    /// # Safety
    /// `from` is valid for reads of `count` numbers, at most one register.
    #[inline(always)]
    unsafe fn load_first<S: Simd>(s: S, count: usize, from: *const Self) -> Self::Vector<S> {
        let mut lanes = [Self::zero(); MOST_LANES];
        // SAFETY: the caller's promise; no register is longer than the buffer.
        unsafe {
            std::ptr::copy_nonoverlapping(from, lanes.as_mut_ptr(), count);
            Self::load(s, lanes.as_ptr())
        }
    }
    /// The first `count` lanes; what follows is not touched. As slow as
    /// [`load_first`](Self::load_first).
    ///
    /// # Safety
    /// `to` is valid for writes of `count` numbers, at most one register.
    #[inline(always)]
    unsafe fn store_first<S: Simd>(s: S, count: usize, to: *mut Self, x: Self::Vector<S>) {
        let mut lanes = [Self::zero(); MOST_LANES];
        // SAFETY: the caller's promise; no register is longer than the buffer.
        unsafe {
            Self::store(s, lanes.as_mut_ptr(), x);
            std::ptr::copy_nonoverlapping(lanes.as_ptr(), to, count);
        }
    }
    /// `x` in each lane.
    #[inline(always)]
    fn constant<S: Simd>(s: S, x: f64) -> Self::Vector<S> {
        Self::splat(s, crate::kernels::activation::from_f64(x))
    }
    /// `a b + c`, fused where the hardware can.
    fn fma<S: Simd>(
        s: S,
        a: Self::Vector<S>,
        b: Self::Vector<S>,
        c: Self::Vector<S>,
    ) -> Self::Vector<S>;
    /// `a + b`.
    fn plus<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    /// `a - b`.
    fn minus<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    /// `a b`.
    fn times<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    /// The larger; `b` where either is not a number.
    fn larger<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    /// The smaller; `b` where either is not a number.
    fn smaller<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
}

macro_rules! lane {
    ($float:ident, $vector:ident, $lanes:ident, $splat:ident, $fma:ident, $add:ident, $sub:ident, $mul:ident, $max:ident, $min:ident) => {
        impl Lane for $float {
            type Vector<S: Simd> = S::$vector;

            #[inline(always)]
            fn lanes<S: Simd>() -> usize {
                S::$lanes
            }
            #[inline(always)]
            fn splat<S: Simd>(s: S, x: Self) -> Self::Vector<S> {
                s.$splat(x)
            }
            #[inline(always)]
            unsafe fn load<S: Simd>(_: S, from: *const Self) -> Self::Vector<S> {
                // SAFETY: the caller's promise; a vector is plain numbers without padding.
                unsafe { from.cast::<S::$vector>().read_unaligned() }
            }
            #[inline(always)]
            unsafe fn store<S: Simd>(_: S, to: *mut Self, x: Self::Vector<S>) {
                // SAFETY: the caller's promise; a vector is plain numbers without padding.
                unsafe { to.cast::<S::$vector>().write_unaligned(x) }
            }
            #[inline(always)]
            fn fma<S: Simd>(
                s: S,
                a: Self::Vector<S>,
                b: Self::Vector<S>,
                c: Self::Vector<S>,
            ) -> Self::Vector<S> {
                s.$fma(a, b, c)
            }
            #[inline(always)]
            fn plus<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S> {
                s.$add(a, b)
            }
            #[inline(always)]
            fn minus<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S> {
                s.$sub(a, b)
            }
            #[inline(always)]
            fn times<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S> {
                s.$mul(a, b)
            }
            #[inline(always)]
            fn larger<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S> {
                s.$max(a, b)
            }
            #[inline(always)]
            fn smaller<S: Simd>(s: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S> {
                s.$min(a, b)
            }
        }
    };
}

lane!(
    f32,
    f32s,
    F32_LANES,
    splat_f32s,
    mul_add_e_f32s,
    add_f32s,
    sub_f32s,
    mul_f32s,
    max_f32s,
    min_f32s
);
lane!(
    f64,
    f64s,
    F64_LANES,
    splat_f64s,
    mul_add_e_f64s,
    add_f64s,
    sub_f64s,
    mul_f64s,
    max_f64s,
    min_f64s
);
