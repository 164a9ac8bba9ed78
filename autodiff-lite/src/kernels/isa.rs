//! Instruction sets as values: found at run time, forced by tests.

use std::sync::OnceLock;

use pulp::WithSimd;

/// An instruction set that the register-tiled kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// One number at a time: the fallback everywhere, and the twin that tests compare with.
    Scalar,
    /// 256-bit vectors with fused multiply-add.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// 512-bit vectors.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// The best of another architecture (NEON, for one).
    #[cfg(not(target_arch = "x86_64"))]
    Native,
}

impl Isa {
    /// The fastest instruction set of this machine.
    pub fn best() -> Self {
        static BEST: OnceLock<Isa> = OnceLock::new();
        *BEST.get_or_init(|| *Self::available().last().expect("scalar is always there"))
    }

    /// All that this machine can run, the slowest first.
    pub fn available() -> Vec<Self> {
        #[cfg(target_arch = "x86_64")]
        let all = [Self::Scalar, Self::Avx2, Self::Avx512];
        #[cfg(not(target_arch = "x86_64"))]
        let all = [Self::Scalar, Self::Native];
        all.into_iter().filter(|isa| isa.is_available()).collect()
    }

    /// Whether this machine can run it. Built with `--cfg scalar_kernels` it is one without vectors.
    pub fn is_available(self) -> bool {
        if cfg!(scalar_kernels) {
            return self == Self::Scalar;
        }
        match self {
            Self::Scalar => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => pulp::x86::V3::is_available(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => pulp::x86::V4::is_available(),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Native => true,
        }
    }

    /// Runs a kernel that is written for any vector width.
    ///
    /// # Panics
    /// If the machine lacks the instruction set.
    #[inline]
    pub fn run<K: WithSimd>(self, kernel: K) -> K::Output {
        match self {
            Self::Scalar => kernel.with_simd(pulp::Scalar),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                let v3 = pulp::x86::V3::try_new().expect("this machine has no AVX2");
                pulp::Simd::vectorize(v3, kernel)
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                let v4 = pulp::x86::V4::try_new().expect("this machine has no AVX-512");
                pulp::Simd::vectorize(v4, kernel)
            }
            #[cfg(not(target_arch = "x86_64"))]
            Self::Native => pulp::Arch::new().dispatch(kernel),
        }
    }

    /// [`run`](Self::run) without the question whether the machine has the instructions, which
    /// costs as much as a small tile.
    ///
    /// # Safety
    /// [`is_available`](Self::is_available).
    #[inline]
    pub(crate) unsafe fn run_unchecked<K: WithSimd>(self, kernel: K) -> K::Output {
        match self {
            Self::Scalar => kernel.with_simd(pulp::Scalar),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                // SAFETY: the caller's promise.
                pulp::Simd::vectorize(unsafe { pulp::x86::V3::new_unchecked() }, kernel)
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                // SAFETY: the caller's promise.
                pulp::Simd::vectorize(unsafe { pulp::x86::V4::new_unchecked() }, kernel)
            }
            #[cfg(not(target_arch = "x86_64"))]
            Self::Native => pulp::Arch::new().dispatch(kernel),
        }
    }

    /// Runs a kernel that is only for 32 registers.
    ///
    /// # Safety
    /// [`is_available`](Self::is_available).
    ///
    /// # Panics
    /// If this is not AVX-512.
    #[inline]
    pub(crate) unsafe fn run_wide<K: WithSimd>(self, kernel: K) -> K::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                // SAFETY: the caller's promise.
                pulp::Simd::vectorize(unsafe { pulp::x86::V4::new_unchecked() }, kernel)
            }
            _ => unreachable!("tiles this high are cut for AVX-512 alone"),
        }
    }
}
