//! Why a dataset cannot be inspected.

use std::path::PathBuf;

use datasets::{ReadViewsError, View};
use mesh_core::nalgebra::Vector3;

use super::diagnosis::{COINCIDENT, Problem};

/// Cameras that stand closer together than this share of their distance from the origin stand at one point: what is
/// left are roundings of inverted matrices.
const TOGETHER: f64 = 1e-6;

/// Why a dataset cannot be inspected.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InspectError {
    /// It cannot be read.
    #[error(transparent)]
    Read(#[from] ReadViewsError),
    /// Cameras that cannot have seen one object.
    #[error("{}: the cameras of {object} do not see one object: {reason}", path.display())]
    Cameras {
        /// The dataset.
        path: PathBuf,
        /// The object's name.
        object: String,
        /// What was found, and what may explain it.
        reason: String,
    },
}

/// What is wrong with cameras that all stand at one point; none where they do not.
pub(super) fn at_one_point(views: &[View], problems: &[Problem]) -> Option<String> {
    let seen = views.iter().filter(|view| view.camera.is_perspective());
    let centers: Vec<_> = seen.map(|view| view.camera.center()).collect();
    let first = centers.first().filter(|_| centers.len() == views.len() && views.len() > 1)?;
    let reach = centers.iter().map(Vector3::norm).fold(0.0, f64::max);
    let coincident = problems.iter().any(|problem| problem.kind == COINCIDENT);
    if !coincident || centers.iter().any(|center| (center - first).norm() > TOGETHER * reach) {
        return None;
    }
    let hint = problems
        .iter()
        .find(|problem| problem.kind.starts_with("inverse"))
        .map_or("were world-to-camera matrices given for camera-to-world ones?", |problem| {
            &problem.message
        });
    let [x, y, z]: [f64; 3] = (*first).into();
    Some(format!("all {} stand at one point, ({x:.4}, {y:.4}, {z:.4}); {hint}", views.len()))
}
