//! Residual networks against torchvision's own, on weights that both sides make by one rule
//! (`fixtures/make_resnet.py`).

use autodiff_lite::state::State;
use autodiff_lite::{Module, Param, Real, Tape, Tensor};
use ndarray::{Array4, ArrayD};
use nets::{Init, NormKind, ResNet, ResNetConfig, read_weights};

use crate::rule::{close, fixture, numbers, sums};

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
        param.value = ArrayD::from_shape_vec(shape, values).unwrap().into();
        k += 1;
    });
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
        close(&format!("{} {what}", self.name), found, expected, self.tolerance, scale);
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
        let expected = expected.as_slice();
        golden.close("map", &sums(channels_first(&map.value()).iter()), expected, expected[1]);
    }
    drop(tape.take_updates());
    tape.reset();

    let logits = net.forward(tape.constant(image));
    let found: Vec<f64> = logits.value().iter().map(|&x| Real::to_f64(x)).collect();
    golden.close("logits", &found, golden.array("logits").as_slice(), 1.0);
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
                golden.close(path, &found, golden.array(path).as_slice(), 1.0);
            }
        });
    }
}

fn narrow() -> ResNetConfig {
    ResNetConfig { width: 4, ..ResNetConfig::resnet18() }
}

fn deep() -> ResNetConfig {
    ResNetConfig { width: 2, inputs: 4, ..ResNetConfig::resnet50() }
}

#[test]
fn maps_logits_gradients_and_statistics_are_those_of_torchvision() {
    for config in [narrow(), narrow().frozen()] {
        check::<f64>("resnet18", config, 1e-11);
    }
    // Sixteen times over, the variances of eight pixels amplify rounding.
    for config in [deep(), deep().frozen()] {
        check::<f64>("resnet50", config, 1e-9);
    }
}

#[test]
fn single_precision_is_near() {
    check::<f32>("resnet18", narrow(), 5e-3);
    check::<f32>("resnet18", narrow().frozen(), 1e-3);
    check::<f32>("resnet50", deep().frozen(), 1e-3);
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
