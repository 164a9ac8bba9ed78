//! The tables of img2mesh: the paper's own setting, and unseen objects.

mod clock;
mod controls;
mod unseen;

pub use clock::ClockStudy;
pub use unseen::UnseenStudy;

use models::img2mesh::{Img2Mesh, Img2MeshConfig};
use train::Configuration;

use crate::Study;
use crate::preset::Planned;

/// The studies of this module, in the order of lists.
pub const STUDIES: &[&dyn Study] = &[&ClockStudy, &UnseenStudy];

type Config = Configuration<Img2MeshConfig>;
type Jobs = Vec<Planned<Img2Mesh>>;
