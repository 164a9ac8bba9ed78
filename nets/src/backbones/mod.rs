//! Networks that turn images into features.

pub(crate) mod conv_front_end;
pub(crate) mod imagenet;
pub(crate) mod inception;
pub(crate) mod pixel2mesh_encoder;
pub(crate) mod resnet;
pub(crate) mod small_cnn;
pub(crate) mod vgg;
