//! Options of the system, and what they amount to.

use nets::NormKind;
use serde::{Deserialize, Serialize};
use synth::{PoseNoise, families_named};
use train::Subset;
use train::settings::{LARGEST, Options as _, above_to};

use crate::parts::counts;
use crate::viewpoint::DIRECTIONS;

train::options! {
    /// Options of [`Mcmr`](super::Mcmr), in one table with those of the training loop.
    pub struct McmrConfig {
        /// Side of the cropped images, of the renderings and of the texture, pixels: a multiple of 64.
        pub image_size: usize = 64, in 64..=512;
        /// The norms behind convolutions and linear layers: `batch` as published; `frozen` for pretrained convolutions; `group`,
        /// whose statistics are those of each image: of eight images those of a batch say little, and codes are noise.
        pub norm: NormKind = NormKind::Batch;
        /// Channels of the first stage of the ResNet-18; 64 in the published one.
        pub width: usize = 32, in 1..=256;
        /// Numbers in the code of an image; 256 published.
        pub features: usize = 128, in 1..=4096;
        /// Width of the texture decoder, which begins with 16 times as many channels; 16 published.
        pub texture_width: usize = 4, in 1..=64;
        /// Channels of the hidden layers of selection and camera; 64 published.
        pub head: usize = 64, in 1..=4096;
        /// Width of the four layers of the deformation; 512 published.
        pub hidden: usize = 128, in 1..=4096;
        /// What coordinates are multiplied by before the deformation sees them. At the published 1 they are a quarter
        /// large, three of them beside the numbers of the code, and a deformation that starts out nearly blind to the
        /// place may stay so.
        pub vertex_scale: f64 = 1.0, in 1e-3..=1e3;
        /// What is added to the size that is predicted: with 1 an object is first seen at all; 0 published.
        pub first_size: f64 = 1.0, in 0.0..=10.0;
        /// Whether the texture goes on around the sphere without a seam; the published one does not. Only SoftRas draws one
        /// that does not.
        pub closed_texture: bool = true;
        /// Whether the network sees nothing, noise in the place of each image: the control that a table needs.
        pub blind: bool = false;
        /// What guesses the direction that an image was taken from.
        pub camera_head: CameraHead = CameraHead::Quaternion;
        /// How many guessed cameras are tried at most where `camera-head` is `viewpoint`; the one whose outline fits the
        /// image's mask best is kept.
        pub camera_hypotheses: usize = 3, in 1..=DIRECTIONS;
        /// Before which epoch training begins to draw with the cameras that it guesses itself in the place of the rough ones,
        /// whose noise they do not have, and to learn them from what is drawn too. Of several guesses that of the direction which is
        /// nearest to the rough camera. Not published.
        #[serde(with = "train::settings::optional")]
        pub own_cameras_at: Option<u64> = None, in 1..=LARGEST;
        /// Share of the deformation's hidden numbers that training drops; 0.2 published.
        pub dropout: f64 = 0.2, in 0.0..=0.99;
        /// The same for the code that the camera is made from; 0.5 published.
        pub camera_dropout: f64 = 0.5, in 0.0..=0.99;
        /// Mean shapes, `N`.
        pub shapes: usize = 2, in 1..=64;
        /// Level of the icosphere that they begin as: 2 has 162 vertices, 3 has 642.
        pub level: u32 = 2, in 0..=5;
        /// Before which epoch each face becomes four.
        #[serde(with = "train::settings::optional")]
        pub subdivide_at: Option<u64> = None, in 1..=LARGEST;
        /// Whether the optimiser's moments of the mean shapes are carried over then; the published code loses them,
        /// and those of all other parameters too.
        pub keep_moments: bool = true;
        /// Radius of the spheres, in lengths of an object; 0.25 published.
        pub radius: f64 = 0.25, in 1e-3..=10.0;
        /// How far the spheres differ at first, in radii: each is stretched by numbers of its own. Published are
        /// equal ones, 0, among which a selection has nothing to choose.
        pub perturb: f64 = 0.0, in 0.0..=0.9;
        /// What the logits of the selection are divided by.
        pub temperature: f64 = 1.0, in 1e-3..=1e3;
        /// What the learning rate of the mean shapes is multiplied by.
        pub shape_rate: f64 = 1.0, in 0.0..=1e3;
        /// A file with pretrained weights of ResNet-18 under torchvision's names.
        #[serde(with = "train::settings::optional")]
        pub weights: Option<String> = None;
        /// A file with VGG16 under torchvision's names, for the perceptual loss; without it and `lpips-weights` a
        /// pyramid of differences takes its place.
        #[serde(with = "train::settings::optional")]
        pub vgg_weights: Option<String> = None;
        /// A file with the weights of LPIPS, for the perceptual loss.
        #[serde(with = "train::settings::optional")]
        pub lpips_weights: Option<String> = None;
        /// Whether LPIPS is given images from 0 to 1, as by the published code; it expects -1 to 1.
        pub lpips_from_zero: bool = false;
        /// A file with Inception v3's weights for the FID, without which there is no FID.
        #[serde(with = "train::settings::optional")]
        pub inception_weights: Option<String> = None;
        /// The renderer.
        pub renderer: RendererKind = RendererKind::DibR;
        /// Sharpness of DIB-R's silhouette: a pixel at squared distance `d²` (the image is 2 wide) counts
        /// `exp(-sigma-inv d²)`.
        pub sigma_inv: f64 = 1500.0, in 1.0..=1e6;
        /// How far DIB-R's silhouette reaches, NDC.
        pub reach: f64 = 0.1, in 1e-3..=2.0;
        /// How much of the silhouette is the exact one, which pulls at both sides of an outline where DIB-R's has no
        /// gradient inside the object.
        pub exact: f64 = 0.5, in 0.0..=1.0;
        /// SoftRas's spread of faces; 1e-5 published.
        pub softras_sigma: f64 = 1e-4, in 1e-9..=1.0;
        /// SoftRas's softness in depth.
        pub softras_gamma: f64 = 1e-4, in 1e-9..=1.0;
        /// Focal length of the camera that all images are thought to be taken with, in halves of an image. MCMR's are
        /// 23.44 (Pascal3D+) and 7.81 (CUB).
        pub focal: f64 = 4.5, in 0.1..=1e3;
        /// How far it stands from objects of size 1; 5 published.
        pub distance: f64 = 2.4, in 0.6..=1e3;
        /// Weight of the mean squared difference of masks, which shapes come from.
        pub mask_weight: f64 = 100.0, in above_to(0.0, 1e6);
        /// Weight of the camera loss.
        pub camera_weight: f64 = 20.0, in 0.0..=1e6;
        /// How predicted rotations are compared, where they are quaternions.
        pub rotation_loss: RotationLoss = RotationLoss::Cosine;
        /// Weight of what viewpoints miss, where they are what is guessed.
        pub viewpoint_weight: f64 = 1.0, in 0.0..=1e6;
        /// Weight of the quaternion's length.
        pub camera_length_weight: f64 = 0.1, in 0.0..=1e6;
        /// Weight of the mean length of offsets.
        pub deform_weight: f64 = 0.05, in 0.0..=1e6;
        /// Weight of the Laplacian of the shape.
        pub laplacian_weight: f64 = 6.0, in 0.0..=1e6;
        /// Weight of the Laplacian of the offsets.
        pub laplacian_offsets_weight: f64 = 1.8, in 0.0..=1e6;
        /// Whether both of them count in proportion to the number of faces, as they are given for the 320 of level 2.
        /// The published ones do not: of the same surface, four times as many faces have about a quarter of the
        /// Laplacian, so a finer mesh is smoothed less.
        pub laplacian_by_faces: bool = false;
        /// Weight of the cotangent Laplacian of the shape; 0 published.
        pub cotangent_weight: f64 = 0.0, in 0.0..=1e6;
        /// Weight of the perceptual distance.
        pub percept_weight: f64 = 0.8, in 0.0..=1e6;
        /// Weight of the squared difference of a and b of CIE Lab.
        pub color_weight: f64 = 0.03, in 0.0..=1e6;
        /// Weight of the squared difference of L.
        pub lightness_weight: f64 = 0.005, in 0.0..=1e6;
        /// Weight of what keeps all mean shapes in use: `ln N` less the entropy of the weights' mean over a batch.
        /// Not published.
        pub balance_weight: f64 = 0.0, in 0.0..=1e6;
        /// Weight of the mean entropy of the weights of one image, which makes up the selection's mind. Not
        /// published.
        pub decision_weight: f64 = 0.0, in 0.0..=1e6;
        /// Probability that an image is mirrored, with its camera; 0.5 published.
        pub flip: f64 = 0.5, in 0.0..=1.0;
        /// Probability that a prediction is compared with the mirrored image, which makes shapes symmetric in x; 0.5
        /// published.
        pub prediction_flip: f64 = 0.5, in 0.0..=1.0;
        /// How far the crop is jittered in training, in lengths of the box: its size and its place; 0.05 published.
        pub jitter: f64 = 0.05, in 0.0..=0.5;
        /// Around the object's box, in lengths of the box.
        pub margin: f64 = 0.1, in 0.0..=1.0;
        /// The same of tests and predictions, 0 published; without, that of training and validation.
        #[serde(with = "train::settings::optional")]
        pub test_margin: Option<f64> = None, in 0.0..=1.0;
        /// Whether what is not the object is black before the network sees it, so that a photograph's background does not
        /// matter where masks are known; published is the whole photograph. Images that are black there already stay as they
        /// are.
        pub cut_out: bool = true;
        /// Whether what a mask surrounds is object, as in the masks of instance segmentation: a surface that was a sphere has no
        /// openings, and a mask that one can see through uncovers what is around them too.
        pub fill_holes: bool = false;
        /// One of so many objects is held out where the data has no lists of its own, by a hash of its name: half of these
        /// for validation, half for tests. Without, scores are of what was trained on.
        #[serde(with = "train::settings::optional")]
        pub hold_out: Option<usize> = Some(5), in 2..=LARGEST as usize;
        /// Seed of the data that is made when none is given; without, that of the run, so that each seed learns from its
        /// own.
        #[serde(serialize_with = "train::settings::optional::serialize", deserialize_with = "train::settings::optional::or_zero")]
        pub data_seed: Option<u64> = None, in ..=LARGEST;
        /// Procedural objects of each family to train on when no data is given, each with one photograph.
        pub objects: usize = 100, in 1..=100_000;
        /// Others of each family for validation, by which checkpoints are chosen; without, half as many as `test-objects`.
        #[serde(with = "train::settings::optional")]
        pub validation_objects: Option<usize> = None, in 1..=100_000;
        /// Others of each family that are scored at the end.
        pub test_objects: usize = 20, in 0..=100_000;
        /// The families; empty takes all.
        pub families: Vec<String> = vec!["airplane".to_owned(), "car".to_owned()];
        /// How rough the poses of photographs are that are made, in degrees, per cent of size and hundredths of a
        /// length.
        pub pose_noise: [f64; 3] = [10.0, 10.0, 3.0], in 0.0..=90.0;
    }
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

/// What guesses the direction that an image was taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CameraHead {
    /// One quaternion from the code of the image, as published: of two sides that look alike it can name only one.
    Quaternion,
    /// Several viewpoints by a network of its own, [`nets::ViewpointHead`], of which the outline chooses. Cameras are upright:
    /// what a rough one is turned about its line of sight is lost.
    Viewpoint,
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

impl McmrConfig {
    /// Around the object's box in images of a subset, in lengths of the box.
    pub(super) fn margin_in(&self, subset: Subset) -> f64 {
        let of_tests = self.test_margin.filter(|_| subset == Subset::Test);
        of_tests.unwrap_or(self.margin)
    }

    /// Seed of the data that is made; 0 where neither the options nor a run say one.
    pub fn data_seed(&self) -> u64 {
        self.data_seed.unwrap_or(0)
    }

    /// Procedural objects of each family for training, validation and test.
    pub(super) fn counts(&self) -> [usize; 3] {
        counts(self.objects, self.validation_objects, self.test_objects)
    }

    /// What is wrong, one sentence each; empty when nothing is.
    pub fn check(&self) -> Vec<String> {
        let mut problems = self.out_of_range();
        let side = self.image_size;
        if !side.is_multiple_of(64) {
            problems.push(format!("`image-size` is {side}, expected a multiple of 64"));
        }
        if self.own_cameras_at.is_some() && self.camera_head != CameraHead::Viewpoint {
            let what = "only cameras of the `camera-head` `viewpoint` are drawn with";
            problems.push(format!("`own-cameras-at` is given: {what}"));
        }
        if self.level == 5 && self.subdivide_at.is_some() {
            problems
                .push("`level` is 5, expected at most 4 where `subdivide-at` adds one".to_owned());
        }
        if self.vgg_weights.is_none() != self.lpips_weights.is_none() {
            let what = "one is given, expected both or none";
            problems.push(format!("`vgg-weights` and `lpips-weights`: {what}"));
        }
        if !self.closed_texture && self.renderer != RendererKind::SoftRas {
            let what = "expected true: only the renderer `softras` draws a texture with a seam";
            problems.push(format!("`closed-texture` is false, {what}"));
        }
        let [_, size, place] = self.pose_noise;
        if size > 50.0 || place > 50.0 {
            let what = "at most 50 per cent and 50 hundredths";
            problems.push(format!("`pose-noise` is {:?}, expected {what}", self.pose_noise));
        }
        problems.extend(
            families_named(&self.families).err().map(|error| format!("`families`: {error}")),
        );
        problems
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
