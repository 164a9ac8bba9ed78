//! Deformation in continuous time: how a mesh flows to what an image shows.

mod field;
#[cfg(test)]
mod fixtures;
mod reading;
mod reduced;
mod residual;
mod schedule;
mod stacked;

pub use field::{DeformationField, FieldConfig, positions, project_points};
pub use reduced::ReducedField;
pub use residual::ResidualDeformation;
pub use schedule::Schedule;
pub use stacked::{StackedConfig, StackedConv, StackedField};
