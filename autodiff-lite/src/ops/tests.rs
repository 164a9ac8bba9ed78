//! Properties that hold for all heavy operations alike.
#![allow(clippy::unwrap_used, reason = "tests")]

use ndarray::{ArrayD, IxDyn};
use proptest::prelude::*;

use crate::testkit::{self, Options};
use crate::{
    Activation, ConvGeometry, Padding, PoolGeometry, Real, SparseMatrix, Tape, Tensor, Var,
};

fn array<F: Real>(shape: &[usize], seed: usize) -> ArrayD<F> {
    let mut k = seed * 7919;
    ArrayD::from_shape_simple_fn(IxDyn(shape), || {
        k += 1;
        F::from_f64(((k * 2_654_435_761) % 1009) as f64 / 504.5 - 1.0)
    })
}

/// A small network through every heavy operation; returns its output and all gradients.
fn network<F: Real>() -> Vec<Tensor<F>> {
    let tape = Tape::<F>::train(0);
    let leaf = |shape: &[usize], seed| tape.leaf(array::<F>(shape, seed));
    let x = leaf(&[2, 36, 33, 16], 1);
    let (w, b) = (leaf(&[32, 16, 3, 3], 2), leaf(&[32], 3));
    let y = x.conv2d(w, Some(b), ConvGeometry::new().padding(1), Activation::LeakyRelu(0.1));
    let (gamma, beta) = (leaf(&[32], 4), leaf(&[32], 5));
    let (y, _) = y.batch_norm(gamma, beta, 1e-5, Activation::None);
    let y = y.group_norm(4, gamma, beta, 1e-5, Activation::Tanh);
    let pooled = y.max_pool2d(PoolGeometry::square(3).stride(2).padding(1));
    let up = pooled.resize_bilinear(30, 31, false);
    let points = leaf(&[2, 700, 2], 6);
    let sampled = up.bilinear_sample(points, Padding::Zeros, true);
    let entries: Vec<_> = (0..2100).map(|k| (k % 700, (k * 31) % 700, F::from_f64(0.3))).collect();
    let smooth = sampled.sparse_matmul(&SparseMatrix::from_triplets(700, 700, &entries).unwrap());
    let (v, c) = (leaf(&[192, 32], 7), leaf(&[192], 8));
    let wide = smooth.linear(v, Some(c), Activation::Relu);
    let (gamma, beta) = (leaf(&[192], 9), leaf(&[192], 10));
    let normal = wide.layer_norm(gamma, beta, 1e-5, Activation::None);
    let scores = normal.matmul_transposed(wide, [false, true]).softmax();
    let out = scores.matmul(normal);
    let gradients = out.backward_with(array::<F>(&out.shape(), 11));
    let leaves = [x, w, b, points, v, c, gamma, beta];
    let mut all = vec![out.value()];
    all.extend(leaves.iter().map(|&leaf| gradients.wrt(leaf).unwrap().clone()));
    all
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(network::<f32>)
    };
    let one = run(1);
    assert!(one.iter().all(|x| x.iter().all(|x| x.is_finite())));
    assert!(one == run(2));
    assert!(one == run(3));
}

#[test]
fn single_precision_follows_double() {
    for (k, (f, d)) in network::<f32>().iter().zip(network::<f64>()).enumerate() {
        let scale = d.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let error = f.iter().zip(&d).fold(0.0_f64, |m, (f, d)| m.max((*f as f64 - d).abs()));
        assert!(error <= 2e-3 * scale, "value {k}: {error:e} of {scale:e}");
    }
}

fn options() -> Options {
    Options { probes: 20, pieces: true, tolerance: 1e-6, ..Options::default() }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn gradients_of_products(
        m in 1usize..9, k in 1usize..9, n in 1usize..9, batch in 1usize..4,
        left in any::<bool>(), right in any::<bool>(),
    ) {
        let a = if left { vec![batch, k, m] } else { vec![batch, m, k] };
        let mut b = if right { vec![n, k] } else { vec![k, n] };
        let f = testkit::function(move |v: &[Var<'_, f64>]| v[0].matmul_transposed(v[1], [left, right]));
        testkit::assert_gradients(&f, &[a.clone(), b.clone()], &options());
        b.insert(0, batch);
        testkit::assert_gradients(&f, &[a, b], &options());
    }

    #[test]
    fn gradients_of_pooling_and_resizing(
        n in 1usize..3, h in 1usize..8, w in 1usize..8,
        c in prop::sample::select(vec![1usize, 3, 17]),
        kernel in 1usize..4, stride in 1usize..4, size in (1usize..9, 1usize..9),
        align in any::<bool>(),
    ) {
        let geometry = PoolGeometry::square(kernel).stride(stride).padding(kernel / 2);
        let shape = [vec![n, h, w, c]];
        let adaptive = testkit::function(move |v: &[Var<'_, f64>]| v[0].adaptive_avg_pool2d(size.0, size.1));
        testkit::assert_gradients(&adaptive, &shape, &options());
        let resize = testkit::function(move |v: &[Var<'_, f64>]| v[0].resize_bilinear(size.0, size.1, align));
        testkit::assert_gradients(&resize, &shape, &options());
        let windows = crate::kernels::pooling::Windows::new([n, h, w, c], &geometry);
        prop_assume!(windows.is_some());
        let mean = testkit::function(move |v: &[Var<'_, f64>]| v[0].avg_pool2d(geometry));
        testkit::assert_gradients(&mean, &shape, &options());
        let max = testkit::function(move |v: &[Var<'_, f64>]| v[0].max_pool2d(geometry));
        testkit::assert_gradients(&max, &shape, &options());
    }

    #[test]
    fn gradients_of_norms_and_samples(
        n in 1usize..3, h in 1usize..5, w in 1usize..5, groups in 1usize..4, width in 1usize..4,
        points in 1usize..6, border in any::<bool>(), align in any::<bool>(),
    ) {
        let c = groups * width;
        let shapes = [vec![n, h, w, c], vec![c], vec![c]];
        let none = Activation::None;
        let group = testkit::function(move |v: &[Var<'_, f64>]| v[0].group_norm(groups, v[1], v[2], 0.1, none));
        testkit::assert_gradients(&group, &shapes, &options());
        let layer = testkit::function(move |v: &[Var<'_, f64>]| v[0].layer_norm(v[1], v[2], 0.1, none));
        testkit::assert_gradients(&layer, &shapes, &options());
        let batch = testkit::function(move |v: &[Var<'_, f64>]| v[0].batch_norm(v[1], v[2], 0.1, none).0);
        testkit::assert_gradients(&batch, &shapes, &options());
        let padding = if border { Padding::Border } else { Padding::Zeros };
        let sample = testkit::function(move |v: &[Var<'_, f64>]| v[0].bilinear_sample(v[1], padding, align));
        let shapes = [vec![n, h, w, c], vec![n, points, 2]];
        testkit::assert_gradients(&sample, &shapes, &options());
    }
}
