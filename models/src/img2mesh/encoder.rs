//! What turns images into features.

use autodiff_lite::{Var, impl_module};
use ndarray::Array2;
use nets::{
    ConvFrontEnd, Init, LoadWeights, SmallCnn, Vgg16, WeightsError, freeze, imagenet_normalized,
};

use super::config::{EncoderKind, Img2MeshConfig};

/// One of the encoders.
#[derive(Clone, Debug)]
pub(super) struct Encoder {
    pub(super) small: Option<SmallCnn>,
    pub(super) cnn: Option<ConvFrontEnd>,
    pub(super) vgg: Option<Vgg16>,
    width: usize,
    pub(super) normalize: bool,
}
impl_module!(Encoder: f32 { small, cnn, vgg } fixed { width, normalize });

impl Encoder {
    pub(super) fn new(init: &Init, config: &Img2MeshConfig) -> Self {
        let kind = config.encoder;
        let is = |other: EncoderKind| (kind == other).then_some(());
        let mut encoder = Self {
            small: is(EncoderKind::Small)
                .map(|()| SmallCnn::new(&init.at("small"), 3, config.features)),
            cnn: is(EncoderKind::Cnn).map(|()| ConvFrontEnd::new(&init.at("cnn"))),
            vgg: is(EncoderKind::Vgg16).map(|()| Vgg16::cut(&init.at("vgg"), 1)),
            width: config.width(),
            normalize: config.normalize,
        };
        if config.freeze_encoder {
            // The four convolutions that narrow the CNN's features have no pretrained weights.
            let part = if config.encoder == EncoderKind::Cnn { "cnn.features" } else { "" };
            freeze(&mut encoder, part);
        }
        encoder
    }

    /// Whether nothing of it is trained.
    pub(super) fn is_frozen(config: &Img2MeshConfig) -> bool {
        config.freeze_encoder && config.encoder != EncoderKind::Cnn
    }

    /// Fills the part that is VGG16's with weights under torchvision's names.
    ///
    /// # Errors
    /// If the file is damaged, or lacks what this encoder has.
    pub(super) fn load(&mut self, path: &str) -> Result<(), WeightsError> {
        if let Some(cnn) = &mut self.cnn {
            let below = LoadWeights::partial().map("features.=").expect("a sound rule");
            below.load(path, &mut cnn.features)?;
        }
        if let Some(vgg) = &mut self.vgg {
            LoadWeights::partial().load(path, vgg)?;
        }
        Ok(())
    }

    /// `[M, S, S, 3]` to `[M, D]`.
    pub(super) fn forward<'t>(&self, images: Var<'t>) -> Var<'t> {
        match (&self.small, &self.cnn, &self.vgg) {
            (Some(net), ..) => net.forward(images),
            (_, Some(net), _) => net.forward(self.normalized(images)),
            (.., Some(net)) => net.forward(self.normalized(images)),
            _ => {
                let count = images.shape()[0];
                images.tape().constant(Array2::zeros((count, self.width)))
            }
        }
    }

    /// Maps of the encoder `small`, finest first, and the features `[M, D]` that follow from them; no maps of the others.
    pub(super) fn maps<'t>(&self, images: Var<'t>) -> (Vec<Var<'t>>, Var<'t>) {
        match &self.small {
            Some(net) => {
                let maps = net.maps(images);
                let features = net.features(&maps);
                (maps, features)
            }
            None => (Vec::new(), self.forward(images)),
        }
    }

    fn normalized<'t>(&self, images: Var<'t>) -> Var<'t> {
        if self.normalize { imagenet_normalized(images) } else { images }
    }
}
