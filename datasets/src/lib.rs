//! Views of objects from the layouts that people have, and procedural shapes.

mod split;
mod view;

pub use split::{Split, split};
pub use view::{DepthMap, Layout, View, Views};
