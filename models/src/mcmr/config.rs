//! Options of the system, and what they amount to.

use serde::{Deserialize, Serialize};
use synth::{PoseNoise, families_named};
use train::Summary;
use train::settings::in_toml;

use super::size::summary;

/// Options of [`Mcmr`](super::Mcmr), in one table with those of the training loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct McmrConfig {
    /// Side of the cropped images, of the renderings and of the texture, pixels: a multiple of 64 up to 512. Default 64.
    pub image_size: usize,
    /// Channels of the first stage of the ResNet-18; 64 in the published one. Default 32.
    pub width: usize,
    /// Numbers in the code of an image; 256 published. Default 128.
    pub features: usize,
    /// Width of the texture decoder, which begins with 16 times as many channels; 16 published. Default 4.
    pub texture_width: usize,
    /// Channels of the hidden layers of selection and camera; 64 published. Default 64.
    pub head: usize,
    /// Width of the four layers of the deformation; 512 published. Default 128.
    pub hidden: usize,
    /// What coordinates are multiplied by before the deformation sees them. At the published 1 they are a quarter large, three
    /// of them beside the numbers of the code, and a deformation that starts out nearly blind to the place may stay so. Default 1.
    pub vertex_scale: f64,
    /// Share of the deformation's hidden numbers that training drops; 0.2 published. Default 0.2.
    pub dropout: f64,
    /// The same for the code that the camera is made from; 0.5 published. Default 0.5.
    pub camera_dropout: f64,
    /// Mean shapes, `N`. Default 2.
    pub shapes: usize,
    /// Level of the icosphere that they begin as: 2 has 162 vertices, 3 has 642. Default 2.
    pub level: u32,
    /// Before which epoch each face becomes four; 0 is never. Default 0.
    pub subdivide_at: u64,
    /// Whether the optimiser's moments of the mean shapes are carried over then; the published code loses them, and those
    /// of all other parameters too. Default true.
    pub keep_moments: bool,
    /// Radius of the spheres, in lengths of an object; 0.25 published. Default 0.25.
    pub radius: f64,
    /// How far the spheres differ at first, in radii: each is stretched by numbers of its own. Published are equal ones, 0,
    /// among which a selection has nothing to choose. Default 0.
    pub perturb: f64,
    /// What the logits of the selection are divided by. Default 1.
    pub temperature: f64,
    /// What the step length of the mean shapes is multiplied by. Default 1.
    pub shape_rate: f64,
    /// A file with pretrained weights of ResNet-18 under torchvision's names; empty is none. Default empty.
    pub weights: String,
    /// Files with VGG16 under torchvision's names and with the weights of LPIPS, for the perceptual loss. Empty ones take a
    /// pyramid of differences instead. Default empty.
    pub vgg_weights: String,
    /// See `vgg-weights`. Default empty.
    pub lpips_weights: String,
    /// A file with Inception v3's weights for the FID, without which there is no FID. Default empty.
    pub inception_weights: String,
    /// The renderer. Default `"dib-r"`.
    pub renderer: RendererKind,
    /// Sharpness of DIB-R's silhouette: a pixel at squared distance `d²` (the image is 2 wide) counts `exp(-sigma-inv d²)`.
    /// Default 1500.
    pub sigma_inv: f64,
    /// How far DIB-R's silhouette reaches, NDC. Default 0.1.
    pub reach: f64,
    /// How much of the silhouette is the exact one, which pulls at both sides of an outline where DIB-R's has no gradient
    /// inside the object, 0 to 1. Default 0.5.
    pub exact: f64,
    /// SoftRas's spread of faces; 1e-5 published. Default 1e-4.
    pub softras_sigma: f64,
    /// SoftRas's softness in depth. Default 1e-4.
    pub softras_gamma: f64,
    /// Focal length of the camera that all images are thought to be taken with, in halves of an image. MCMR's are 23.44
    /// (Pascal3D+) and 7.81 (CUB). Default 4.5.
    pub focal: f64,
    /// How far it stands from objects of size 1; 5 published. Default 2.4.
    pub distance: f64,
    /// Weight of the mean squared difference of masks.
    pub mask_weight: f64,
    /// Weight of the camera loss.
    pub camera_weight: f64,
    /// How predicted rotations are compared. Default `"cosine"`.
    pub rotation_loss: RotationLoss,
    /// Weight of the quaternion's length.
    pub camera_length_weight: f64,
    /// Weight of the mean length of offsets.
    pub deform_weight: f64,
    /// Weight of the Laplacian of the shape.
    pub laplacian_weight: f64,
    /// Weight of the Laplacian of the offsets.
    pub laplacian_offsets_weight: f64,
    /// Whether both of them count in proportion to the number of faces, as they are given for the 320 of level 2. The
    /// published ones do not: of the same surface, four times as many faces have about a quarter of the Laplacian, so a finer
    /// mesh is smoothed less. Default false.
    pub laplacian_by_faces: bool,
    /// Weight of the cotangent Laplacian of the shape; 0 published.
    pub cotangent_weight: f64,
    /// Weight of the perceptual distance.
    pub percept_weight: f64,
    /// Weight of the squared difference of a and b of CIE Lab.
    pub color_weight: f64,
    /// Weight of the squared difference of L.
    pub lightness_weight: f64,
    /// Weight of what keeps all mean shapes in use: `ln N` less the entropy of the weights' mean over a batch. Not
    /// published. Default 0.
    pub balance_weight: f64,
    /// Weight of the mean entropy of the weights of one image, which makes up the selection's mind. Not published. Default 0.
    pub decision_weight: f64,
    /// Probability that an image is mirrored, with its camera; 0.5 published. Default 0.5.
    pub flip: f64,
    /// Probability that a prediction is compared with the mirrored image, which makes shapes symmetric in x; 0.5
    /// published. Default 0.5.
    pub prediction_flip: f64,
    /// How far the crop is jittered in training, in lengths of the box: its size and its place; 0.05 published. Default 0.05.
    pub jitter: f64,
    /// Around the object's box, in lengths of the box. Default 0.1.
    pub margin: f64,
    /// Every how many objects one is held out where the data has no split of its own, at least 2; 0 is none, and scores are
    /// then of what was trained on. Default 5.
    pub hold_out: usize,
    /// Seed of the data that is made when none is given; that of the run decides all else. Default 0.
    pub data_seed: u64,
    /// Procedural objects of each family to train on when no data is given, each with one photograph. Default 100.
    pub objects: usize,
    /// More of each family that are held out. Default 20.
    pub test_objects: usize,
    /// The families; empty takes all. Default `["airplane", "car"]`.
    pub families: Vec<String>,
    /// How rough the poses of photographs are that are made, in degrees, per cent of size and hundredths of a length.
    /// Default 10, 10, 3.
    pub pose_noise: [f64; 3],
}

