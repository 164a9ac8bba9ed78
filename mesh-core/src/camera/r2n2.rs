//! 3D-R2N2's renderings of ShapeNet: an angle, a height, a distance.

use super::{Camera, CameraError, Lens};

/// One line of `rendering_metadata.txt`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct R2n2View {
    /// Azimuth in degrees, `[0, 360)`.
    pub azimuth: f64,
    /// Elevation in degrees.
    pub elevation: f64,
    /// Distance in the file's unit; the camera stands 1.75 times as far.
    pub distance_ratio: f64,
}

/// Blender's lens: 35 mm on a sensor 32 mm wide. The file's own field of view, 25, is wrong.
const FOCAL_OVER_SENSOR: f64 = 35.0 / 32.0;
/// World units per unit of the file's distance column.
const DISTANCE: f64 = 1.75;

impl Camera {
    /// From a line of 3D-R2N2's `rendering_metadata.txt`; angles in degrees.
    ///
    /// The world is ShapeNet's own, unscaled, +Y up. The renderings are 137 x 137.
    pub fn from_r2n2(
        azimuth: f64,
        elevation: f64,
        distance_ratio: f64,
        width: usize,
        height: usize,
    ) -> Self {
        let (az, el) = (azimuth.to_radians(), elevation.to_radians());
        let d = DISTANCE * distance_ratio;
        let eye = [d * el.cos() * az.cos(), d * el.sin(), d * el.cos() * az.sin()];
        let mut camera = Self::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 1.0, width, height);
        let (w, h) = (width as f64, height as f64);
        let f = FOCAL_OVER_SENSOR * w;
        camera.lens = Lens::Perspective { fx: f, fy: f, cx: w / 2.0, cy: h / 2.0 };
        camera
    }

    /// The azimuth, elevation and distance of this camera in 3D-R2N2's terms.
    ///
    /// # Errors
    /// `NotRepresentable` where the lens is another, or the camera does not look at the origin
    /// with +Y up.
    pub fn to_r2n2(&self) -> Result<R2n2View, CameraError> {
        let c = self.center();
        let view = R2n2View {
            azimuth: c.z.atan2(c.x).to_degrees().rem_euclid(360.0),
            elevation: c.y.atan2(c.x.hypot(c.z)).to_degrees(),
            distance_ratio: c.norm() / DISTANCE,
        };
        let R2n2View { azimuth, elevation, distance_ratio } = view;
        let again = Self::from_r2n2(azimuth, elevation, distance_ratio, self.width, self.height);
        let convention = "3D-R2N2";
        let close = |(a, b): (f64, f64)| (a - b).abs() <= 1e-6 * (1.0 + a.abs());
        let pairs = self.pinhole(convention)?.into_iter().zip(again.pinhole(convention)?);
        if !{ pairs }.all(close) {
            let what = "a lens other than 35 mm on 32 mm, centred";
            return Err(CameraError::NotRepresentable { convention, what });
        }
        if (self.rotation - again.rotation).abs().max() > 1e-6 {
            let what = "a camera that does not look at the origin with +Y up";
            return Err(CameraError::NotRepresentable { convention, what });
        }
        Ok(view)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::super::tests::off_center;
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn round_trips_at_any_size() {
        for (az, el, ratio) in [(53.4, 25.1, 0.85), (212.0, 29.0, 0.66), (359.0, -10.0, 0.95)] {
            let v = Camera::from_r2n2(az, el, ratio, 137, 100).to_r2n2().unwrap();
            assert_relative_eq!(v.azimuth, az, epsilon = 1e-9);
            assert_relative_eq!(v.elevation, el, epsilon = 1e-9);
            assert_relative_eq!(v.distance_ratio, ratio, epsilon = 1e-9);
        }
        assert!(off_center().to_r2n2().is_err());
    }

    #[test]
    fn the_focal_length_is_150_pixels_and_the_axes_are_the_papers() {
        // At azimuth 0, elevation 0, ratio 1/1.75: the eye is at (1, 0, 0), +z is to the left.
        let c = Camera::from_r2n2(0.0, 0.0, 1.0 / 1.75, 137, 137);
        let p = c.project([0.0, 0.1, 0.2]);
        assert_relative_eq!(p.column, 68.5 - 149.84375 * 0.2, epsilon = 1e-9);
        assert_relative_eq!(p.row, 68.5 - 149.84375 * 0.1, epsilon = 1e-9);
        assert_relative_eq!(p.depth, 1.0, epsilon = 1e-12);
    }
}
