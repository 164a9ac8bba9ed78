//! What the two systems can be told, beside the loop's own options.

use nets::{NormKind, ResNetConfig};
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use crate::paired::PairsConfig;

/// What both have: data, backbone, refinement, losses. Lengths are in the frame of the camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct RefineConfig {
    /// The data. `scale` is 1 in the published code of Mesh R-CNN.
    #[serde(flatten)]
    pub pairs: PairsConfig,
    /// What the network is given beside the colours. Default `"none"`.
    pub depth: DepthKind,
    /// Whether depth is given as it was estimated, floor and background included, as on the poster. Default false:
    /// inside of the silhouette alone.
    pub raw_depth: bool,
    /// Where the object is along the camera's axis. Default `"fixed"`.
    pub place: PlaceKind,
    /// The depth of the middle of an object; where `place` is `"known"` the middle is known. Default 1.4, of 3D-R2N2's
    /// renderings.
    pub middle: f64,
    /// Nearest and farthest depth that voxels and the network's depth channel reach, in terms of the middle. Default
    /// [0.42, 1.72].
    pub reach: [f64; 2],
    /// The backbone. Default `"resnet18"`.
    pub backbone: BackboneKind,
    /// Its width, 1 to 512: channels of its stem. Default 32, half of the published one.
    pub width: usize,
    /// Its norms. Default `"batch"`: what learns from scratch needs them.
    pub norm: NormName,
    /// A file with torchvision's weights for the backbone, `.pth` or safetensors; the filters for depth stay fresh. Empty
    /// for none. Default empty.
    pub weights: String,
    /// Refinement stages, 1 to 8. Default 3.
    pub stages: usize,
    /// Features inside of them. Default 64; published 128.
    pub hidden: usize,
    /// Graph convolutions in each, 1 to 8. Default 3.
    pub graph_convolutions: usize,
    /// Whether the last stage predicts six numbers a vertex, with a colour. Default false.
    pub colors: bool,
    /// Weight of the Chamfer distance between sampled points. Default 1.
    pub chamfer_weight: f64,
    /// Weight of the distance of normals at nearest points. Default 0, as released.
    pub normal_weight: f64,
    /// Weight of the mean squared edge length. Default 0.2.
    pub edge_weight: f64,
    /// Weight of the rendered-depth loss: the last mesh's depth from the image's camera against what is known of it.
    /// Default 0.
    pub depth_weight: f64,
    /// How depths are compared. Default `"auto"`.
    pub depth_loss: DepthLossKind,
    /// The share of the pixels that are left out where the comparison is trimmed, 0 to 0.9. Default 0.2.
    pub depth_trim: f64,
    /// Weight of the gradients of the difference at four scales, inside of the rendered-depth loss. Default 0.5.
    pub depth_gradients: f64,
    /// What a pixel of the silhouette without any depth counts in the rendered-depth loss, through a silhouette that is
    /// soft at its outline; compare with errors of depth, which are below half an object. Default 0.
    pub coverage: f64,
    /// Weight of the colours against those of the nearest true points, and of the rendered colours against the image.
    /// Default 0.1.
    pub color_weight: f64,
}

impl Default for RefineConfig {
    fn default() -> Self {
        Self {
            pairs: PairsConfig { scale: 1.0, points: 1000, ..PairsConfig::default() },
            depth: DepthKind::None,
            raw_depth: false,
            place: PlaceKind::Fixed,
            middle: 1.4,
            reach: [0.42, 1.72],
            backbone: BackboneKind::Resnet18,
            width: 32,
            norm: NormName::Batch,
            weights: String::new(),
            stages: 3,
            hidden: 64,
            graph_convolutions: 3,
            colors: false,
            chamfer_weight: 1.0,
            normal_weight: 0.0,
            edge_weight: 0.2,
            depth_weight: 0.0,
            depth_loss: DepthLossKind::Auto,
            depth_trim: 0.2,
            depth_gradients: 0.5,
            coverage: 0.0,
            color_weight: 0.1,
        }
    }
}

impl RefineConfig {
    /// Channels of the network's images.
    pub fn inputs(&self) -> usize {
        if self.depth == DepthKind::None { 3 } else { 4 }
    }

    /// The backbone, without a classifier.
    pub fn resnet(&self) -> ResNetConfig {
        let base = match self.backbone {
            BackboneKind::Resnet18 => ResNetConfig::resnet18(),
            BackboneKind::Resnet34 => ResNetConfig::resnet34(),
            BackboneKind::Resnet50 => ResNetConfig::resnet50(),
        };
        let norm = match self.norm {
            NormName::Batch => NormKind::Batch,
            NormName::Frozen => NormKind::Frozen,
        };
        ResNetConfig { width: self.width, inputs: self.inputs(), norm, ..base }
    }

