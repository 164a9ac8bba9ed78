//! Rigs of several cameras and the frames that they took, which COLMAP has since 3.12.
//!
//! `images.*` still holds the pose of each image, so that older readers go on working, but COLMAP itself composes poses of
//! those of the frame and of the camera in its rig, and so do we: where a program changed frames alone, `images.*` is old.

use std::collections::BTreeMap;
use std::path::Path;

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

    /// This pose behind another one.
    fn after(self, first: Self) -> Self {
        let [a, b, c, d] = unit(self.quaternion);
        let [e, f, g, h] = unit(first.quaternion);
        let quaternion = [
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ];
        let turned = turned([a, b, c, d], first.translation);
        let translation = std::array::from_fn(|k| turned[k] + self.translation[k]);
        Self { quaternion, translation }
    }

    /// Whether another pose is the same but for what writing it as text rounds.
    fn is_near(self, other: Self) -> bool {
        let cosine: f64 =
            unit(self.quaternion).iter().zip(unit(other.quaternion)).map(|(a, b)| a * b).sum();
        let size = |t: [f64; 3]| t.iter().map(|x| x * x).sum::<f64>().sqrt();
        let apart: [f64; 3] = std::array::from_fn(|k| self.translation[k] - other.translation[k]);
        1.0 - cosine.abs() < 1e-10 && size(apart) <= 1e-5 * size(self.translation).max(1e-9)
    }
}

fn unit(q: [f64; 4]) -> [f64; 4] {
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    q.map(|x| x / length)
}

/// A vector turned by a unit quaternion.
fn turned([w, x, y, z]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let cross = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|k| a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3])
    };
    let axis = [x, y, z];
    let once = cross(axis, v);
    let twice = cross(axis, once);
    std::array::from_fn(|k| v[k] + 2.0 * (w * once[k] + twice[k]))
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
            let t = turned(unit(pose.quaternion), v);
            std::array::from_fn(|k| t[k] + pose.translation[k])
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
