//! The networks of MCMR and of its evaluation against PyTorch and torchvision, on weights that both
//! sides make by one rule (`fixtures/make_mcmr.py`).

use std::collections::BTreeMap;

use autodiff_lite::state::State;
use autodiff_lite::{Gradients, Module, Param, Real, Tape};
use ndarray::{Array4, ArrayD};
use nets::{
    ImageDecoder, InceptionKind, InceptionV3, Init, MixedPool, PointMlp, PointMlpConfig,
    read_weights,
};

use crate::rule::{close, fixture, numbers, sums};

/// Weights by the rule of `fill`: arrays are numbered in the order of their names.
fn fill<F: Real>(module: &mut impl Module<F>) {
    let mut order = BTreeMap::new();
    module.visit("", &mut |path: &str, _: &Param<F>| {
        order.insert(path.to_owned(), 0);
    });
    order.values_mut().enumerate().for_each(|(k, at)| *at = k);
    module.visit_mut("", &mut |path: &str, param: &mut Param<F>| {
        let shape = param.shape().to_vec();
        let fan: usize = shape[1..].iter().product();
        let value = |u: f64| match shape.len() {
            _ if path.ends_with("running_var") => 1.0 + u / 2.0,
            _ if path.ends_with("weight_g") => 1.0 + u / 4.0,
            1 if path.ends_with("weight") => 1.0 + u / 4.0,
            1 => u / 5.0,
            _ => u * (6.0 / fan as f64).sqrt(),
        };
        let all = numbers(order[path], param.len());
        let all: Vec<F> = all.into_iter().map(|u| F::from_f64(value(u))).collect();
        param.value = ArrayD::from_shape_vec(shape, all).unwrap().into();
    });
}

fn golden(all: &State, name: &str) -> Vec<f64> {
    all.array::<f64>(name).unwrap_or_else(|| panic!("{name}")).iter().copied().collect()
}

fn check_gradients<F: Real>(
    all: &State,
    name: &str,
    module: &impl Module<F>,
    gradients: &Gradients<F>,
    tolerance: f64,
) {
    module.visit("", &mut |path: &str, param: &Param<F>| {
        let expected = golden(all, &format!("{name}.grads.{path}"));
        let found = sums(gradients.of(param).unwrap().iter());
        close(path, &found, &expected, tolerance, expected[1]);
    });
}

fn points<F: Real>(tolerance: f64) {
    let all = read_weights(fixture("mcmr.pth")).unwrap();
    let config =
        PointMlpConfig { hidden: vec![6, 4, 7, 5], dropout: 0.0, ..PointMlpConfig::published(5) };
    let mut net = PointMlp::<F>::new(&Init::new(0), &config);
    fill(&mut net);
    let tape = Tape::<F>::train(0);
    let array = |k: usize, shape: &[usize]| {
        let all = numbers(k, shape.iter().product()).into_iter().map(F::from_f64).collect();
        tape.leaf(ArrayD::from_shape_vec(shape, all).unwrap())
    };
    let (code, points) = (array(1000, &[2, 5]), array(1001, &[2, 9, 3]));
    let y = net.forward(code, points);
    let close = |what: &str, found: &[F]| {
        let found: Vec<_> = found.iter().map(|&x| Real::to_f64(x)).collect();
        close(what, &found, &golden(&all, &format!("points.{what}")), tolerance, 1.0);
    };
    close("output", y.value().as_slice());
    let mut k = -1.0;
    let seed = y.value().mapv(|_| {
        k += 1.0;
        F::from_f64(f64::cos(k))
    });
    let gradients = y.backward_with(seed);
    close("code", gradients.wrt(code).unwrap().as_slice());
    close("points", gradients.wrt(points).unwrap().as_slice());
    check_gradients(&all, "points", &net, &gradients, tolerance);
}

#[test]
fn points_under_weight_norm_are_those_of_pytorch() {
    points::<f64>(1e-12);
    points::<f32>(1e-5);
}

/// Position of a features-last pixel in PyTorch's order, `[C, H, W]`.
fn place(shape: &[usize], i: usize, j: usize, c: usize) -> usize {
    (c * shape[1] + i) * shape[2] + j
}

#[test]
fn images_from_maps_are_those_of_pytorch() {
    let all = read_weights(fixture("mcmr.pth")).unwrap();
    let mut net = ImageDecoder::<f64>::new(&Init::new(0), 1, 3);
    fill(&mut net);
    let tape = Tape::<f64>::train(0);
    let x = numbers(1002, 16);
    let y = net.forward(tape.constant(Array4::from_shape_fn((1, 1, 1, 16), |(.., c)| x[c])));
    let value = y.value();
    let shape = value.shape().to_vec();
    let pixels: Vec<_> =
        (0..3).flat_map(|c| (30..40).map(move |j| [0, 20, j, c])).map(|at| value[at]).collect();
    close("pixels", &pixels, &golden(&all, "image.pixels"), 1e-12, 1.0);
    let first = value.view().permuted_axes(ndarray::IxDyn(&[0, 3, 1, 2]));
    let expected = golden(&all, "image.output");
    close("output", &sums(first.iter()), &expected, 1e-12, expected[1]);
    let seed = ArrayD::from_shape_fn(shape.clone(), |at| {
        (place(&shape, at[1], at[2], at[3]) as f64).cos()
    });
    check_gradients(&all, "image", &net, &y.backward_with(seed), 1e-11);
}

#[test]
fn both_kinds_of_inception_are_those_of_torchvision() {
    let all = read_weights(fixture("mcmr.pth")).unwrap();
    let pixels = numbers(1003, 3 * 83 * 91);
    let mut net = InceptionV3::<f32>::new(&Init::new(0), InceptionKind::Fid);
    fill(&mut net);
    // The same weights in torchvision's form.
    let mut other = net.clone();
    for block in other.mixed.iter_mut().filter(|block| block.pool != MixedPool::HalvingMax) {
        block.pool = MixedPool::Mean;
    }
    for (name, net) in [("fid", net), ("torchvision", other)] {
        let tape = Tape::eval();
        let image = Array4::from_shape_fn((1, 83, 91, 3), |(_, i, j, c)| {
            pixels[(c * 83 + i) * 91 + j] as f32
        });
        let features = net.forward_features(tape.constant(image)).value();
        let found: Vec<_> = features.iter().step_by(16).map(|&x| f64::from(x)).collect();
        let expected = golden(&all, &format!("inception.{name}"));
        let scale = expected.iter().fold(0.0_f64, |s, x| s.max(x.abs()));
        close(name, &found, &expected, 1e-3 * scale.min(1.0), scale);
    }
}

#[test]
fn names_and_shapes_of_inception_are_those_of_torchvision() {
    let text = std::fs::read_to_string(fixture("torchvision.txt")).unwrap();
    let net = InceptionV3::<f32>::new(&Init::new(0), InceptionKind::Torchvision);
    let mut found = Vec::new();
    net.visit("", &mut |path: &str, param: &Param| {
        let shape: Vec<_> = param.shape().iter().map(usize::to_string).collect();
        found.push(format!("inception_v3 {path} {}", shape.join("x")));
    });
    let kept = |line: &&str| {
        line.starts_with("inception_v3 ") && !line.contains(" AuxLogits.") && !line.contains(" fc.")
    };
    let expected: Vec<_> = text.lines().filter(kept).collect();
    assert_eq!(found, expected);
}
