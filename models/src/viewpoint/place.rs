//! Where a camera stands around an object.

use std::f64::consts::{PI, TAU};

use mesh_core::nalgebra::Vector3;
use mesh_core::{Camera, Lens, TriMesh};

/// A camera that looks at the origin with +Y up, whatever its lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// Radians from +x to +z, as 3D-R2N2 counts them.
    pub azimuth: f64,
    /// Radians above the horizon.
    pub elevation: f64,
    /// Distance from the origin over the focal length, which is counted in halves of the image's height: how large a thing is
    /// seen, whatever the lens.
    pub distance: f64,
}

impl Viewpoint {
    /// That of a camera; where it does not look at the origin, that of one at the same place that does.
    pub fn of(camera: &Camera) -> Self {
        let c = camera.center();
        Self {
            azimuth: c.z.atan2(c.x),
            elevation: c.y.atan2(c.x.hypot(c.z)),
            distance: c.norm() / focal(camera),
        }
    }

    /// A camera here, with the lens and the size of another.
    pub fn camera(&self, like: &Camera) -> Camera {
        let distance = self.distance * focal(like);
        let (sin, cos) = self.elevation.sin_cos();
        let eye = [cos * self.azimuth.cos(), sin, cos * self.azimuth.sin()].map(|x| distance * x);
        let (width, height) = (like.width, like.height);
        let camera = Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 1.0, width, height);
        Camera { lens: like.lens, ..camera }
    }

    /// By how many degrees the azimuths differ, 0 to 180.
    pub fn azimuth_error(&self, other: &Self) -> f64 {
        wrapped(self.azimuth - other.azimuth).abs().to_degrees()
    }
}

/// The vertical focal length in halves of the image's height.
fn focal(camera: &Camera) -> f64 {
    let [_, along, ..] = camera.lens.numbers();
    match camera.lens {
        Lens::Perspective { .. } => 2.0 * along / camera.height as f64,
        // Parallel rays have none; their distance shows nothing.
        Lens::Orthographic { .. } => 1.0,
    }
}

/// An angle within half a turn of 0.
pub(super) fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}

/// A mesh moved so that camera `to` sees it as `from` does.
#[must_use]
pub fn as_seen(mesh: TriMesh, from: &Camera, to: &Camera) -> TriMesh {
    let rotation = to.rotation.transpose() * from.rotation;
    let offset = to.rotation.transpose() * (from.translation - to.translation);
    mesh.map_positions(|p| {
        (rotation * Vector3::from(p.map(f64::from)) + offset).map(|x| x as f32).into()
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn a_camera_comes_back_whatever_its_lens() {
        for (azimuth, elevation, ratio) in
            [(40.0, 27.0, 0.8), (200.0, -10.0, 0.65), (359.0, 80.0, 1.2)]
        {
            let camera = Camera::from_r2n2(azimuth, elevation, ratio, 60, 40);
            let viewpoint = Viewpoint::of(&camera);
            assert!((wrapped(viewpoint.azimuth - f64::to_radians(azimuth))).abs() < 1e-9);
            assert!((viewpoint.elevation.to_degrees() - elevation).abs() < 1e-9);
            let again = viewpoint.camera(&camera);
            assert!((again.rotation - camera.rotation).abs().max() < 1e-9);
            assert!((again.translation - camera.translation).abs().max() < 1e-9);
            assert_eq!(again.lens, camera.lens);
            // Twice as far through a lens twice as long, a thing is as large, and the viewpoint the same.
            let [fx, fy, cx, cy] = camera.lens.numbers();
            let lens = camera.lens.with([2.0 * fx, 2.0 * fy, cx, cy]);
            let far = Camera { lens, translation: 2.0 * camera.translation, ..camera.clone() };
            assert!((Viewpoint::of(&far).distance - viewpoint.distance).abs() < 1e-9);
        }
        let at = |degrees: f64| Viewpoint {
            azimuth: degrees.to_radians(),
            elevation: 0.0,
            distance: 1.0,
        };
        assert!((at(350.0).azimuth_error(&at(-350.0)) - 20.0).abs() < 1e-9);
        assert!((at(10.0).azimuth_error(&at(170.0)) - 160.0).abs() < 1e-9);
    }

    #[test]
    fn one_camera_sees_what_the_other_saw() {
        let [from, to] =
            [(40.0, 27.0, 0.8), (200.0, -10.0, 0.7)].map(|(azimuth, elevation, ratio)| {
                Camera::from_r2n2(azimuth, elevation, ratio, 60, 40)
            });
        let mesh = mesh_core::primitives::cuboid([0.1, 0.2, 0.3]);
        let moved = as_seen(mesh.clone(), &from, &to);
        for (p, q) in mesh.positions.iter().zip(&moved.positions) {
            let [p, q] = [(&from, p), (&to, q)].map(|(camera, p)| camera.project(p.map(f64::from)));
            assert!((p.column - q.column).abs() < 1e-4 && (p.row - q.row).abs() < 1e-4);
            assert!((p.depth - q.depth).abs() < 1e-5);
        }
    }
}
