//! Saving, loading, resuming.

use autodiff_lite::optim::{Adam, RmsProp, Sgd};
use autodiff_lite::state::{LoadError, Mismatch, State, load, save};
use autodiff_lite::{BufferUpdate, Param, Tape, Var, impl_module};
use ndarray::{Array1, Array2};
use proptest::prelude::*;

struct Layer {
    weight: Param,
    bias: Option<Param>,
    running_mean: Param,
}
impl_module!(Layer: f32 { weight, bias, running_mean });

struct Model {
    layers: Vec<Layer>,
    scale: Param,
}
impl_module!(Model: f32 { layers, scale });

impl Model {
    fn new() -> Self {
        let layer = |n: usize, bias: bool| Layer {
            weight: Param::new(Array2::from_shape_fn((n, 3), |(i, j)| ((i * 3 + j) as f32).sin())),
            bias: bias.then(|| Param::new(Array1::zeros(3))),
            running_mean: Param::buffer(Array1::zeros(3)),
        };
        Self { layers: vec![layer(3, true), layer(3, false)], scale: Param::new(Array1::ones(1)) }
    }

    fn loss<'t>(&self, tape: &'t Tape, step: u64) -> Var<'t> {
        let mut x = tape.constant(Array1::from_shape_fn(3, |k| (step as f32 + k as f32).cos()));
        for layer in &self.layers {
            let w = tape.param(&layer.weight);
            x = (w * x).sum_axis(0);
            if let Some(bias) = &layer.bias {
                x = x + tape.param(bias);
            }
            let mut seen = tape.buffer(3);
            seen.copy_from_slice(x.value().as_slice());
            tape.push_update(BufferUpdate::new(&layer.running_mean, seen, 0.1));
            x = x.tanh().dropout(0.2);
        }
        (x * tape.param(&self.scale) - 0.3).square().mean()
    }

    fn train(&mut self, adam: &mut Adam, steps: std::ops::Range<u64>) {
        let mut tape = Tape::train(0);
        for step in steps {
            tape.reseed(step);
            let gradients = self.loss(&tape, step).backward();
            let updates = tape.take_updates();
            tape.reset();
            updates.apply(self);
            adam.step(self, &gradients);
        }
    }

    fn bytes(&self, adam: &Adam) -> Vec<u8> {
        let mut state = State::new();
        state.add_module("", self);
        state.add_optimizer(adam);
        state.to_bytes()
    }
}

#[test]
fn a_resumed_run_is_the_same_bit_for_bit() {
    let (mut model, mut adam) = (Model::new(), Adam::new(0.01));
    model.train(&mut adam, 0..20);
    let whole = model.bytes(&adam);

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("step-000007.safetensors");
    let (mut model, mut adam) = (Model::new(), Adam::new(0.01));
    model.train(&mut adam, 0..7);
    let mut state = State::new();
    state.add_module("", &model);
    state.add_optimizer(&adam);
    state.metadata.insert("step".to_owned(), "7".to_owned());
    state.write(&path).unwrap();

    let state = State::read(&path).unwrap();
    let (mut model, mut adam) = (Model::new(), Adam::new(0.01));
    state.load_module("", &mut model).unwrap();
    state.load_optimizer(&mut adam).unwrap();
    model.train(&mut adam, state.metadata["step"].parse().unwrap()..20);
    assert!(model.bytes(&adam) == whole, "the resumed run differs");
    assert!(model.layers[0].running_mean.value.iter().any(|&x| x != 0.0));
}

/// Others may read it, as they may any file that the user makes.
#[test]
#[cfg(unix)]
fn a_file_has_the_usual_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let [ours, usual] = ["model.safetensors", "usual"].map(|name| folder.path().join(name));
    State::new().write(&ours).unwrap();
    std::fs::write(&usual, "").unwrap();
    let mode = |path| std::fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(ours), mode(usual));
}

