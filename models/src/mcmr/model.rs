//! The network.

use autodiff_lite::{
    Activation, ConvGeometry, Module, Param, Tape, Var, Visitor, VisitorMut, impl_module,
};
use ndarray::Array1;
use nets::{
    BatchNorm1d, Conv2d, Dropout, ImageDecoder, Init, LayerNorm, Linear, Norm, NormKind, PointMlp,
    PointMlpConfig, ResNet, ResNetConfig, ViewpointGuess, ViewpointHead, imagenet_normalized,
};

use super::config::{CameraHead, McmrConfig};
use super::shapes::{self, Template};
use super::texture::closed;
use crate::viewpoint::DIRECTIONS;

/// Slope of negative numbers, as published.
const SLOPE: f32 = 0.2;
pub(super) const LEAKY: Activation = Activation::LeakyRelu(SLOPE as f64);

/// A linear layer, a norm, leaky ReLU.
#[derive(Clone, Debug)]
pub(super) struct NormedLinear {
    pub(super) linear: Linear,
    pub(super) norm: RowNorm,
}
impl_module!(NormedLinear: f32 { linear, norm });

/// The norm behind a linear layer.
#[derive(Clone, Debug)]
pub(super) enum RowNorm {
    /// Statistics of the batch while training.
    Batch(Box<BatchNorm1d>),
    /// Statistics of each row.
    Layer(Box<LayerNorm>),
}

impl Module<f32> for RowNorm {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<f32>) {
        match self {
            Self::Batch(norm) => norm.visit(path, visitor),
            Self::Layer(norm) => norm.visit(path, visitor),
        }
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<f32>) {
        match self {
            Self::Batch(norm) => norm.visit_mut(path, visitor),
            Self::Layer(norm) => norm.visit_mut(path, visitor),
        }
    }
}

impl NormedLinear {
    fn new(init: &Init, [inputs, outputs]: [usize; 2], kind: NormKind) -> Self {
        let norm = init.at("norm");
        Self {
            linear: Linear::new(&init.at("linear"), inputs, outputs),
            norm: match kind {
                NormKind::Group => RowNorm::Layer(Box::new(LayerNorm::new(&norm, outputs))),
                _ => RowNorm::Batch(Box::new(BatchNorm1d::new(&norm, outputs))),
            },
        }
    }

    pub(super) fn forward<'t>(&self, x: Var<'t>) -> Var<'t> {
        let y = self.linear.forward(x);
        match &self.norm {
            RowNorm::Batch(norm) => norm.forward_then(y, LEAKY),
            RowNorm::Layer(norm) => norm.forward(y).leaky_relu(SLOPE),
        }
    }
}

/// Everything that is trained.
#[derive(Clone, Debug)]
pub(super) struct Model {
    pub(super) encoder: ResNet,
    pub(super) enc_conv: Conv2d,
    pub(super) enc_norm: Norm,
    pub(super) enc_fc: NormedLinear,
    pub(super) selection: NormedLinear,
    pub(super) selection_out: Linear,
    /// The mean shapes, `[N, V, 3]`.
    pub(super) shapes: Param,
    pub(super) deformation: PointMlp,
    pub(super) camera: NormedLinear,
    pub(super) camera_out: Linear,
    pub(super) texture: ImageDecoder,
    /// What guesses viewpoints, where the quaternion does not say the direction.
    pub(super) viewpoint: Option<ViewpointHead>,
    pub(super) temperature: f32,
    pub(super) vertex_scale: f32,
    pub(super) camera_dropout: Dropout,
    pub(super) first_size: f32,
    pub(super) closed_texture: bool,
}
impl_module!(Model: f32 {
    encoder, enc_conv, enc_norm, enc_fc, selection, selection_out, shapes, deformation, camera, camera_out, texture, viewpoint
} fixed { temperature, vertex_scale, camera_dropout, first_size, closed_texture });

/// What becomes of a batch of `B` images.
#[derive(Clone, Copy, Debug)]
pub(super) struct Predicted<'t> {
    /// How much of each mean shape, `[B, N]`: rows add up to 1.
    pub(super) weights: Var<'t>,
    /// Offsets of the vertices, `[B, V, 3]`.
    pub(super) offsets: Var<'t>,
    /// `[B, V, 3]`.
    pub(super) positions: Var<'t>,
    /// Scale and place in the image, `[B, 3]`.
    pub(super) place: Var<'t>,
    /// Quaternions w, x, y, z before they are normalised, `[B, 4]`.
    pub(super) raw_rotation: Var<'t>,
    /// The same of length 1.
    pub(super) rotation: Var<'t>,
    /// Viewpoints, where a head of their own guesses them; the quaternions mean nothing then.
    pub(super) viewpoint: Option<ViewpointGuess<'t>>,
    /// The texture, `[B, H, W, 3]`: closed around the sphere, or as the decoder puts it out.
    pub(super) texture: Var<'t>,
}

