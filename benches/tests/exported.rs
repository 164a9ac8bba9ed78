//! Everything that is exported in ONNX's form, run by rten: the numbers are those of the tape, within 1e-5 of their range.
//!
//! `ONNX_FOLDER=networks cargo test -p unsphere-benches --test exported` also writes each network there with inputs and the
//! tape's outputs, for `benches/peers/exported.py` to hold onnxruntime to.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "exported/networks.rs"]
mod networks;

use std::path::Path;

use ndarray::ArrayD;
use nets::onnx::OnnxModel;
use rten::{ModelOptions, Value};
use rten_tensor::Tensor;
use rten_tensor::prelude::*;

use networks::{Network, layers, systems};

/// Numbers from -1 to 1 that look like nothing; the same for the same place.
fn noise(shape: &[usize], salt: usize) -> ArrayD<f32> {
    let mut at = 0;
    ArrayD::from_shape_simple_fn(shape, || {
        at += 1;
        let turned = (at * 7919 + salt * 104_729) as f64;
        ((turned * 0.618_033_988_749).fract() * 2.0 - 1.0) as f32
    })
}

/// The outputs of a model by rten.
fn run(model: &OnnxModel, inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>> {
    let loaded = ModelOptions::with_all_ops().load(model.to_bytes()).unwrap();
    let given = model.inputs.iter().zip(inputs).map(|(value, input)| {
        let id = loaded.node_id(&value.name).unwrap();
        let (shape, values) = (input.shape(), input.iter().copied().collect::<Vec<_>>());
        (id, Tensor::from_data(shape, values).into())
    });
    let wanted: Vec<_> =
        model.outputs.iter().map(|value| loaded.node_id(&value.name).unwrap()).collect();
    let answers = loaded.run(given.collect(), &wanted, None).unwrap();
    let array = |answer: Value| {
        let tensor: Tensor<f32> = answer.try_into().unwrap();
        ArrayD::from_shape_vec(tensor.shape().to_vec(), tensor.to_vec()).unwrap()
    };
    answers.into_iter().map(array).collect()
}

/// The largest difference, as a share of the range of the expected numbers.
fn error(found: &ArrayD<f32>, expected: &ArrayD<f32>) -> f32 {
    assert_eq!(found.shape(), expected.shape());
    let range = expected.iter().fold(0.0_f32, |range, x| range.max(x.abs()));
    let both = found.iter().zip(expected);
    let difference = both.fold(0.0_f32, |most, (a, b)| most.max((a - b).abs()));
    assert!(range > 0.0 && range.is_finite() && difference.is_finite());
    difference / range
}

/// The worst share over batches of one and of three.
fn held(network: &Network) -> f32 {
    let mut worst = 0.0_f32;
    for batch in [1, 3] {
        let shaped = |(k, value): (usize, &nets::onnx::OnnxValue)| {
            let shape: Vec<usize> = std::iter::once(batch).chain(value.shape.clone()).collect();
            noise(&shape, 10 * batch + k)
        };
        let inputs: Vec<_> = network.model.inputs.iter().enumerate().map(shaped).collect();
        let expected = (network.tape)(&inputs);
        let found = run(&network.model, &inputs);
        assert_eq!(found.len(), expected.len(), "{}", network.name);
        for ((found, expected), value) in found.iter().zip(&expected).zip(&network.model.outputs) {
            let share = error(found, expected);
            assert!(share <= 1e-5, "{}, {}, batch {batch}: {share:e}", network.name, value.name);
            worst = worst.max(share);
        }
        if let Ok(folder) = std::env::var("ONNX_FOLDER") {
            write(Path::new(&folder), network, batch, [&inputs, &expected]);
        }
    }
    worst
}

/// The network, and what goes in and comes out: names and shapes as JSON, numbers as they lie in memory.
fn write(folder: &Path, network: &Network, batch: usize, arrays: [&Vec<ArrayD<f32>>; 2]) {
    let place = folder.join(format!("{}-{batch}", network.name));
    std::fs::create_dir_all(&place).unwrap();
    std::fs::write(place.join("model.onnx"), network.model.to_bytes()).unwrap();
    let mut listed = Vec::new();
    let values = [&network.model.inputs, &network.model.outputs];
    for (kind, (values, arrays)) in ["in", "out"].iter().zip(values.into_iter().zip(arrays)) {
        for (value, array) in values.iter().zip(arrays) {
            let file = format!("{kind}_{}.f32", value.name);
            let bytes: Vec<u8> = array.iter().flat_map(|x| x.to_le_bytes()).collect();
            std::fs::write(place.join(&file), bytes).unwrap();
            listed.push(serde_json::json!({
                "kind": kind, "name": value.name, "shape": array.shape(), "file": file,
            }));
        }
    }
    std::fs::write(place.join("arrays.json"), serde_json::to_vec(&listed).unwrap()).unwrap();
}

#[test]
fn layers_and_networks_give_the_numbers_of_the_tape() {
    for network in layers() {
        assert!(held(&network) <= 1e-5);
    }
}

#[test]
fn systems_give_the_numbers_of_the_tape() {
    for network in systems() {
        assert!(held(&network) <= 1e-5);
    }
}

/// The comparison can fail: a weight that is off by a thousandth shows.
#[test]
fn another_weight_shows() {
    let mut networks = layers();
    let (mut one, other) = (networks.swap_remove(0), networks.swap_remove(0));
    let inputs = vec![noise(&[1, one.model.inputs[0].shape[0]], 1)];
    let expected = (one.tape)(&inputs);
    one.tape = Box::new(move |_| expected.iter().map(|y| y.mapv(|y| 1.001 * y)).collect());
    let found = run(&one.model, &inputs);
    assert!(error(&found[0], &(one.tape)(&inputs)[0]) > 1e-4);
    drop(other);
}
