//! Attention and transformers as nodes of a graph.

use super::ToOnnx;
use super::graph::{OnnxGraph, OnnxValue};
use autodiff_lite::Activation;

use crate::{
    FeedForward, MultiHeadAttention, NormPlacement, TransformerEncoder, TransformerEncoderLayer,
};

impl ToOnnx for MultiHeadAttention {
    type Output = OnnxValue;

    /// Tokens `[N, T, D]` that attend to each other, without a mask.
    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let [tokens, width] = x.shape[..] else {
            panic!("[N, T, D] expected, found {:?}", x.shape)
        };
        let (weight, bias) = (self.in_proj_weight.as_slice(), self.in_proj_bias.as_slice());
        let packed =
            graph.scope("in_proj", |graph| graph.linear(x, [3 * width, width], weight, Some(bias)));
        let each = width / self.heads;
        // `[N, T, D]` to heads, each with its rows: `[N, heads, T, each]`, keys transposed.
        let mut part = |k: usize, order: [usize; 3]| {
            let part = graph.slice(&packed, 1, k * width..(k + 1) * width);
            let heads = graph.reshape(&part, &[tokens, self.heads, each]);
            graph.permute(&heads, &order)
        };
        let [q, k, v] = [part(0, [1, 0, 2]), part(1, [1, 2, 0]), part(2, [1, 0, 2])];
        let scores = graph.matmul(&q, &k);
        let scores = graph.scale(&scores, (each as f32).sqrt().recip());
        let shares = graph.softmax(&scores);
        let mixed = graph.matmul(&shares, &v);
        let mixed = graph.permute(&mixed, &[1, 0, 2]);
        let mixed = graph.reshape(&mixed, &[tokens, width]);
        graph.scope("out_proj", |graph| self.out_proj.to_onnx(graph, &mixed))
    }
}

impl TransformerEncoderLayer {
    fn hidden_to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let y = graph.scope("linear1", |graph| self.linear1.to_onnx(graph, x));
        let y = match self.feed_forward {
            FeedForward::Relu => graph.activate(&y, Activation::Relu),
            FeedForward::Gelu => graph.gelu(&y),
        };
        graph.scope("linear2", |graph| self.linear2.to_onnx(graph, &y))
    }
}

impl ToOnnx for TransformerEncoderLayer {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let attend = |graph: &mut OnnxGraph, x: &OnnxValue| {
            graph.scope("self_attn", |graph| self.self_attn.to_onnx(graph, x))
        };
        let norm1 = |graph: &mut OnnxGraph, x: &OnnxValue| {
            graph.scope("norm1", |graph| self.norm1.to_onnx(graph, x))
        };
        let norm2 = |graph: &mut OnnxGraph, x: &OnnxValue| {
            graph.scope("norm2", |graph| self.norm2.to_onnx(graph, x))
        };
        match self.norm {
            NormPlacement::Post => {
                let y = attend(graph, x);
                let sum = graph.add(x, &y);
                let x = norm1(graph, &sum);
                let y = self.hidden_to_onnx(graph, &x);
                let sum = graph.add(&x, &y);
                norm2(graph, &sum)
            }
            NormPlacement::Pre => {
                let y = norm1(graph, x);
                let y = attend(graph, &y);
                let x = graph.add(x, &y);
                let y = norm2(graph, &x);
                let y = self.hidden_to_onnx(graph, &y);
                graph.add(&x, &y)
            }
        }
    }
}

impl ToOnnx for TransformerEncoder {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let mut x = x.clone();
        for (i, layer) in self.layers.iter().enumerate() {
            x = graph.scope(&format!("layers/{i}"), |graph| layer.to_onnx(graph, &x));
        }
        match &self.norm {
            Some(norm) => graph.scope("norm", |graph| norm.to_onnx(graph, &x)),
            None => x,
        }
    }
}
