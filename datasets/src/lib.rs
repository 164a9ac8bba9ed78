//! Views of objects from the layouts that people have, and procedural shapes.

mod assemble;
mod consistency;
mod depth;
mod error;
mod json;
mod kaolin;
mod mask;
mod npy;
mod options;
mod read;
pub mod shapes;
mod source;
mod split;
mod transforms;
mod view;

pub use error::{ReadViewsError, ViewsProblem, WriteViewsError};
pub use kaolin::write_kaolin;
pub use mask::{mask_from_alpha, mask_from_backdrop};
pub use options::{MaskSource, ReadOptions};
pub use read::read_views;
pub use split::{Split, split};
pub use transforms::write_transforms;
pub use view::{Layout, View, Views};
