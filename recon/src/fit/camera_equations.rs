//! What the outline of a mesh in one view tells of that view's camera: Gauss-Newton's normal equations.

use mesh_core::nalgebra::{Matrix6, SMatrix, Vector3, Vector6};
use mesh_core::{Camera, MedianOfEven, median};

use super::outline::Border;

/// Damping, as a share of the weight of a residual that moves with its parameter pixel by pixel: what the masks do not tell (how a
/// ball is turned) stays as it was.
const DAMPING: f64 = 0.0003;
/// The same for moves ahead and the focal length, which only perspective tells apart: more would stop them on their way.
const FAINT: f64 = 0.0001;
/// Distances from here on, in pixels or in medians, count less: they are parts that the shape does not have.
const OUTLIER: f64 = 1.0;
const MEDIANS: f64 = 2.5;

/// How a camera's motion moves the places of a mesh in its image.
pub(super) struct Motion<'a> {
    camera: &'a Camera,
    /// The middle of the object in the camera's frame.
    middle: Vector3<f64>,
    /// Pixels to a unit of a turn (radians), of a move aside, of a move ahead, and of the focal length's logarithm: the equations are in
    /// pixels.
    pub(super) units: [f64; 4],
}

/// How far a place of the mesh's outline is from the edge of the mask, and what the camera's motion does to that.
pub(super) struct Residual {
    /// Derivatives by three turns, three moves and the focal length's logarithm, each in pixels by its unit.
    derivatives: SMatrix<f64, 7, 1>,
    /// Pixels.
    distance: f64,
    weight: f64,
}

/// The normal equations of one view: six of its pose, and their coupling with the focal length.
pub(super) struct Equations {
    pub(super) pose: Matrix6<f64>,
    pub(super) coupling: Vector6<f64>,
    pub(super) focal: f64,
    pub(super) right: Vector6<f64>,
    pub(super) right_focal: f64,
    /// Of all residuals.
    pub(super) weight: f64,
    /// See [`Motion::units`].
    pub(super) units: [f64; 4],
}

impl<'a> Motion<'a> {
    /// That of a camera that sees an object of this middle and radius.
    pub(super) fn of(camera: &'a Camera, center: Vector3<f64>, radius: f64) -> Self {
        let sx = camera.lens.numbers()[0];
        let middle = camera.rotation * center + camera.translation;
        let depth = if camera.is_perspective() { -middle.z } else { 1.0 };
        let pixels = sx / depth;
        let size = pixels * radius;
        Self { camera, middle, units: [size, pixels, size / depth, size] }
    }

    /// Of a place of the outline, given by the way to it from the object's middle.
    pub(super) fn residual(&self, from_middle: Vector3<f64>, border: &Border) -> Residual {
        let (camera, Border { normal, point, .. }) = (self.camera, border);
        let [sx, sy, cx, cy] = camera.lens.numbers();
        let arm = camera.rotation * from_middle;
        let seen = arm + self.middle;
        let over = if camera.is_perspective() { -seen.z } else { 1.0 };
        let [nx, ny] = normal.map(f64::from);
        // How the distance changes when the point moves in the camera's frame.
        let mut toward = Vector3::new(nx * sx / over, -ny * sy / over, 0.0);
        let from_axis = [f64::from(point[0]) - cx, f64::from(point[1]) - cy];
        let spread = nx * from_axis[0] + ny * from_axis[1];
        let lens = if camera.is_perspective() { spread } else { 0.0 };
        toward.z = lens / over;
        let turn = arm.cross(&toward);
        let [by_turn, aside, ahead, by_lens] = self.units;
        let derivatives = SMatrix::<f64, 7, 1>::from_column_slice(&[
            turn.x / by_turn,
            turn.y / by_turn,
            turn.z / by_turn,
            toward.x / aside,
            toward.y / aside,
            toward.z / ahead,
            lens / by_lens,
        ]);
        let (distance, weight) = (f64::from(border.distance), f64::from(border.weight));
        Residual { derivatives, distance, weight }
    }
}

impl Equations {
    /// Those of all residuals of a view, outliers counting less; `None` where there are none.
    pub(super) fn of(residuals: &[Residual], units: [f64; 4]) -> Option<Self> {
        let sizes = residuals.iter().map(|r| r.distance.abs());
        let outlier = OUTLIER.max(MEDIANS * median(sizes, MedianOfEven::Upper)?);
        let mut normal = SMatrix::<f64, 7, 7>::zeros();
        let mut right = SMatrix::<f64, 7, 1>::zeros();
        let mut total = 0.0;
        for Residual { derivatives, distance, weight } in residuals {
            let weight = weight / (1.0 + (distance / outlier).powi(2));
            normal += weight * derivatives * derivatives.transpose();
            right -= weight * distance * derivatives;
            total += weight;
        }
        let mut pose: Matrix6<f64> = normal.fixed_view::<6, 6>(0, 0).into_owned();
        for k in 0..6 {
            pose[(k, k)] += total * if k < 5 { DAMPING } else { FAINT };
        }
        Some(Self {
            pose,
            coupling: normal.fixed_view::<6, 1>(0, 6).into_owned(),
            focal: normal[(6, 6)] + FAINT * total,
            right: right.fixed_view::<6, 1>(0, 0).into_owned(),
            right_focal: right[6],
            weight: total,
            units,
        })
    }

    /// The turn (radians) and the move of the camera, where the focal length's logarithm moves by `focal`.
    pub(super) fn step(&self, focal: f64) -> Vector6<f64> {
        let [turn, aside, ahead, lens] = self.units;
        self.solve(&(self.right - self.coupling * focal * lens))
            .component_div(&Vector6::new(turn, turn, turn, aside, aside, ahead))
    }

    /// The pose's part of them, for another right side; nothing moves where they are singular.
    pub(super) fn solve(&self, right: &Vector6<f64>) -> Vector6<f64> {
        self.pose.cholesky().map_or_else(Vector6::zeros, |c| c.solve(right))
    }
}
