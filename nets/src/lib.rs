//! Layers and backbones under PyTorch's names, on the tape of `autodiff-lite`.
//!
//! ```
//! use autodiff_lite::optim::Adam;
//! use autodiff_lite::{Activation, Tape};
//! use nets::{Init, Mlp, SmallCnn};
//! use ndarray::{Array2, Array4};
//!
//! // Every initial value follows from the seed and the path of its parameter.
//! let init = Init::new(7);
//! let encoder = SmallCnn::new(&init.at("encoder"), 3, 32);
//! let head = Mlp::new(&init.at("head"), &[32, 16, 1], Activation::Relu);
//! let mut model = (encoder, head); // a tuple of modules is a module
//!
//! // A bright column in four places.
//! let images = Array4::from_shape_fn((4, 16, 16, 3), |(n, _, j, _)| f32::from(j / 4 == n));
//! let targets = Array2::from_shape_fn((4, 1), |(n, _)| n as f32);
//! let (mut tape, mut adam) = (Tape::train(0), Adam::new(3e-3));
//! let mut losses = Vec::new();
//! for _ in 0..30 {
//!     let features = model.0.forward(tape.constant(images.clone()));
//!     let error = model.1.forward(features) - tape.constant(targets.clone());
//!     let loss = error.square().mean();
//!     losses.push(loss.item());
//!     let gradients = loss.backward();
//!     tape.reset();
//!     adam.step(&mut model, &gradients);
//! }
//! assert!(losses[29] < 0.2 * losses[0]);
//! ```
//!
//! # Where things are
//!
//! | for | see |
//! |---|---|
//! | initial values | [`Init`] |
//! | layers | [`Linear`], [`WeightNormLinear`], [`Mlp`], [`PointMlp`], [`Conv2d`], [`ConvTranspose2d`], [`MaxPool2d`], [`AvgPool2d`], [`AdaptiveAvgPool2d`], [`Dropout`] |
//! | norms | [`BatchNorm2d`], [`BatchNorm1d`], [`FrozenBatchNorm2d`], [`Norm`] (either of them), [`LayerNorm`], [`GroupNorm`] |
//! | attention | [`MultiHeadAttention`], [`TransformerEncoderLayer`], [`TransformerEncoder`] |
//! | graphs | [`GraphConv`] (Mesh R-CNN), [`ChebyshevConv`] (Pixel2Mesh), [`GraphResBlock`], [`GraphBottleneck`] |
//! | maps at points | [`pool_features`], [`pool_linear`] |
//! | heads of Mesh R-CNN | [`VoxelHead`], [`MeshRefinementHead`], [`MeshRefinementStage`] |
//! | image encoders | [`SmallCnn`], [`Vgg16`], [`ResNet`], [`ConvFrontEnd`] |
//! | images from maps | [`ImageDecoder`] |
//! | networks that measure | [`InceptionV3`], [`Vgg16`] with [`LpipsWeights`] |
//! | weights from files, freezing | [`LoadWeights`], [`read_weights`], [`freeze`], [`unfreeze`] |
//!
//! # Conventions
//!
//! - A layer is a plain struct of parameters with inherent `new` and `forward`; there is no
//!   forward trait and no `train: bool`: the tape knows whether it trains.
//! - Fields have the names of PyTorch's state dict, weights its layouts, so its files load without
//!   a table of names. Activations are features-last: images `[N, H, W, C]`, tokens `[N, T, D]`.
//! - New layers have PyTorch's initial distributions.
//! - `forward_then` applies an activation in the same pass.
//!
//! # Invariants
//!
//! - No layer knows a mesh, a file of a data set, or a training loop.
//! - The same seed gives the same bits whatever the number of threads.
//!
//! # What this crate does not do
//!
//! It defines no loss and no optimiser, downloads no weights, and fuses nothing on its own.

mod activation;
mod batch_norm;
mod conv2d;
mod conv_front_end;
mod conv_transpose2d;
mod dropout;
mod graph_bottleneck;
mod graph_conv;
mod group_norm;
mod image_decoder;
mod inception;
mod indexed;
mod init;
mod layer_norm;
mod linear;
mod lpips_weights;
mod mesh_refinement;
mod mlp;
mod multi_head_attention;
mod norm;
mod perceptual_pooling;
mod pixel2mesh_encoder;
mod point_mlp;
mod pooling;
mod resnet;
mod small_cnn;
#[cfg(test)]
mod testing;
mod transformer_encoder;
mod vgg;
mod voxel_head;
mod weight_norm;
mod weights;

pub use activation::activate;

pub use batch_norm::{BatchNorm1d, BatchNorm2d, FrozenBatchNorm2d};
pub use conv_front_end::ConvFrontEnd;
pub use conv_transpose2d::ConvTranspose2d;
pub use conv2d::Conv2d;
pub use dropout::Dropout;
pub use graph_bottleneck::{GraphBottleneck, GraphResBlock};
pub use graph_conv::{ChebyshevConv, GraphConv};
pub use group_norm::GroupNorm;
pub use image_decoder::{ImageDecoder, PreactivatedBlock};
pub use inception::{Branch, ConvNormRelu, InceptionKind, InceptionV3, Mixed, MixedPool};
pub use indexed::Indexed;
pub use init::{FanMode, Init, Nonlinearity, fans};
pub use layer_norm::LayerNorm;
pub use linear::Linear;
pub use lpips_weights::LpipsWeights;
pub use mesh_refinement::{MeshRefinementHead, MeshRefinementStage, RefinedVertices};
pub use mlp::Mlp;
pub use multi_head_attention::MultiHeadAttention;
pub use norm::{Norm, NormKind};
pub use perceptual_pooling::{MapSampling, pool_features, pool_linear};
pub use pixel2mesh_encoder::{EncoderInit, Pixel2MeshEncoder};
pub use point_mlp::{PointMlp, PointMlpConfig};
pub use pooling::{AdaptiveAvgPool2d, AvgPool2d, MaxPool2d};
pub use resnet::{BlockKind, ResNet, ResNetConfig, ResidualBlock};
pub use small_cnn::SmallCnn;
pub use transformer_encoder::{
    FeedForward, NormPlacement, TransformerConfig, TransformerEncoder, TransformerEncoderLayer,
};
pub use vgg::Vgg16;
pub use voxel_head::VoxelHead;
pub use weight_norm::{WeightNormLinear, weight_norm};
pub use weights::{
    LoadWeights, MapError, NameMap, WeightsError, freeze, read_weights, unfreeze,
    weights_from_bytes,
};
