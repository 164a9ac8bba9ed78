//! Matrix products on one core, either operand transposed.

use std::hint::black_box;

use autodiff_lite::kernels::gemm::Matrix;
use autodiff_lite::kernels::product::gemm;
use benches::{criterion, numbers, pool, yardsticks};
use criterion::Throughput;

fn main() {
    let mut criterion = criterion();
    yardsticks(&mut criterion, "gemm");
    let mut group = criterion.benchmark_group("gemm");
    for [m, k, n] in [[2466, 963, 192], [2562, 1024, 512], [1024, 1024, 1024]] {
        let (a, b) = (numbers(m * k, 1), numbers(k * n, 2));
        let mut c = vec![0.0; m * n];
        group.throughput(Throughput::Elements(2 * (m * k * n) as u64)); // flops
        for order in ["nn", "tn", "nt"] {
            let left = if order == "tn" { Matrix::transposed(&a, m) } else { Matrix::rows(&a, k) };
            let right = if order == "nt" { Matrix::transposed(&b, k) } else { Matrix::rows(&b, n) };
            group.bench_function(format!("{m}x{k}x{n}/{order}/1t"), |bencher| {
                pool(1).install(|| {
                    bencher.iter(|| {
                        gemm([m, k, n], 1.0, left, right, 0.0, black_box(&mut c));
                    });
                });
            });
        }
    }
    group.finish();
    criterion.final_summary();
}
