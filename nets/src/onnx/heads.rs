//! Heads as nodes of a graph.

use std::f64::consts::TAU;

use autodiff_lite::{Activation, Param};

use super::ToOnnx;
use super::graph::{OnnxGraph, OnnxValue};
use crate::heads::image_decoder::{BLOCKS, SLOPE};
use crate::heads::viewpoint_head::SIDE;
use crate::heads::voxel_head::name;
use crate::{
    ImageDecoder, PointMlp, PreactivatedBlock, ViewpointHead, VoxelHead, WeightNormLinear,
};

/// What a [`ViewpointHead`] says of images; see [`ViewpointGuess`](crate::ViewpointGuess).
#[derive(Clone, Debug)]
pub struct ViewpointOnnx {
    /// `[N, K]`.
    pub logits: OnnxValue,
    /// `[N, K]`, radians.
    pub turns: OnnxValue,
    /// `[N, 1]`, radians.
    pub elevation: OnnxValue,
    /// `[N, 1]`.
    pub log_distance: OnnxValue,
}

impl ToOnnx for ViewpointHead {
    type Output = ViewpointOnnx;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> ViewpointOnnx {
        let mut x = x.clone();
        loop {
            let [_, h, w] = x.image();
            if h.max(w) < SIDE || h.min(w) < 2 {
                break;
            }
            x = graph.adaptive_avg_pool2d(&x, h / 2, w / 2);
        }
        let made = graph.scope("encoder", |graph| self.encoder.to_onnx(graph, &x));
        let features = graph.activate(&made.features, Activation::Relu);
        let numbers = graph.scope("fc", |graph| self.fc.to_onnx(graph, &features));
        let k = self.hypotheses();
        let turns = graph.slice(&numbers, 0, k..2 * k);
        let turns = graph.activate(&turns, Activation::Tanh);
        ViewpointOnnx {
            logits: graph.slice(&numbers, 0, 0..k),
            turns: graph.scale(&turns, (TAU / k as f64) as f32),
            elevation: graph.slice(&numbers, 0, 2 * k..2 * k + 1),
            log_distance: graph.slice(&numbers, 0, 2 * k + 1..2 * k + 2),
        }
    }
}

impl ToOnnx for VoxelHead {
    type Output = OnnxValue;

    /// A map to logits `[N, V, V, V]`: row, column, step in depth, as on the tape.
    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let half = self.cells() / 2;
        let relu = Activation::Relu;
        let mut x = graph.resize_bilinear(x, half, half);
        for (k, conv) in self.voxel_fcns.iter().enumerate() {
            x = graph.scope(&name(k), |graph| {
                let y = conv.to_onnx(graph, &x);
                graph.activate(&y, relu)
            });
        }
        let y = graph.scope("deconv", |graph| self.deconv.to_onnx(graph, &x));
        let y = graph.activate(&y, relu);
        let y = graph.scope("predictor", |graph| self.predictor.to_onnx(graph, &y));
        // The steps in depth are channels.
        graph.permute(&y, &[1, 2, 0])
    }
}

impl ToOnnx for PreactivatedBlock {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let leaky = Activation::LeakyRelu(SLOPE);
        let active = graph.activate(x, leaky);
        let y = graph.scope("conv_0", |graph| self.conv_0.to_onnx(graph, &active));
        let y = graph.activate(&y, leaky);
        let y = graph.scope("conv_1", |graph| self.conv_1.to_onnx(graph, &y));
        let shortcut = match &self.conv_s {
            Some(conv) => graph.scope("conv_s", |graph| conv.to_onnx(graph, x)),
            None => x.clone(),
        };
        graph.add(&y, &shortcut)
    }
}

impl ToOnnx for ImageDecoder {
    type Output = OnnxValue;

    /// A map to an image `[N, outputs, H', W']` in (0, 1).
    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let mut x = x.clone();
        for ((name, .., step), block) in BLOCKS.iter().zip(&self.blocks) {
            if *step == 1 || (*step == 2 && self.six_steps) {
                let [_, h, w] = x.image();
                x = graph.resize_bilinear(&x, 2 * h, 2 * w);
            }
            x = graph.scope(name, |graph| block.to_onnx(graph, &x));
        }
        let active = graph.activate(&x, Activation::LeakyRelu(SLOPE));
        let y = graph.scope("conv_img", |graph| self.conv_img.to_onnx(graph, &active));
        graph.activate(&y, Activation::Sigmoid)
    }
}

impl PointMlp {
    /// Adds its nodes behind `code [N, D]` and `points [N, V, P]`: `[N, V, outputs]`.
    ///
    /// # Panics
    /// If the shapes are others.
    pub fn to_onnx(
        &self,
        graph: &mut OnnxGraph,
        code: &OnnxValue,
        points: &OnnxValue,
    ) -> OnnxValue {
        let mut h: Option<OnnxValue> = None;
        for (i, layer) in self.hidden.iter().enumerate() {
            h = Some(graph.scope(&format!("lin{i}"), |graph| match &h {
                Some(h) if self.skip != Some(i) => {
                    let y = layer.to_onnx(graph, h);
                    graph.activate(&y, Activation::Relu)
                }
                h => conditioned(graph, layer, h.as_ref(), code, points),
            }));
        }
        let h = h.expect("`new` wants a hidden layer");
        graph.scope(&format!("lin{}", self.hidden.len()), |graph| {
            let y = self.last.to_onnx(graph, &h);
            graph.activate(&y, self.activation)
        })
    }
}

/// `relu(W [h, code, point] + b)`, the part of the code once for each set of points.
fn conditioned(
    graph: &mut OnnxGraph,
    layer: &WeightNormLinear,
    h: Option<&OnnxValue>,
    code: &OnnxValue,
    points: &OnnxValue,
) -> OnnxValue {
    let (weight, all) = (layer.folded(), layer.weight_v.shape()[1]);
    let outputs = layer.weight_v.shape()[0];
    let before = h.map_or(0, |h| h.shape[1]);
    let middle = before + code.shape[0];
    let part = |from: usize, to: usize| -> Vec<f32> {
        weight.chunks(all).flat_map(|row| &row[from..to]).copied().collect()
    };
    let bias = layer.bias.as_ref().map(Param::as_slice);
    let of_code = graph.linear(code, [outputs, middle - before], &part(before, middle), bias);
    let of_code = graph.reshape(&of_code, &[1, outputs]);
    let of_points = graph.linear(points, [outputs, all - middle], &part(middle, all), None);
    let mut sum = graph.add(&of_points, &of_code);
    if let Some(h) = h {
        let of_h = graph.linear(h, [outputs, before], &part(0, before), None);
        sum = graph.add(&sum, &of_h);
    }
    graph.activate(&sum, Activation::Relu)
}
