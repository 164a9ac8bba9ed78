//! One source for the scalar twin and for every vector width.
//!
//! A kernel is a [`Job`]: written once against [`Lanes`], run by [`dispatch`] with the lanes of the
//! instruction set that it is given. `f32` goes to `pulp`; `f64`, which serves reference and
//! gradient checks, is one lane wide.

use std::marker::PhantomData;

use autodiff_lite::Real;
use pulp::{Arch, Simd, WithSimd, bytemuck};

/// More lanes than any instruction set has: planes are padded by this much, so that a vector may
/// start at any pixel of a row.
pub const MAX_LANES: usize = 16;

/// `[expression for 0, for 1, for 2]`.
///
/// Vector code must not pass through `array::map`: it is compiled without the instruction set of
/// the kernel around it, and each vector operation would become a function call (20x slower).
macro_rules! three {
    ($k:ident => $value:expr) => {{
        let (a, b, c) = (
            {
                let $k = 0_usize;
                $value
            },
            {
                let $k = 1_usize;
                $value
            },
            {
                let $k = 2_usize;
                $value
            },
        );
        [a, b, c]
    }};
}
pub(crate) use three;

/// A vector of consecutive pixels.
pub trait Lanes: Copy {
    /// The scalar.
    type F: Real;
    /// Numbers.
    type V: Copy;
    /// Truth values.
    type M: Copy;
    /// Indices.
    type U: Copy;
    /// Pixels per vector, at most [`MAX_LANES`].
    const N: usize;

    /// All lanes the same.
    fn splat(self, x: Self::F) -> Self::V;
    /// All lanes 0.
    #[inline(always)]
    fn zero(self) -> Self::V {
        self.splat(Self::F::from_f64(0.0))
    }
    /// All lanes 1.
    #[inline(always)]
    fn one(self) -> Self::V {
        self.splat(Self::F::from_f64(1.0))
    }
    /// All lanes the same index.
    fn splat_u(self, x: u32) -> Self::U;
    /// Lanes from the start of a slice of at least `N`.
    fn load(self, from: &[Self::F]) -> Self::V;
    /// Lanes from a slice that may be shorter, the rest 0.
    fn load_part(self, from: &[Self::F]) -> Self::V;
    /// Indices from the start of a slice of at least `N`.
    fn load_u(self, from: &[u32]) -> Self::U;
    /// Lanes to the start of a slice of at least `N`.
    fn store(self, to: &mut [Self::F], x: Self::V);
    /// Indices to the start of a slice of at least `N`.
    fn store_u(self, to: &mut [u32], x: Self::U);
    /// `a + b`
    fn add(self, a: Self::V, b: Self::V) -> Self::V;
    /// `a - b`
    fn sub(self, a: Self::V, b: Self::V) -> Self::V;
    /// `a b`
    fn mul(self, a: Self::V, b: Self::V) -> Self::V;
    /// `a / b`
    fn div(self, a: Self::V, b: Self::V) -> Self::V;
    /// `a b + c`, rounded once where the processor can.
    fn fma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// `c - a b`, rounded once where the processor can.
    fn fnma(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// The smaller.
    fn min(self, a: Self::V, b: Self::V) -> Self::V;
    /// The larger.
    fn max(self, a: Self::V, b: Self::V) -> Self::V;
    /// `a < b`
    fn lt(self, a: Self::V, b: Self::V) -> Self::M;
    /// `a <= b`
    fn le(self, a: Self::V, b: Self::V) -> Self::M;
    /// `a <= b` of indices.
    fn le_u(self, a: Self::U, b: Self::U) -> Self::M;
    /// `a = b` of indices.
    fn eq_u(self, a: Self::U, b: Self::U) -> Self::M;
    /// `a + b` of indices.
    fn add_u(self, a: Self::U, b: Self::U) -> Self::U;
    /// Both.
    fn and(self, a: Self::M, b: Self::M) -> Self::M;
    /// Whether any lane is true.
    fn any(self, m: Self::M) -> bool;
    /// `m ? a : b`
    fn select(self, m: Self::M, a: Self::V, b: Self::V) -> Self::V;
    /// `m ? a : b` of indices.
    fn select_u(self, m: Self::M, a: Self::U, b: Self::U) -> Self::U;
    /// Truth values from the low bits, the first lane lowest.
    fn mask(self, bits: u32) -> Self::M;
    /// True in so many lanes from the first on, at most [`N`](Self::N).
    #[inline(always)]
    fn first(self, count: usize) -> Self::M {
        self.mask(((1_u64 << count) - 1) as u32)
    }
    /// The low bits from truth values, the first lane lowest.
    fn bits(self, m: Self::M) -> u32;
    /// `exp(x)` for `x <= 0`; in `f32` to 1e-7 relative.
    fn exp(self, x: Self::V) -> Self::V;
    /// The sum of the lanes, in a fixed order.
    fn sum(self, x: Self::V) -> Self::F;
}

/// A kernel, to be run with some lanes.
pub trait Job<F: Real> {
    /// What it returns.
    type Output;

