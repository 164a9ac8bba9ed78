//! Layers as nodes of a graph.

use autodiff_lite::{Activation, Param};

use super::ToOnnx;
use super::graph::{OnnxGraph, OnnxValue};
use super::proto::Attribute;
use crate::{
    AdaptiveAvgPool2d, AvgPool2d, BatchNorm2d, Conv2d, ConvTranspose2d, Dropout, FrozenBatchNorm2d,
    GroupNorm, LayerNorm, Linear, MaxPool2d, Mlp, Norm, WeightNormLinear,
};

impl ToOnnx for Linear {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let shape = [self.weight.shape()[0], self.weight.shape()[1]];
        let bias = self.bias.as_ref().map(Param::as_slice);
        graph.linear(x, shape, self.weight.as_slice(), bias)
    }
}

impl ToOnnx for WeightNormLinear {
    type Output = OnnxValue;

    /// With the weight that length and direction come to.
    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let shape = [self.weight_v.shape()[0], self.weight_v.shape()[1]];
        let bias = self.bias.as_ref().map(Param::as_slice);
        graph.linear(x, shape, &self.folded(), bias)
    }
}

impl WeightNormLinear {
    /// The weight, `[out, in]`.
    pub(super) fn folded(&self) -> Vec<f32> {
        let tape = autodiff_lite::Tape::eval();
        let [v, g] = [&self.weight_v, &self.weight_g].map(|param| tape.param(param));
        crate::weight_norm(v, g).value().as_slice().to_vec()
    }
}

impl ToOnnx for Mlp {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let mut x = x.clone();
        for (i, layer) in self.layers.iter().enumerate() {
            x = graph.scope(&format!("layers/{i}"), |graph| {
                let y = layer.to_onnx(graph, &x);
                let last = i + 1 == self.layers.len();
                graph.activate(&y, if last { Activation::None } else { self.activation })
            });
        }
        x
    }
}

impl ToOnnx for Conv2d {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        graph.conv2d(x, &self.weight, self.bias.as_ref(), self.geometry)
    }
}

impl ToOnnx for ConvTranspose2d {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let Self { weight, bias, geometry, output_padding } = self;
        graph.conv_transpose2d(x, weight, bias.as_ref(), *geometry, *output_padding)
    }
}

/// Of images `[N, C, H, W]` or rows `[N, C]`, with running statistics.
fn batch_norm(graph: &mut OnnxGraph, x: &OnnxValue, params: [&Param; 4], eps: f64) -> OnnxValue {
    let names = ["weight", "bias", "running_mean", "running_var"];
    let params: Vec<String> = names
        .into_iter()
        .zip(params)
        .map(|(name, param)| graph.constant(name, param.shape(), param.as_slice()))
        .collect();
    let inputs: Vec<&str> = std::iter::once(&x.name).chain(&params).map(String::as_str).collect();
    graph.node("BatchNormalization", &inputs, vec![Attribute::float("epsilon", eps)], &x.shape)
}

impl ToOnnx for BatchNorm2d {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let Self { weight, bias, running_mean, running_var, eps, .. } = self;
        batch_norm(graph, x, [weight, bias, running_mean, running_var], *eps)
    }
}

impl ToOnnx for FrozenBatchNorm2d {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let Self { weight, bias, running_mean, running_var, eps } = self;
        batch_norm(graph, x, [weight, bias, running_mean, running_var], *eps)
    }
}

impl ToOnnx for Norm {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        match self {
            Self::Batch(norm) => norm.to_onnx(graph, x),
            Self::Frozen(norm) => norm.to_onnx(graph, x),
            Self::Group(norm) => norm.to_onnx(graph, x),
        }
    }
}

impl ToOnnx for GroupNorm {
    type Output = OnnxValue;

    /// An instance norm of the groups, then weight and bias of the channels.
    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let [c, h, w] = x.image();
        let groups = self.groups;
        let grouped = graph.reshape(x, &[groups, c / groups * h * w]);
        let one = graph.constant("one", &[groups], &vec![1.0; groups]);
        let zero = graph.constant("zero", &[groups], &vec![0.0; groups]);
        let normed = graph.node(
            "InstanceNormalization",
            &[&grouped.name, &one, &zero],
            vec![Attribute::float("epsilon", self.eps)],
            &grouped.shape,
        );
        let y = graph.reshape(&normed, &[c, h, w]);
        let y = graph.mul_constant(&y, "weight", &[c, 1, 1], self.weight.as_slice());
        graph.add_constant(&y, "bias", &[c, 1, 1], self.bias.as_slice())
    }
}

impl ToOnnx for LayerNorm {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let width = self.weight.shape();
        let weight = graph.constant("weight", width, self.weight.as_slice());
        let bias = graph.constant("bias", width, self.bias.as_slice());
        let attributes = vec![Attribute::last_axis(), Attribute::float("epsilon", self.eps)];
        graph.node("LayerNormalization", &[&x.name, &weight, &bias], attributes, &x.shape)
    }
}

impl ToOnnx for MaxPool2d {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        graph.max_pool2d(x, self.0)
    }
}

impl ToOnnx for AvgPool2d {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        graph.avg_pool2d(x, self.0)
    }
}

impl ToOnnx for AdaptiveAvgPool2d {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        graph.adaptive_avg_pool2d(x, self.height, self.width)
    }
}

impl ToOnnx for Dropout {
    type Output = OnnxValue;

    /// Nothing: it drops while training.
    fn to_onnx(&self, _: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        x.clone()
    }
}

/// A convolution and the norm behind it, under the names that both have.
pub(super) fn normed(
    graph: &mut OnnxGraph,
    x: &OnnxValue,
    (names, conv, norm): ([&str; 2], &Conv2d, &impl ToOnnx<Output = OnnxValue>),
    activation: Activation,
) -> OnnxValue {
    let y = graph.scope(names[0], |graph| conv.to_onnx(graph, x));
    graph.scope(names[1], |graph| {
        let y = norm.to_onnx(graph, &y);
        graph.activate(&y, activation)
    })
}