#[test]
fn names_are_paths() {
    let mut state = State::new();
    let (mut model, mut adam) = (Model::new(), Adam::new(0.01));
    model.train(&mut adam, 0..1);
    state.add_module("encoder", &model);
    state.add_optimizer(&adam);
    let names: Vec<_> = state.names().collect();
    for name in [
        "encoder.layers.0.bias",
        "encoder.layers.1.running_mean",
        "encoder.scale",
        "optim.m.layers.0.weight",
        "optim.v.scale",
        "optim.t.scale",
    ] {
        assert!(names.contains(&name), "{name} is not in {names:?}");
    }
    assert!(!names.contains(&"optim.m.layers.1.running_mean"), "a buffer is not optimised");
}

#[test]
fn all_differences_are_reported_at_once() {
    let mut other = Model::new();
    other.layers[1].bias = Some(Param::new(Array1::zeros(3)));
    other.layers[0].bias = None;
    other.scale = Param::new(Array1::zeros(2));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    save(&path, &other).unwrap();
    let mut model = Model::new();
    let before = model.bytes(&Adam::new(0.1));
    let error = load(&path, &mut model).unwrap_err();
    let LoadError::Mismatch { mismatch, .. } = &error else { panic!("{error}") };
    assert_eq!(
        *mismatch,
        Mismatch {
            missing: vec!["layers.0.bias".to_owned()],
            unexpected: vec!["layers.1.bias".to_owned()],
            different: vec![("scale".to_owned(), "[1]".to_owned(), "[2]".to_owned())],
        }
    );
    let text = error.to_string();
    assert!(
        text.ends_with(
            "does not fit the model: missing layers.0.bias; unexpected layers.1.bias; scale is [2] instead of [1]"
        ),
        "{text}"
    );
    assert!(model.bytes(&Adam::new(0.1)) == before, "the module was changed");
}

#[test]
fn an_optimizer_of_another_kind_is_refused() {
    let mut model = Model::new();
    let mut state = State::new();
    let mut sgd = Sgd::<f32>::new(0.1);
    let gradients = model.loss(&Tape::train(0), 0).backward();
    sgd.step(&mut model, &gradients);
    state.add_optimizer(&sgd);
    let mut adam = Adam::<f32>::new(0.1);
    let mismatch = state.load_optimizer(&mut adam).unwrap_err();
    assert!(mismatch.missing.contains(&"optim.v.scale".to_owned()), "{mismatch}");
}

#[test]
fn moments_of_another_method_are_unexpected() {
    let mut x = [1.0_f32];
    let mut adam = Adam::<f32>::new(0.1);
    let mut rmsprop = RmsProp::<f32>::new(0.1);
    adam.update("x", &mut x, &[1.0]);
    rmsprop.update("x", &mut x, &[1.0]);
    let [mut of_adam, mut of_rmsprop] = [State::new(), State::new()];
    of_adam.add_optimizer(&adam);
    of_adam.insert("optim.average.x", &[1], &[1.0_f32]);
    of_rmsprop.add_optimizer(&rmsprop);
    let mismatch = of_adam.load_optimizer(&mut Sgd::<f32>::new(0.1)).unwrap_err();
    assert_eq!(mismatch.unexpected, ["optim.v.x"]);
    let mismatch = of_rmsprop.load_optimizer(&mut adam).unwrap_err();
    assert_eq!(mismatch.unexpected, ["optim.a.x"]);
    of_adam.load_optimizer(&mut Adam::<f32>::new(0.1)).unwrap();
    of_rmsprop.load_optimizer(&mut RmsProp::<f32>::new(0.1)).unwrap();
}

/// A second moment of 1e-10 would be 0 in half precision, and the next step infinite.
#[test]
fn moments_are_not_halved() {
    let mut adam = Adam::<f32>::new(0.1);
    adam.update("x", &mut [1.0], &[1e-4]);
    let mut state = State::new();
    state.add_optimizer(&adam);
    assert_eq!(state.clone().halved(), state);
}

