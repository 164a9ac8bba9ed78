//! The whole network in ONNX's form.

use autodiff_lite::{Activation, Tape};
use ndarray::ArrayD;
use nets::onnx::{OnnxGraph, OnnxModel, OnnxValue, ToOnnx, channels_first, channels_last};
use nets::{IMAGENET_DEVIATION, IMAGENET_MEAN};

use super::model::{LEAKY, Model, NormedLinear, Predicted, RowNorm};
use crate::stacked::numbers;
use crate::viewpoint::{viewpoint_outputs, viewpoint_to_onnx};

impl ToOnnx for NormedLinear {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let y = graph.scope("linear", |graph| self.linear.to_onnx(graph, x));
        let y = graph.scope("norm", |graph| match &self.norm {
            RowNorm::Batch(norm) => norm.to_onnx(graph, &y),
            RowNorm::Layer(norm) => norm.to_onnx(graph, &y),
        });
        graph.activate(&y, LEAKY)
    }
}

/// Two layers of a head.
fn head(
    graph: &mut OnnxGraph,
    x: &OnnxValue,
    name: &str,
    (first, last): (&NormedLinear, &nets::Linear),
) -> OnnxValue {
    let y = graph.scope(name, |graph| first.to_onnx(graph, x));
    graph.scope(&format!("{name}_out"), |graph| last.to_onnx(graph, &y))
}

impl Model {
    /// Images `[N, 3, S, S]` in `[0, 1]` to the shares of the mean shapes, positions, the camera, and the texture as the decoder puts it
    /// out (`[N, 3, H, W]`, before it is closed around the sphere).
    pub(super) fn to_onnx(&self, side: usize) -> OnnxModel {
        let mut graph = OnnxGraph::new("mcmr");
        let image = graph.input("image", &[3, side, side]);
        let map = graph.scope("encoder", |graph| {
            let image = graph.normalized(&image, &IMAGENET_MEAN, &IMAGENET_DEVIATION);
            let [.., last] = self.encoder.to_onnx(graph, &image);
            last
        });
        let map = graph.scope("enc_conv", |graph| self.enc_conv.to_onnx(graph, &map));
        let map = graph.scope("enc_norm", |graph| self.enc_norm.to_onnx(graph, &map));
        let map = graph.activate(&map, LEAKY);
        // The weights are in the order of features-last maps.
        let rows = graph.permute(&map, &[1, 2, 0]);
        let flat = graph.reshape(&rows, &[rows.shape.iter().product()]);
        let code = graph.scope("enc_fc", |graph| self.enc_fc.to_onnx(graph, &flat));
        graph.output("code", &code);
        let weights = self.selection_to_onnx(&mut graph, &code);
        self.shape_to_onnx(&mut graph, &code, &weights);
        self.camera_to_onnx(&mut graph, &code);
        let texture = graph.scope("texture", |graph| self.texture.to_onnx(graph, &map));
        graph.output("texture", &texture);
        if let Some(head) = &self.viewpoint {
            viewpoint_to_onnx(head, &mut graph, &image);
        }
        graph.finish()
    }

    /// The same on the tape.
    pub(super) fn onnx_outputs(&self, inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>> {
        let tape = Tape::eval();
        let images = tape.constant(channels_last(&inputs[0]));
        let map = self.map(images);
        let [b, h, w, c] = map.dims();
        let code = self.enc_fc.forward(map.reshape(&[b, h * w * c]));
        let Predicted { weights, positions, rotation, place, viewpoint, .. } =
            self.forward(&tape, images, None);
        let mut outputs = [code, weights, positions, rotation, place].map(numbers).to_vec();
        outputs.push(channels_first(&numbers(self.texture.forward(map))));
        outputs.extend(viewpoint.iter().flat_map(viewpoint_outputs));
        outputs
    }

    /// How much of each mean shape.
    fn selection_to_onnx(&self, graph: &mut OnnxGraph, code: &OnnxValue) -> OnnxValue {
        let logits = head(graph, code, "selection", (&self.selection, &self.selection_out));
        let logits = graph.scale(&logits, self.temperature.recip());
        let weights = graph.softmax(&logits);
        graph.output("weights", &weights);
        weights
    }

    fn shape_to_onnx(&self, graph: &mut OnnxGraph, code: &OnnxValue, weights: &OnnxValue) {
        let [shapes, vertices] = [0, 1].map(|axis| self.shapes.shape()[axis]);
        // `weights · shapes`, as a linear layer whose weight is `[3 V, shapes]`.
        let values = self.shapes.as_slice();
        let rows = 3 * vertices;
        let across: Vec<f32> =
            (0..rows * shapes).map(|at| values[(at % shapes) * rows + at / shapes]).collect();
        let mean =
            graph.scope("shapes", |graph| graph.linear(weights, [rows, shapes], &across, None));
        let mean = graph.reshape(&mean, &[vertices, 3]);
        let points = graph.scale(&mean, self.vertex_scale);
        let code = graph.concat(&[code, weights], 0);
        let offsets =
            graph.scope("deformation", |graph| self.deformation.to_onnx(graph, &code, &points));
        let positions = graph.add(&mean, &offsets);
        graph.output("positions", &positions);
    }

    /// A quaternion w, x, y, z of length 1, and scale and place in the image.
    fn camera_to_onnx(&self, graph: &mut OnnxGraph, code: &OnnxValue) {
        let camera = head(graph, code, "camera", (&self.camera, &self.camera_out));
        let raw = graph.slice(&camera, 0, 0..4);
        let raw = graph.activate(&raw, Activation::Tanh);
        let length = graph.norm(&raw, 0);
        let rotation = graph.div(&raw, &length);
        graph.output("rotation", &rotation);
        let place = graph.slice(&camera, 0, 4..7);
        let place = graph.add_constant(&place, "usual", &[3], &[self.first_size, 0.0, 0.0]);
        graph.output("place", &place);
    }
}
