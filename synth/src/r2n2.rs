//! The cameras of 3D-R2N2's renderings of ShapeNet.

use mesh_core::{Camera, R2n2View};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Cameras distributed as those of 3D-R2N2's renderings, around an object whose box has diagonal 1.
///
/// Azimuth is uniform in [0, 360), elevation and distance ratio are uniform in their ranges; the
/// camera stands 1.75 times the ratio away, its lens has 35 mm on a sensor 32 mm wide.
///
/// ```
/// use synth::R2n2Cameras;
/// let cameras = R2n2Cameras { seed: 7, ..R2n2Cameras::default() }.cameras();
/// assert_eq!((cameras.len(), cameras[0].width), (24, 137));
/// assert!((25.0..=30.0).contains(&cameras[23].to_r2n2()?.elevation));
/// # Ok::<(), mesh_core::CameraError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct R2n2Cameras {
    /// How many.
    pub count: usize,
    /// Lowest and highest elevation, degrees.
    pub elevation: [f64; 2],
    /// Least and greatest distance, in units of 1.75.
    pub distance_ratio: [f64; 2],
    /// Width of the images.
    pub width: usize,
    /// Height of the images.
    pub height: usize,
    /// Seed of all that is drawn.
    pub seed: u64,
}

impl Default for R2n2Cameras {
    fn default() -> Self {
        Self {
            count: 24,
            elevation: [25.0, 30.0],
            distance_ratio: [0.65, 0.95],
            width: 137,
            height: 137,
            seed: 0,
        }
    }
}

impl R2n2Cameras {
    /// What `rendering_metadata.txt` would say of the cameras; the same for the same values.
    pub fn lines(&self) -> Vec<R2n2View> {
        (0..self.count)
            .map(|i| {
                // A stream of its own for each camera: adding one moves no other.
                let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
                rng.set_stream(i as u64);
                let [turn, height, far] = [(); 3].map(|()| rng.random::<f64>());
                let within = |[low, high]: [f64; 2], share: f64| low + (high - low) * share;
                R2n2View {
                    azimuth: 360.0 * turn,
                    elevation: within(self.elevation, height),
                    distance_ratio: within(self.distance_ratio, far),
                }
            })
            .collect()
    }

    /// The cameras of those lines.
    pub fn cameras(&self) -> Vec<Camera> {
        let camera = |view: R2n2View| {
            let R2n2View { azimuth, elevation, distance_ratio } = view;
            Camera::from_r2n2(azimuth, elevation, distance_ratio, self.width, self.height)
        };
        self.lines().into_iter().map(camera).collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn draws_fill_their_ranges_evenly() {
        let set = R2n2Cameras { count: 2000, ..R2n2Cameras::default() };
        let lines = set.lines();
        let ranges = [[0.0, 360.0], [25.0, 30.0], [0.65, 0.95]];
        for (k, [low, high]) in ranges.into_iter().enumerate() {
            let value = |v: &R2n2View| [v.azimuth, v.elevation, v.distance_ratio][k];
            let shares: Vec<f64> = lines.iter().map(|v| (value(v) - low) / (high - low)).collect();
            assert!(shares.iter().all(|s| (0.0..=1.0).contains(s)));
            // A uniform share has mean 1/2 and variance 1/12; four standard errors of each.
            let mean = shares.iter().sum::<f64>() / 2000.0;
            let variance = shares.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / 2000.0;
            assert!((mean - 0.5).abs() < 0.026 && (variance - 1.0 / 12.0).abs() < 0.007);
        }
        assert_eq!(lines[..24], R2n2Cameras::default().lines());
    }

    #[test]
    fn cameras_say_the_lines_that_they_came_from() {
        let set = R2n2Cameras { width: 137, height: 100, seed: 3, ..R2n2Cameras::default() };
        for (line, camera) in set.lines().into_iter().zip(set.cameras()) {
            let again = camera.to_r2n2().unwrap();
            assert!((again.azimuth - line.azimuth).abs() < 1e-9);
            assert!((again.elevation - line.elevation).abs() < 1e-9);
            assert!((again.distance_ratio - line.distance_ratio).abs() < 1e-12);
        }
    }
}