#[test]
fn a_refused_write_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let error = save(folder.path().join("missing/model.safetensors"), &Model::new()).unwrap_err();
    assert!(error.to_string().contains("missing/model.safetensors"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn other_tools_can_read_the_file() {
    let mut state = State::new();
    state.add_module("", &Model::new());
    state.metadata.insert("note".to_owned(), "a \"quoted\" line\nand \\ another".to_owned());
    let bytes = state.to_bytes();
    // The reference implementation validates header, offsets and lengths.
    let tensors = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let weight = tensors.tensor("layers.0.weight").unwrap();
    assert_eq!(weight.shape(), [3, 3]);
    assert_eq!(weight.data()[4..8], 1.0_f32.sin().to_le_bytes());
    assert_eq!(State::from_bytes(&bytes).unwrap(), state);
}

#[test]
fn doubles_load_into_singles() {
    let mut state = State::new();
    state.add_module("", &Param::<f64>::new(Array1::from(vec![0.1, 0.2])));
    let mut param = Param::<f32>::new(Array1::zeros(2));
    state.load_module("", &mut param).unwrap();
    assert_eq!(param.as_slice(), [0.1, 0.2]);
}

#[test]
fn claims_of_terabytes_are_refused() {
    let header =
        r#"{"a":{"dtype":"F32","shape":[1000000000000],"data_offsets":[0,4000000000000]}}"#;
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.as_bytes());
    State::from_bytes(&bytes).unwrap_err();
    State::from_bytes(&u64::MAX.to_le_bytes()).unwrap_err();
    State::from_bytes(&[]).unwrap_err();
}

/// A file of one array of this type and shape, whose `bytes` of numbers are zero.
fn file(dtype: &str, shape: &[usize], bytes: usize) -> Vec<u8> {
    let shape = format!("{shape:?}");
    let header =
        format!(r#"{{"a":{{"dtype":"{dtype}","shape":{shape},"data_offsets":[0,{bytes}]}}}}"#);
    let mut file = (header.len() as u64).to_le_bytes().to_vec();
    file.extend(header.as_bytes());
    file.resize(file.len() + bytes, 0);
    file
}

/// No numbers at all, and yet more of them along the other axes than memory has addresses.
#[test]
fn shapes_that_no_array_has_are_refused() {
    for shape in [&[0, 1 << 62, 4][..], &[0, 1 << 61], &[1 << 61, 0], &[1 << 62, 4, 0]] {
        State::from_bytes(&file("F32", shape, 0)).unwrap_err();
    }
    let error = State::from_bytes(&file("F32", &[0, 1 << 62, 4], 0)).unwrap_err();
    assert!(error.starts_with("\"a\" has the shape [0, 46"), "{error}");
    let state = State::from_bytes(&file("F32", &[0, 1 << 40], 0)).unwrap();
    assert_eq!(state.array::<f32>("a").unwrap().shape(), [0, 1 << 40]);
}

#[test]
#[should_panic(expected = "a: shape and numbers")]
fn shapes_whose_product_wraps_are_not_inserted() {
    State::new().insert::<f32>("a", &[1 << 32, 1 << 32], &[]);
}

/// Moments are as long as what is there, not as a shape says.
#[test]
fn a_claim_about_moments_takes_no_memory() {
    let mut adam = Adam::<f32>::new(0.1);
    let count = State::from_bytes(&file("U64", &[], 8)).unwrap();
    let mut state = count.renamed(|_| "optim.t.weight".to_owned()).unwrap();
    state.insert_other("optim.m.weight", &[1 << 62, 2], "I8");
    let mismatch = state.load_optimizer(&mut adam).unwrap_err();
    assert!(mismatch.to_string().contains("optim.m.weight"), "{mismatch}");
}

proptest! {
    #[test]
    fn any_bytes_are_an_error_or_a_state(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        let _ = State::from_bytes(&bytes);
    }

    #[test]
    fn a_damaged_file_never_panics(at in any::<proptest::sample::Index>(), value in any::<u8>(), cut in any::<proptest::sample::Index>()) {
        let mut state = State::new();
        state.add_module("", &Model::new());
        state.metadata.insert("step".to_owned(), "1".to_owned());
        let mut bytes = state.to_bytes();
        let place = at.index(bytes.len());
        bytes[place] = value;
        if let Ok(state) = State::from_bytes(&bytes) {
            let _ = state.load_module("", &mut Model::new());
            let _ = state.load_optimizer(&mut Adam::<f32>::new(0.1));
        }
        bytes.truncate(cut.index(bytes.len()));
        prop_assert!(State::from_bytes(&bytes).is_err());
    }
}
