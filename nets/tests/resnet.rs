//! Residual networks against torchvision's own, on weights that both sides make by one rule
//! (`fixtures/make_resnet.py`).
#![allow(clippy::unwrap_used, reason = "tests")]

use std::path::Path;

use autodiff_lite::state::State;
use autodiff_lite::{Module, Param, Real, Tape, Tensor};
use ndarray::{Array4, ArrayD};
use nets::{Init, NormKind, ResNet, ResNetConfig, read_weights};

fn fixture(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

/// Numbers in [-1, 1) for the k-th array.
fn numbers(k: u64, count: usize) -> Vec<f64> {
    let number = |i: usize| {
        let mut x = (i as u64 * 2_654_435_761 + (k + 1) * 40_503) & 0xFFFF_FFFF;
        x ^= x >> 15;
        x = x.wrapping_mul(2_246_822_519) & 0xFFFF_FFFF;
        x ^= x >> 13;
        x as f64 / 2.0_f64.powi(31) - 1.0
    };
    (0..count).map(number).collect()
}

/// Weights by the rule of `fill`.
fn fill<F: Real>(module: &mut impl Module<F>) {
    let mut k = 0;
    module.visit_mut("", &mut |path: &str, param: &mut Param<F>| {
        let shape = param.shape().to_vec();
        let fan: usize = shape[1..].iter().product();
        let value = |u: f64| match path {
            _ if path.ends_with("running_var") => 1.0 + u / 2.0,
            _ if shape.len() > 1 => u * (6.0 / fan as f64).sqrt(),
            _ if path.ends_with("weight") => 1.0 + u / 4.0,
            _ => u / 5.0,
        };
        let values: Vec<F> =
            numbers(k, param.len()).into_iter().map(|u| F::from_f64(value(u))).collect();
        param.value = ArrayD::from_shape_vec(shape, values).unwrap().into_shared();
        k += 1;
    });
}

/// The product with a wave and the sum of absolute values of numbers in PyTorch's order.
fn sums<'a, F: Real>(x: impl Iterator<Item = &'a F>) -> [f64; 2] {
    x.enumerate().fold([0.0; 2], |[wave, size], (i, &x)| {
        let x = Real::to_f64(x);
        [wave + x * (i as f64).cos(), size + x.abs()]
    })
}

/// The order of N, C, H, W of a features-last map.
fn channels_first<F: Real>(x: &Tensor<F>) -> ArrayD<F> {
    let order = x.view().permuted_axes(ndarray::IxDyn(&[0, 3, 1, 2]));
    order.as_standard_layout().into_owned()
}

struct Golden<'a> {
    all: &'a State,
    name: String,
    tolerance: f64,
}

impl Golden<'_> {
    fn array(&self, key: &str) -> Tensor<f64> {
        self.all.array(&format!("{}.{key}", self.name)).unwrap()
    }

    fn close(&self, what: &str, found: &[f64], expected: &[f64], scale: f64) {
        assert_eq!(found.len(), expected.len(), "{} {what}", self.name);
        for (f, e) in found.iter().zip(expected) {
            let error = (f - e).abs() / scale.max(1.0);
            assert!(error <= self.tolerance, "{} {what}: {f} instead of {e}", self.name);
        }
    }
}

fn check<F: Real>(name: &str, config: ResNetConfig, tolerance: f64) {
    let all = read_weights(fixture("resnet.pth")).unwrap();
    let mode = if config.norm == NormKind::Batch { "train" } else { "eval" };
    let golden = Golden { all: &all, name: format!("{name}.{mode}"), tolerance };
    let config = ResNetConfig { classes: Some(3), ..config };
    let mut net = ResNet::<F>::new(&Init::new(0), &config);
    fill(&mut net);
    let c = config.inputs;
    let pixels = numbers(1000, 2 * c * 37 * 44);
    let image = Array4::from_shape_fn((2, 37, 44, c), |(n, i, j, k)| {
        F::from_f64(pixels[((n * c + k) * 37 + i) * 44 + j])
    });
    let mut tape = Tape::<F>::train(0);
    let images = tape.constant(image.clone());
    for (k, map) in net.forward_maps(images).iter().enumerate() {
        let expected = golden.array(&format!("map{}", k + 1));
        let expected = expected.as_slice().unwrap();
        golden.close("map", &sums(channels_first(&map.value()).iter()), expected, expected[1]);
    }
    drop(tape.take_updates());
    tape.reset();

    let logits = net.forward(tape.constant(image));
    let found: Vec<f64> = logits.value().iter().map(|&x| Real::to_f64(x)).collect();
    golden.close("logits", &found, golden.array("logits").as_slice().unwrap(), 1.0);
    let seed = ArrayD::from_shape_fn(vec![2, 3], |i| F::from_f64(((3 * i[0] + i[1]) as f64).cos()));
    let gradients = logits.backward_with(seed);
    let expected = golden.array("grads");
    let mut rows = expected.rows().into_iter();
    net.visit("", &mut |path: &str, param: &Param<F>| {
        if path.contains("running_") {
            return;
        }
        let row = rows.next().unwrap().to_vec();
        if param.trainable {
            golden.close(path, &sums(gradients.of(param).unwrap().iter()), &row, row[1]);
        }
    });
    assert!(rows.next().is_none(), "{name} has fewer parameters");

    let updates = tape.take_updates();
    tape.reset();
    updates.apply(&mut net);
    if config.norm == NormKind::Batch {
        let last = &net.layer4.last().unwrap().bn2;
        last.visit("", &mut |path: &str, param: &Param<F>| {
            if path.contains("running_") {
                let found: Vec<f64> = param.as_slice().iter().map(|&x| Real::to_f64(x)).collect();
                golden.close(path, &found, golden.array(path).as_slice().unwrap(), 1.0);
            }
        });
    }
}

fn both<F: Real>(tolerance: f64) {
    let narrow = ResNetConfig { width: 4, ..ResNetConfig::resnet18() };
    let deep = ResNetConfig { width: 2, inputs: 4, ..ResNetConfig::resnet50() };
    for (name, config) in [("resnet18", narrow), ("resnet50", deep)] {
        check::<F>(name, config, tolerance);
        check::<F>(name, config.frozen(), tolerance);
    }
}

#[test]
fn maps_logits_gradients_and_statistics_are_those_of_torchvision() {
    both::<f64>(1e-11);
}

/// In the end a few pixels decide a channel's variance, which single precision shows.
#[test]
fn single_precision_is_near() {
    both::<f32>(5e-3);
}

#[test]
fn names_and_shapes_are_those_of_torchvision() {
    let text = std::fs::read_to_string(fixture("torchvision.txt")).unwrap();
    for (name, config) in
        [("resnet18", ResNetConfig::resnet18()), ("resnet50", ResNetConfig::resnet50())]
    {
        for config in [config, config.frozen()] {
            let config = ResNetConfig { classes: Some(1000), ..config };
            let net = ResNet::<f32>::new(&Init::new(0), &config);
            let mut found = Vec::new();
            net.visit("", &mut |path: &str, param: &Param| {
                let shape: Vec<_> = param.shape().iter().map(usize::to_string).collect();
                found.push(format!("{name} {path} {}", shape.join("x")));
            });
            let prefix = format!("{name} ");
            let expected: Vec<_> = text.lines().filter(|l| l.starts_with(&prefix)).collect();
            assert_eq!(found, expected);
        }
    }
}