    /// Sides of the backbone's four maps.
    pub fn sides(&self) -> [usize; 4] {
        std::array::from_fn(|k| self.pairs.image_size.div_ceil(4 << k))
    }

    /// Numbers in the refinement stages, which are all trained.
    pub(super) fn refinement_parameters(&self) -> usize {
        let channels: usize = self.resnet().channels().iter().sum();
        let linear = |inputs: usize, outputs: usize| outputs * (inputs + 1);
        let (hidden, last) = (self.hidden, self.stages - 1);
        let stage = |i: usize| {
            let first = hidden + 3 + if i == 0 { 0 } else { hidden };
            let more = (self.graph_convolutions - 1) * 2 * linear(hidden + 3, hidden);
            let outputs = if self.colors && i == last { 6 } else { 3 };
            linear(channels, hidden)
                + 2 * linear(first, hidden)
                + more
                + linear(hidden + 3, outputs)
        };
        (0..self.stages).map(stage).sum()
    }

    /// Numbers of the backbone: trained, then those of its norms that are not.
    pub(super) fn backbone_parameters(&self) -> [usize; 2] {
        let config = self.resnet();
        let (mut weights, mut channels) = (49 * config.inputs * config.width, config.width);
        let mut inputs = config.width;
        let expansion = config.block.expansion();
        for (k, &blocks) in config.blocks.iter().enumerate() {
            let width = config.width << k;
            let outputs = width * expansion;
            for i in 0..blocks {
                let inside = if expansion == 1 {
                    channels += 2 * width;
                    9 * inputs * width + 9 * width * width
                } else {
                    channels += 2 * width + outputs;
                    inputs * width + 9 * width * width + width * outputs
                };
                weights += inside;
                if inputs != outputs || (k > 0 && i == 0) {
                    weights += inputs * outputs;
                    channels += outputs;
                }
                inputs = outputs;
            }
        }
        match config.norm {
            NormKind::Batch => [weights + 2 * channels, 2 * channels],
            NormKind::Frozen => [weights, 4 * channels],
        }
    }

    pub(super) fn check(&self) -> Vec<String> {
        let mut problems = self.pairs.check();
        let mut require = |holds: bool, field: &str, found: String, what: &str| {
            if !holds {
                problems.push(format!("`{field}` is {found}, expected {what}"));
            }
        };
        let mut count = |n: usize, most: usize, field: &str| {
            require((1..=most).contains(&n), field, n.to_string(), &format!("1 to {most}"));
        };
        count(self.width, 512, "width");
        count(self.stages, 8, "stages");
        count(self.hidden, 4096, "hidden");
        count(self.graph_convolutions, 8, "graph-convolutions");
        let sound = (1e-3..=1e6).contains(&self.middle);
        require(sound, "middle", self.middle.to_string(), "0.001 to 1e6");
        let [near, far] = self.reach;
        let sound = (0.01..1.0).contains(&near) && far > 1.0 && far <= 100.0;
        require(sound, "reach", format!("{:?}", self.reach), "0.01 to 1, then 1 to 100");
        let sound = (0.0..=0.9).contains(&self.depth_trim);
        require(sound, "depth-trim", self.depth_trim.to_string(), "0 to 0.9");
        for (weight, field) in [
            (self.chamfer_weight, "chamfer-weight"),
            (self.normal_weight, "normal-weight"),
            (self.edge_weight, "edge-weight"),
            (self.depth_weight, "depth-weight"),
            (self.depth_gradients, "depth-gradients"),
            (self.coverage, "coverage"),
            (self.color_weight, "color-weight"),
        ] {
            require((0.0..=1e9).contains(&weight), field, weight.to_string(), "0 to 1e9");
        }
        let sound = self.chamfer_weight > 0.0;
        require(sound, "chamfer-weight", self.chamfer_weight.to_string(), "more than 0");
        let metric = matches!(self.depth_loss, DepthLossKind::Log | DepthLossKind::Plain);
        require(
            !(metric && self.depth == DepthKind::Estimated),
            "depth-loss",
            format!("{:?}", self.depth_loss).to_lowercase(),
            "auto, aligned or trimmed: an estimate has no unit",
        );
        problems
    }
}

