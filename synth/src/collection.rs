//! Photo collections: one image of each object, and a pose that is only roughly known.

use mesh_core::nalgebra::{Rotation3, Vector3};
use mesh_core::{Camera, Lens};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// How far a rough pose is from the true one: standard deviations of normal draws.
///
/// Such a pose is what keypoints or a pose network would give of the camera that made an image.
///
/// ```
/// use synth::{Orbit, PoseNoise};
/// let camera = &Orbit { seed: 7, ..Orbit::photos() }.cameras()[0];
/// let rough = PoseNoise::default().drawn(camera, 7, 0);
/// assert_eq!(camera.lens, rough.lens);
/// assert_ne!(camera.rotation, rough.rotation);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoseNoise {
    /// Of the rotation about each axis of the camera, through the world's origin, degrees.
    pub rotation: f64,
    /// Of the logarithm of the object's size in the image.
    pub scale: f64,
    /// Of the object's place along each axis of the image, world units.
    pub translation: f64,
}

/// The camera that made an image, and what is known of it.
#[derive(Clone, Debug, PartialEq)]
pub struct RoughPose {
    /// The true camera.
    pub camera: Camera,
    /// The camera as it is known; the lens is the true one's.
    pub rough: Camera,
}

impl Default for PoseNoise {
    fn default() -> Self {
        Self { rotation: 10.0, scale: 0.1, translation: 0.03 }
    }
}

impl PoseNoise {
    /// The camera as it would be known: a function of a seed and the image's number.
    pub fn drawn(&self, camera: &Camera, seed: u64, image: u64) -> Camera {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        // The streams below belong to the orbit.
        rng.set_stream((1 << 32) + image);
        self.disturb(camera, &mut rng)
    }

    fn disturb(&self, camera: &Camera, rng: &mut ChaCha8Rng) -> Camera {
        let turn = Vector3::from_fn(|_, _| self.rotation.to_radians() * normal(rng));
        let grow = (self.scale * normal(rng)).exp();
        let shift = [(); 2].map(|()| self.translation * normal(rng));
        let mut rough = camera.clone();
        rough.rotation = Rotation3::from_scaled_axis(turn) * camera.rotation;
        rough.translation.x += shift[0];
        rough.translation.y += shift[1];
        match &mut rough.lens {
            // A larger image of the same object: nearer by as much.
            Lens::Perspective { .. } => rough.translation /= grow,
            Lens::Orthographic { sx, sy, .. } => (*sx, *sy) = (*sx * grow, *sy * grow),
        }
        rough
    }
}

/// A normal draw of mean 0 and deviation 1 (Box and Muller).
pub(crate) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v) = (1.0 - rng.random::<f64>(), rng.random::<f64>());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Orbit;

    fn spread(values: &[f64]) -> f64 {
        (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
    }

    fn poses(orbit: &Orbit, noise: PoseNoise) -> Vec<RoughPose> {
        let cameras = orbit.cameras().into_iter().zip(0..);
        cameras
            .map(|(camera, i)| RoughPose { rough: noise.drawn(&camera, orbit.seed, i), camera })
            .collect()
    }

    #[test]
    fn the_noise_is_as_large_as_it_says() {
        let noise = PoseNoise { rotation: 4.0, scale: 0.2, translation: 0.05 };
        let poses = poses(&Orbit { count: 3000, ..Orbit::photos() }, noise);
        let mut angles = Vec::new();
        let mut sizes = Vec::new();
        let mut shifts = Vec::new();
        for RoughPose { camera, rough } in &poses {
            let turn =
                Rotation3::from_matrix_unchecked(rough.rotation * camera.rotation.transpose());
            angles.extend(turn.scaled_axis().iter().map(|a| a.to_degrees()));
            let grow = camera.translation.z / rough.translation.z;
            sizes.push(grow.ln());
            shifts.extend((0..2).map(|k| rough.translation[k] * grow - camera.translation[k]));
        }
        assert!((spread(&angles) - 4.0).abs() < 0.2, "{}", spread(&angles));
        assert!((spread(&sizes) - 0.2).abs() < 0.01, "{}", spread(&sizes));
        assert!((spread(&shifts) - 0.05).abs() < 0.003, "{}", spread(&shifts));
    }

    #[test]
    fn without_noise_both_poses_are_one() {
        let noise = PoseNoise { rotation: 0.0, scale: 0.0, translation: 0.0 };
        for pose in poses(&Orbit { count: 5, ..Orbit::photos() }, noise) {
            assert!((pose.camera.rotation - pose.rough.rotation).abs().max() < 1e-15);
            assert_eq!(pose.camera.translation, pose.rough.translation);
        }
    }

    #[test]
    fn more_images_move_none() {
        let drawn = |orbit| poses(&orbit, PoseNoise::default());
        let two = drawn(Orbit { count: 2, ..Orbit::photos() });
        assert_eq!(two[..1], drawn(Orbit::photos()));
        assert_ne!(two[0], two[1]);
        assert_ne!(two[..1], drawn(Orbit { seed: 1, ..Orbit::photos() }));
    }
}
