//! What turns pictures into features.

use autodiff_lite::{Activation, ConvGeometry, PoolGeometry, Var, impl_module};
use nets::{Conv2d, Indexed, Init, SmallCnn};

use super::config::{EncoderKind, Img2MeshConfig};

/// One of the encoders.
#[derive(Clone, Debug)]
pub(super) struct Encoder {
    small: Option<SmallCnn>,
    cnn: Option<Narrowing>,
}
impl_module!(Encoder: f32 { small, cnn });

impl Encoder {
    pub(super) fn new(init: &Init, config: &Img2MeshConfig) -> Self {
        match config.encoder {
            EncoderKind::Small => {
                let small = SmallCnn::new(&init.at("small"), 3, config.features);
                Self { small: Some(small), cnn: None }
            }
            EncoderKind::Cnn => Self { small: None, cnn: Some(Narrowing::new(&init.at("cnn"))) },
        }
    }

    /// `[M, S, S, 3]` to `[M, D]`.
    pub(super) fn forward<'t>(&self, images: Var<'t>) -> Var<'t> {
        match (&self.small, &self.cnn) {
            (Some(net), _) => net.forward(images),
            (_, Some(net)) => net.forward(images),
            _ => unreachable!("one encoder is made"),
        }
    }
}

/// The published CNN: VGG16 through its third pooling, then four convolutions that narrow its 256
/// channels to one.
#[derive(Clone, Debug)]
struct Narrowing {
    /// Under the indices that they have in torchvision's VGG16.
    features: Indexed<Conv2d>,
    narrow: Vec<Conv2d>,
}
impl_module!(Narrowing: f32 { features, narrow });

/// Index, channels in and out; a pooling follows where the second number of a block says so.
const FEATURES: [(usize, usize, usize, bool); 7] = [
    (0, 3, 64, false),
    (2, 64, 64, true),
    (5, 64, 128, false),
    (7, 128, 128, true),
    (10, 128, 256, false),
    (12, 256, 256, false),
    (14, 256, 256, true),
];
const NARROW: [usize; 5] = [256, 64, 16, 4, 1];

impl Narrowing {
    fn new(init: &Init) -> Self {
        let same = ConvGeometry::new().padding(1);
        let (features, narrow) = (init.at("features"), init.at("narrow"));
        let feature = |&(index, inputs, outputs, _): &(usize, usize, usize, bool)| {
            let at = features.index(index);
            let conv = Conv2d::new(&at, inputs, outputs, 3, same);
            // As torchvision begins: a plain uniform start dies out through seven layers.
            let weight = at.at("weight").kaiming_normal(
                conv.weight.shape(),
                nets::FanMode::Out,
                nets::Nonlinearity::Relu,
            );
            (index, Conv2d { weight, bias: Some(at.at("bias").zeros(&[outputs])), ..conv })
        };
        Self {
            features: Indexed(FEATURES.iter().map(feature).collect()),
            narrow: (0..4)
                .map(|i| Conv2d::new(&narrow.index(i), NARROW[i], NARROW[i + 1], 3, same))
                .collect(),
        }
    }

    /// `[M, S, S, 3]` to `[M, S² / 64]`.
    fn forward<'t>(&self, images: Var<'t>) -> Var<'t> {
        let mut x = images;
        for (conv, (.., pooled)) in self.features.iter().zip(FEATURES) {
            x = conv.forward_then(x, Activation::Relu);
            if pooled {
                x = x.max_pool2d(PoolGeometry::square(2));
            }
        }
        let leaky = Activation::LeakyRelu(0.01);
        let x = self.narrow.iter().fold(x, |x, conv| conv.forward_then(x, leaky));
        let [m, h, w, _] = x.dims();
        x.reshape(&[m, h * w])
    }
}
