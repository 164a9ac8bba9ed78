//! Cameras as the network predicts them: a size, a place in the image, a rotation.

use mesh_core::nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use mesh_core::{Camera, Lens};

use crate::viewpoint::Viewpoint;

/// The least size that a pose has: of what has none, or a negative one, nothing is seen.
pub(super) const SMALLEST: f64 = 0.05;
/// The largest, in distances of the camera: more of an object of size 1 would stand behind it.
const LARGEST: f64 = 1.5;
/// Rounds in which a size and a place settle.
const FILLINGS: usize = 5;

/// The lens that all images are thought to be taken with; what an image's own camera differs from it is
/// in the size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommonLens {
    /// Focal length, in halves of an image.
    pub focal: f64,
    /// From the camera to the object's middle, for a size of 1.
    pub distance: f64,
}

/// Where an object is seen: MCMR's `[scale, cx, cy, q]` under a [`CommonLens`].
///
/// ```text
/// p = scale R v + (0, 0, -distance)        x = focal p_x / -p_z + cx,  y = focal p_y / -p_z + cy
/// ```
///
/// x right, y up, both in `[-1, 1]` over the image; the camera looks along -z. The published code has y
/// down, and shapes mirrored for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// How large the object is.
    pub scale: f64,
    /// Where its middle lands.
    pub place: [f64; 2],
    /// From the object to the camera: w, x, y, z, of length 1.
    pub rotation: [f64; 4],
}

impl Pose {
    /// The pose that is nearest to a camera: the middle of the world lands where it does, a length there is
    /// as long, and the direction of sight is the same.
    ///
    /// What is lost is how strong the perspective is.
    pub fn of(camera: &Camera, lens: CommonLens) -> Self {
        let rows = camera.projection();
        let depth = rows[2][3];
        let (half, pixels) = (
            camera.width as f64 / 2.0,
            match camera.lens {
                Lens::Perspective { fx, .. } => fx / depth,
                Lens::Orthographic { sx, .. } => sx,
            },
        );
        let (place, turned) = if camera.is_perspective() {
            // The ray to the object, brought to the axis.
            let turn = Rotation3::rotation_between(&camera.translation, &-Vector3::z());
            let turn = turn.unwrap_or_else(Rotation3::identity).into_inner();
            ([rows[0][3] / depth, rows[1][3] / depth], turn * camera.rotation)
        } else {
            ([rows[0][3], rows[1][3]], camera.rotation)
        };
        let q = UnitQuaternion::from_matrix(&turned);
        let scale = pixels / half * lens.distance / lens.focal;
        Self { scale, place, rotation: [q.w, q.i, q.j, q.k] }
    }

    /// From seven numbers of the network, `[scale, cx, cy, w, x, y, z]`.
    pub(super) fn from_row(row: &[f32]) -> Self {
        let at = |k: usize| f64::from(row[k]);
        Self { scale: at(0), place: [at(1), at(2)], rotation: [at(3), at(4), at(5), at(6)] }
    }

    /// From where the object is seen; what the camera is turned about its line of sight is lost.
    pub fn viewpoint(&self, lens: CommonLens) -> Viewpoint {
        let eye = self.matrix().transpose() * Vector3::z();
        Viewpoint {
            azimuth: eye.z.atan2(eye.x),
            elevation: eye.y.atan2(eye.x.hypot(eye.z)),
            distance: lens.distance / (self.scale.max(1e-9) * lens.focal),
        }
    }