/// What turns a mesh and a camera into an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RendererKind {
    /// DIB-R: the nearest face, and a silhouette that reaches out.
    #[serde(rename = "dib-r")]
    DibR,
    /// SoftRas, as published: every face a cloud, six by six texels each.
    #[serde(rename = "softras")]
    SoftRas,
}

/// By how much a rotation misses another, of half the angle between them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RotationLoss {
    /// One minus the cosine, as published: between two rotations that are as likely it settles halfway.
    Cosine,
    /// The sine: it settles on one of them.
    Sine,
}

impl Default for McmrConfig {
    fn default() -> Self {
        Self {
            image_size: 64,
            width: 32,
            features: 128,
            texture_width: 4,
            head: 64,
            hidden: 128,
            vertex_scale: 1.0,
            dropout: 0.2,
            camera_dropout: 0.5,
            shapes: 2,
            level: 2,
            subdivide_at: 0,
            keep_moments: true,
            radius: 0.25,
            perturb: 0.0,
            temperature: 1.0,
            shape_rate: 1.0,
            weights: String::new(),
            vgg_weights: String::new(),
            lpips_weights: String::new(),
            inception_weights: String::new(),
            renderer: RendererKind::DibR,
            sigma_inv: 1500.0,
            reach: 0.1,
            exact: 0.5,
            softras_sigma: 1e-4,
            softras_gamma: 1e-4,
            focal: 4.5,
            distance: 2.4,
            mask_weight: 100.0,
            camera_weight: 20.0,
            rotation_loss: RotationLoss::Cosine,
            camera_length_weight: 0.1,
            deform_weight: 0.05,
            laplacian_weight: 6.0,
            laplacian_offsets_weight: 1.8,
            laplacian_by_faces: false,
            cotangent_weight: 0.0,
            percept_weight: 0.8,
            color_weight: 0.03,
            lightness_weight: 0.005,
            balance_weight: 0.0,
            decision_weight: 0.0,
            flip: 0.5,
            prediction_flip: 0.5,
            jitter: 0.05,
            margin: 0.1,
            hold_out: 5,
            data_seed: 0,
            objects: 100,
            test_objects: 20,
            families: vec!["airplane".to_owned(), "car".to_owned()],
            pose_noise: [10.0, 10.0, 3.0],
        }
    }
}

