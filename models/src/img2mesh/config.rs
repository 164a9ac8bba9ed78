//! What img2mesh can be told, beside the loop's own options.

use serde::{Deserialize, Serialize};
use synth::families_named;
use train::Summary;
use train::settings::in_toml;

/// Options of the model, its losses and its data. Lengths are relative to the frame of the data, in
/// which the object has about radius 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of its own")]
pub struct Img2MeshConfig {
    /// What turns an image into features. Default `"small"`.
    pub encoder: EncoderKind,
    /// Features of the encoders `small` and `none`, 1 to 8192; the others' follow from their layers.
    /// Default 256.
    pub features: usize,
    /// Whether the encoder stays as it begins, of `cnn` the part that is VGG16's: sensible with
    /// `weights`, else it is a random projection. Features of an image are then computed once,
    /// but for `cnn`. Default false.
    pub freeze_encoder: bool,
    /// A file with weights for the encoder (`vgg16`, `cnn`): torchvision's `vgg16` as `.pth` or
    /// safetensors. Empty for none: the encoder begins at random. Default empty.
    pub weights: String,
    /// Whether `vgg16` and `cnn` see images less ImageNet's mean colour over its deviation, as
    /// torchvision's weights expect. The published code does not. Default true.
    pub normalize: bool,
    /// Side of the encoder's images, pixels, 16 (`vgg16`: 32) to 1024. Default 128.
    pub image_size: usize,
    /// Side of the renderings that are compared, pixels, 8 to 2048. Default 128.
    pub render_size: usize,
    /// Views that a mesh is made from in training, 1 to 64; elsewhere any number will do. Default 2.
    pub views: usize,
    /// Whether each step gives another number of them, 1 to `views`; the others are then only
    /// compared with. Default false.
    pub vary_views: bool,
    /// Views more, not given to the model, that the mesh is compared with. Default 0.
    pub extra_views: usize,
    /// What mixes the views. Default `"views"`.
    pub attention: AttentionKind,
    /// Layers of attention. Default 1.
    pub layers: usize,
    /// Heads of attention. Default 2.
    pub heads: usize,
    /// Columns between the two linear layers behind the attention. Default 512.
    pub feed_forward: usize,
    /// Share of what is forgotten in the attention's layers while training. Default 0.1.
    pub dropout: f64,
    /// Whether each view's camera is told to the model. Default false.
    pub camera_embedding: bool,
    /// Subdivision level of the icosphere, 0 to 5. Default 3: 642 vertices.
    pub level: u32,
    /// How many coarser levels have offsets of their own, which are carried to the finest and
    /// added there. Default 0: the finest alone, as published.
    pub coarse_levels: u32,
    /// After how many epochs each the next finer level comes in; 0 is all from the start.
    /// Default 0.
    pub refine_every: u64,
    /// Radius of the icosphere before it is deformed. Default 0.6.
    pub radius: f64,
    /// What the step length of the head for colours is multiplied by, 0 to 1000. Default 1.
    pub color_rate: f64,
    /// Weight of the mean absolute difference of colours. Default 0.1.
    pub image_weight: f64,
    /// Weight of one minus the masks' soft intersection over union. Default 10.
    pub mask_weight: f64,
    /// Weight of the face-angle loss. Default 1e-3.
    pub flat_weight: f64,
    /// Weight of the sum of squared edge lengths. The published 1e-8 is of a sphere of radius
    /// 37.5, which is 1.4e-5 here. Default 1.4e-5.
    pub edge_weight: f64,
    /// The silhouette that is compared with masks. Default `"soft"`.
    pub silhouette: SilhouetteKind,
    /// Sharpness of the soft silhouette. Default 7000.
    pub sigma_inv: f64,
    /// How far the soft silhouette reaches, NDC. Default 0.02.
    pub reach: f64,
    /// Every how many views (of a single object) or objects one is held out, at least 2; 0 is none,
    /// and scores are then of what was trained on. Of a single object more views should be held
    /// out than are given: where no other is left, the given ones are scored. Default 5.
    pub hold_out: usize,
    /// Views that are made of a clock when no data is given, or of each object. Default 100.
    pub synthetic_views: usize,
    /// Seed of the data that is made when none is given; that of the run decides all else.
    /// Default 0.
    pub data_seed: u64,
    /// Procedural objects of each family to train on when no data is given; 0 takes a single clock.
    /// Default 0.
    pub objects: usize,
    /// Whether each of them is turned about the vertical by an angle of its own, so that the mesh
    /// cannot be had without the cameras (`camera-embedding`). Default false.
    pub turned: bool,
    /// How far each of them may be set down beside the middle along each axis, in lengths of an object, 0 to 1: where it
    /// is can only be known with the cameras. Default 0.
    pub placed: f64,
    /// More of each family that are held out. Default 10.
    pub test_objects: usize,
    /// The families; empty takes all. Default empty.
    pub families: Vec<String>,
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
fn vertices(level: u32) -> usize {
    10 * 4_usize.pow(level) + 2
}

impl Default for Img2MeshConfig {
    fn default() -> Self {
        Self {
            encoder: EncoderKind::Small,
            features: 256,
            freeze_encoder: false,
            weights: String::new(),
            normalize: true,
            image_size: 128,
            render_size: 128,
            views: 2,
            vary_views: false,
            extra_views: 0,
            attention: AttentionKind::Views,
            layers: 1,
            heads: 2,
            feed_forward: 512,
            dropout: 0.1,
            camera_embedding: false,
            level: 3,
            coarse_levels: 0,
            refine_every: 0,
            radius: 0.6,
            color_rate: 1.0,
            image_weight: 0.1,
            mask_weight: 10.0,
            flat_weight: 1e-3,
            edge_weight: 1.4e-5,
            silhouette: SilhouetteKind::Soft,
            sigma_inv: 7000.0,
            reach: 0.02,
            hold_out: 5,
            synthetic_views: 100,
            data_seed: 0,
            objects: 0,
            turned: false,
            placed: 0.0,
            test_objects: 10,
            families: Vec::new(),
        }
    }
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

