//! Networks that compare images and are not trained.

use autodiff_lite::{Module, Tape, Var};
use nets::{InceptionKind, InceptionV3, Init, LoadWeights, LpipsWeights, Vgg16, freeze};
use train::DataError;

use super::config::McmrConfig;
use crate::pretrained::unusable;

/// Levels of the pyramid that stands in for LPIPS.
const LEVELS: usize = 4;
/// Blocks of VGG16 up to its last maps before a pool.
const POOLS: usize = 5;

/// What the user has weights for.
#[derive(Debug, Default)]
pub struct PerceptualMetrics {
    lpips: Option<(Vgg16, LpipsWeights)>,
    /// Whether LPIPS is given what it does not expect.
    from_zero: bool,
    inception: Option<InceptionV3>,
}

impl PerceptualMetrics {
    /// Reads the files that a configuration names.
    ///
    /// # Errors
    /// If a file is damaged or lacks something.
    pub(super) fn open(config: &McmrConfig) -> Result<Self, DataError> {
        fn loaded<M: Module<f32>>(mut net: M, path: &str) -> Result<M, DataError> {
            let done = LoadWeights::partial().load(path, &mut net);
            done.map_err(unusable)?;
            freeze(&mut net, "");
            Ok(net)
        }
        let init = Init::new(0);
        let files = config.vgg_weights.as_ref().zip(config.lpips_weights.as_ref());
        let lpips = files
            .map(|(vgg, lpips)| {
                let vgg = loaded(Vgg16::features_until_pool(&init, POOLS), vgg)?;
                Ok::<_, DataError>((vgg, loaded(LpipsWeights::uniform(), lpips)?))
            })
            .transpose()?;
        let inception = config.inception_weights.as_ref();
        let inception = inception
            .map(|path| loaded(InceptionV3::new(&init, InceptionKind::Fid), path))
            .transpose()?;
        Ok(Self { lpips, from_zero: config.lpips_from_zero, inception })
    }

    /// How unlike images `[N, S, S, 3]` in `[0, 1]` look: LPIPS, or a pyramid of differences without its
    /// weights. LPIPS is given images in `[-1, 1]`, as it expects, or in `[0, 1]`, as the published code gives it.
    pub(super) fn distance<'t>(&self, image: Var<'t>, target: Var<'t>) -> Var<'t> {
        let Some((vgg, weights)) = &self.lpips else {
            return losses::pyramid(image, target, None, LEVELS);
        };
        let maps = |x: Var<'t>| {
            let x = if self.from_zero { x } else { x.scale(2.0).add_scalar(-1.0) };
            vgg.forward_before_pools(LpipsWeights::normalized(x))
        };
        losses::lpips(&maps(image), &maps(target), &weights.vectors())
    }

    /// Inception's features `[N, 2048]` of images `[N, S, S, 3]` in `[0, 1]`; none without its weights.
    pub(super) fn features(&self, tape: &Tape, images: Var<'_>) -> Option<Vec<f32>> {
        let net = self.inception.as_ref()?;
        let images = tape.constant(images.value());
        Some(net.forward(images).value().iter().copied().collect())
    }
}
