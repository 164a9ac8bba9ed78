//! Rigs of several cameras and the frames that they took, which COLMAP has since 3.12.
//!
//! `images.*` still holds the pose of each image, so that older readers go on working, but COLMAP itself composes poses of
//! those of the frame and of the camera in its rig, and so do we: where a program changed frames alone, `images.*` is old.

use std::collections::BTreeMap;
use std::path::Path;

use mesh_core::nalgebra::{Isometry3, Quaternion, UnitQuaternion};

use super::model::ModelImage;
use crate::error::ReadViewsError;

/// A rotation and a translation behind it: from one frame of coordinates to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    /// `[w, x, y, z]`, of any length but 0.
    pub(crate) quaternion: [f64; 4],
    pub(crate) translation: [f64; 3],
}

impl Pose {
    const IDENTITY: Self = Self { quaternion: [1.0, 0.0, 0.0, 0.0], translation: [0.0; 3] };

    fn isometry(self) -> Isometry3<f64> {
        let [w, x, y, z] = self.quaternion;
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        Isometry3::from_parts(self.translation.into(), rotation)
    }

    /// This pose behind another one.
    fn after(self, first: Self) -> Self {
        let both = self.isometry() * first.isometry();
        let q = both.rotation;
        Self { quaternion: [q.w, q.i, q.j, q.k], translation: both.translation.vector.into() }
    }

    /// Whether another pose is the same but for what writing it as text rounds.
    fn is_near(self, other: Self) -> bool {
        let (own, other) = (self.isometry(), other.isometry());
        let cosine = own.rotation.coords.dot(&other.rotation.coords);
        let apart = (own.translation.vector - other.translation.vector).norm();
        1.0 - cosine.abs() < 1e-10 && apart <= 1e-5 * own.translation.vector.norm().max(1e-9)
    }
}

/// What took an image: which rig, where it was, and which of its cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Exposure {
    pub(crate) frame: u32,
    pub(crate) rig: u32,
    pub(crate) camera: u32,
    /// World to rig.
    pub(crate) pose: Pose,
}

/// The rigs and frames of a model.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rigs {
    /// Rig to camera, by the numbers of rig and camera; none where COLMAP does not know it.
    sensors: BTreeMap<(u32, u32), Option<Pose>>,
    /// By the number of the image.
    exposures: BTreeMap<u64, Exposure>,
}

impl Rigs {
    /// The camera that a rig is measured from.
    pub(crate) fn add_reference(&mut self, rig: u32, camera: u32) {
        self.sensors.insert((rig, camera), Some(Pose::IDENTITY));
    }

    /// Another camera of a rig.
    pub(crate) fn add_sensor(&mut self, rig: u32, camera: u32, pose: Option<Pose>) {
        self.sensors.insert((rig, camera), pose);
    }

    pub(crate) fn add_exposure(&mut self, image: u64, exposure: Exposure) {
        self.exposures.insert(image, exposure);
    }

    /// Gives images the poses that rigs and frames say, and counts those that had another one. Images of no frame, and of
    /// cameras whose place in the rig is not known, keep theirs.
    pub(crate) fn place(
        &self,
        images: &mut [ModelImage],
        frames: &Path,
    ) -> Result<usize, ReadViewsError> {
        let mut moved = 0;
        for image in images {
            let Some(exposure) = self.exposures.get(&u64::from(image.id)) else { continue };
            let Exposure { frame, rig, camera, pose } = *exposure;
            let Some(sensor) = self.sensors.get(&(rig, camera)) else {
                let field = format!("frame {frame}, image {}", image.id);
                let found = format!("camera {camera} of rig {rig}");
                return Err(ReadViewsError::field(
                    frames,
                    field,
                    found,
                    "a camera of one of the rigs",
                ));
            };
            if camera != image.camera {
                let field = format!("frame {frame}, image {}", image.id);
                let expected = format!("camera {}, which the image names", image.camera);
                return Err(ReadViewsError::field(
                    frames,
                    field,
                    format!("camera {camera}"),
                    expected,
                ));
            }
            let Some(sensor) = sensor else { continue };
            let composed = sensor.after(pose);
            let own = Pose { quaternion: image.quaternion, translation: image.translation };
            moved += usize::from(!composed.is_near(own));
            (image.quaternion, image.translation) = (composed.quaternion, composed.translation);
        }
        Ok(moved)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_follow_each_other() {
        // A quarter about z takes x to y; then a quarter about x takes y to z.
        let half = 0.5f64.sqrt();
        let first = Pose { quaternion: [half, 0.0, 0.0, half], translation: [1.0, 2.0, 3.0] };
        let then =
            Pose { quaternion: [2.0 * half, 2.0 * half, 0.0, 0.0], translation: [0.0, 0.0, 5.0] };
        let both = then.after(first);
        let at = |pose: Pose, v: [f64; 3]| -> [f64; 3] {
            pose.isometry().transform_point(&v.into()).into()
        };
        for v in [[1.0, 0.0, 0.0], [0.3, -0.7, 0.2]] {
            let (once, twice) = (at(both, v), at(then, at(first, v)));
            assert!(
                once.iter().zip(twice).all(|(a, b)| (a - b).abs() < 1e-12),
                "{once:?} {twice:?}"
            );
        }
        assert!((at(both, [1.0, 0.0, 0.0])[2] - (3.0 + 5.0)).abs() < 1e-12);
        assert!(both.is_near(Pose { quaternion: both.quaternion.map(|x| -x), ..both }));
        assert!(!both.is_near(first));
    }
}
