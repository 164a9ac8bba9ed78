//! Cameras around an object.

use mesh_core::Camera;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Cameras on a spherical shell around a point, all looking at it, +Y up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Orbit {
    /// How many cameras.
    pub count: usize,
    /// Where on the sphere they stand.
    pub placement: Placement,
    /// What they look at.
    pub target: [f64; 3],
    /// Least and greatest distance from it; each camera draws its own.
    pub distance: [f64; 2],
    /// Lowest and highest elevation, degrees.
    pub elevation: [f64; 2],
    /// Full vertical angle of view, degrees.
    pub fov_y: f64,
    /// Width of the images.
    pub width: usize,
    /// Height of the images.
    pub height: usize,
    /// Seed of all that is drawn.
    pub seed: u64,
}

/// Where cameras stand on their sphere.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Placement {
    /// Evenly, along a Fibonacci spiral from the top down: the spread is as good as it gets.
    #[default]
    Fibonacci,
    /// Independently, uniform over the band of elevations.
    Random,
}

impl Default for Orbit {
    fn default() -> Self {
        Self {
            count: 100,
            placement: Placement::Fibonacci,
            target: [0.0, 0.08, 0.0],
            distance: [5.0, 6.2],
            elevation: [-90.0, 90.0],
            fov_y: 40.0,
            width: 256,
            height: 256,
            seed: 0,
        }
    }
}

impl Orbit {
    /// As photographs of an object are taken whose box has diagonal 1: one image each, from
    /// anywhere a little below it to well above.
    pub fn photos() -> Self {
        Self {
            count: 1,
            placement: Placement::Random,
            target: [0.0; 3],
            distance: [1.7, 2.3],
            elevation: [-5.0, 40.0],
            ..Self::default()
        }
    }

    /// The cameras; the same for the same values.
    pub fn cameras(&self) -> Vec<Camera> {
        let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let [low, high] = self.elevation.map(|degrees| degrees.to_radians().sin());
        (0..self.count)
            .map(|i| {
                // A stream of its own for each camera: adding one moves no other.
                let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
                rng.set_stream(i as u64);
                let [height, turn, far] = [(); 3].map(|()| rng.random::<f64>());
                let (y, azimuth) = match self.placement {
                    Placement::Fibonacci => {
                        let share = (i as f64 + 0.5) / self.count as f64;
                        (high + (low - high) * share, golden * i as f64)
                    }
                    Placement::Random => {
                        (low + (high - low) * height, std::f64::consts::TAU * turn)
                    }
                };
                let ring = (1.0 - y * y).max(0.0).sqrt();
                let toward = [ring * azimuth.sin(), y, ring * azimuth.cos()];
                let distance = self.distance[0] + (self.distance[1] - self.distance[0]) * far;
                let eye = std::array::from_fn(|k| self.target[k] + distance * toward[k]);
                Camera::look_at(
                    eye,
                    self.target,
                    [0.0, 1.0, 0.0],
                    self.fov_y.to_radians(),
                    self.width,
                    self.height,
                )
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_camera_looks_at_the_target_from_its_distance() {
        for placement in [Placement::Fibonacci, Placement::Random] {
            let orbit = Orbit { placement, target: [1.0, 2.0, 3.0], ..Orbit::default() };
            let cameras = orbit.cameras();
            assert_eq!(cameras.len(), 100);
            for camera in &cameras {
                assert_eq!(camera.validate(), Ok(()));
                let p = camera.project(orbit.target);
                assert!((p.column - 128.0).abs() < 1e-9 && (p.row - 128.0).abs() < 1e-9);
                assert!(p.depth > 4.999 && p.depth < 6.201);
            }
            assert_eq!(cameras, orbit.cameras());
        }
    }

    #[test]
    fn elevations_keep_to_their_band() {
        for placement in [Placement::Fibonacci, Placement::Random] {
            let orbit = Orbit { placement, elevation: [0.0, 30.0], ..Orbit::default() };
            for camera in orbit.cameras() {
                let toward = camera.center() - mesh_core::nalgebra::Vector3::from(orbit.target);
                let sin = toward.y / toward.norm();
                assert!((-1e-9..=0.5 + 1e-9).contains(&sin), "{sin}");
            }
        }
    }
}
