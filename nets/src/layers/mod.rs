//! Layers, one a file, with their equations.

pub(crate) mod activation;
pub(crate) mod batch_norm;
pub(crate) mod conv2d;
pub(crate) mod conv_transpose2d;
pub(crate) mod dropout;
pub(crate) mod graph_conv;
pub(crate) mod group_norm;
pub(crate) mod indexed;
pub(crate) mod layer_norm;
pub(crate) mod linear;
pub(crate) mod mlp;
pub(crate) mod multi_head_attention;
pub(crate) mod norm;
pub(crate) mod perceptual_pooling;
pub(crate) mod point_mlp;
pub(crate) mod pooling;
pub(crate) mod transformer_encoder;
pub(crate) mod weight_norm;
