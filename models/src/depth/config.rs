//! What the two systems can be told, beside the loop's own options.

use nets::{NormKind, ResNetConfig};
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use train::settings::{LARGEST, above_to};

use crate::paired::PairsConfig;

train::options! {
    /// What both have: data, backbone, refinement, losses. Lengths are in the frame of the camera.
    pub struct RefineConfig extends pairs: PairsConfig = PairsConfig { scale: 1.0, points: 1000, ..PairsConfig::default() } => {
        /// What the network is given beside the colours.
        pub depth: DepthKind = DepthKind::None;
        /// How a depth is wrong that is estimated from the true one.
        pub estimate_errors: EstimateErrors = EstimateErrors::Affine;
        /// Whether depth is given as it was estimated, floor and background included, as on the poster; else inside
        /// of the silhouette alone.
        pub raw_depth: bool = false;
        /// Where the object is along the camera's axis.
        pub place: PlaceKind = PlaceKind::Fixed;
        /// The depth of the middle of an object; where `place` is `"known"` the middle is known. 1.4 is that of
        /// 3D-R2N2's renderings.
        pub middle: f64 = 1.4, in 1e-3..=1e6;
        /// Whether vertices are told and projected as in the published code: the third number is what Blender's matrix
        /// makes of the depth instead of -1 to 1 over `reach`, no place is cut off beside the image, and depths within a
        /// tenth of the camera's plane count as a tenth, behind it as minus a tenth. Its numbers are of lengths in which
        /// objects are about 1.4 away.
        pub published_places: bool = false;
        /// Nearest and farthest depth that voxels and the network's depth channel reach, in terms of the middle.
        pub reach: [f64; 2] = [0.42, 1.72];
        /// Whether the network sees nothing, neither colours nor depth: the control that a table needs.
        pub blind: bool = false;
        /// Whether what is not the object is black in the images, as in 3D-R2N2's without their alpha; else white.
        pub black_background: bool = false;
        /// The backbone.
        pub backbone: BackboneKind = BackboneKind::Resnet18;
        /// Its width: channels of its stem. Published: 64.
        pub width: usize = 32, in 1..=512;
        /// Its norms: what learns from scratch needs them.
        pub norm: NormKind = NormKind::Batch;
        /// A file with torchvision's weights for the backbone, `.pth` or safetensors; the filters for depth stay
        /// fresh.
        #[serde(with = "train::settings::optional")]
        pub weights: Option<String> = None;
        /// Whether vertices are told, beside their places, what the outline and measured depth say of them: how far they are
        /// from the outline, and how far behind the surface that is seen there.
        pub depth_residuals: bool = false;
        /// Refinement stages.
        pub stages: usize = 3, in 1..=8;
        /// Features inside of them; published 128.
        pub hidden: usize = 64, in 1..=4096;
        /// Graph convolutions in each.
        pub graph_convolutions: usize = 3, in 1..=8;
        /// Whether the last stage predicts six numbers a vertex, with a colour.
        pub colors: bool = false;
        /// Weight of the Chamfer distance between sampled points.
        pub chamfer_weight: f64 = 1.0, in above_to(0.0, 1e9);
        /// Weight of the distance of normals at nearest points. The poster names it among its losses; Mesh R-CNN's code
        /// defaults to 1, its released configurations have 0.
        pub normal_weight: f64 = 0.0, in 0.0..=1e9;
        /// Weight of the mean squared edge length.
        pub edge_weight: f64 = 0.2, in 0.0..=1e9;
        /// Weight of the squared Laplacian of the positions, in squared edges: of what is rough.
        pub smoothness_weight: f64 = 0.0, in 0.0..=1e9;
        /// Weight of the squared Laplacian of each stage's offsets, in edges to the fourth: of what they bend.
        pub bending_weight: f64 = 0.0, in 0.0..=1e9;
        /// Weight of the rendered-depth loss: the last mesh's depth from the image's camera against what is known of
        /// it.
        pub depth_weight: f64 = 0.0, in 0.0..=1e9;
        /// How depths are compared.
        pub depth_loss: DepthLossKind = DepthLossKind::Auto;
        /// The share of the pixels that are left out where the comparison is trimmed.
        pub depth_trim: f64 = 0.2, in 0.0..=0.9;
        /// Weight of the gradients of the difference at four scales, inside of the rendered-depth loss.
        pub depth_gradients: f64 = 0.5, in 0.0..=1e9;
        /// What a pixel of the silhouette without any depth counts in the rendered-depth loss, through a silhouette
        /// that is soft at its outline; compare with errors of depth, which are below half an object.
        pub coverage: f64 = 0.0, in 0.0..=1e9;
        /// Whether that is all that the rendered-depth loss has: what of its effect is outlines and what is depth.
        pub coverage_alone: bool = false;
        /// Whether the rendered-depth loss is a mean over the meshes of all stages, as the Chamfer distance is (deep
        /// supervision), and not of the last one alone.
        pub depth_of_all_stages: bool = false;
        /// Weight of the colours against those of the nearest true points, and of the rendered colours against the
        /// image.
        pub color_weight: f64 = 0.1, in 0.0..=1e9;
    }
}

