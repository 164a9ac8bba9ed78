//! What img2mesh can be told, beside the loop's own options.

use serde::{Deserialize, Serialize};
use synth::families_named;
use train::settings::{LARGEST, Options as _, above_to};

use crate::parts::counts;

train::options! {
    /// Options of the model, its losses and its data. Lengths are relative to the frame of the data, in
    /// which the object has about radius 1.
    #[serde(deny_unknown_fields)]
    pub struct Img2MeshConfig {
        /// What turns an image into features.
        pub encoder: EncoderKind = EncoderKind::Small;
        /// Features of the encoders `small` and `none`; the others' follow from their layers.
        pub features: usize = 256, in 1..=8192;
        /// Whether the encoder stays as it begins, of `cnn` the part that is VGG16's: sensible with `weights`, else
        /// it is a random projection. Features of an image are then computed once, but for `cnn`.
        pub freeze_encoder: bool = false;
        /// A file with weights for the encoder (`vgg16`, `cnn`): torchvision's `vgg16` as `.pth` or safetensors.
        /// Without, the encoder begins at random.
        #[serde(with = "train::settings::optional")]
        pub weights: Option<String> = None;
        /// Whether `vgg16` and `cnn` see images less ImageNet's mean colour over its deviation, as torchvision's
        /// weights expect. The published code does not.
        pub normalize: bool = true;
        /// Side of the encoder's images, pixels, of `vgg16` at least 32.
        pub image_size: usize = 128, in 16..=1024;
        /// Side of the renderings that are compared, pixels.
        pub render_size: usize = 128, in 8..=2048;
        /// Whether all that is not the object is made black before images are given and compared. The published code
        /// leaves them as they are.
        pub mask_images: bool = true;
        /// Views that a mesh is made from in training; elsewhere any number will do.
        pub views: usize = 2, in 1..=64;
        /// Whether each step gives another number of them, 1 to `views`; the others are then only compared with.
        pub vary_views: bool = false;
        /// Views more, not given to the model, that the mesh is compared with.
        pub extra_views: usize = 0, in 0..=64;
        /// What mixes the views.
        pub attention: AttentionKind = AttentionKind::Views;
        /// Layers of attention.
        pub layers: usize = 1, in 1..=16;
        /// Heads of attention.
        pub heads: usize = 2, in 1..=16_384;
        /// Columns between the two linear layers behind the attention.
        pub feed_forward: usize = 512, in 1..=65536;
        /// Share of what is forgotten in the attention's layers while training.
        pub dropout: f64 = 0.1, in 0.0..1.0;
        /// Whether each view's camera is told to the model.
        pub camera_embedding: bool = false;
        /// Subdivision level of the icosphere; 3 has 642 vertices.
        pub level: u32 = 3, in 0..=5;
        /// How many coarser levels have offsets of their own, which are carried to the finest and added there; 0 is
        /// the finest alone, as published.
        pub coarse_levels: u32 = 0, in 0..=5;
        /// How many stages look at the views where each vertex is seen and move it from there: the first on the mesh that the whole
        /// images gave, each other on the next finer level, the last on `level`. 0 is as published. They take maps of the encoder
        /// `small`, and the cameras of the views.
        pub stages: usize = 0, in 0..=5;
        /// Features of a vertex in the stages.
        pub vertex_features: usize = 96, in 1..=4096;
        /// Heads of the attention over the views at a vertex.
        pub vertex_heads: usize = 4, in 1..=4096;
        /// Graph convolutions of a stage.
        pub graph_convolutions: usize = 4, in 1..=64;
        /// After how many epochs each the next finer level comes in; without, all are there from the start.
        #[serde(with = "train::settings::optional")]
        pub refine_every: Option<u64> = None, in 1..=LARGEST;
        /// Whether the frame is about the origin of the data's world, as published, instead of the point that the cameras
        /// look at.
        pub world_origin: bool = false;
        /// Radius of the icosphere before it is deformed.
        pub radius: f64 = 0.6, in 1e-3..=10.0;
        /// What the heads of offsets and of the place put out is multiplied by, their first weights being divided by it.
        /// It changes nothing but how far a step of Adam moves the mesh: published heads speak the clock's unit, in
        /// which the sphere has radius 37.5, which is 0.016 for a sphere of radius 0.6, and a step of 1e-5 is as much
        /// smaller.
        pub offset_scale: f64 = 1.0, in above_to(0.0, 1e3);
        /// How large the first weights of the head for colours are beside PyTorch's. Nearly 0 begins nearly grey; as
        /// published, at 1, each vertex has a colour of its own, which takes longer to unlearn than the right one to
        /// learn.
        pub first_colors: f64 = 0.05, in above_to(0.0, 1e3);
        /// What the learning rate of the head for colours is multiplied by.
        pub color_rate: f64 = 1.0, in 0.0..=1e3;
        /// Weight of the mean absolute difference of colours.
        pub image_weight: f64 = 0.1, in 0.0..=1e6;
        /// Weight of one minus the masks' soft intersection over union.
        pub mask_weight: f64 = 10.0, in 0.0..=1e6;
        /// Weight of the face-angle loss.
        pub flat_weight: f64 = 1e-3, in 0.0..=1e6;
        /// Weight of the sum of squared edge lengths. The published 1e-8 is of a sphere of radius 37.5: of one of
        /// radius 0.6, whose squares are 62.5² times smaller, 3.90625e-5 says the same.
        pub edge_weight: f64 = 3.90625e-5, in 0.0..=1e6;
        /// Weight of the bending energy of the deformation, of every mesh on the way: the mean square of its Laplacian over the
        /// fourth power of an edge of the sphere's, which is the same at each level.
        pub bending_weight: f64 = 0.0, in 0.0..=1e6;
        /// Whether what passes through itself is moved apart in the mesh that the network puts out
        /// (`mesh_core::TriMesh::untangle`), before it is scored or written.
        pub untangle: bool = false;
        /// What the loss of the masks counts of each mesh before the last stage's.
        pub early_weight: f64 = 0.3, in 0.0..=1.0;
        /// Whether DIB-R draws by its published rules (`diff_raster::Settings::published`): colours
        /// linear on the screen, no near plane, faces that turn away invisible, a silhouette of at most 30 faces a
        /// pixel, the first by their numbers.
        pub published_rules: bool = false;
        /// The silhouette that is compared with masks.
        pub silhouette: SilhouetteKind = SilhouetteKind::Soft;
        /// Sharpness of the soft silhouette.
        pub sigma_inv: f64 = 7000.0, in 1.0..=1e6;
        /// How far the soft silhouette reaches, NDC.
        pub reach: f64 = 0.02, in 1e-3..=2.0;
        /// Of a single object every so many-th view is held out; of many, where the data has no lists of its own, one of so
        /// many by a hash of its name. Half of these are for validation, half for tests; without, scores are of what was
        /// trained on. Each half of the views should be more than are given: where no other is left, the given ones are
        /// scored.
        #[serde(with = "train::settings::optional")]
        pub hold_out: Option<usize> = Some(5), in 2..=LARGEST as usize;
        /// Views that are made of a clock when no data is given, or of each object.
        pub synthetic_views: usize = 100, in 4..=10_000;
        /// Seed of the data that is made when none is given; without, that of the run, so that each seed learns from its
        /// own.
        #[serde(serialize_with = "train::settings::optional::serialize", deserialize_with = "train::settings::optional::or_zero")]
        pub data_seed: Option<u64> = None, in ..=LARGEST;
        /// Procedural objects of each family to train on when no data is given; without, a single clock.
        #[serde(with = "train::settings::optional")]
        pub objects: Option<usize> = None, in 1..=100_000;
        /// Whether each of them is turned about the vertical by an angle of its own, so that the mesh cannot be had
        /// without the cameras (`camera-embedding`).
        pub turned: bool = false;
        /// How far each of them may be set down beside the middle along each axis, in lengths of an object: where it
        /// is can only be known with the cameras.
        pub placed: f64 = 0.0, in 0.0..=1.0;
        /// Others of each family for validation, by which checkpoints are chosen; without, half as many as `test-objects`.
        #[serde(with = "train::settings::optional")]
        pub validation_objects: Option<usize> = None, in 1..=100_000;
        /// Others of each family that are scored at the end.
        pub test_objects: usize = 10, in 0..=100_000;
        /// The families; empty takes all.
        pub families: Vec<String> = Vec::new();
    }
}

