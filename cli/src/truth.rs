//! The true mesh that the user names, and the one that was meant.

use std::path::{Path, PathBuf};

use losses::metrics::{CompareError, FrameMismatch, Preset, Protocol, Role, evaluate};
use mesh_core::TriMesh;

use crate::console::Console;
use crate::failure::Failure;
use crate::mesh_file::read_mesh;

/// What people and programs call the true mesh that lies beside its views.
const NAMES: [&str; 9] = [
    "truth",
    "ground_truth",
    "ground-truth",
    "groundtruth",
    "gt",
    "reference",
    "mesh",
    "model",
    "object",
];

/// The true mesh and where it was read.
pub(crate) struct Truth {
    path: PathBuf,
    pub(crate) mesh: TriMesh,
}

impl Truth {
    /// Reads it, and refuses what no figure can be of: better before the fit than behind it.
    pub(crate) fn read(console: Console, path: &Path) -> Result<Self, Failure> {
        let mesh = read_mesh(console, path)?;
        let path = path.to_owned();
        // Of no points and no grid, so that nothing is computed.
        let protocol = Protocol { points: None, iou: None, ..Preset::OccNet.protocol(0) };
        evaluate(&mesh, &mesh, &protocol).map_err(|error| {
            let error = match error {
                CompareError::Invalid { source, .. } => {
                    CompareError::Invalid { role: Role::Truth, source }
                }
                CompareError::NoSurface { faces, .. } => {
                    CompareError::NoSurface { role: Role::Truth, faces }
                }
            };
            Failure::Input(format!("{}: {error}", path.display()))
        })?;
        Ok(Self { path, mesh })
    }

    /// One that is in no file.
    pub(crate) fn known(mesh: TriMesh) -> Self {
        Self { path: PathBuf::from("the truth"), mesh }
    }

    /// What there is to say where the mesh and its truth lie in different frames, with the mesh beside the views that does
    /// agree, if there is one.
    pub(crate) fn doubt(&self, mesh: &TriMesh, views: &Path) -> Option<String> {
        let mismatch = FrameMismatch::of(mesh, &self.mesh)?;
        let agrees = |path: &PathBuf| {
            let other = mesh_core::read_mesh(path);
            other.is_ok_and(|other| {
                !other.faces.is_empty() && FrameMismatch::of(mesh, &other).is_none()
            })
        };
        let place = if views.is_dir() { Some(views) } else { views.parent() };
        let found = place.map(beside).unwrap_or_default().into_iter().find(agrees);
        let hint = found.map_or_else(String::new, |path| {
            format!("; beside the views lies one that agrees: --truth {}", path.display())
        });
        Some(format!("{}: {mismatch}{hint}", self.path.display()))
    }
}

/// The meshes of a folder that are called like a truth, those with the plainest names first.
fn beside(folder: &Path) -> Vec<PathBuf> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let rank = |path: &Path| {
        let stem = path.file_stem()?.to_string_lossy().to_lowercase();
        let kind = path.extension()?.to_string_lossy().to_lowercase();
        let rank = NAMES.iter().position(|name| *name == stem)?;
        ["obj", "ply", "glb", "stl"].contains(&kind.as_str()).then_some(rank)
    };
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let mut found: Vec<_> = paths.filter_map(|path| Some((rank(&path)?, path))).collect();
    found.sort();
    found.into_iter().map(|(_, path)| path).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::primitives::icosphere;

    use super::*;

    #[test]
    fn the_truth_beside_the_views_is_the_one_that_agrees() {
        let folder = tempfile::tempdir().unwrap();
        let ball = icosphere(2);
        let far = ball.clone().translated([50.0, 0.0, 0.0]);
        let write = |name: &str, mesh: &TriMesh| {
            mesh_core::write_mesh(folder.path().join(name), mesh).unwrap();
        };
        let truth = Truth { path: "far.ply".into(), mesh: far.clone() };
        assert_eq!(truth.doubt(&far, folder.path()), None);
        write("cow.ply", &ball);
        let text = truth.doubt(&ball, folder.path()).unwrap();
        assert!(text.starts_with("far.ply: the truth lies in another frame"), "{text}");
        assert!(!text.contains("--truth"), "{text}");
        write("truth.ply", &far);
        write("GT.obj", &ball);
        // Views in a file have their truth beside that file.
        for views in [folder.path().to_owned(), folder.path().join("transforms.json")] {
            let text = truth.doubt(&ball, &views).unwrap();
            assert!(text.contains("--truth") && text.ends_with("GT.obj"), "{text}");
        }
    }
}