impl RefineConfig {
    /// Channels of the network's images.
    pub fn inputs(&self) -> usize {
        if self.depth == DepthKind::None { 3 } else { 4 }
    }

    /// Numbers that vertices are told of themselves.
    pub(super) fn places(&self) -> usize {
        3 + if self.depth_residuals { self.depth.residuals() } else { 0 }
    }

    /// The backbone, without a classifier.
    pub fn resnet(&self) -> ResNetConfig {
        let base = match self.backbone {
            BackboneKind::Resnet18 => ResNetConfig::resnet18(),
            BackboneKind::Resnet34 => ResNetConfig::resnet34(),
            BackboneKind::Resnet50 => ResNetConfig::resnet50(),
        };
        ResNetConfig { width: self.width, inputs: self.inputs(), norm: self.norm, ..base }
    }

    /// Sides of the backbone's four maps.
    pub fn sides(&self) -> [usize; 4] {
        std::array::from_fn(|k| self.pairs.image_size.div_ceil(4 << k))
    }

    /// Numbers in the refinement stages, which are all trained.
    pub(super) fn refinement_parameters(&self) -> usize {
        let channels: usize = self.resnet().channels().iter().sum();
        let linear = |inputs: usize, outputs: usize| outputs * (inputs + 1);
        let (hidden, places, last) = (self.hidden, self.places(), self.stages - 1);
        let stage = |i: usize| {
            let first = hidden + places + if i == 0 { 0 } else { hidden };
            let more = (self.graph_convolutions - 1) * 2 * linear(hidden + places, hidden);
            let outputs = if self.colors && i == last { 6 } else { 3 };
            linear(channels, hidden)
                + 2 * linear(first, hidden)
                + more
                + linear(hidden + places, outputs)
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
            NormKind::Group => [weights + 2 * channels, 0],
        }
    }

    /// What is wrong beside ranges, one sentence each.
    pub(super) fn conflicts(&self) -> Vec<String> {
        let mut problems = self.pairs.conflicts();
        let [near, far] = self.reach;
        if !((0.01..1.0).contains(&near) && far > 1.0 && far <= 100.0) {
            problems.push(format!("`reach` is [{near}, {far}], expected 0.01 to 1, then 1 to 100"));
        }
        if self.place == PlaceKind::Seen && self.depth != DepthKind::True {
            problems.push(
                "`place` is seen, expected fixed or known: there is no measured depth".to_owned(),
            );
        }
        if self.depth_residuals && self.published_places {
            let what = "expected false with `published-places`, whose depths are others";
            problems.push(format!("`depth-residuals` is true, {what}"));
        }
        let metric = matches!(self.depth_loss, DepthLossKind::Log | DepthLossKind::Plain);
        if metric && self.depth == DepthKind::Estimated {
            let found = format!("{:?}", self.depth_loss).to_lowercase();
            let what = "auto, aligned or trimmed: an estimate has no unit";
            problems.push(format!("`depth-loss` is {found}, expected {what}"));
        }
        if self.coverage_alone && self.coverage == 0.0 {
            let what = "expected false where `coverage` is 0: no loss would be left";
            problems.push(format!("`coverage-alone` is true, {what}"));
        }
        problems
    }
}