/// What turns an image into features.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EncoderKind {
    /// Four strided convolutions with group norm, then a linear layer: learns from scratch.
    Small,
    /// The published CNN: VGG16 through its third pooling, four narrowing convolutions.
    Cnn,
    /// The published base model's: VGG16 to its first 4,096 features.
    Vgg16,
    /// Looks at no image: the mean shape that the losses settle on, to compare with.
    None,
}

/// What mixes the views.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AttentionKind {
    /// Attention over the views of an object, as the paper describes.
    Views,
    /// Attention over the objects of a batch, view by view, as the published code computes.
    Published,
    /// None: the mean over the views alone.
    Mean,
}

/// The silhouette that is compared with masks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SilhouetteKind {
    /// DIB-R's, which pulls at pixels outside and knows none inside.
    Soft,
    /// Exact at the outline, with pulls on both of its sides; none from afar.
    Antialiased,
}

/// Vertices of an icosphere.
pub(super) fn vertices(level: u32) -> usize {
    10 * 4_usize.pow(level) + 2
}

impl Img2MeshConfig {
    /// Features of an image: `D`.
    pub fn width(&self) -> usize {
        match self.encoder {
            EncoderKind::Small | EncoderKind::None => self.features,
            // Asked of sizes that are not checked yet, too.
            EncoderKind::Cnn => (self.image_size / 8).saturating_pow(2),
            EncoderKind::Vgg16 => 4096,
        }
    }

