//! Turns about the upright axis that leave a surface as it is.

use mesh_core::{TriMesh, bounds, sample_points};

use super::point_distances;

/// Turns that are tried, over the full circle.
const TURNS: usize = 24;
/// How much farther from a turned sample of the surface points may be than from another sample of the surface itself.
const ALIKE: f64 = 1.25;

/// The turns about +Y through the middle of its bounding box, degrees in `[0, 360)`, that leave a surface as it is; 0 is always among them.
///
/// Of what a camera does not see cannot be told which of these it is: a round table has no front, and an error of a camera is
/// one only [modulo these](symmetric_rotation_angle). Multiples of 15 degrees are tried. A turn leaves the surface as it is if `points` of the
/// turned surface are no farther from others of the surface, on average, than two samples of one surface are from each other, times 1.25; colours
/// do not count. So what is seen is as fine as the samples are dense: details much smaller than their spacing are not.
/// Of a mesh without area, and with no `points`, nothing can be told: 0 is the only one.
///
/// # Cost
/// 24 searches for nearest neighbours among `points`.
///
/// ```
/// use losses::metrics::turns;
/// use mesh_core::primitives::{cuboid, icosphere};
///
/// assert_eq!(turns(&cuboid([1.0, 0.3, 0.5]), 2000), [0.0, 180.0]);
/// assert_eq!(turns(&icosphere(3), 2000).len(), 24);
/// ```
pub fn turns(mesh: &TriMesh, points: usize) -> Vec<f64> {
    let [(surface, _), (other, _)] = [0, 1].map(|seed| sample_points(mesh, points, seed));
    let Some(around) = super::bounds::bounds(mesh).filter(|_| !surface.is_empty()) else {
        return vec![0.0];
    };
    let [x, _, z] = bounds::center(around).map(|c| c as f32);
    let turned = |degrees: f64| -> Vec<[f32; 3]> {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let (sin, cos) = (sin as f32, cos as f32);
        let turn = |p: &[f32; 3]| {
            let [a, b] = [p[0] - x, p[2] - z];
            [x + cos * a + sin * b, p[1], z - sin * a + cos * b]
        };
        other.iter().map(turn).collect()
    };
    let away = |degrees: f64| {
        let (there, back) = point_distances(&surface, &turned(degrees)).chamfer(false);
        there + back
    };
    let itself = away(0.0);
    let all = (0..TURNS).map(|k| 360.0 * k as f64 / TURNS as f64);
    all.filter(|&degrees| degrees == 0.0 || away(degrees) <= ALIKE * itself).collect()
}

/// The smallest [`rotation_angle`](super::rotation_angle) between a rotation and a true one after any of these turns about +Y, degrees.
///
/// Rotations are quaternions w, x, y, z from the object's frame to the camera's, so a turn of the object comes first. Not a number without
/// turns: what has no symmetry has that by 0.
pub fn symmetric_rotation_angle(found: [f64; 4], truth: [f64; 4], turns: &[f64]) -> f64 {
    let turned = |degrees: &f64| {
        let (sin, cos) = (0.5 * degrees).to_radians().sin_cos();
        let [w, x, y, z] = truth;
        // truth * (cos, 0, sin, 0)
        [w * cos - y * sin, x * cos - z * sin, y * cos + w * sin, z * cos + x * sin]
    };
    let angles = turns.iter().map(|turn| super::rotation_angle(found, turned(turn)));
    angles.fold(f64::NAN, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesh_core::primitives::{cuboid, lathe};

    #[test]
    fn what_is_round_has_no_front_and_what_has_one_keeps_it() {
        let vase = lathe(&[[0.4, -0.8], [0.65, -0.4], [0.3, 0.4], [0.45, 0.8]], 96);
        assert_eq!(turns(&vase, 2000).len(), TURNS);
        assert_eq!(turns(&cuboid([0.6, 0.2, 0.6]), 2000), [0.0, 90.0, 180.0, 270.0]);
        // A wedge: higher at one end.
        let wedge = cuboid([0.5, 0.3, 1.0])
            .map_positions(|[x, y, z]| [x, if y > 0.0 { y * (1.0 + 0.8 * z) } else { y }, z]);
        assert_eq!(turns(&wedge, 2000), [0.0]);
        assert_eq!(turns(&TriMesh::default(), 2000), [0.0]);
    }

    #[test]
    fn where_there_are_no_points_no_turn_is_known() {
        let line = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        assert_eq!(turns(&TriMesh::new(line.to_vec(), vec![[0, 1, 2]]), 2000), [0.0]);
        assert_eq!(turns(&cuboid([0.6, 0.2, 0.6]), 0), [0.0]);
    }

    #[test]
    fn an_error_by_a_turn_that_nobody_sees_is_none() {
        let turn = |degrees: f64| {
            let (sin, cos) = (0.5 * degrees).to_radians().sin_cos();
            [cos, 0.0, sin, 0.0]
        };
        let (truth, found) = (turn(20.0), turn(205.0));
        assert!((symmetric_rotation_angle(found, truth, &[0.0]) - 175.0).abs() < 1e-9);
        assert!((symmetric_rotation_angle(found, truth, &[0.0, 180.0]) - 5.0).abs() < 1e-9);
        // The turn is the object's: before a camera that is tilted too.
        let (sin, cos) = 0.4_f64.sin_cos();
        let tilted = |[w, _, y, _]: [f64; 4]| [cos * w, sin * w, cos * y, sin * y];
        let angle = symmetric_rotation_angle(tilted(found), tilted(truth), &[0.0, 180.0]);
        assert!((angle - 5.0).abs() < 1e-9, "{angle}");
    }
}