    /// An upright camera at a viewpoint, which sees the object's middle at `place`.
    pub fn from_viewpoint(viewpoint: &Viewpoint, place: [f64; 2], lens: CommonLens) -> Self {
        let (sin, cos) = viewpoint.elevation.sin_cos();
        let eye = [cos * viewpoint.azimuth.cos(), sin, cos * viewpoint.azimuth.sin()];
        let camera = Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 1.0, 2, 2);
        let q = UnitQuaternion::from_matrix(&camera.rotation);
        let scale = lens.distance / (viewpoint.distance * lens.focal);
        Self { scale, place, rotation: [q.w, q.i, q.j, q.k] }
    }

    /// The same direction, from as far and beside by as much that points of the object fill a box of the image: left,
    /// right, lowest, highest, NDC.
    #[must_use]
    pub(super) fn filling(self, points: &[[f32; 3]], bounds: [f64; 4], lens: CommonLens) -> Self {
        let size = |b: [f64; 4]| b[1] - b[0] + b[3] - b[2];
        let middle = |b: [f64; 4]| [0.5 * (b[0] + b[1]), 0.5 * (b[2] + b[3])];
        let mut pose = self;
        // How strong the perspective is changes with the size: a few rounds.
        for _ in 0..FILLINGS {
            let seen = pose.bounds(points, lens);
            let ratio = size(bounds) / size(seen).max(1e-9);
            let scale = (pose.scale * ratio).clamp(SMALLEST, LARGEST * lens.distance);
            let (from, to) = (middle(seen), middle(bounds));
            let place = |k: usize| to[k] - (from[k] - pose.place[k]) * scale / pose.scale;
            pose = Self { scale, place: [place(0), place(1)], ..pose };
        }
        pose
    }

    /// The box that points are seen in: left, right, lowest, highest, NDC.
    fn bounds(&self, points: &[[f32; 3]], lens: CommonLens) -> [f64; 4] {
        let rows = self.projection(lens).map(f64::from);
        let empty = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
        points.iter().fold(empty, |b, p| {
            let row = |k: usize| {
                let of = &rows[4 * k..4 * k + 4];
                (0..3).map(|j| of[j] * f64::from(p[j])).sum::<f64>() + of[3]
            };
            // Nothing is nearer to the camera than a tenth of the way to the object's middle.
            let depth = row(2).max(0.1 * lens.distance);
            let (x, y) = (row(0) / depth, row(1) / depth);
            [b[0].min(x), b[1].max(x), b[2].min(y), b[3].max(y)]
        })
    }

    /// What the mirrored image of the mirrored object has: `D R D` with `D = diag(-1, 1, 1)`.
    #[must_use]
    pub fn flipped(self) -> Self {
        let [w, x, y, z] = self.rotation;
        let [cx, cy] = self.place;
        Self { place: [-cx, cy], rotation: [w, x, -y, -z], ..self }
    }

    /// The rotation as a matrix.
    pub fn matrix(&self) -> Matrix3<f64> {
        let [w, x, y, z] = self.rotation;
        let q = mesh_core::nalgebra::Quaternion::new(w, x, y, z);
        UnitQuaternion::from_quaternion(q).to_rotation_matrix().into_inner()
    }

    /// From the object to the image plane, `[3, 4]` in a row: normalised device coordinates times depth, depth.
    pub fn projection(&self, lens: CommonLens) -> [f32; 12] {
        let r = self.matrix() * self.scale;
        let [cx, cy] = self.place;
        let row = |axis: usize, place: f64| {
            let at = |k: usize| lens.focal * r[(axis, k)] - place * r[(2, k)];
            [at(0), at(1), at(2), place * lens.distance]
        };
        let depth = [-r[(2, 0)], -r[(2, 1)], -r[(2, 2)], lens.distance];
        let rows = [row(0, cx), row(1, cy), depth];
        std::array::from_fn(|k| rows[k / 4][k % 4] as f32)
    }

    /// The object's place before another camera that sees it where and as large as this pose says: rows of a
    /// map from the object to that camera's world, lengths unchanged. The inverse of [`of`](Self::of).
    pub fn in_world(&self, camera: &Camera, lens: CommonLens) -> [[f64; 4]; 3] {
        let (w, h) = (camera.width as f64, camera.height as f64);
        let [cx, cy] = self.place;
        let (column, row) = ((cx + 1.0) * w / 2.0, (1.0 - cy) * h / 2.0);
        let size = (self.scale * lens.focal / lens.distance * w / 2.0).max(1e-9);
        let (depth, turn) = match camera.lens {
            Lens::Perspective { fx, .. } => {
                let depth = fx / size;
                let world = Vector3::from(camera.unproject(column, row, depth));
                let ray = camera.rotation * world + camera.translation;
                let turn = Rotation3::rotation_between(&-Vector3::z(), &ray);
                (depth, turn.unwrap_or_else(Rotation3::identity).into_inner())
            }
            Lens::Orthographic { .. } => (1.0, Matrix3::identity()),
        };
        let rotation = camera.rotation.transpose() * turn * self.matrix();
        let at = camera.unproject(column, row, depth);
        std::array::from_fn(|i| [rotation[(i, 0)], rotation[(i, 1)], rotation[(i, 2)], at[i]])
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const LENS: CommonLens = CommonLens { focal: 4.5, distance: 2.4 };

    fn seen(matrix: [f32; 12], p: [f64; 3]) -> [f64; 3] {
        let row = |k: usize| {
            let m = &matrix[4 * k..4 * k + 4];
            (0..3).map(|j| f64::from(m[j]) * p[j]).sum::<f64>() + f64::from(m[3])
        };
        [row(0) / row(2), row(1) / row(2), row(2)]
    }

    fn camera(eye: [f64; 3], at: [f64; 3], fov: f64) -> Camera {
        Camera::look_at(eye, at, [0.0, 1.0, 0.0], fov, 80, 80)
    }

    proptest! {
        /// A camera with the common lens that looks at the origin is a pose without loss.
        #[test]
        fn the_common_lens_loses_nothing(angle in -3.0f64..3.0, up in -1.2f64..1.2, scale in 0.5f64..2.0, p in prop::array::uniform3(-0.5f64..0.5)) {
            let distance = LENS.distance / scale;
            let eye = [angle.sin() * up.cos(), up.sin(), angle.cos() * up.cos()].map(|v| distance * v);
            let camera = camera(eye, [0.0; 3], 2.0 * (1.0 / LENS.focal).atan());
            let pose = Pose::of(&camera, LENS);
            prop_assert!((pose.scale - scale).abs() < 1e-9, "{} {}", pose.scale, scale);
            let found = seen(pose.projection(LENS), p);
            let expected = camera.project(p);
            prop_assert!((found[0] - (expected.column / 40.0 - 1.0)).abs() < 1e-5);
            prop_assert!((found[1] - (1.0 - expected.row / 40.0)).abs() < 1e-5);
        }

        /// Mirrored object, mirrored pose: mirrored image.
        #[test]
        fn a_flip_mirrors(angle in -3.0f64..3.0, shift in -0.3f64..0.3, p in prop::array::uniform3(-0.5f64..0.5)) {
            let camera = camera([3.0 * angle.sin(), 0.8, 3.0 * angle.cos()], [shift, 0.1, 0.0], 0.7);
            let pose = Pose::of(&camera, LENS);
            let one = seen(pose.projection(LENS), p);
            let other = seen(pose.flipped().projection(LENS), [-p[0], p[1], p[2]]);
            prop_assert!((one[0] + other[0]).abs() < 1e-5 && (one[1] - other[1]).abs() < 1e-5);
            prop_assert!((one[2] - other[2]).abs() < 1e-5);
            prop_assert_eq!(pose.flipped().flipped(), pose);
        }

        /// A viewpoint and a place are an upright camera's whole pose.
        #[test]
        fn upright_cameras_come_back(angle in -3.0f64..3.0, up in -1.2f64..1.2, scale in 0.5f64..2.0, place in prop::array::uniform2(-0.3f64..0.3)) {
            let distance = LENS.distance / scale;
            let eye = [angle.sin() * up.cos(), up.sin(), angle.cos() * up.cos()].map(|v| distance * v);
            let pose = Pose { place, ..Pose::of(&camera(eye, [0.0; 3], 2.0 * (1.0 / LENS.focal).atan()), LENS) };
            let viewpoint = pose.viewpoint(LENS);
            prop_assert!((viewpoint.elevation - up).abs() < 1e-9);
            let again = Pose::from_viewpoint(&viewpoint, place, LENS);
            prop_assert!((again.matrix() - pose.matrix()).abs().max() < 1e-9);
            prop_assert!((again.scale - scale).abs() < 1e-9 && again.place == place);
            // Seen in a mirror, the azimuth is the mirrored one.
            let mirrored = pose.flipped().viewpoint(LENS);
            let [a, b] = [mirrored.azimuth, viewpoint.azimuth].map(f64::sin_cos);
            prop_assert!((a.0 - b.0).abs() < 1e-9 && (a.1 + b.1).abs() < 1e-9);
        }

        /// The box that an object was seen in says how far and how much beside it stands.
        #[test]
        fn a_box_says_size_and_place(angle in -3.0f64..3.0, scale in 0.6f64..1.6, place in prop::array::uniform2(-0.3f64..0.3)) {
            let points: Vec<[f32; 3]> = mesh_core::primitives::icosphere(2).scaled([0.3, 0.2, 0.45]).positions;
            let pose = Pose { scale, place, ..Pose::of(&camera([angle.sin(), 0.4, angle.cos()], [0.0; 3], 0.4), LENS) };
            let found = Pose { place: [0.0; 2], scale: 1.0, ..pose }.filling(&points, pose.bounds(&points, LENS), LENS);
            prop_assert!((found.scale / scale - 1.0).abs() < 0.01, "{found:?} {pose:?}");
            for k in 0..2 {
                prop_assert!((found.place[k] - place[k]).abs() < 0.01, "{found:?} {pose:?}");
            }
        }

        /// Put into the world of its camera the object stands where it stood, up to its depth.
        #[test]
        fn back_in_the_world(angle in -3.0f64..3.0, shift in -0.3f64..0.3, fov in 0.4f64..1.0) {
            let camera = camera([2.2 * angle.sin(), 0.5, 2.2 * angle.cos()], [shift, 0.1, 0.0], fov);
            let rows = Pose::of(&camera, LENS).in_world(&camera, LENS);
            for (i, row) in rows.iter().enumerate() {
                for (k, v) in row.iter().enumerate() {
                    let expected = f64::from(u8::from(i == k));
                    prop_assert!((v - expected).abs() < 1e-9, "{rows:?}");
                }
            }
        }
    }

    #[test]
    fn parallel_rays_have_a_size_too() {
        let camera = Camera::from_weak_perspective(0.9, 0.1, -0.2, [1.0, 0.0, 0.0, 0.0], 64, 64);
        let pose = Pose::of(&camera, LENS);
        let far = CommonLens { focal: 4.5e4, distance: 2.4e4 };
        let found = seen(Pose { ..pose }.projection(far), [0.3, 0.2, 0.1]);
        let expected = camera.project([0.3, 0.2, 0.1]);
        assert!((found[0] - (expected.column / 32.0 - 1.0)).abs() < 1e-3, "{found:?} {expected:?}");
        assert!((found[1] - (1.0 - expected.row / 32.0)).abs() < 1e-3, "{found:?} {expected:?}");
    }
}
