//! Photo collections: one image of each object, and a pose that is only roughly known.

use mesh_core::nalgebra::{Rotation3, Vector3};
use mesh_core::{Camera, Lens};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::cameras::{Orbit, Placement};

/// Cameras as in collections of photographs, around an object whose box has diagonal 1.
///
/// Each view has the true camera, which made the image, and a rough one, as keypoints or a
/// pose network would give it.
///
/// ```
/// use synth::Collection;
/// let pose = &Collection { seed: 7, ..Collection::default() }.poses()[0];
/// assert_eq!(pose.camera.lens, pose.rough.lens);
/// assert_ne!(pose.camera.rotation, pose.rough.rotation);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Collection {
    /// Images of an object.
    pub count: usize,
    /// Least and greatest distance from its middle.
    pub distance: [f64; 2],
    /// Lowest and highest elevation, degrees.
    pub elevation: [f64; 2],
    /// Full vertical angle of view, degrees.
    pub fov_y: f64,
    /// How rough the poses are.
    pub noise: PoseNoise,
    /// Width of the images.
    pub width: usize,
    /// Height of the images.
    pub height: usize,
    /// Seed of all that is drawn.
    pub seed: u64,
}

/// How far a rough pose is from the true one: standard deviations of normal draws.
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

impl Default for Collection {
    fn default() -> Self {
        Self {
            count: 1,
            distance: [1.7, 2.3],
            elevation: [-5.0, 40.0],
            fov_y: 40.0,
            noise: PoseNoise::default(),
            width: 256,
            height: 256,
            seed: 0,
        }
    }
}

impl Default for PoseNoise {
    fn default() -> Self {
        Self { rotation: 10.0, scale: 0.1, translation: 0.03 }
    }
}

impl Collection {
    /// The poses; the same for the same values.
    pub fn poses(&self) -> Vec<RoughPose> {
        let orbit = Orbit {
            count: self.count,
            placement: Placement::Random,
            target: [0.0; 3],
            distance: self.distance,
            elevation: self.elevation,
            fov_y: self.fov_y,
            width: self.width,
            height: self.height,
            seed: self.seed,
        };
        let cameras = orbit.cameras().into_iter().enumerate();
        cameras
            .map(|(i, camera)| {
                let rough = self.noise.drawn(&camera, self.seed, i as u64);
                RoughPose { camera, rough }
            })
            .collect()
    }
}

impl PoseNoise {
    /// The camera as it would be known: a function of a seed and the image's number.
    pub fn drawn(&self, camera: &Camera, seed: u64, picture: u64) -> Camera {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        // The streams below belong to the orbit.
        rng.set_stream((1 << 32) + picture);
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
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v) = (1.0 - rng.random::<f64>(), rng.random::<f64>());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spread(values: &[f64]) -> f64 {
        (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
    }

    #[test]
    fn the_noise_is_as_large_as_it_says() {
        let noise = PoseNoise { rotation: 4.0, scale: 0.2, translation: 0.05 };
        let set = Collection { count: 3000, noise, ..Collection::default() };
        let poses = set.poses();
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
        for pose in (Collection { count: 5, noise, ..Collection::default() }).poses() {
            assert!((pose.camera.rotation - pose.rough.rotation).abs().max() < 1e-15);
            assert_eq!(pose.camera.translation, pose.rough.translation);
        }
    }

    #[test]
    fn more_pictures_move_none() {
        let two = Collection { count: 2, ..Collection::default() }.poses();
        assert_eq!(two[..1], Collection::default().poses());
        assert_ne!(two[0], two[1]);
        assert_ne!(two[..1], Collection { seed: 1, ..Collection::default() }.poses());
    }
}