    /// Vertices of the mesh.
    pub fn vertices(&self) -> usize {
        vertices(self.level)
    }

    /// The coarsest level that has offsets of its own.
    pub(super) fn coarsest(&self) -> u32 {
        self.level.saturating_sub(self.coarse_levels)
    }

    /// Ranges, shapes and numbers of parameters.
    ///
    /// # Errors
    /// What is wrong, one sentence each.
    pub fn check(&self) -> Result<Summary, Vec<String>> {
        let mut problems = Vec::new();
        let mut require = |holds: bool, field: &str, found: &dyn std::fmt::Display, what: &str| {
            if !holds {
                problems.push(format!("`{field}` is {found}, expected {what}"));
            }
        };
        let count = |n: usize, low: usize, high: usize| (low..=high).contains(&n);
        require(count(self.features, 1, 8192), "features", &self.features, "1 to 8192");
        require(self.image_size <= 1024, "image-size", &self.image_size, "at most 1024");
        require(count(self.render_size, 8, 2048), "render-size", &self.render_size, "8 to 2048");
        require(count(self.views, 1, 64), "views", &self.views, "1 to 64");
        require(count(self.extra_views, 0, 64), "extra-views", &self.extra_views, "0 to 64");
        require(count(self.layers, 1, 16), "layers", &self.layers, "1 to 16");
        require(self.level <= 5, "level", &self.level, "0 to 5");
        require(
            count(self.feed_forward, 1, 65536),
            "feed-forward",
            &self.feed_forward,
            "1 to 65536",
        );
        require((0.0..1.0).contains(&self.dropout), "dropout", &self.dropout, "0 to less than 1");
        let held = self.hold_out;
        require(held != 1 && in_toml(held), "hold-out", &held, "0 (none) or 2 to 2^63 - 1");
        let refine = self.refine_every;
        require(in_toml(refine), "refine-every", &refine, "at most 2^63 - 1");
        let synthetic = self.synthetic_views;
        require(count(synthetic, 4, 10_000), "synthetic-views", &synthetic, "4 to 10000");
        let seed = self.data_seed;
        require(in_toml(seed), "data-seed", &seed, "at most 2^63 - 1");
        require(count(self.objects, 0, 100_000), "objects", &self.objects, "0 to 100000");
        let tested = &self.test_objects;
        require(count(*tested, 0, 100_000), "test-objects", tested, "0 to 100000");
        let coarser = self.coarse_levels;
        require(coarser <= self.level, "coarse-levels", &coarser, "at most `level`");
        let looks = matches!(self.encoder, EncoderKind::Vgg16 | EncoderKind::Cnn);
        require(
            self.weights.is_empty() || looks,
            "weights",
            &self.weights,
            "nothing: only the encoders `vgg16` and `cnn` can be loaded",
        );
        let least = if self.encoder == EncoderKind::Vgg16 { 32 } else { 16 };
        require(
            self.image_size >= least,
            "image-size",
            &self.image_size,
            &format!("at least {least} for this encoder"),
        );
        let mut within = |v: f64, low: f64, high: f64, field: &str| {
            require(v >= low && v <= high, field, &v, &format!("{low} to {high}"));
        };
        within(self.radius, 1e-3, 10.0, "radius");
        within(self.color_rate, 0.0, 1e3, "color-rate");
        within(self.sigma_inv, 1.0, 1e6, "sigma-inv");
        within(self.reach, 1e-3, 2.0, "reach");
        within(self.placed, 0.0, 1.0, "placed");
        for (weight, field) in [
            (self.image_weight, "image-weight"),
            (self.mask_weight, "mask-weight"),
            (self.flat_weight, "flat-weight"),
            (self.edge_weight, "edge-weight"),
        ] {
            within(weight, 0.0, 1e6, field);
        }
        let all_off = [self.image_weight, self.mask_weight, self.flat_weight, self.edge_weight];
        require(all_off.iter().any(|&w| w > 0.0), "mask-weight", &0, "a weight that is not 0");
        let width = self.width();
        let divides = self.heads > 0 && width.is_multiple_of(self.heads);
        require(divides, "heads", &self.heads, &format!("a divisor of the {width} features"));
        problems.extend(
            families_named(&self.families).err().map(|error| format!("`families`: {error}")),
        );
        if problems.is_empty() { Ok(self.summary()) } else { Err(problems) }
    }

