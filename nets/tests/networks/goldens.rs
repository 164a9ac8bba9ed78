//! Outputs and gradients of PyTorch's layers, on the same weights.

use autodiff_lite::state::State;
use autodiff_lite::{
    Activation, ConvGeometry, Module, Param, PoolGeometry, Real, Tape, Tensor, Var, impl_module,
};
use ndarray::{ArrayD, ArrayViewD, IxDyn};
use nets::{
    BatchNorm2d, Conv2d, ConvTranspose2d, FeedForward, GroupNorm, Indexed, Init, Linear,
    LoadWeights, MultiHeadAttention, NormPlacement, TransformerConfig, TransformerEncoderLayer,
    read_weights,
};

/// The goldens whose names begin so.
struct Golden<'a> {
    all: &'a State,
    name: &'static str,
}

impl Golden<'_> {
    fn array(&self, key: &str) -> Tensor<f64> {
        let name = format!("{}.{key}", self.name);
        self.all.array(&name).unwrap_or_else(|| panic!("{name} is missing"))
    }

    fn load<F: Real>(&self, module: &mut impl Module<F>) {
        let mut state = State::new();
        let prefix = format!("{}.weights.", self.name);
        for name in self.all.names() {
            if let Some(path) = name.strip_prefix(&prefix) {
                let array: Tensor<f64> = self.all.array(name).unwrap();
                state.insert(path, array.shape(), array.as_slice());
            }
        }
        LoadWeights::lenient().load_state(state.clone(), module).unwrap();
        let missing = state.compare_module("", module);
        let statistics = |name: &String| name.contains("running_");
        assert!(
            missing.missing.iter().all(statistics) && missing.unexpected.is_empty(),
            "{missing}"
        );
    }

    /// Runs `forward` on the golden inputs and compares output and all gradients.
    fn check<F: Real, M: Module<F>>(
        &self,
        module: &M,
        inputs: &[&str],
        tolerance: f64,
        forward: impl for<'t> Fn(&M, &[Var<'t, F>]) -> Var<'t, F>,
    ) {
        let tape = Tape::<F>::train(0);
        let leaf =
            |key: &&str| tape.leaf(cast::<F>(&last(self.array(&format!("input.{key}")).view())));
        let vars: Vec<_> = inputs.iter().map(leaf).collect();
        let y = forward(module, &vars);
        let expected = last(self.array("output").view());
        self.close("output", &y.value().view(), &expected, tolerance);
        // The seed is a function of the index in PyTorch's layout.
        let golden = self.array("output");
        let mut k = -1.0;
        let seed = golden.mapv(|_| {
            k += 1.0;
            f64::cos(k)
        });
        let gradients = y.backward_with(cast::<F>(&last(seed.view())));
        for (key, &var) in inputs.iter().zip(&vars) {
            let expected = last(self.array(&format!("grad_input.{key}")).view());
            self.close(key, &gradients.wrt(var).unwrap().view(), &expected, tolerance);
        }
        module.visit("", &mut |path: &str, param: &Param<F>| {
            if param.trainable {
                let expected = self.array(&format!("grads.{path}")).into_owned();
                let found = gradients.of(param).unwrap().view();
                self.close(path, &found, &expected, tolerance);
            }
        });
    }

    fn close<F: Real>(
        &self,
        what: &str,
        found: &ArrayViewD<'_, F>,
        expected: &ArrayD<f64>,
        tolerance: f64,
    ) {
        assert_eq!(found.shape(), expected.shape(), "{}: {what}", self.name);
        let scale = expected.iter().fold(1.0_f64, |s, x| s.max(x.abs()));
        for (f, e) in found.iter().zip(expected) {
            let error = (Real::to_f64(*f) - e).abs();
            assert!(error <= tolerance * scale, "{}: {what}: {f} instead of {e}", self.name);
        }
    }
}

/// Channels last.
fn last(x: ArrayViewD<'_, f64>) -> ArrayD<f64> {
    match x.ndim() {
        4 => x.permuted_axes(IxDyn(&[0, 2, 3, 1])).as_standard_layout().into_owned(),
        _ => x.into_owned(),
    }
}

fn cast<F: Real>(x: &ArrayD<f64>) -> ArrayD<F> {
    x.mapv(F::from_f64)
}

fn goldens() -> State {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    read_weights(folder.join("goldens.pth")).unwrap()
}

