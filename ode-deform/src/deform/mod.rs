//! Deformation in continuous time: how a mesh flows to what an image shows.

mod field;

pub use field::{DeformationField, FieldConfig};
