//! In which frame truth and prediction live: that of the image's camera, or the object's own.

use mesh_core::nalgebra::{Matrix3, Vector3};
use mesh_core::{Camera, TriMesh};
use serde::{Deserialize, Serialize};

/// Whose frame it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FrameKind {
    /// The camera's, as published: -z ahead. A network learns shape and pose at once.
    #[default]
    Camera,
    /// The object's own, the world in which its cameras stand around it. A network learns the shape alone, and has to
    /// be told where the camera stands.
    Object,
}

/// A frame: from the world by a rotation, a translation and a factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    scale: f64,
}

impl Frame {
    /// That of a camera, lengths multiplied by `scale`.
    pub fn of(camera: &Camera, scale: f64) -> Self {
        Self { rotation: camera.rotation, translation: camera.translation, scale }
    }

    /// That of the object: the world, lengths multiplied by `scale`.
    pub fn object(scale: f64) -> Self {
        Self { rotation: Matrix3::identity(), translation: Vector3::zeros(), scale }
    }

    /// What lengths are multiplied by.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// A point of the world.
    pub fn place(&self, p: [f32; 3]) -> [f32; 3] {
        let p = self.rotation * Vector3::from(p.map(f64::from)) + self.translation;
        (p * self.scale).map(|x| x as f32).into()
    }

    /// A direction of the world.
    pub fn turn(&self, n: [f32; 3]) -> [f32; 3] {
        (self.rotation * Vector3::from(n.map(f64::from))).map(|x| x as f32).into()
    }

    /// A point of the frame in the world.
    pub fn world(&self, p: [f32; 3]) -> [f32; 3] {
        let p = Vector3::from(p.map(f64::from)) / self.scale - self.translation;
        (self.rotation.transpose() * p).map(|x| x as f32).into()
    }

    /// A mesh of the world in the frame.
    #[must_use]
    pub fn mesh_placed(&self, mesh: &TriMesh) -> TriMesh {
        mesh.clone().map_positions(|p| self.place(p))
    }

    /// A mesh of the frame in the world.
    #[must_use]
    pub fn mesh_in_world(&self, mut mesh: TriMesh) -> TriMesh {
        mesh.positions.iter_mut().for_each(|p| *p = self.world(*p));
        mesh
    }
}

impl FrameKind {
    /// The frame of this kind for an image of a camera, lengths multiplied by `scale`.
    pub fn of(self, camera: &Camera, scale: f64) -> Frame {
        match self {
            Self::Camera => Frame::of(camera, scale),
            Self::Object => Frame::object(scale),
        }
    }

    /// From that frame to the image plane, `[3, 4]` in a row: normalised device coordinates times depth, y up, then depth, which
    /// is in the frame's lengths.
    pub(super) fn lens(self, camera: &Camera, scale: f64) -> [f32; 12] {
        let (rotation, translation) = match self {
            Self::Camera => (Matrix3::identity(), Vector3::zeros()),
            // `K (R p + t)` times the factor is `K (R (scale p) + scale t)`, and goes to the same pixel.
            Self::Object => (camera.rotation, camera.translation * scale),
        };
        let rows = Camera { rotation, translation, ..camera.clone() }.projection();
        std::array::from_fn(|k| rows[k / 4][k % 4] as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point goes the same way through the world's camera and through either frame and its lens.
    #[test]
    fn frame_and_lens_are_the_camera() {
        let camera = Camera::from_r2n2(40.0, 27.0, 0.8, 40, 30);
        let point = [0.1_f32, -0.2, 0.15];
        let seen = camera.project(point.map(f64::from));
        let places = [FrameKind::Camera, FrameKind::Object].map(|kind| {
            let (frame, lens) = (kind.of(&camera, 0.57), kind.lens(&camera, 0.57));
            let p = frame.place(point);
            let row = |k: usize| -> f64 {
                let m = &lens[4 * k..4 * k + 4];
                (0..3).map(|j| f64::from(m[j]) * f64::from(p[j])).sum::<f64>() + f64::from(m[3])
            };
            let (x, y, depth) = (row(0) / row(2), row(1) / row(2), row(2));
            assert!((x - (2.0 * seen.column / 40.0 - 1.0)).abs() < 1e-5, "{kind:?}");
            assert!((y - (1.0 - 2.0 * seen.row / 30.0)).abs() < 1e-5, "{kind:?}");
            assert!((depth - 0.57 * seen.depth).abs() < 1e-5, "{kind:?}");
            let back = frame.world(p);
            (0..3).for_each(|k| assert!((back[k] - point[k]).abs() < 1e-5));
            let n = frame.turn([0.0, 1.0, 0.0]);
            assert!((n.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-6);
            p
        });
        let [camera, object] = places;
        assert!(camera[2] < -0.3, "before the camera: {camera:?}");
        (0..3).for_each(|k| assert!((object[k] - 0.57 * point[k]).abs() < 1e-6));
    }

    #[test]
    fn meshes_come_back() {
        let camera = Camera::from_r2n2(40.0, 27.0, 0.8, 40, 30);
        let mesh = mesh_core::primitives::cuboid([0.2; 3]);
        for frame in [FrameKind::Camera, FrameKind::Object].map(|kind| kind.of(&camera, 0.5)) {
            let there = frame.mesh_placed(&mesh);
            let back = frame.mesh_in_world(there.clone());
            assert!((there.volume() - 0.125 * mesh.volume()).abs() < 1e-7 && frame.scale() == 0.5);
            let pairs = back.positions.as_flattened().iter().zip(mesh.positions.as_flattened());
            assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }
}
