//! Every path against a naive sum in `f64`, and against itself on other numbers of threads.
#![allow(clippy::unwrap_used, reason = "tests")]

use super::{Conv, ConvAlgorithm, ConvGeometry, ConvSizes, Operands, wide, winograd};
use crate::kernels::activation::Activation;
use crate::kernels::compiled::Compiled;
use crate::kernels::isa::Isa;

/// Reproducible numbers in [-1, 1] without structure that a wrong index could hide behind.
fn noise<F: Compiled>(len: usize, seed: u64) -> Vec<F> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        F::from((state >> 40) as f64 / (1u64 << 23) as f64 - 1.0).unwrap()
    };
    std::iter::repeat_with(next).take(len).collect()
}

/// Calls `f(output, input, weight)` with the indices of every product.
fn products(s: &ConvSizes, mut f: impl FnMut(usize, usize, usize)) {
    let ([h, w], [oh, ow], [kh, kw]) = (s.input, s.output, s.kernel);
    for (n, oy, ox) in triples(s.batch, oh, ow) {
        for (ky, kx) in (0..kh).flat_map(|ky| (0..kw).map(move |kx| (ky, kx))) {
            let y = (oy * s.stride[0] + ky * s.dilation[0]) as isize - s.padding[0] as isize;
            let x = (ox * s.stride[1] + kx * s.dilation[1]) as isize - s.padding[1] as isize;
            if y < 0 || x < 0 || y >= h as isize || x >= w as isize {
                continue;
            }
            for o in 0..s.out_channels {
                for i in 0..s.in_channels {
                    f(
                        ((n * oh + oy) * ow + ox) * s.out_channels + o,
                        ((n * h + y as usize) * w + x as usize) * s.in_channels + i,
                        ((o * s.in_channels + i) * kh + ky) * kw + kx,
                    );
                }
            }
        }
    }
}

fn triples(a: usize, b: usize, c: usize) -> impl Iterator<Item = (usize, usize, usize)> {
    (0..a).flat_map(move |i| (0..b).flat_map(move |j| (0..c).map(move |k| (i, j, k))))
}

fn close<F: Compiled>(found: &[F], expected: &[f64], tolerance: f64, what: &str) {
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        let f = f.to_f64().unwrap();
        assert!((f - e).abs() <= tolerance * (1.0 + e.abs()), "{what}[{i}]: {f} is not {e}");
    }
}

fn to_f64<F: Compiled>(x: &[F]) -> Vec<f64> {
    x.iter().map(|x| x.to_f64().unwrap()).collect()
}

/// Forward, both gradients, bias and activation of one shape on one instruction set.
fn check<F: Compiled>(s: ConvSizes, isa: Isa, algorithm: ConvAlgorithm, tolerance: f64) {
    let conv = Conv { sizes: s, algorithm, isa };
    let what = format!("{s:?} {isa:?} {algorithm:?}");
    let x = noise::<F>(s.input_len(), 1);
    let w = noise::<F>(s.weight_len(), 2);
    let g = noise::<F>(s.output_len(), 3);
    let bias = noise::<F>(s.out_channels, 4);
    let nan = F::nan();
    let scratch = |len: usize| vec![nan; len];

    let (xd, wd, gd, bd) = (to_f64(&x), to_f64(&w), to_f64(&g), to_f64(&bias));
    let mut y_expected: Vec<f64> = (0..s.output_len()).map(|i| bd[i % s.out_channels]).collect();
    let mut gx_expected = vec![0.0; s.input_len()];
    let mut gw_expected = vec![0.0; s.weight_len()];
    products(&s, |o, i, k| {
        y_expected[o] += xd[i] * wd[k];
        gx_expected[i] += gd[o] * wd[k];
        gw_expected[k] += gd[o] * xd[i];
    });
    for activation in
        [Activation::None, Activation::Relu, Activation::LeakyRelu(0.1), Activation::Sigmoid]
    {
        let expected: Vec<f64> = y_expected.iter().map(|&y| activation.apply(y)).collect();
        let mut y = vec![nan; s.output_len()];
        let mut memory = scratch(conv.forward_scratch::<F>());
        conv.forward(&x, &w, Some(&bias), activation, &mut y, &mut memory);
        close(&y, &expected, tolerance, &format!("y of {what}"));
    }
    let mut gx = vec![nan; s.input_len()];
    let mut memory = scratch(conv.grad_input_scratch::<F>());
    conv.grad_input(&g, &w, None, Activation::None, &mut gx, &mut memory);
    close(&gx, &gx_expected, tolerance, &format!("gx of {what}"));
    let mut gw = vec![nan; s.weight_len()];
    let mut memory = scratch(conv.grad_weight_scratch::<F>());
    conv.grad_weight(&x, &g, &mut gw, &mut memory);
    let terms = (s.output_len() / s.out_channels.max(1)).max(1) as f64;
    close(&gw, &gw_expected, tolerance * terms.sqrt(), &format!("gw of {what}"));
}

