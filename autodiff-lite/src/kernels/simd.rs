//! Clones of slice loops for the instruction sets that are found at run time.
//!
//! The loops are written once, without intrinsics, in an `#[inline(always)]` body; the compiler
//! vectorises each clone for its instruction set. From the L2 cache upward plain loops are bound
//! by bandwidth whatever the width; the clones matter in L1, for `exp`, and for reductions.

/// Defines a function that runs `body` compiled for AVX-512, AVX2 or the baseline.
///
/// The body must be `#[inline(always)]`, and must not use `mul_add`, which without the hardware
/// instruction is a slow library call.
macro_rules! clones {
    ($(#[$meta:meta])* $vis:vis fn $name:ident[$($generics:tt)*]($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? = $body:path) => {
        $(#[$meta])*
        $vis fn $name<$($generics)*>($($arg: $ty),*) $(-> $ret)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma")]
                fn wide<$($generics)*>($($arg: $ty),*) $(-> $ret)? {
                    $body($($arg),*)
                }
                #[target_feature(enable = "avx2,fma")]
                fn medium<$($generics)*>($($arg: $ty),*) $(-> $ret)? {
                    $body($($arg),*)
                }
                match $crate::kernels::simd::level() {
                    // SAFETY: `level` found these features on this machine.
                    $crate::kernels::simd::Level::Avx512 => return unsafe { wide($($arg),*) },
                    // SAFETY: as above.
                    $crate::kernels::simd::Level::Avx2 => return unsafe { medium($($arg),*) },
                    $crate::kernels::simd::Level::Base => {}
                }
            }
            $body($($arg),*)
        }
    };
}
pub(crate) use clones;

/// Instruction sets that [`clones!`] distinguishes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(scalar_kernels, allow(dead_code, reason = "the baseline alone"))]
pub(crate) enum Level {
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg_attr(not(target_arch = "x86_64"), allow(dead_code, reason = "the only one there"))]
    Base,
}

/// The best level of this machine. The standard library caches the answer. Built with
/// `--cfg scalar_kernels`, as proofs are, it is the baseline.
#[inline]
#[cfg_attr(not(target_arch = "x86_64"), allow(dead_code, reason = "nothing to choose there"))]
pub(crate) fn level() -> Level {
    #[cfg(all(target_arch = "x86_64", not(scalar_kernels)))]
    {
        if std::is_x86_feature_detected!("avx512f")
            && std::is_x86_feature_detected!("avx512vl")
            && std::is_x86_feature_detected!("avx512dq")
            && std::is_x86_feature_detected!("avx512bw")
            && std::is_x86_feature_detected!("fma")
        {
            return Level::Avx512;
        }
        if std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma") {
            return Level::Avx2;
        }
    }
    Level::Base
}
