//! Reconstruction of meshes from images: the systems, their training and their reports.

pub mod delivery;
pub mod evaluate;
pub mod fit;
pub mod output;
pub mod report;
pub mod settings;
pub mod synthetic;
pub mod turntable;