fn sizes(x: [usize; 4], w: [usize; 4], geometry: ConvGeometry) -> ConvSizes {
    ConvSizes::new(x, w, &geometry).unwrap()
}

fn odd_shapes() -> Vec<ConvSizes> {
    let g = ConvGeometry::new();
    vec![
        sizes([1, 1, 1, 1], [1, 1, 1, 1], g),
        sizes([2, 5, 7, 3], [4, 3, 3, 3], g.padding(1)),
        sizes([1, 9, 6, 17], [33, 17, 3, 3], g.padding(1)),
        sizes([2, 8, 9, 5], [20, 5, 3, 3], g.padding(1).stride(2)),
        sizes([1, 11, 13, 4], [7, 4, 5, 5], g.padding(2).stride(2)),
        sizes([1, 16, 15, 3], [64, 3, 7, 7], g.padding(3).stride(2)),
        sizes([1, 10, 12, 6], [5, 6, 3, 3], g.padding(2).dilation(2)),
        sizes([1, 12, 11, 2], [3, 2, 3, 3], g.padding(1).dilation(2).stride(3)),
        sizes([3, 6, 5, 18], [35, 18, 1, 1], g),
        sizes([1, 6, 5, 4], [9, 4, 1, 1], g.stride(2)),
        sizes([1, 7, 30, 16], [48, 16, 1, 3], ConvGeometry { padding: [0, 1], ..g }),
        sizes([1, 8, 8, 3], [3, 3, 2, 2], g.stride(2)),
        sizes([1, 5, 5, 2], [2, 2, 3, 3], g.padding(4)),
        sizes([1, 4, 9, 2], [2, 2, 4, 2], ConvGeometry { stride: [1, 3], padding: [2, 0], ..g }),
    ]
}

#[test]
fn direct_equals_the_sum_on_every_instruction_set() {
    for s in odd_shapes() {
        for isa in Isa::available() {
            check::<f32>(s, isa, ConvAlgorithm::Direct, 1e-4);
            check::<f64>(s, isa, ConvAlgorithm::Direct, 1e-12);
        }
    }
}

#[test]
fn winograd_equals_the_sum_on_every_instruction_set() {
    let g = ConvGeometry::new();
    for s in [
        sizes([2, 30, 29, 16], [32, 16, 3, 3], g.padding(1)),
        sizes([1, 34, 37, 32], [48, 32, 3, 3], g),
        sizes([1, 32, 32, 16], [16, 16, 3, 3], g.padding(2)),
    ] {
        assert!(winograd::pays(&s));
        for isa in Isa::available() {
            check::<f32>(s, isa, ConvAlgorithm::Auto, 3e-4);
        }
    }
}

#[test]
fn wide_winograd_equals_the_sum_on_every_instruction_set() {
    let g = ConvGeometry::new();
    let s = sizes([1, 14, 11, 320], [256, 320, 3, 3], g.padding(1));
    assert!(wide::pays(&s) && wide::grad_weight_pays(&s));
    for isa in Isa::available() {
        check::<f32>(s, isa, ConvAlgorithm::Auto, 2e-3);
    }
}

