//! A guess among the outputs of a network in ONNX's form.

use autodiff_lite::Var;
use ndarray::ArrayD;
use nets::onnx::{OnnxGraph, OnnxValue, ToOnnx};
use nets::{ViewpointGuess, ViewpointHead};

use crate::stacked::numbers;

/// Adds a head on an image, and its guess to the outputs: `logits`, `turns`, `elevation`, `log_distance`.
pub(crate) fn viewpoint_to_onnx(head: &ViewpointHead, graph: &mut OnnxGraph, image: &OnnxValue) {
    let guess = graph.scope("viewpoint", |graph| head.to_onnx(graph, image));
    graph.output("logits", &guess.logits);
    graph.output("turns", &guess.turns);
    graph.output("elevation", &guess.elevation);
    graph.output("log_distance", &guess.log_distance);
}

/// The same outputs of a guess on the tape.
pub(crate) fn viewpoint_outputs(guess: &ViewpointGuess<'_>) -> [ArrayD<f32>; 4] {
    let column = |x: Var<'_>| numbers(x.reshape(&[x.shape()[0], 1]));
    let [elevation, log_distance] = [guess.elevation, guess.log_distance].map(column);
    [numbers(guess.logits), numbers(guess.turns), elevation, log_distance]
}
