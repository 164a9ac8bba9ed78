//! The network in ONNX's form, for a single view.

use autodiff_lite::{Activation, Tape};
use ndarray::ArrayD;
use nets::onnx::{OnnxGraph, OnnxModel, OnnxValue, ToOnnx, channels_first, channels_last};
use nets::{IMAGENET_DEVIATION, IMAGENET_MEAN};

use super::config::AttentionKind;
use super::encoder::Encoder;
use super::model::Model;
use crate::stacked::numbers;

/// Numbers that say how a view's camera stands.
const CAMERA: usize = 12;

impl Encoder {
    /// Maps where it has some, and the features; nothing of an encoder that sees nothing.
    fn to_onnx(
        &self,
        graph: &mut OnnxGraph,
        image: &OnnxValue,
    ) -> Option<(Vec<OnnxValue>, OnnxValue)> {
        if let Some(net) = &self.small {
            let made = graph.scope("small", |graph| net.to_onnx(graph, image));
            return Some((made.maps, made.features));
        }
        let image = if self.normalize {
            graph.normalized(image, &IMAGENET_MEAN, &IMAGENET_DEVIATION)
        } else {
            image.clone()
        };
        let features = match (&self.cnn, &self.vgg) {
            (Some(net), _) => graph.scope("cnn", |graph| net.to_onnx(graph, &image)),
            (_, Some(net)) => graph.scope("vgg", |graph| net.to_onnx(graph, &image)),
            _ => return None,
        };
        Some((Vec::new(), features))
    }
}

impl Model {
    /// Images `[N, 3, S, S]`, an object each, to their features; and to meshes, unless the objects of a batch attend to each other
    /// (`published`) or stages look at the maps again, which are put out then.
    pub(super) fn to_onnx(&self, side: usize) -> Option<OnnxModel> {
        let mut graph = OnnxGraph::new("img2mesh");
        let image = graph.input("image", &[3, side, side]);
        let (maps, features) =
            graph.scope("encoder", |graph| self.encoder.to_onnx(graph, &image))?;
        graph.output("features", &features);
        if !self.stages().is_empty() {
            for (k, map) in maps.iter().enumerate() {
                graph.output(&format!("map_{k}"), map);
            }
        } else if self.attention != AttentionKind::Published {
            let code = self.code_to_onnx(&mut graph, &features);
            self.mesh_to_onnx(&mut graph, &code);
        }
        Some(graph.finish())
    }

    /// The same on the tape.
    pub(super) fn onnx_outputs(&self, inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>> {
        let tape = Tape::eval();
        let images = tape.constant(channels_last(&inputs[0]));
        let n = images.shape()[0];
        let (maps, features) = self.encode_maps(images);
        let mut outputs = vec![numbers(features)];
        if !self.stages().is_empty() {
            outputs.extend(maps.into_iter().map(|map| channels_first(&numbers(map))));
        } else if self.attention != AttentionKind::Published {
            let cameras = inputs.get(1).cloned();
            let cameras = cameras.unwrap_or_else(|| ArrayD::zeros(vec![n, CAMERA]));
            let meshes = self.forward(n, features, tape.constant(cameras));
            outputs.extend([meshes.positions, meshes.colors].map(numbers));
        }
        outputs
    }

    /// What one view says of its object.
    fn code_to_onnx(&self, graph: &mut OnnxGraph, features: &OnnxValue) -> OnnxValue {
        let width = features.shape[0];
        let mut x = features.clone();
        if let Some(camera) = &self.camera {
            let numbers = graph.input("camera", &[CAMERA]);
            let embedded = graph.scope("camera_fc", |graph| camera.to_onnx(graph, &numbers));
            x = graph.add(&x, &embedded);
        }
        if self.attention == AttentionKind::Views {
            x = graph.reshape(&x, &[1, width]);
            for (i, layer) in self.layers.iter().enumerate() {
                x = graph.scope(&format!("layers/{i}"), |graph| layer.to_onnx(graph, &x));
            }
            x = graph.reshape(&x, &[width]);
        }
        let more = graph.scope("fc", |graph| {
            let y = self.fc.to_onnx(graph, &x);
            graph.activate(&y, Activation::Relu)
        });
        graph.add(&x, &more)
    }

    /// Positions in the frame of the network, and colours.
    fn mesh_to_onnx(&self, graph: &mut OnnxGraph, code: &OnnxValue) {
        let vertices = self.sphere.nrows();
        let scale = self.offset_scale;
        let (weight, bias) = self.mesh_fc.folded();
        let shape = [3 * vertices, code.shape[0]];
        let offsets =
            graph.scope("mesh_fc", |graph| graph.linear(code, shape, &weight, Some(&bias)));
        let offsets = graph.reshape(&offsets, &[vertices, 3]);
        let offsets = graph.scale(&offsets, scale);
        let sphere: Vec<f32> = self.sphere.iter().copied().collect();
        let raw = graph.add_constant(&offsets, "sphere", &[vertices, 3], &sphere);
        let (high, low) = (graph.max(&raw, 0), graph.min(&raw, 0));
        let sum = graph.add(&high, &low);
        let middle = graph.scale(&sum, 0.5);
        let place = graph.scope("mesh_pos_fc", |graph| self.mesh_pos_fc.to_onnx(graph, code));
        let place = graph.reshape(&place, &[1, 3]);
        let place = graph.scale(&place, scale);
        let shift = graph.sub(&place, &middle);
        let positions = graph.add(&raw, &shift);
        graph.output("positions", &positions);
        let colors = graph.scope("mesh_color_fc", |graph| self.mesh_color_fc.to_onnx(graph, code));
        let colors = graph.hard_sigmoid(&colors);
        let colors = graph.reshape(&colors, &[vertices, 3]);
        graph.output("colors", &colors);
    }
}