    /// The kernel. Implementations are `#[inline(always)]`, so that they are compiled once per
    /// instruction set.
    fn run<L: Lanes<F = F>>(self, lanes: L) -> Self::Output;
}

/// Runs a kernel with the lanes of an instruction set.
#[inline]
pub fn dispatch<F: Real, J: Job<F>>(arch: Arch, job: J) -> J::Output {
    if size_of::<F>() == 4 {
        arch.dispatch(WithLanes(job, PhantomData))
    } else {
        job.run(One(PhantomData))
    }
}

struct WithLanes<J, F>(J, PhantomData<F>);

impl<F: Real, J: Job<F>> WithSimd for WithLanes<J, F> {
    type Output = J::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> J::Output {
        self.0.run(Wide { simd, scalar: PhantomData })
    }
}

/// One lane, of either precision.
#[derive(Clone, Copy, Debug)]
pub struct One<F>(PhantomData<F>);

impl<F: Real> Lanes for One<F> {
    type F = F;
    type V = F;
    type M = bool;
    type U = u32;
    const N: usize = 1;

    #[inline(always)]
    fn splat(self, x: F) -> F {
        x
    }
    #[inline(always)]
    fn splat_u(self, x: u32) -> u32 {
        x
    }
    #[inline(always)]
    fn load(self, from: &[F]) -> F {
        from[0]
    }
    #[inline(always)]
    fn load_part(self, from: &[F]) -> F {
        from.first().copied().unwrap_or_default()
    }
    #[inline(always)]
    fn load_u(self, from: &[u32]) -> u32 {
        from[0]
    }
    #[inline(always)]
    fn store(self, to: &mut [F], x: F) {
        to[0] = x;
    }
    #[inline(always)]
    fn store_u(self, to: &mut [u32], x: u32) {
        to[0] = x;
    }
    #[inline(always)]
    fn add(self, a: F, b: F) -> F {
        a + b
    }
    #[inline(always)]
    fn sub(self, a: F, b: F) -> F {
        a - b
    }
    #[inline(always)]
    fn mul(self, a: F, b: F) -> F {
        a * b
    }
    #[inline(always)]
    fn div(self, a: F, b: F) -> F {
        a / b
    }
    #[inline(always)]
    fn fma(self, a: F, b: F, c: F) -> F {
        a * b + c
    }
    #[inline(always)]
    fn fnma(self, a: F, b: F, c: F) -> F {
        c - a * b
    }
    #[inline(always)]
    fn min(self, a: F, b: F) -> F {
        if b < a { b } else { a }
    }
    #[inline(always)]
    fn max(self, a: F, b: F) -> F {
        if b > a { b } else { a }
    }
    #[inline(always)]
    fn lt(self, a: F, b: F) -> bool {
        a < b
    }
    #[inline(always)]
    fn le(self, a: F, b: F) -> bool {
        a <= b
    }
    #[inline(always)]
    fn le_u(self, a: u32, b: u32) -> bool {
        a <= b
    }
    #[inline(always)]
    fn eq_u(self, a: u32, b: u32) -> bool {
        a == b
    }
    #[inline(always)]
    fn add_u(self, a: u32, b: u32) -> u32 {
        a.wrapping_add(b)
    }
    #[inline(always)]
    fn and(self, a: bool, b: bool) -> bool {
        a & b
    }
    #[inline(always)]
    fn any(self, m: bool) -> bool {
        m
    }
    #[inline(always)]
    fn select(self, m: bool, a: F, b: F) -> F {
        if m { a } else { b }
    }
    #[inline(always)]
    fn select_u(self, m: bool, a: u32, b: u32) -> u32 {
        if m { a } else { b }
    }
    #[inline(always)]
    fn mask(self, bits: u32) -> bool {
        bits & 1 == 1
    }
    #[inline(always)]
    fn bits(self, m: bool) -> u32 {
        m as u32
    }
    #[inline(always)]
    fn exp(self, x: F) -> F {
        x.exp()
    }
    #[inline(always)]
    fn sum(self, x: F) -> F {
        x
    }
}

/// The `f32` lanes of a `pulp` instruction set. `F` is `f32`; it is a parameter only so that
/// generic kernels need not know that.
#[derive(Clone, Copy, Debug)]
struct Wide<S, F> {
    simd: S,
    scalar: PhantomData<F>,
}

const F32: &str = "wide lanes are only made for f32";

/// Methods that are a call of `pulp` under another name.
macro_rules! forward {
    ($($name:ident($($x:ident: $X:ty),*) -> $Y:ty = $simd:ident;)*) => {$(
        #[inline(always)]
        fn $name(self, $($x: $X),*) -> $Y {
            self.simd.$simd($($x),*)
        }
    )*};
}

impl<S: Simd, F: Real> Lanes for Wide<S, F> {
    type F = F;
    type V = S::f32s;
    type M = S::m32s;
    type U = S::u32s;
    const N: usize = S::F32_LANES;

