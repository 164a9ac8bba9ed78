//! The transformer's encoder layer, and a stack of them.

use autodiff_lite::{Activation, LinearThen, Real, Tensor, Var, impl_module};

use crate::{Dropout, Init, LayerNorm, Linear, MultiHeadAttention};

/// Where the norms of a transformer layer stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NormPlacement {
    /// After each sum, as published and as PyTorch's default.
    Post,
    /// Before attention and feed-forward layer (`norm_first=True`): easier to train when deep.
    Pre,
}

/// What stands between the two feed-forward layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeedForward {
    /// `max(x, 0)`, PyTorch's default.
    Relu,
    /// `x Φ(x)`, exact.
    Gelu,
}

/// The sizes and choices of a [`TransformerEncoderLayer`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransformerConfig {
    /// D.
    pub width: usize,
    /// The number of heads; it divides `D`.
    pub heads: usize,
    /// Columns between the feed-forward layers.
    pub hidden: usize,
    /// Of attention probabilities, of the hidden columns and of both branches.
    pub dropout: f64,
    /// Where the norms stand.
    pub norm: NormPlacement,
    /// What stands between the feed-forward layers.
    pub feed_forward: FeedForward,
}

impl TransformerConfig {
    /// PyTorch's defaults: 2048 hidden columns, dropout 0.1, norms after the sums, ReLU.
    pub fn new(width: usize, heads: usize) -> Self {
        Self {
            width,
            heads,
            hidden: 2048,
            dropout: 0.1,
            norm: NormPlacement::Post,
            feed_forward: FeedForward::Relu,
        }
    }
}

/// One layer of a transformer's encoder, as `torch.nn.TransformerEncoderLayer(batch_first=True)`.
///
/// ```text
/// post   x ← norm1(x + drop(attention(x)))      x ← norm2(x + drop(W₂ drop(f(W₁ x))))
/// pre    x ← x + drop(attention(norm1(x)))      x ← x + drop(W₂ drop(f(W₁ norm2(x))))
/// ```
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{Init, TransformerConfig, TransformerEncoderLayer};
///
/// let config = TransformerConfig { hidden: 64, ..TransformerConfig::new(32, 2) };
/// let layer = TransformerEncoderLayer::<f32>::new(&Init::new(0), &config);
/// let tape = Tape::train(0);
/// let views = tape.constant(ndarray::Array3::zeros((1, 3, 32)));
/// assert_eq!(layer.forward(views, None).shape(), [1, 3, 32]);
/// ```
///
/// # References
/// Vaswani et al. 2017, *Attention is all you need*, section 3.1; Xiong et al. 2020, *On layer
/// normalization in the transformer architecture* (pre-norm); Hendrycks and Gimpel 2016, *Gaussian
/// error linear units*.
#[derive(Clone, Debug)]
pub struct TransformerEncoderLayer<F: Real = f32> {
    /// Attention of the tokens to each other.
    pub self_attn: MultiHeadAttention<F>,
    /// To the hidden columns.
    pub linear1: Linear<F>,
    /// And back.
    pub linear2: Linear<F>,
    /// Of the attention.
    pub norm1: LayerNorm<F>,
    /// Of the feed-forward layers.
    pub norm2: LayerNorm<F>,
    /// Of the hidden columns and of both branches.
    pub dropout: Dropout,
    /// Where the norms stand.
    pub norm: NormPlacement,
    /// What stands between the feed-forward layers.
    pub feed_forward: FeedForward,
}
impl_module!(TransformerEncoderLayer { self_attn, linear1, linear2, norm1, norm2 }
    fixed { dropout, norm, feed_forward });

impl<F: Real> TransformerEncoderLayer<F> {
    /// PyTorch's initial values.
    ///
    /// # Panics
    /// If the heads do not divide the width, or `dropout` is not within `[0, 1)`.
    #[track_caller]
    pub fn new(init: &Init, config: &TransformerConfig) -> Self {
        let TransformerConfig { width, heads, hidden, dropout, norm, feed_forward } = *config;
        let attention = MultiHeadAttention::new(&init.at("self_attn"), width, heads);
        Self {
            self_attn: MultiHeadAttention { dropout, ..attention },
            linear1: Linear::new(&init.at("linear1"), width, hidden),
            linear2: Linear::new(&init.at("linear2"), hidden, width),
            norm1: LayerNorm::new(&init.at("norm1"), width),
            norm2: LayerNorm::new(&init.at("norm2"), width),
            dropout: Dropout::new(dropout),
            norm,
            feed_forward,
        }
    }

    /// Attention and the two linear layers, each with its norm and skip; the mask is added to the scores, see
    /// [`Var::attention`].
    ///
    /// # Shapes
    /// `x [N, T, D]`, `mask [T, T]` or `[N, T, T]` → `[N, T, D]`.
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>, mask: Option<&Tensor<F>>) -> Var<'t, F> {
        let dropout = self.dropout.p;
        let onto =
            |residual| LinearThen { dropout, residual: Some(residual), ..LinearThen::default() };
        let attend = |x, residual| self.self_attn.forward_fused(x, mask, onto(residual));
        let feed = |x, residual| self.linear2.forward_fused(self.hidden(x), onto(residual));
        match self.norm {
            NormPlacement::Post => {
                let x = self.norm1.forward(attend(x, x));
                self.norm2.forward(feed(x, x))
            }
            NormPlacement::Pre => {
                let x = attend(self.norm1.forward(x), x);
                feed(self.norm2.forward(x), x)
            }
        }
    }

    fn hidden<'t>(&self, x: Var<'t, F>) -> Var<'t, F> {
        match self.feed_forward {
            FeedForward::Relu => {
                let (activation, dropout) = (Activation::Relu, self.dropout.p);
                self.linear1.forward_fused(x, LinearThen { activation, dropout, residual: None })
            }
            FeedForward::Gelu => self.dropout.forward(self.linear1.forward(x).gelu()),
        }
    }
}

/// Layers one after the other, as `torch.nn.TransformerEncoder`.
#[derive(Clone, Debug)]
pub struct TransformerEncoder<F: Real = f32> {
    /// In order.
    pub layers: Vec<TransformerEncoderLayer<F>>,
    /// After the last, where layers norm before.
    pub norm: Option<LayerNorm<F>>,
}
impl_module!(TransformerEncoder { layers, norm });

impl<F: Real> TransformerEncoder<F> {
    /// `depth` layers; a last norm if they norm before.
    ///
    /// # Panics
    /// As [`TransformerEncoderLayer::new`].
    #[track_caller]
    pub fn new(init: &Init, depth: usize, config: &TransformerConfig) -> Self {
        let layers = init.at("layers");
        let layer = |i| TransformerEncoderLayer::new(&layers.index(i), config);
        let last = || LayerNorm::new(&init.at("norm"), config.width);
        Self {
            layers: (0..depth).map(layer).collect(),
            norm: (config.norm == NormPlacement::Pre).then(last),
        }
    }

    /// All layers, one after the other.
    ///
    /// # Shapes
    /// `x [N, T, D]`, `mask [T, T]` or `[N, T, T]` → `[N, T, D]`.
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>, mask: Option<&Tensor<F>>) -> Var<'t, F> {
        let x = self.layers.iter().fold(x, |x, layer| layer.forward(x, mask));
        self.norm.as_ref().map_or(x, |norm| norm.forward(x))
    }
}