impl Model {
    pub(super) fn new(config: &McmrConfig, seed: u64, template: &Template) -> Self {
        let init = Init::new(seed);
        let McmrConfig { width, features, head, hidden, shapes, .. } = *config;
        let map = 16 * config.texture_width;
        let side = config.image_size / 64;
        let resnet = ResNetConfig { width, norm: config.norm, ..ResNetConfig::resnet18() };
        let point = PointMlpConfig {
            hidden: vec![hidden; 4],
            dropout: config.dropout,
            ..PointMlpConfig::published(features + shapes)
        };
        let halves = ConvGeometry::new().stride(2).padding(1);
        let enc_conv = Conv2d::normal(&init.at("enc_conv"), 8 * width, map, 4, 0.02, halves);
        Self {
            encoder: ResNet::new(&init.at("encoder"), &resnet),
            enc_conv,
            enc_norm: Norm::new(&init.at("enc_norm"), map, config.norm),
            enc_fc: NormedLinear::new(
                &init.at("enc_fc"),
                [side * side * map, features],
                config.norm,
            ),
            selection: NormedLinear::new(&init.at("selection"), [features, head], config.norm),
            selection_out: Linear::new(&init.at("selection_out"), head, shapes),
            shapes: shapes::first(config, seed, template),
            deformation: PointMlp::new(&init.at("deformation"), &point),
            camera: NormedLinear::new(&init.at("camera"), [features, head], config.norm),
            camera_out: Linear::new(&init.at("camera_out"), head, 7),
            texture: ImageDecoder::new(&init.at("texture"), config.texture_width, 3),
            viewpoint: (config.camera_head == CameraHead::Viewpoint)
                .then(|| ViewpointHead::new(&init.at("viewpoint"), 3, DIRECTIONS)),
            temperature: config.temperature as f32,
            vertex_scale: config.vertex_scale as f32,
            camera_dropout: Dropout::new(config.camera_dropout),
            first_size: config.first_size as f32,
            closed_texture: config.closed_texture,
        }
    }

    /// Images `[B, S, S, 3]` in `[0, 1]`; weights of the mean shapes, `[B, N]`, where it is not to find them itself.
    pub(super) fn forward<'t>(
        &self,
        tape: &'t Tape,
        images: Var<'t>,
        weights: Option<Var<'t>>,
    ) -> Predicted<'t> {
        let map = tape.scope("encoder", || self.map(images));
        let [b, h, w, c] = map.dims();
        let code = self.enc_fc.forward(map.reshape(&[b, h * w * c]));
        let weights = weights.unwrap_or_else(|| {
            let logits = self.selection_out.forward(self.selection.forward(code));
            logits.scale(self.temperature.recip()).softmax()
        });
        let (positions, offsets) = self.shape(tape, code, weights);
        let camera = self.camera.forward(self.camera_dropout.forward(code));
        let camera = self.camera_out.forward(camera);
        // The published order: a quaternion, the size, the place.
        let raw_rotation = camera.slice_axis(1, 0..4).tanh();
        let length = raw_rotation.square().sum_axis(1).add_scalar(1e-12).sqrt().reshape(&[b, 1]);
        let usual = tape.constant(Array1::from(vec![self.first_size, 0.0, 0.0]));
        let texture = tape.scope("texture", || self.texture.forward(map));
        Predicted {
            weights,
            offsets,
            positions,
            place: camera.slice_axis(1, 4..7).add(usual),
            raw_rotation,
            rotation: raw_rotation.div(length),
            viewpoint: self.viewpoint.as_ref().map(|head| head.forward(images)),
            texture: if self.closed_texture { closed(texture) } else { texture },
        }
    }

    /// Images to the maps that code and texture are made from, `[B, S/64, S/64, 16 texture-width]`.
    pub(super) fn map<'t>(&self, images: Var<'t>) -> Var<'t> {
        let [.., last] = self.encoder_maps(images);
        self.enc_norm.after(&self.enc_conv, last, LEAKY)
    }

    /// The encoder's maps of images `[B, S, S, 3]` in `[0, 1]`.
    pub(super) fn encoder_maps<'t>(&self, images: Var<'t>) -> [Var<'t>; 4] {
        self.encoder.forward_maps(imagenet_normalized(images))
    }

    /// The weighted mean shape, deformed vertex by vertex: positions and offsets, `[B, V, 3]`.
    fn shape<'t>(&self, tape: &'t Tape, code: Var<'t>, weights: Var<'t>) -> (Var<'t>, Var<'t>) {
        let [b, n] = weights.dims();
        let vertices = self.shapes.shape()[1];
        let shapes = tape.param(&self.shapes).reshape(&[n, 3 * vertices]);
        let mean = weights.matmul(shapes).reshape(&[b, vertices, 3]);
        let code = tape.concat(&[code, weights], 1);
        let points = mean.scale(self.vertex_scale);
        let offsets = tape.scope("deformation", || self.deformation.forward(code, points));
        (mean.add(offsets), offsets)
    }
}