    forward! {
        splat_u(x: u32) -> S::u32s = splat_u32s;
        add(a: S::f32s, b: S::f32s) -> S::f32s = add_f32s;
        sub(a: S::f32s, b: S::f32s) -> S::f32s = sub_f32s;
        mul(a: S::f32s, b: S::f32s) -> S::f32s = mul_f32s;
        div(a: S::f32s, b: S::f32s) -> S::f32s = div_f32s;
        min(a: S::f32s, b: S::f32s) -> S::f32s = min_f32s;
        max(a: S::f32s, b: S::f32s) -> S::f32s = max_f32s;
        lt(a: S::f32s, b: S::f32s) -> S::m32s = less_than_f32s;
        le(a: S::f32s, b: S::f32s) -> S::m32s = less_than_or_equal_f32s;
        le_u(a: S::u32s, b: S::u32s) -> S::m32s = less_than_or_equal_u32s;
        eq_u(a: S::u32s, b: S::u32s) -> S::m32s = equal_u32s;
        add_u(a: S::u32s, b: S::u32s) -> S::u32s = add_u32s;
        and(a: S::m32s, b: S::m32s) -> S::m32s = and_m32s;
        select(m: S::m32s, a: S::f32s, b: S::f32s) -> S::f32s = select_f32s;
        select_u(m: S::m32s, a: S::u32s, b: S::u32s) -> S::u32s = select_u32s;
    }

