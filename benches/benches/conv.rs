//! 3x3 convolutions: the output, and the gradients of input, weight and bias.

use std::hint::black_box;

use autodiff_lite::kernels::activation::Activation;
use autodiff_lite::kernels::columns::column_sums;
use autodiff_lite::kernels::conv::{Conv, ConvAlgorithm, ConvGeometry, ConvSizes};
use benches::{criterion, numbers, pool, yardsticks};
use criterion::Throughput;

fn main() {
    let mut criterion = criterion();
    yardsticks(&mut criterion, "conv2d");
    let mut group = criterion.benchmark_group("conv2d");
    for [batch, side, cin, cout] in [[8, 56, 64, 64], [8, 28, 128, 128]] {
        let geometry = ConvGeometry::new().padding(1);
        let sizes = ConvSizes::new([batch, side, side, cin], [cout, cin, 3, 3], &geometry)
            .expect("the window fits");
        let conv = Conv::new(sizes, ConvAlgorithm::Auto);
        let x = numbers(sizes.input_len(), 1);
        let w = numbers(sizes.weight_len(), 2);
        let bias = numbers(cout, 3);
        let gy = numbers(sizes.output_len(), 4);
        let mut y = vec![0.0; sizes.output_len()];
        let (mut gx, mut gw, mut gb) = (vec![0.0; x.len()], vec![0.0; w.len()], vec![0.0; cout]);
        let scratch = conv
            .forward_scratch::<f32>()
            .max(conv.grad_input_scratch::<f32>())
            .max(conv.grad_weight_scratch::<f32>());
        let mut scratch = vec![0.0; scratch];
        let pool = pool(2);

        let forward = |y: &mut [f32], scratch: &mut [f32]| {
            conv.forward(&x, &w, Some(&bias), Activation::None, y, scratch);
        };

        group.throughput(Throughput::Elements(sizes.flops() as u64));
        let shape = format!("{batch}x{side}x{side}x{cin}-{cout}");
        group.bench_function(format!("{shape}/forward/2t"), |bencher| {
            pool.install(|| {
                bencher.iter(|| {
                    forward(black_box(&mut y), &mut scratch);
                });
            });
        });
        group.throughput(Throughput::Elements(3 * sizes.flops() as u64));
        group.bench_function(format!("{shape}/forward-backward/2t"), |bencher| {
            pool.install(|| {
                bencher.iter(|| {
                    forward(black_box(&mut y), &mut scratch);
                    conv.grad_input(
                        &gy,
                        &w,
                        None,
                        Activation::None,
                        black_box(&mut gx),
                        &mut scratch,
                    );
                    conv.grad_weight(&x, &gy, black_box(&mut gw), &mut scratch);
                    column_sums(&gy, black_box(&mut gb));
                });
            });
        });
    }
    group.finish();
    criterion.final_summary();
}