fn attention<F: Real>(tolerance: f64) {
    let all = goldens();
    let init = Init::new(0);
    let mask: Tensor<F> = all.array("mask").unwrap();
    let mut module = MultiHeadAttention::<F>::new(&init, 8, 2);
    let golden = Golden { all: &all, name: "attention" };
    golden.load(&mut module);
    golden.check(&module, &["x"], tolerance, |m, v| m.forward(v[0], Some(&mask)));
    let golden = Golden { all: &all, name: "cross" };
    golden.load(&mut module);
    golden.check(&module, &["queries", "memory"], tolerance, |m, v| m.cross(v[0], v[1], None));
    for (name, norm, feed_forward) in [
        ("post", NormPlacement::Post, FeedForward::Relu),
        ("pre", NormPlacement::Pre, FeedForward::Gelu),
    ] {
        let config =
            TransformerConfig { width: 8, heads: 2, hidden: 12, dropout: 0.0, norm, feed_forward };
        let mut layer = TransformerEncoderLayer::<F>::new(&init, &config);
        let golden = Golden { all: &all, name };
        golden.load(&mut layer);
        golden.check(&layer, &["x"], tolerance, |m, v| m.forward(v[0], None));
    }
}

#[test]
fn attention_and_encoder_layers_are_those_of_pytorch() {
    attention::<f64>(1e-12);
    attention::<f32>(2e-6);
}

/// VGG16 in small: convolutions, pools, a grid of means, PyTorch's order of channels.
struct Vgg<F: Real> {
    features: Indexed<Conv2d<F>>,
    classifier: Indexed<Linear<F>>,
}
impl_module!(Vgg { features, classifier });

fn vgg<F: Real>(tolerance: f64) {
    let all = goldens();
    let (init, same) = (Init::new(0), ConvGeometry::new().padding(1));
    let conv = |at, i, o| (at, Conv2d::new(&init, i, o, 3, same));
    let mut vgg = Vgg::<F> {
        features: Indexed(vec![conv(0, 3, 4), conv(2, 4, 4), conv(5, 4, 6)]),
        classifier: Indexed(vec![(0, Linear::new(&init, 24, 5)), (3, Linear::new(&init, 5, 3))]),
    };
    let golden = Golden { all: &all, name: "vgg" };
    golden.load(&mut vgg);
    golden.check(&vgg, &["x"], tolerance, |m, v| {
        let (relu, two) = (Activation::Relu, PoolGeometry::square(2));
        let f: Vec<_> = m.features.iter().collect();
        let x = f[1].forward_then(f[0].forward_then(v[0], relu), relu).max_pool2d(two);
        let x = f[2].forward_then(x, relu).max_pool2d(two).adaptive_avg_pool2d(2, 2);
        let x = x.permute(&[0, 3, 1, 2]).reshape(&[2, 24]);
        let c: Vec<_> = m.classifier.iter().collect();
        c[1].forward(c[0].forward_then(x, relu))
    });
    let geometry = ConvGeometry::new().stride(2).padding(1);
    let mut transposed = ConvTranspose2d::<F>::new(&init, 3, 4, 3, geometry);
    transposed.output_padding = 1;
    let golden = Golden { all: &all, name: "transposed" };
    golden.load(&mut transposed);
    golden.check(&transposed, &["x"], tolerance, |m, v| m.forward(v[0]));
}

#[test]
fn convolutional_networks_are_those_of_pytorch() {
    vgg::<f64>(1e-12);
    vgg::<f32>(5e-6);
}

#[test]
fn norms_and_their_statistics_are_those_of_pytorch() {
    let all = goldens();
    let init = Init::new(0);
    let mut norms = (GroupNorm::<f64>::new(&init, 2, 4), BatchNorm2d::<f64>::new(&init, 4));
    let golden = Golden { all: &all, name: "norms" };
    golden.load(&mut norms);
    golden.check(&norms, &["x"], 1e-12, |m, v| m.1.forward(m.0.forward(v[0])));
    let mut tape = Tape::train(0);
    let x = tape.constant(last(golden.array("input.x").view()));
    let _ = norms.1.forward(norms.0.forward(x));
    let updates = tape.take_updates();
    tape.reset();
    updates.apply(&mut norms);
    golden.close(
        "mean",
        &norms.1.running_mean.value.view(),
        &golden.array("running_mean").into_owned(),
        1e-12,
    );
    golden.close(
        "variance",
        &norms.1.running_var.value.view(),
        &golden.array("running_var").into_owned(),
        1e-12,
    );
}
