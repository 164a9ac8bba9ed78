//! What a figure is measured by, in the same process: the peak of fused multiply-adds, and a reference that never changes.

use std::hint::black_box;

use autodiff_lite::kernels::isa::Isa;
use criterion::{Criterion, Throughput};
use pulp::{Simd, WithSimd};

/// Chains of multiply-adds that are in flight: enough to hide their latency on two ports, and not so many that they leave
/// the registers.
const CHAINS: usize = 12;

/// Rounds of all chains in one measurement: about a millisecond.
const ROUNDS: usize = 100_000;

/// Numbers that the reference goes through: 4 MiB, more than an L2 cache.
const NUMBERS: usize = 1 << 20;

/// Times the yardsticks, as `yardstick/<bench>/peak/1t` and `yardstick/<bench>/reference/1t`; first in each bench.
///
/// The peak is of one core: of 32-bit floating-point operations on registers alone, in the widest vectors that there are. The
/// reference, for work that has no count of operations, is plain code of this file, three passes over memory with a sort, a
/// square root and a sum: no change elsewhere makes it faster or slower.
pub fn yardsticks(criterion: &mut Criterion, bench: &str) {
    let mut group = criterion.benchmark_group(format!("yardstick/{bench}"));
    group.throughput(Throughput::Elements(Isa::best().run(Peak { rounds: 0 }).1));
    group.bench_function("peak/1t", |b| b.iter(|| Isa::best().run(Peak { rounds: ROUNDS })));
    let source = crate::numbers(NUMBERS, 1);
    let mut work = source.clone();
    group.throughput(Throughput::Elements(NUMBERS as u64));
    group.bench_function("reference/1t", |b| b.iter(|| reference(black_box(&source), &mut work)));
    group.finish();
}

fn reference(source: &[f32], work: &mut [f32]) -> f64 {
    work.copy_from_slice(source);
    for part in work.chunks_mut(4096) {
        part[..256].sort_unstable_by(f32::total_cmp);
    }
    for x in &mut *work {
        *x = (1.0 + *x * *x).sqrt();
    }
    work.iter().map(|&x| f64::from(x)).sum()
}

/// So many rounds of multiply-adds; gives a number that depends on all, and the operations of [`ROUNDS`].
struct Peak {
    rounds: usize,
}

impl WithSimd for Peak {
    type Output = (f32, u64);

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) -> (f32, u64) {
        let (x, y) = (s.splat_f32s(black_box(0.999)), s.splat_f32s(black_box(0.0011)));
        let mut chains = [s.splat_f32s(1.0); CHAINS];
        for _ in 0..self.rounds {
            for chain in &mut chains {
                *chain = s.mul_add_e_f32s(*chain, x, y);
            }
        }
        let sum = chains.into_iter().fold(s.splat_f32s(0.0), |sum, chain| s.add_f32s(sum, chain));
        (s.reduce_sum_f32s(sum), (2 * ROUNDS * CHAINS * S::F32_LANES) as u64)
    }
}