/// A pass from one side of a convolution to the other, and the gradient of its weight.
type Pass = fn(&ConvSizes, Isa, Operands<'_, f64>);
type WeightPass = fn(&ConvSizes, Isa, &[f64], &[f64], &mut [f64], &mut [f64]);

/// In `f64` the rounding of an algorithm is out of the way.
fn assert_exact(
    s: &ConvSizes,
    [forward, grad_input]: [Pass; 2],
    grad_weight: WeightPass,
    tolerance: f64,
) {
    for isa in Isa::available() {
        let (x, w) = (noise::<f64>(s.input_len(), 1), noise::<f64>(s.weight_len(), 2));
        let (g, bias) = (noise::<f64>(s.output_len(), 3), noise::<f64>(s.out_channels, 4));
        let direct = Conv { sizes: *s, algorithm: ConvAlgorithm::Direct, isa };
        let mut memory = vec![f64::NAN; 3 << 20];
        let relu = Activation::Relu;
        for bias in [None, Some(&bias[..])] {
            let (mut a, mut b) = (vec![0.0; s.output_len()], vec![f64::NAN; s.output_len()]);
            direct.forward(&x, &w, bias, relu, &mut a, &mut memory);
            let (to, scratch) = (&mut b[..], &mut memory[..]);
            forward(s, isa, Operands { from: &x, w: &w, bias, activation: relu, to, scratch });
            close(&b, &a, tolerance, "y");
        }
        let none = Activation::None;
        let (mut a, mut b) = (vec![0.0; s.input_len()], vec![f64::NAN; s.input_len()]);
        direct.grad_input(&g, &w, None, none, &mut a, &mut memory);
        let (to, scratch) = (&mut b[..], &mut memory[..]);
        grad_input(s, isa, Operands { from: &g, w: &w, bias: None, activation: none, to, scratch });
        close(&b, &a, tolerance, "gx");
        let (mut a, mut b) = (vec![0.0; s.weight_len()], vec![f64::NAN; s.weight_len()]);
        direct.grad_weight(&x, &g, &mut a, &mut memory);
        grad_weight(s, isa, &x, &g, &mut b, &mut memory);
        close(&b, &a, tolerance, "gw");
    }
}

/// One size has several blocks of tiles.
#[test]
fn wide_winograd_is_exact_but_for_rounding() {
    let g = ConvGeometry::new();
    for s in [
        sizes([2, 9, 7, 64], [128, 64, 3, 3], g.padding(1)),
        sizes([1, 61, 60, 128], [64, 128, 3, 3], g),
        sizes([1, 3, 3, 64], [64, 64, 3, 3], g.padding(2)),
    ] {
        assert!(wide::applies_to(&s));
        assert_exact(&s, [wide::forward, wide::grad_input], wide::grad_weight, 1e-11);
    }
}

#[test]
fn winograd_is_exact_but_for_rounding() {
    let g = ConvGeometry::new();
    for s in [
        sizes([1, 9, 7, 16], [32, 16, 3, 3], g.padding(1)),
        sizes([2, 6, 11, 48], [16, 48, 3, 3], g),
        sizes([1, 3, 3, 16], [16, 16, 3, 3], g.padding(2)),
    ] {
        assert!(winograd::applies(&s));
        assert_exact(&s, [winograd::forward, winograd::grad_input], winograd::grad_weight, 1e-12);
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let g = ConvGeometry::new().padding(1);
    for (algorithm, s) in [
        (ConvAlgorithm::Auto, sizes([2, 33, 35, 32], [48, 32, 3, 3], g)),
        (ConvAlgorithm::Auto, sizes([1, 13, 14, 256], [320, 256, 3, 3], g)),
        (ConvAlgorithm::Direct, sizes([2, 33, 35, 32], [48, 32, 3, 3], g)),
    ] {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let conv = Conv::new(s, algorithm);
                let x = noise::<f32>(s.input_len(), 1);
                let w = noise::<f32>(s.weight_len(), 2);
                let g = noise::<f32>(s.output_len(), 3);
                let mut memory = vec![f32::NAN; 1 << 21];
                let mut y = vec![0.0; s.output_len()];
                conv.forward(&x, &w, None, Activation::None, &mut y, &mut memory);
                let mut gx = vec![0.0; s.input_len()];
                conv.grad_input(&g, &w, None, Activation::None, &mut gx, &mut memory);
                let mut gw = vec![0.0; s.weight_len()];
                conv.grad_weight(&x, &g, &mut gw, &mut memory);
                (y, gx, gw)
            })
        };
        let one = run(1);
        assert_eq!(one, run(2));
        assert_eq!(one, run(3));
    }
}