    fn summary(&self) -> Summary {
        let (d, v) = (self.width(), self.vertices());
        let linear = |inputs: usize, outputs: usize| outputs * (inputs + 1);
        let conv =
            |pairs: &[[usize; 2]]| -> usize { pairs.iter().map(|p| linear(9 * p[0], p[1])).sum() };
        let front = [[3, 64], [64, 64], [64, 128], [128, 128], [128, 256], [256, 256], [256, 256]];
        let encoder = match self.encoder {
            EncoderKind::Small => {
                // Instead of a bias each channel has the two numbers of its norm.
                let convs = conv(&[[3, 32], [32, 64], [64, 128], [128, 256]]);
                convs + (32 + 64 + 128 + 256) + linear(4096, d) + 2 * d
            }
            EncoderKind::Cnn => conv(&front) + conv(&[[256, 64], [64, 16], [16, 4], [4, 1]]),
            EncoderKind::Vgg16 => {
                let deep = [[256, 512], [512, 512], [512, 512]];
                let last = [[512, 512]; 3];
                conv(&front) + conv(&deep) + conv(&last) + linear(7 * 7 * 512, d)
            }
            EncoderKind::None => 0,
        };
        let f = self.feed_forward;
        let layer = 4 * linear(d, d) + linear(d, f) + linear(f, d) + 4 * d;
        let mean = self.attention == AttentionKind::Mean;
        let attention = if mean { 0 } else { self.layers * layer };
        let camera = if self.camera_embedding { linear(12, d) } else { 0 };
        let coarse: usize =
            (self.coarsest()..self.level).map(|level| linear(d, 3 * vertices(level))).sum();
        let heads = 2 * linear(d, 3 * v) + linear(d, 3) + coarse;
        let frozen = match self.encoder {
            _ if !self.freeze_encoder => 0,
            EncoderKind::Cnn => conv(&front),
            _ => encoder,
        };
        let trainable = encoder - frozen + attention + camera + linear(d, d) + heads;
        let shapes = [
            ("images", format!("[N V, {0}, {0}, 3]", self.image_size)),
            ("features", format!("[N, V, {d}]")),
            ("mesh", format!("[N, {v}, 3] positions and colours, {} faces", 2 * v - 4)),
            ("renderings", format!("[N V, {0}, {0}, 3]", self.render_size)),
        ];
        // Beside the weights stands the frame of the data, four numbers.
        let shapes = shapes.map(|(name, shape)| (name.to_owned(), shape)).into();
        Summary { trainable, frozen: frozen + 4, shapes }
    }
}
