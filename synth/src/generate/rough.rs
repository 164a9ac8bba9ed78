//! `rough_poses.json`: the true cameras of a photo collection, and what is known of them.

use std::path::Path;

use mesh_core::Camera;
use serde::{Deserialize, Serialize};

use crate::RoughPose;

/// The file's name, in the folder of the images.
pub(super) const FILE: &str = "rough_poses.json";

/// Matrices are camera to world with OpenGL's axes; lengths of the lens are pixels.
#[derive(Debug, Serialize, Deserialize)]
struct Entry {
    w: usize,
    h: usize,
    fl_x: f64,
    fl_y: f64,
    cx: f64,
    cy: f64,
    camera: [[f64; 4]; 4],
    rough: [[f64; 4]; 4],
}

/// Why rough poses could not be read.
#[derive(Debug, thiserror::Error)]
#[error("{}: {what}", path.display())]
pub struct RoughPosesError {
    /// The file.
    pub path: std::path::PathBuf,
    /// What is wrong with it.
    pub what: String,
}

/// The text of the file.
pub(super) fn text(pairs: &[(&Camera, &Camera)]) -> String {
    let entries: Vec<Entry> = pairs
        .iter()
        .map(|(camera, rough)| {
            let mesh_core::Lens::Perspective { fx, fy, cx, cy } = camera.lens else {
                unreachable!("collections are made with perspective lenses")
            };
            let (w, h) = (camera.width, camera.height);
            let (camera, rough) = (camera.to_opengl(), rough.to_opengl());
            Entry { w, h, fl_x: fx, fl_y: fy, cx, cy, camera, rough }
        })
        .collect();
    serde_json::to_string_pretty(&entries).expect("numbers and names")
}

/// Reads the poses of a photo collection from the folder of its images, in their order.
///
/// # Errors
/// If the file is missing or is not as `generate` writes it.
pub fn read_rough_poses(folder: &Path) -> Result<Vec<RoughPose>, RoughPosesError> {
    let path = folder.join(FILE);
    let failed = |what: String| RoughPosesError { path: path.clone(), what };
    let text = std::fs::read(&path).map_err(|e| failed(e.to_string()))?;
    let entries: Vec<Entry> = serde_json::from_slice(&text).map_err(|e| failed(e.to_string()))?;
    entries
        .into_iter()
        .enumerate()
        .map(|(i, e)| {
            let camera = |pose| Camera::from_opengl(pose, e.fl_x, e.fl_y, e.cx, e.cy, e.w, e.h);
            let pose = RoughPose { camera: camera(e.camera), rough: camera(e.rough) };
            for (name, camera) in [("camera", &pose.camera), ("rough", &pose.rough)] {
                camera
                    .validate()
                    .map_err(|error| failed(format!("field `[{i}].{name}`: {error}")))?;
            }
            Ok(pose)
        })
        .collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::{Orbit, PoseNoise};

    #[test]
    fn poses_come_back_and_faults_are_named() {
        let orbit = Orbit { count: 3, width: 80, height: 60, ..Orbit::photos() };
        let rough = |camera: &Camera| PoseNoise::default().drawn(camera, 0, 0);
        let poses = orbit.cameras().into_iter();
        let poses: Vec<_> =
            poses.map(|camera| RoughPose { rough: rough(&camera), camera }).collect();
        let pairs: Vec<_> = poses.iter().map(|p| (&p.camera, &p.rough)).collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE);
        std::fs::write(&path, text(&pairs)).unwrap();
        let read = read_rough_poses(folder.path()).unwrap();
        assert_eq!(read.len(), 3);
        for (a, b) in read.iter().zip(&poses) {
            for (a, b) in [(&a.camera, &b.camera), (&a.rough, &b.rough)] {
                assert!((a.rotation - b.rotation).abs().max() < 1e-12);
                assert!((a.translation - b.translation).abs().max() < 1e-12);
                assert_eq!((a.lens, a.width, a.height), (b.lens, b.width, b.height));
            }
        }
        std::fs::write(&path, text(&pairs).replace("\"fl_x\": ", "\"fl_x\": -")).unwrap();
        let error = read_rough_poses(folder.path()).unwrap_err().to_string();
        assert!(error.contains(FILE) && error.contains("[0]"), "{error}");
        std::fs::write(&path, "[{}]").unwrap();
        assert!(read_rough_poses(folder.path()).unwrap_err().to_string().contains("missing field"));
    }
}
