//! Which sides of an object no view shows.

use mesh_core::Camera;
use mesh_core::nalgebra::Vector3;

/// Directions that are tried, evenly over the sphere.
const DIRECTIONS: usize = 600;
/// A side is seen at less than so many degrees from straight on.
const SLANT: f64 = 80.0;

/// What the directions of a set of views leave in the dark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Unseen {
    /// Share of all directions that a surface can face in which no view sees it, 0 to 1: 0.09 for a turntable seen from 25 degrees
    /// above (the underside), 0.5 for a single view.
    pub(crate) share: f64,
    /// The middle of these directions; no length where there are none.
    pub(crate) direction: [f64; 3],
}

impl Unseen {
    /// For cameras around a point.
    pub(crate) fn of<'a>(cameras: impl Iterator<Item = &'a Camera>, center: [f64; 3]) -> Self {
        let center = Vector3::from(center);
        let toward: Vec<Vector3<f64>> = cameras
            .filter_map(|camera| {
                // One at the point itself sees no side of it.
                let toward = if camera.is_perspective() {
                    camera.center() - center
                } else {
                    -camera.forward()
                };
                toward.try_normalize(0.0)
            })
            .collect();
        let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let least = SLANT.to_radians().cos();
        let (mut count, mut sum) = (0, Vector3::zeros());
        for k in 0..DIRECTIONS {
            let z = 1.0 - (2 * k + 1) as f64 / DIRECTIONS as f64;
            let (ring, turn) = ((1.0 - z * z).sqrt(), golden * k as f64);
            let normal = Vector3::new(ring * turn.cos(), ring * turn.sin(), z);
            if toward.iter().all(|t| t.dot(&normal) < least) {
                count += 1;
                sum += normal;
            }
        }
        Self { share: f64::from(count) / DIRECTIONS as f64, direction: sum.into() }
    }

    /// The side in words, by the axis of the cameras' world that it is nearest to.
    pub(crate) fn side(&self) -> String {
        let axis = (0..3)
            .max_by(|&a, &b| self.direction[a].abs().total_cmp(&self.direction[b].abs()))
            .unwrap_or(0);
        let sign = if self.direction[axis] < 0.0 { '-' } else { '+' };
        format!("{sign}{}", ["x", "y", "z"][axis])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn around(elevation: f64, azimuths: impl Iterator<Item = f64>) -> Unseen {
        let cameras: Vec<Camera> = azimuths
            .map(|azimuth| {
                let (y, ring) =
                    (5.0 * elevation.to_radians().sin(), 5.0 * elevation.to_radians().cos());
                let eye = [ring * azimuth.to_radians().sin(), y, ring * azimuth.to_radians().cos()];
                Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.7, 64, 64)
            })
            .collect();
        Unseen::of(cameras.iter(), [0.0; 3])
    }

    #[test]
    fn the_dark_side_is_the_one_behind() {
        // A turntable leaves the cap below: 90 - 25 + 80 degrees are seen, (1 - cos 35) / 2 are not.
        let table = around(25.0, (0..24).map(|k| f64::from(15 * k)));
        assert!((table.share - 0.09).abs() < 0.01 && table.side() == "-y", "{table:?}");
        // From straight on, views from -45 to 45 degrees leave 110 of 360, and a little at the poles.
        let front = around(0.0, (0..10).map(|k| f64::from(10 * k - 45)));
        assert!((0.3..0.35).contains(&front.share) && front.side() == "-z", "{front:?}");
        assert!(around(0.0, [90.0].into_iter()).side() == "-x");
    }
}
