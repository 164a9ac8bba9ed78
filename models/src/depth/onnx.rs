//! The image side in ONNX's form: the backbone, and the cells' logits where there are some.

use autodiff_lite::Tape;
use ndarray::{Array1, ArrayD};
use nets::onnx::{OnnxGraph, OnnxModel, OnnxValue, ToOnnx, channels_first, channels_last};

use super::encoder::{DEVIATION, Encoder, MEAN};
use super::mesh_init::MeshInit;
use super::refined::Refined;
use crate::stacked::numbers;

impl Encoder {
    /// Colours in `[0, 1]`, and the depth channel as it is, to the four maps, finest first.
    fn to_onnx(&self, graph: &mut OnnxGraph, image: &OnnxValue) -> [OnnxValue; 4] {
        let channels = image.shape[0];
        let image = graph.normalized(image, &MEAN[..channels], &DEVIATION[..channels]);
        self.resnet.to_onnx(graph, &image)
    }
}

impl<B: MeshInit> Refined<B> {
    /// Images `[N, 3 or 4, S, S]` to the four maps that vertices look at, and to `logits` of the cells. Nothing of a network that is
    /// shown no image.
    pub(super) fn image_side_to_onnx(&self) -> Option<OnnxModel> {
        if self.encoder.blind {
            return None;
        }
        let (side, channels) = (self.refine().pairs.image_size, self.encoder.channels());
        let mut graph = OnnxGraph::new(B::NAME);
        let image = graph.input("image", &[channels, side, side]);
        let maps = graph.scope("encoder", |graph| self.encoder.to_onnx(graph, &image));
        for (k, map) in maps.iter().enumerate() {
            graph.output(&format!("map_{k}"), map);
        }
        if let Some(head) = self.mesh_init.voxel_head() {
            let logits = graph.scope("voxels", |graph| head.to_onnx(graph, &maps[3]));
            graph.output("logits", &logits);
        }
        Some(graph.finish())
    }

    /// The same on the tape.
    pub(super) fn image_side(&self, inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>> {
        let tape = Tape::eval();
        let channels = self.encoder.channels();
        let array = |values: &[f32]| tape.constant(Array1::from(values[..channels].to_vec()));
        let images = tape.constant(channels_last(&inputs[0]));
        let maps = self.encoder.resnet.forward_maps((images - array(&MEAN)) / array(&DEVIATION));
        let mut outputs: Vec<_> =
            maps.into_iter().map(|map| channels_first(&numbers(map))).collect();
        let head = self.mesh_init.voxel_head();
        outputs.extend(head.map(|head| numbers(head.forward(maps[3]))));
        outputs
    }
}
