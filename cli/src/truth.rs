//! The true mesh that the user names, and the one that was meant.

use std::path::{Path, PathBuf};

use losses::metrics::{CompareError, FrameMismatch, Preset, Protocol, Role, evaluate, voxel_iou};
use mesh_core::TriMesh;
use recon::verdict::Evidence;

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

/// A mesh whose outlines agree with the masks by more than this, from so many views, has the place and the size of the object.
const MASK_IOU: f64 = 0.8;
const VIEWS: usize = 7;
/// Then a truth whose solid shares less than this with it, and whose box is off by more than this share of the mesh's longest side, is
/// of something else. Solids alone do not tell: outlines fill what is hollow and thicken what is thin, but keep its box.
const SOLID_IOU: f64 = 0.2;
const BOX_OFFSET: f64 = 0.15;
/// Cells along the longest side of the grid on which solids are compared.
const CELLS: usize = 32;

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

    /// What there is to say where the mesh and its truth lie in different frames or are of different objects, with the mesh
    /// beside the views that does agree, if there is one. `fixed` says whether the views fix where the mesh is.
    pub(crate) fn doubt(&self, mesh: &TriMesh, fixed: bool, views: &Path) -> Option<String> {
        let mismatch = mismatch(mesh, &self.mesh, fixed)?;
        let agrees = |path: &PathBuf| {
            let other = mesh_core::read_mesh(path);
            other.is_ok_and(|other| {
                !other.faces.is_empty() && self::mismatch(mesh, &other, fixed).is_none()
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

/// Whether outlines of many views agree with the mesh, so that it is where the object is.
pub(crate) fn is_fixed(evidence: &Evidence) -> bool {
    evidence.fitted_views >= VIEWS && evidence.mask_iou > MASK_IOU
}

/// What speaks against a mesh and its truth being one object in one place.
fn mismatch(mesh: &TriMesh, truth: &TriMesh, fixed: bool) -> Option<String> {
    if let Some(mismatch) = FrameMismatch::of(mesh, truth) {
        return Some(mismatch.to_string());
    }
    let offset =
        fixed.then(|| box_offset(mesh, truth)).flatten().filter(|off| *off > BOX_OFFSET)?;
    let iou = Some(voxel_iou(mesh, truth, CELLS)).filter(|iou| *iou < SOLID_IOU)?;
    Some(format!(
        "the truth is another object, or lies elsewhere: the masks agree with the mesh, and the truth shares little with it (3D IoU \
         {iou:.3}, its box is off by {offset:.2} of the mesh's longest side)"
    ))
}

/// The greatest distance between like sides of the boxes of a mesh and its truth, by the longest side of the mesh.
fn box_offset(mesh: &TriMesh, truth: &TriMesh) -> Option<f64> {
    let ((low, high), (true_low, true_high)) = (mesh.bounds()?, truth.bounds()?);
    let greatest =
        |a: [f32; 3], b: [f32; 3]| (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f32::max);
    let offset = greatest(low, true_low).max(greatest(high, true_high));
    let longest = greatest(high, low);
    (longest > 0.0).then(|| f64::from(offset / longest))
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
    use mesh_core::primitives::{cuboid, icosphere, torus};

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
        assert_eq!(truth.doubt(&far, true, folder.path()), None);
        write("cow.ply", &ball);
        let text = truth.doubt(&ball, true, folder.path()).unwrap();
        assert!(text.starts_with("far.ply: the truth lies in another frame"), "{text}");
        assert!(!text.contains("--truth"), "{text}");
        write("truth.ply", &far);
        write("GT.obj", &ball);
        // Views in a file have their truth beside that file.
        for views in [folder.path().to_owned(), folder.path().join("transforms.json")] {
            let text = truth.doubt(&ball, true, &views).unwrap();
            assert!(text.contains("--truth") && text.ends_with("GT.obj"), "{text}");
        }
    }

    /// Volumes that meet are no alarm unless the masks fix the mesh, and then only if boxes differ too.
    #[test]
    fn another_object_in_the_same_place_is_doubted() {
        let folder = tempfile::tempdir().unwrap();
        let column = cuboid([0.3, 0.3, 1.0]);
        let beam = Truth {
            path: "beam.ply".into(),
            mesh: cuboid([1.0, 0.3, 0.3]).translated([0.4, 0.0, 0.0]),
        };
        mesh_core::write_mesh(folder.path().join("mesh.ply"), &column).unwrap();
        assert_eq!(beam.doubt(&column, false, folder.path()), None);
        let text = beam.doubt(&column, true, folder.path()).unwrap();
        assert!(text.starts_with("beam.ply: the truth is another object"), "{text}");
        assert!(text.contains("--truth") && text.ends_with("mesh.ply"), "{text}");
        // What outlines fill or thicken keeps its box.
        let ring = torus(1.0, 0.05, 48, 12);
        for (thin, fitted) in
            [(ring, cuboid([2.1, 0.1, 2.1])), (cuboid([1.0, 1.0, 1e-4]), cuboid([1.0, 1.0, 0.05]))]
        {
            let truth = Truth { path: "thin.ply".into(), mesh: thin };
            assert_eq!(truth.doubt(&fitted, true, folder.path()), None);
        }
    }
}
