//! The network: encoder, attention, trunk, heads.

use autodiff_lite::{Activation, Param, SparseMatrix, Var, impl_module};
use mesh_core::TriMesh;
use ndarray::{Array1, Array2};
use nets::{Init, Linear, TransformerConfig, TransformerEncoderLayer};

use super::config::{AttentionKind, Img2MeshConfig};
use super::encoder::Encoder;
use super::offsets::Offsets;
use super::view_stage::ViewStage;

/// The network, whose parameters are named as the published code names them where it does.
#[derive(Clone, Debug)]
pub(super) struct Model {
    pub(super) encoder: Encoder,
    pub(super) camera: Option<Linear>,
    pub(super) layers: Vec<TransformerEncoderLayer>,
    pub(super) fc: Linear,
    pub(super) mesh_fc: Offsets,
    pub(super) mesh_pos_fc: Linear,
    pub(super) mesh_color_fc: Linear,
    stages: Vec<ViewStage>,
    /// Centre and scale of the data in its world: `[4]`.
    pub(super) frame: Param,
    pub(super) attention: AttentionKind,
    pub(super) offset_scale: f32,
    pub(super) sphere: Array2<f32>,
}
impl_module!(Model: f32 { encoder, camera, layers, fc, mesh_fc, mesh_pos_fc, mesh_color_fc, stages, frame }
    fixed { attention, offset_scale, sphere });

/// Meshes of a batch: `[N, V, 3]` each.
#[derive(Clone, Copy, Debug)]
pub(super) struct Meshes<'t> {
    /// Before they are put in their place.
    pub(super) raw: Var<'t>,
    pub(super) positions: Var<'t>,
    pub(super) colors: Var<'t>,
}

/// The radius of the published sphere, in the units of the published heads' first outputs.
const PUBLISHED_RADIUS: f64 = 37.5;

/// First weights multiplied by a factor.
fn shrunk(mut head: Linear, factor: f64) -> Linear {
    let factor = factor as f32;
    for param in std::iter::once(&mut head.weight).chain(head.bias.as_mut()) {
        param.as_slice_mut().iter_mut().for_each(|x| *x *= factor);
    }
    head
}

impl<'t> Meshes<'t> {
    /// The same on the next level, whose vertices lie between these.
    pub(super) fn carried(self, up: &SparseMatrix) -> Self {
        let [raw, positions, colors] =
            [self.raw, self.positions, self.colors].map(|x| x.sparse_matmul(up));
        Self { raw, positions, colors }
    }

    /// With vertices moved, and other colours.
    pub(super) fn refined(self, offset: Var<'t>, colors: Var<'t>) -> Self {
        Self { raw: self.raw + offset, positions: self.positions + offset, colors }
    }
}

impl Model {
    /// With fresh weights, for meshes that begin as `template`.
    pub(super) fn new(config: &Img2MeshConfig, template: &TriMesh, seed: u64) -> Self {
        let init = Init::new(seed);
        let (d, v) = (config.width(), template.positions.len());
        let layers = match config.attention {
            AttentionKind::Mean => 0,
            _ => config.layers,
        };
        let at = init.at("layers");
        let transformer = TransformerConfig {
            hidden: config.feed_forward,
            dropout: config.dropout,
            ..TransformerConfig::new(d, config.heads)
        };
        // As small beside the sphere as they were published: of the usual size, first offsets would
        // crumple a sphere of radius 1 before the first step.
        let small = config.radius / PUBLISHED_RADIUS / config.offset_scale;
        let head = |at: &Init, outputs| shrunk(Linear::new(at, d, outputs), small);
        let stage = |i: usize| ViewStage::new(&init.at("stages").index(i), config, config.left(i));
        Self {
            encoder: Encoder::new(&init.at("encoder"), config),
            camera: config.camera_embedding.then(|| Linear::new(&init.at("camera"), 12, d)),
            layers: (0..layers)
                .map(|i| TransformerEncoderLayer::new(&at.index(i), &transformer))
                .collect(),
            fc: Linear::new(&init.at("fc"), d, d),
            mesh_fc: Offsets::new(
                &init.at("mesh_fc"),
                [config.coarsest(), config.base_level()],
                head,
            ),
            mesh_pos_fc: head(&init.at("mesh_pos_fc"), 3),
            mesh_color_fc: shrunk(
                Linear::new(&init.at("mesh_color_fc"), d, 3 * v),
                config.first_colors,
            ),
            stages: (0..config.stages).map(stage).collect(),
            frame: Param::buffer(Array1::from(vec![0.0, 0.0, 0.0, 1.0])),
            attention: config.attention,
            offset_scale: config.offset_scale as f32,
            sphere: Array2::from(template.positions.clone()),
        }
    }

    /// How many stages follow the whole images' mesh.
    pub(super) fn stages(&self) -> &[ViewStage] {
        &self.stages
    }

    /// Images `[M, S, S, 3]` to features `[M, D]`.
    pub(super) fn encode<'t>(&self, images: Var<'t>) -> Var<'t> {
        images.tape().scope("encoder", || self.encoder.forward(images))
    }

    /// Images to the maps that [stages](Self::stages) look at, and features.
    pub(super) fn encode_maps<'t>(&self, images: Var<'t>) -> (Vec<Var<'t>>, Var<'t>) {
        images.tape().scope("encoder", || self.encoder.maps(images))
    }

    /// Features `[N V, D]` and cameras `[N V, 12]` of `n` objects to their meshes.
    pub(super) fn forward<'t>(&self, n: usize, features: Var<'t>, cameras: Var<'t>) -> Meshes<'t> {
        self.decode(self.code(n, features, cameras))
    }

    /// What all views of each object together say of it: `[N, D]`.
    pub(super) fn code<'t>(&self, n: usize, features: Var<'t>, cameras: Var<'t>) -> Var<'t> {
        let tape = features.tape();
        let features = match &self.camera {
            Some(camera) => features + camera.forward(cameras),
            None => features,
        };
        let [m, d] = features.dims();
        let tokens = features.reshape(&[n, m / n, d]);
        let mixed = tape.scope("layers", || self.attend(tokens));
        let mean = mixed.mean_axis(1);
        mean + self.fc.forward_then(mean, Activation::Relu)
    }

    pub(super) fn attend<'t>(&self, tokens: Var<'t>) -> Var<'t> {
        let all = |x| self.layers.iter().fold(x, |x, layer| layer.forward(x, None));
        match self.attention {
            AttentionKind::Views => all(tokens),
            AttentionKind::Published => all(tokens.permute(&[1, 0, 2])).permute(&[1, 0, 2]),
            AttentionKind::Mean => tokens,
        }
    }

    /// Codes `[N, D]` to meshes.
    pub(super) fn decode<'t>(&self, code: Var<'t>) -> Meshes<'t> {
        let tape = code.tape();
        let [n, _] = code.dims();
        let v = self.sphere.nrows();
        let scaled = |x: Var<'t>| if self.offset_scale == 1.0 { x } else { x * self.offset_scale };
        let raw = scaled(self.mesh_fc.forward(code)) + tape.constant(self.sphere.clone());
        // The centre of the box goes where the position head says.
        let (high, low) = (raw.max_axis(1), raw.min_axis(1));
        let shift = scaled(self.mesh_pos_fc.forward(code)) - (high + low).scale(0.5);
        let positions = raw + shift.reshape(&[n, 1, 3]);
        let colors = self.mesh_color_fc.forward(code).reshape(&[n, v, 3]).hardsigmoid();
        Meshes { raw, positions, colors }
    }
}
