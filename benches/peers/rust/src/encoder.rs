//! A transformer's encoder layer of width 512 with eight heads, 64 tokens in a batch of eight, dropout of 0.1: forward, and all gradients.

use std::error::Error;
use std::hint::black_box;

use burn::nn::activation::ActivationConfig;
use burn::nn::transformer::{TransformerEncoderConfig, TransformerEncoderInput};
use burn::tensor::{Device, Distribution, Tensor};
use candle_core::{D, Device as Cpu, Result, Tensor as Candle, Var};
use candle_nn::ops::{dropout, layer_norm_slow, softmax};

use crate::timing::report;

const BATCH: usize = 8;
const TOKENS: usize = 64;
const WIDTH: usize = 512;
const HEADS: usize = 8;
const HIDDEN: usize = 2048;
const DROPOUT: f32 = 0.1;
const ID: &str = "nets/encoder-layer/8x64x512/forward-backward/2t";

pub fn time() -> std::result::Result<(), Box<dyn Error>> {
    let (layer, tokens) = (Layer::new()?, normal(&[BATCH, TOKENS, WIDTH])?);
    let step = || -> Result<()> {
        black_box(layer.forward(tokens.as_tensor())?.sum_all()?.backward()?);
        Ok(())
    };
    step()?;
    report(ID, "candle 0.11, from its operations", || step().expect("it went before"));

    let device = Device::flex().autodiff();
    let config = TransformerEncoderConfig::new(WIDTH, HIDDEN, HEADS, 1)
        .with_activation(ActivationConfig::Relu);
    let layer = config.init(&device);
    let tokens =
        Tensor::<3>::random([BATCH, TOKENS, WIDTH], Distribution::Default, &device).require_grad();
    report(ID, "burn-flex 0.22", || {
        let y = layer.forward(TransformerEncoderInput::new(tokens.clone()));
        black_box(y.sum().backward());
    });
    Ok(())
}

fn normal(shape: &[usize]) -> Result<Var> {
    Var::from_tensor(&Candle::randn(0f32, 0.05, shape, &Cpu::Cpu)?)
}

/// A linear map with a bias.
struct Linear {
    weight: Var,
    bias: Var,
}

impl Linear {
    fn new(from: usize, to: usize) -> Result<Self> {
        Ok(Self { weight: normal(&[to, from])?, bias: normal(&[to])? })
    }

    fn forward(&self, x: &Candle) -> Result<Candle> {
        let (from, rows) = (x.dim(D::Minus1)?, x.elem_count() / x.dim(D::Minus1)?);
        let y = x.reshape((rows, from))?.matmul(&self.weight.t()?)?.broadcast_add(&self.bias)?;
        y.reshape((BATCH, TOKENS, self.bias.elem_count()))
    }
}

/// The layer as it was published: norms behind the sums. candle has no such layer.
struct Layer {
    /// Query, key, value and output.
    attention: [Linear; 4],
    feed_forward: [Linear; 2],
    norms: [[Var; 2]; 2],
}

impl Layer {
    fn new() -> Result<Self> {
        let square = || Linear::new(WIDTH, WIDTH);
        let norm = || Ok::<_, candle_core::Error>([normal(&[WIDTH])?, normal(&[WIDTH])?]);
        Ok(Self {
            attention: [square()?, square()?, square()?, square()?],
            feed_forward: [Linear::new(WIDTH, HIDDEN)?, Linear::new(HIDDEN, WIDTH)?],
            norms: [norm()?, norm()?],
        })
    }

    fn forward(&self, x: &Candle) -> Result<Candle> {
        let normed = |x: Candle, [scale, shift]: &[Var; 2]| layer_norm_slow(&x, scale, shift, 1e-5);
        let x = normed((x + dropout(&self.attend(x)?, DROPOUT)?)?, &self.norms[0])?;
        let hidden = dropout(&self.feed_forward[0].forward(&x)?.relu()?, DROPOUT)?;
        let y = dropout(&self.feed_forward[1].forward(&hidden)?, DROPOUT)?;
        normed((x + y)?, &self.norms[1])
    }

    fn attend(&self, x: &Candle) -> Result<Candle> {
        let [query, key, value, output] = &self.attention;
        let heads = |linear: &Linear| -> Result<Candle> {
            let y = linear.forward(x)?.reshape((BATCH, TOKENS, HEADS, WIDTH / HEADS))?;
            y.transpose(1, 2)?.contiguous()
        };
        let (q, k, v) = (heads(query)?, heads(key)?, heads(value)?);
        let scores = (q.matmul(&k.t()?)? / ((WIDTH / HEADS) as f64).sqrt())?;
        let weights = dropout(&softmax(&scores, D::Minus1)?, DROPOUT)?;
        output.forward(&weights.matmul(&v)?.transpose(1, 2)?.reshape((BATCH, TOKENS, WIDTH))?)
    }
}
