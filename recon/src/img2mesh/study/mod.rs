//! The tables of img2mesh: the paper's own setting, and unseen objects.

mod clock;
mod unseen;

pub use clock::ClockStudy;
pub use unseen::UnseenStudy;

use train::Configuration;

use super::{Img2Mesh, Img2MeshConfig};
use crate::reproduce::preset::Planned;

type Config = Configuration<Img2MeshConfig>;
type Jobs = Vec<Planned<Img2Mesh>>;
