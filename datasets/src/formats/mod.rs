//! The formats of files that layouts are made of; none knows what its numbers mean.

pub(crate) mod json;
pub(crate) mod mat;
pub(crate) mod npy;
pub(crate) mod yaml;