impl McmrConfig {
    /// Ranges, shapes and numbers of parameters.
    ///
    /// # Errors
    /// What is wrong, one sentence each.
    pub fn check(&self) -> Result<Summary, Vec<String>> {
        let mut problems = self.counts();
        problems.extend(self.numbers());
        let side = self.image_size;
        if !(side.is_multiple_of(64) && (64..=512).contains(&side)) {
            problems.push(format!("`image-size` is {side}, expected a multiple of 64 up to 512"));
        }
        let held = self.hold_out;
        if held == 1 || !in_toml(held) {
            problems.push(format!("`hold-out` is {held}, expected 0 (none) or 2 to 2^63 - 1"));
        }
        for (value, field) in [(self.data_seed, "data-seed"), (self.subdivide_at, "subdivide-at")] {
            if !in_toml(value) {
                problems.push(format!("`{field}` is {value}, expected at most 2^63 - 1"));
            }
        }
        if self.vgg_weights.is_empty() != self.lpips_weights.is_empty() {
            problems.push(
                "`vgg-weights` and `lpips-weights`: one is given, expected both or none".to_owned(),
            );
        }
        problems.extend(
            families_named(&self.families).err().map(|error| format!("`families`: {error}")),
        );
        if problems.is_empty() { Ok(summary(self)) } else { Err(problems) }
    }

    fn counts(&self) -> Vec<String> {
        let level = self.level as usize + usize::from(self.subdivide_at > 0);
        [
            (self.width, 1, 256, "width"),
            (self.features, 1, 4096, "features"),
            (self.texture_width, 1, 64, "texture-width"),
            (self.head, 1, 4096, "head"),
            (self.hidden, 1, 4096, "hidden"),
            (self.shapes, 1, 64, "shapes"),
            (level, 0, 5, "level"),
            (self.objects, 1, 100_000, "objects"),
            (self.test_objects, 0, 100_000, "test-objects"),
        ]
        .into_iter()
        .filter(|(value, low, high, _)| !(low..=high).contains(&value))
        .map(|(value, low, high, field)| format!("`{field}` is {value}, expected {low} to {high}"))
        .collect()
    }

    fn numbers(&self) -> Vec<String> {
        let [degrees, size, place] = self.pose_noise;
        let ranges = [
            (self.vertex_scale, 1e-3, 1e3, "vertex-scale"),
            (self.dropout, 0.0, 0.99, "dropout"),
            (self.camera_dropout, 0.0, 0.99, "camera-dropout"),
            (self.radius, 1e-3, 10.0, "radius"),
            (self.perturb, 0.0, 0.9, "perturb"),
            (self.temperature, 1e-3, 1e3, "temperature"),
            (self.shape_rate, 0.0, 1e3, "shape-rate"),
            (self.sigma_inv, 1.0, 1e6, "sigma-inv"),
            (self.reach, 1e-3, 2.0, "reach"),
            (self.exact, 0.0, 1.0, "exact"),
            (self.softras_sigma, 1e-9, 1.0, "softras-sigma"),
            (self.softras_gamma, 1e-9, 1.0, "softras-gamma"),
            (self.focal, 0.1, 1e3, "focal"),
            (self.distance, 0.6, 1e3, "distance"),
            (self.flip, 0.0, 1.0, "flip"),
            (self.prediction_flip, 0.0, 1.0, "prediction-flip"),
            (self.jitter, 0.0, 0.5, "jitter"),
            (self.margin, 0.0, 1.0, "margin"),
            (degrees, 0.0, 90.0, "pose-noise"),
            (size, 0.0, 50.0, "pose-noise"),
            (place, 0.0, 50.0, "pose-noise"),
        ];
        let weights = self.weights_by_name().map(|(weight, field)| (weight, 0.0, 1e6, field));
        let mut problems: Vec<String> = ranges
            .into_iter()
            .chain(weights)
            .filter(|(value, low, high, _)| !(low..=high).contains(&value))
            .map(|(value, low, high, field)| {
                format!("`{field}` is {value}, expected {low} to {high}")
            })
            .collect();
        if self.mask_weight == 0.0 {
            problems.push(
                "`mask-weight` is 0, expected a weight that is not: shapes come from masks"
                    .to_owned(),
            );
        }
        problems
    }

    fn weights_by_name(&self) -> [(f64, &'static str); 12] {
        [
            (self.mask_weight, "mask-weight"),
            (self.camera_weight, "camera-weight"),
            (self.camera_length_weight, "camera-length-weight"),
            (self.deform_weight, "deform-weight"),
            (self.laplacian_weight, "laplacian-weight"),
            (self.laplacian_offsets_weight, "laplacian-offsets-weight"),
            (self.cotangent_weight, "cotangent-weight"),
            (self.percept_weight, "percept-weight"),
            (self.color_weight, "color-weight"),
            (self.lightness_weight, "lightness-weight"),
            (self.balance_weight, "balance-weight"),
            (self.decision_weight, "decision-weight"),
        ]
    }

    /// Vertices of a mesh before it is subdivided.
    pub fn vertices(&self) -> usize {
        10 * 4_usize.pow(self.level) + 2
    }

    /// How rough made poses are.
    pub(super) fn noise(&self) -> PoseNoise {
        let [rotation, scale, translation] = self.pose_noise;
        PoseNoise { rotation, scale: scale / 100.0, translation: translation / 100.0 }
    }
}
