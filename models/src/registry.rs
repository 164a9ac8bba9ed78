//! The systems of this crate, and how others join them.

use crate::depth::{DepthPixel2Mesh, MeshRcnn};
use crate::img2mesh::Img2Mesh;
use crate::mcmr::Mcmr;
use crate::pixel2mesh::{OdePixel2Mesh, Pixel2Mesh};
use crate::predict::Predictor;

/// What is told each system, by its type: a program with its commands, a list, a test over all.
///
/// ```
/// use models::predict::Predictor;
/// use models::{Registry, register};
///
/// #[derive(Default)]
/// struct Names(Vec<&'static str>);
///
/// impl Registry for Names {
///     fn register<S: Predictor>(&mut self) {
///         self.0.push(S::NAME);
///     }
/// }
///
/// let mut names = Names::default();
/// register(&mut names);
/// assert!(names.0.contains(&"mesh-rcnn"));
/// ```
pub trait Registry {
    /// Takes a system in.
    fn register<S: Predictor>(&mut self);
}

/// Tells a registry the systems of this crate, in the order of lists.
///
/// Whoever has a system of their own registers it in the same way, beside these.
pub fn register(registry: &mut impl Registry) {
    registry.register::<Img2Mesh>();
    registry.register::<Mcmr>();
    registry.register::<OdePixel2Mesh>();
    registry.register::<Pixel2Mesh>();
    registry.register::<DepthPixel2Mesh>();
    registry.register::<MeshRcnn>();
}
