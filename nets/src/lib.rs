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
//! | layers | [`Linear`], [`WeightNormLinear`], [`Mlp`], [`PointMlp`], [`Conv2d`], [`Conv3d`], [`ConvTranspose2d`], [`MaxPool2d`], [`AvgPool2d`], [`AdaptiveAvgPool2d`], [`Dropout`] |
//! | norms | [`BatchNorm2d`], [`BatchNorm1d`], [`FrozenBatchNorm2d`], [`Norm`] (one of batch, frozen batch and group), [`LayerNorm`], [`GroupNorm`] |
//! | attention | [`MultiHeadAttention`], [`TransformerEncoderLayer`], [`TransformerEncoder`] |
//! | graphs | [`GraphConv`] (Mesh R-CNN), [`ChebyshevConv`] (Pixel2Mesh), [`GraphResBlock`], [`GraphBottleneck`] |
//! | maps at points | [`pool_features`], [`pool_linear`] |
//! | heads of Mesh R-CNN | [`VoxelHead`], [`MeshRefinementHead`], [`MeshRefinementStage`] |
//! | image encoders | [`SmallCnn`], [`Vgg16`], [`ResNet`], [`ConvFrontEnd`], [`Pixel2MeshEncoder`]; what torchvision's weights expect: [`imagenet_normalized`] |
//! | images from maps | [`ImageDecoder`] |
//! | the camera of an image | [`ViewpointHead`] |
//! | networks that measure | [`InceptionV3`], [`Vgg16`] with [`LpipsWeights`] |
//! | networks for other programs to run | `onnx` (a feature) |
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

mod backbones;
mod heads;
mod init;
mod layers;
#[cfg(feature = "onnx")]
pub mod onnx;
#[cfg(test)]
mod testing;
mod weights;

pub use layers::activation::activate;

pub use backbones::conv_front_end::ConvFrontEnd;
pub use backbones::imagenet::{IMAGENET_DEVIATION, IMAGENET_MEAN, imagenet_normalized};
pub use backbones::inception::{
    Branch, ConvNormRelu, InceptionKind, InceptionV3, Mixed, MixedPool,
};
pub use backbones::pixel2mesh_encoder::{EncoderInit, Pixel2MeshEncoder};
pub use backbones::resnet::{BlockKind, ResNet, ResNetConfig, ResidualBlock};
pub use backbones::small_cnn::SmallCnn;
pub use backbones::vgg::Vgg16;
pub use heads::graph_bottleneck::{GraphBottleneck, GraphResBlock};
pub use heads::image_decoder::{ImageDecoder, PreactivatedBlock};
pub use heads::mesh_refinement::{MeshRefinementHead, MeshRefinementStage, RefinedVertices};
pub use heads::viewpoint_head::{ViewpointGuess, ViewpointHead};
pub use heads::voxel_head::VoxelHead;
pub use init::{FanMode, Init, Nonlinearity, fans};
pub use layers::batch_norm::{BatchNorm1d, BatchNorm2d, FrozenBatchNorm2d};
pub use layers::conv_transpose2d::ConvTranspose2d;
pub use layers::conv2d::Conv2d;
pub use layers::conv3d::Conv3d;
pub use layers::dropout::Dropout;
pub use layers::graph_conv::{ChebyshevConv, GraphConv};
pub use layers::group_norm::GroupNorm;
pub use layers::indexed::Indexed;
pub use layers::layer_norm::LayerNorm;
pub use layers::linear::Linear;
pub use layers::mlp::Mlp;
pub use layers::multi_head_attention::MultiHeadAttention;
pub use layers::norm::{Norm, NormKind};
pub use layers::perceptual_pooling::{MapSampling, pool_features, pool_linear};
pub use layers::point_mlp::{PointMlp, PointMlpConfig};
pub use layers::pooling::{AdaptiveAvgPool2d, AvgPool2d, MaxPool2d};
pub use layers::transformer_encoder::{
    FeedForward, NormPlacement, TransformerConfig, TransformerEncoder, TransformerEncoderLayer,
};
pub use layers::weight_norm::{WeightNormLinear, weight_norm};
pub use weights::lpips_weights::LpipsWeights;
pub use weights::{
    FormatError, LoadWeights, MapError, NameMap, PthError, WeightsError, freeze, read_weights,
    unfreeze, weights_from_bytes,
};