/// The options of depth-aware Pixel2Mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct SphereConfig {
    /// What both systems have.
    #[serde(flatten)]
    pub refine: RefineConfig,
    /// Subdivision level of the icosphere that the first stage moves, 0 to 6. Default 1: 42 vertices; published 2, and 4
    /// in the form that is not subdivided.
    pub level: u32,
    /// Whether each stage but the last hands its mesh on with four faces for each. Default true; false is the published
    /// "sphere init".
    pub subdivide: bool,
    /// Radius of the icosphere. Default 0.35. (As published it is 1, around the camera.)
    pub radius: f64,
}

impl Default for SphereConfig {
    fn default() -> Self {
        Self { refine: RefineConfig::default(), level: 1, subdivide: true, radius: 0.35 }
    }
}

impl SphereConfig {
    /// The icosphere's level at each stage.
    pub(super) fn levels(&self) -> Vec<u32> {
        let grown = |stage: usize| if self.subdivide { stage as u32 } else { 0 };
        (0..self.refine.stages).map(|stage| self.level + grown(stage)).collect()
    }
}

/// The options of Mesh R-CNN.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct VoxelConfig {
    /// What both systems have.
    #[serde(flatten)]
    pub refine: RefineConfig,
    /// Cells along each axis, even, 4 to 96. Default 24; published 48.
    pub cells: usize,
    /// Channels inside of the voxel branch. Default 64; published 256.
    pub voxel_hidden: usize,
    /// Its convolutions, 0 to 16. Default 4.
    pub voxel_convolutions: usize,
    /// Probability from which on a cell is occupied. Default 0.2.
    pub threshold: f64,
    /// The probability that all cells begin with. Default 0.05; published 0.5, with which the first meshes are the whole
    /// volume's border.
    pub prior: f64,
    /// Weight of the cells' cross entropy. Default 1.
    pub voxel_weight: f64,
}

impl Default for VoxelConfig {
    fn default() -> Self {
        Self {
            refine: RefineConfig::default(),
            cells: 24,
            voxel_hidden: 64,
            voxel_convolutions: 4,
            threshold: 0.2,
            prior: 0.05,
            voxel_weight: 1.0,
        }
    }
}

/// What the network is given beside the colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum DepthKind {
    /// Nothing.
    None,
    /// Depth that was measured: that of the data, or else of its true surface.
    True,
    /// Disparity as a network guesses it: of no scale and no shift, blurred, with a floor under the object.
    Estimated,
}

// By hand: on a command line, `depth=true` is not a text.
impl<'de> Deserialize<'de> for DepthKind {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Kinds;
        impl Visitor<'_> for Kinds {
            type Value = DepthKind;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("none, true or estimated")
            }

            fn visit_bool<E: de::Error>(self, given: bool) -> Result<DepthKind, E> {
                Ok(if given { DepthKind::True } else { DepthKind::None })
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<DepthKind, E> {
                match text {
                    "none" => Ok(DepthKind::None),
                    "true" => Ok(DepthKind::True),
                    "estimated" => Ok(DepthKind::Estimated),
                    _ => Err(E::invalid_value(de::Unexpected::Str(text), &self)),
                }
            }
        }
        deserializer.deserialize_any(Kinds)
    }
}

/// Where the object is along the camera's axis, and how large a length is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PlaceKind {
    /// Lengths are those of the data times `scale`, objects about `middle` away: 3D-R2N2's renderings.
    Fixed,
    /// The depth of the world's origin is known, and lengths are such that the image is 2 units wide there: Pix3D, whose
    /// cameras and boxes differ from image to image.
    Known,
}

/// The backbone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BackboneKind {
    /// Two small blocks a stage.
    Resnet18,
    /// Three to six small blocks.
    Resnet34,
    /// Three to six bottlenecks: the published one.
    Resnet50,
}

/// The backbone's norms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NormName {
    /// Statistics of the batch, which cannot be cut into shards then.
    Batch,
    /// Frozen: with `weights`.
    Frozen,
}

/// How a rendered depth is compared with what is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DepthLossKind {
    /// `aligned` for estimates, `plain` for what was measured.
    Auto,
    /// Disparities, the rendered one brought onto the other by scale and shift, squared: MiDaS's.
    Aligned,
    /// Disparities without median and spread, absolute, the worst pixels left out: MiDaS's robust one.
    Trimmed,
    /// Logarithms of depth up to half of a common factor: Eigen's.
    Log,
    /// Depths as they are, absolute, the worst pixels left out.
    Plain,
}
