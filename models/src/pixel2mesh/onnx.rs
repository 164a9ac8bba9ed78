//! The image side in ONNX's form: the encoder, and what estimates cameras.

use autodiff_lite::Tape;
use ndarray::ArrayD;
use nets::onnx::{OnnxGraph, OnnxModel, ToOnnx, channels_first, channels_last};

use super::deformer::Deformer;
use super::single_view::{SingleView, guess, maps};
use crate::stacked::numbers;
use crate::viewpoint::{viewpoint_outputs, viewpoint_to_onnx};

impl<D: Deformer> SingleView<D> {
    /// Images `[N, 3, S, S]` to the four maps that vertices look at, finest first, and to the camera's numbers where it is estimated.
    pub(super) fn image_side_to_onnx(&self) -> OnnxModel {
        let shared = self.shared();
        let side = shared.pairs.image_size;
        let mut graph = OnnxGraph::new(D::NAME);
        let image = graph.input("image", &[3, side, side]);
        let maps = graph.scope("encoder", |graph| self.encoder.to_onnx(graph, &image));
        let scale = shared.feature_scale as f32;
        for (k, map) in maps.iter().enumerate() {
            let map = if scale == 1.0 { map.clone() } else { graph.scale(map, scale) };
            graph.output(&format!("map_{k}"), &map);
        }
        if let Some(head) = &self.viewpoint {
            viewpoint_to_onnx(head, &mut graph, &image);
        }
        graph.finish()
    }

    /// The same on the tape.
    pub(super) fn image_side(&self, inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>> {
        let tape = Tape::eval();
        let images = tape.constant(channels_last(&inputs[0]));
        let scale = self.shared().feature_scale as f32;
        let maps = maps(&self.encoder, images).map(|map| map.scale(scale));
        let mut outputs: Vec<_> =
            maps.into_iter().map(|map| channels_first(&numbers(map))).collect();
        if let Some(head) = &self.viewpoint {
            outputs.extend(viewpoint_outputs(&guess(head, images)));
        }
        outputs
    }
}