    #[inline(always)]
    fn splat(self, x: F) -> S::f32s {
        // f32 -> f64 -> f32 is exact, and folded away.
        self.simd.splat_f32s(x.to_f64() as f32)
    }
    #[inline(always)]
    fn load(self, from: &[F]) -> S::f32s {
        S::as_simd_f32s(&F::as_f32(from).expect(F32)[..Self::N]).0[0]
    }
    #[inline(always)]
    fn load_part(self, from: &[F]) -> S::f32s {
        self.simd.partial_load_f32s(F::as_f32(from).expect(F32))
    }
    #[inline(always)]
    fn load_u(self, from: &[u32]) -> S::u32s {
        S::as_simd_u32s(&from[..Self::N]).0[0]
    }
    #[inline(always)]
    fn store(self, to: &mut [F], x: S::f32s) {
        S::as_mut_simd_f32s(&mut F::as_f32_mut(to).expect(F32)[..Self::N]).0[0] = x;
    }
    #[inline(always)]
    fn store_u(self, to: &mut [u32], x: S::u32s) {
        S::as_mut_simd_u32s(&mut to[..Self::N]).0[0] = x;
    }
    #[inline(always)]
    fn fma(self, a: S::f32s, b: S::f32s, c: S::f32s) -> S::f32s {
        if S::IS_SCALAR {
            // Without FMA hardware `mul_add` is a library call.
            self.simd.add_f32s(self.simd.mul_f32s(a, b), c)
        } else {
            self.simd.mul_add_e_f32s(a, b, c)
        }
    }
    #[inline(always)]
    fn fnma(self, a: S::f32s, b: S::f32s, c: S::f32s) -> S::f32s {
        if S::IS_SCALAR {
            self.simd.sub_f32s(c, self.simd.mul_f32s(a, b))
        } else {
            self.simd.negate_mul_add_e_f32s(a, b, c)
        }
    }
    #[inline(always)]
    fn any(self, m: S::m32s) -> bool {
        self.simd.first_true_m32s(m) != Self::N
    }
    #[inline(always)]
    fn mask(self, bits: u32) -> S::m32s {
        let lane = S::as_simd_u32s(&LANE_BITS[..Self::N]).0[0];
        self.simd.equal_u32s(self.simd.and_u32s(self.simd.splat_u32s(bits), lane), lane)
    }
    #[inline(always)]
    fn bits(self, m: S::m32s) -> u32 {
        if size_of::<S::m32s>() == 2 {
            // A mask register of AVX-512: it is the bits.
            return bytemuck::cast::<S::m32s, u16>(m) as u32;
        }
        let zero = self.simd.splat_u32s(0);
        let lane = S::as_simd_u32s(&LANE_BITS[..Self::N]).0[0];
        let mut lanes = [0; MAX_LANES];
        self.store_u(&mut lanes, self.simd.select_u32s(m, lane, zero));
        lanes.iter().fold(0, |bits, lane| bits | lane)
    }
    #[inline(always)]
    fn exp(self, x: S::f32s) -> S::f32s {
        // Cephes' polynomial on the remainder of x / ln 2; the integer part goes into the exponent
        // by the rounding trick: adding 1.5 2^23 leaves it in the low bits.
        let s = self.simd;
        let k = |x: f32| s.splat_f32s(x);
        let x = s.max_f32s(x, k(-87.0));
        let z = self.fma(x, k(std::f32::consts::LOG2_E), k(12_582_912.0));
        let n = s.sub_f32s(z, k(12_582_912.0));
        let r = self.fnma(n, k(0.693_359_4), x);
        let r = self.fma(n, k(2.121_944_4e-4), r);
        let mut p = k(1.987_569_1e-4);
        for c in [1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5] {
            p = self.fma(p, r, k(c));
        }
        let p = s.add_f32s(self.fma(s.mul_f32s(r, r), p, r), k(1.0));
        let exponent = s.wrapping_dyn_shl_u32s(s.transmute_u32s_f32s(z), s.splat_u32s(23));
        let scale = s.transmute_f32s_u32s(s.add_u32s(exponent, s.splat_u32s(127 << 23)));
        s.mul_f32s(p, scale)
    }
    #[inline(always)]
    fn sum(self, x: S::f32s) -> F {
        F::from_f64(self.simd.reduce_sum_f32s(x) as f64)
    }
}

const LANE_BITS: [u32; MAX_LANES] = {
    let mut bits = [0; MAX_LANES];
    let mut i = 0;
    while i < MAX_LANES {
        bits[i] = 1 << i;
        i += 1;
    }
    bits
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Instructions;

    struct Check;

    impl Job<f32> for Check {
        type Output = usize;

        fn run<L: Lanes<F = f32>>(self, l: L) -> usize {
            let mut out = [0.0; MAX_LANES];
            for step in 0..900 {
                let x: Vec<f32> =
                    (0..MAX_LANES).map(|i| -0.1 * step as f32 - 0.003 * i as f32).collect();
                l.store(&mut out, l.exp(l.load(&x)));
                for i in 0..L::N {
                    let exact = (x[i].max(-87.0) as f64).exp();
                    assert!((out[i] as f64 / exact - 1.0).abs() < 2e-7, "exp({})", x[i]);
                }
            }
            for bits in 0..1_u32 << L::N {
                assert_eq!(l.bits(l.mask(bits)), bits);
                assert_eq!(l.any(l.mask(bits)), bits != 0);
            }
            L::N
        }
    }

    #[test]
    fn every_instruction_set_computes_the_same() {
        let lanes: Vec<usize> = [Instructions::Best, Instructions::Avx2, Instructions::Scalar]
            .map(|i| dispatch(i.arch(), Check))
            .to_vec();
        assert!(lanes[0] >= lanes[1]);
    }
}