    /// Features that a stage finds at the vertices: of the whole images before the first one.
    pub(super) fn left(&self, stage: usize) -> usize {
        if stage == 0 { self.width() } else { self.vertex_features }
    }

    /// Vertices of the mesh.
    pub fn vertices(&self) -> usize {
        vertices(self.level)
    }

    /// The level of the mesh that the whole images give, which the first stage begins with.
    pub(super) fn base_level(&self) -> u32 {
        self.level.saturating_sub(self.stages.saturating_sub(1) as u32)
    }

    /// The coarsest level that has offsets of its own.
    pub(super) fn coarsest(&self) -> u32 {
        self.base_level().saturating_sub(self.coarse_levels)
    }

    /// Seed of the data that is made; 0 where neither the options nor a run say one.
    pub fn data_seed(&self) -> u64 {
        self.data_seed.unwrap_or(0)
    }

    /// Procedural objects of each family for training, validation and test.
    pub(super) fn counts(&self, objects: usize) -> [usize; 3] {
        counts(objects, self.validation_objects, self.test_objects)
    }

    /// What is wrong, one sentence each; empty when nothing is.
    pub fn check(&self) -> Vec<String> {
        let mut problems = self.out_of_range();
        let mut require = |holds: bool, key: &str, found: &dyn std::fmt::Display, what: &str| {
            if !holds {
                problems.push(format!("`{key}` is {found}, expected {what}"));
            }
        };
        let coarser = self.coarse_levels;
        let most = self.level.saturating_sub(self.stages.saturating_sub(1) as u32);
        let what = "at most `level`, less the stages beyond the first";
        require(coarser <= most, "coarse-levels", &coarser, what);
        let fits = self.stages <= self.level as usize + 1;
        require(fits, "stages", &self.stages, "at most `level` + 1");
        let small = self.stages == 0 || self.encoder == EncoderKind::Small;
        require(small, "stages", &self.stages, "0 for this encoder, which has no maps to look at");
        let learns = self.stages == 0 || !self.freeze_encoder;
        require(learns, "freeze-encoder", &self.freeze_encoder, "false with `stages`");
        let divides = self.vertex_features.is_multiple_of(self.vertex_heads.max(1));
        let what = format!("a divisor of the {} features of a vertex", self.vertex_features);
        require(divides, "vertex-heads", &self.vertex_heads, &what);
        let looks = matches!(self.encoder, EncoderKind::Vgg16 | EncoderKind::Cnn);
        let weights = self.weights.as_deref().unwrap_or_default();
        let what = "nothing: only the encoders `vgg16` and `cnn` can be loaded";
        require(weights.is_empty() || looks, "weights", &weights, what);
        let fits = self.encoder != EncoderKind::Vgg16 || self.image_size >= 32;
        require(fits, "image-size", &self.image_size, "at least 32 for this encoder");
        let weights = [self.image_weight, self.mask_weight, self.flat_weight, self.edge_weight];
        let some = weights.iter().any(|&weight| weight > 0.0);
        require(some, "mask-weight", &self.mask_weight, "a weight that is not 0");
        let width = self.width();
        let divides = self.heads > 0 && width.is_multiple_of(self.heads);
        require(divides, "heads", &self.heads, &format!("a divisor of the {width} features"));
        problems.extend(
            families_named(&self.families).err().map(|error| format!("`families`: {error}")),
        );
        problems
    }
}
