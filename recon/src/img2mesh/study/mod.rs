//! The tables of img2mesh: the paper's own setting, and unseen objects.

mod clock;
mod unseen;

pub use clock::ClockStudy;
pub use unseen::UnseenStudy;

use super::{Img2Mesh, Img2MeshConfig};
use crate::reproduce::preset::Planned;
use crate::train::Configuration;

type Config = Configuration<Img2MeshConfig>;
type Jobs = Vec<Planned<Img2Mesh>>;