train::options! {
    /// The options of depth-aware Pixel2Mesh.
    pub struct SphereConfig extends refine: RefineConfig = RefineConfig::default() => {
        /// Subdivision level of the icosphere that the first stage moves; 1 has 42 vertices; published 2, and 4 in
        /// the form that is not subdivided.
        pub level: u32 = 1, in 0..=6;
        /// Whether each stage but the last hands its mesh on with four faces for each; false is the published "sphere
        /// init".
        pub subdivide: bool = true;
        /// Radius of the icosphere; published 1.
        pub radius: f64 = 0.35, in 1e-3..=1e3;
        /// Whether it begins around the camera, half of it behind, as published, instead of around the middle of objects:
        /// the first stage has to bring it out.
        pub around_camera: bool = false;
    }
}

impl SphereConfig {
    /// The icosphere's level at each stage.
    pub(super) fn levels(&self) -> Vec<u32> {
        let grown = |stage: usize| if self.subdivide { stage as u32 } else { 0 };
        (0..self.refine.stages).map(|stage| self.level + grown(stage)).collect()
    }
}

train::options! {
    /// The options of Mesh R-CNN.
    pub struct VoxelConfig extends refine: RefineConfig = RefineConfig::default() => {
        /// Cells along each axis, even; published 48.
        pub cells: usize = 24, in 4..=96;
        /// Channels inside of the voxel branch; published 256.
        pub voxel_hidden: usize = 64, in 1..=2048;
        /// Its convolutions.
        pub voxel_convolutions: usize = 4, in 0..=16;
        /// Probability from which on a cell is occupied.
        pub threshold: f64 = 0.2, in 0.001..=0.999;
        /// The probability that all cells begin with; published 0.5, with which the first meshes are the whole
        /// volume's border.
        pub prior: f64 = 0.05, in 0.001..=0.999;
        /// Steps at first in which what is refined is a random tetrahedron around the camera instead of the cells'
        /// surface. Published: 100, whose losses count, though only the cells' should.
        pub voxel_only_steps: u64 = 0, in ..=LARGEST;
        /// Whether cells that the image shows to be empty are: those beside the silhouette, and those before the surface of
        /// measured depth, whose own cells are occupied. What is left to predict is what lies behind.
        pub carving: bool = false;
        /// Whether parts of the cells' surface that only touch, along an edge or at a corner, are parted, so that each mesh is a
        /// closed manifold.
        pub manifold: bool = false;
        /// Whether the surface of the cells stands half a cell beside them, as PyTorch3D's `cubify` puts it where nothing
        /// is said of `align`: corners of cells where their middles are.
        pub corner_aligned: bool = false;
        /// Weight of the cells' cross entropy.
        pub voxel_weight: f64 = 1.0, in above_to(0.0, 1e9);
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

impl DepthKind {
    /// How many numbers a vertex is told beside its place: the outline's, and with measured depth its own.
    pub(super) const fn residuals(self) -> usize {
        match self {
            Self::True => 3,
            Self::None | Self::Estimated => 1,
        }
    }
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

/// How an estimate is wrong, beside a floor under the object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EstimateErrors {
    /// A scale and a shift of inverse depth, and a little blur: [`Monocular`](synth::Monocular)'s defaults.
    Affine,
    /// The object leans, is bent, flattened and soft as well: [`Monocular::with_relief_errors`](synth::Monocular::with_relief_errors).
    Nonlinear,
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
    /// Lengths are those of the data times `scale`; the middle is where measured depth shows the object, its median over the
    /// silhouette, so that cells and template stand about each object.
    Seen,
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
