//! Which rows of cell middles along x pass a face, and where.

use crate::vector::{Vec3, area_vector};

/// Places in y and z for each cell.
const ONE: i64 = 65536;

/// A face in units of cells, whose corners are snapped in y and z.
pub(super) struct SnappedFace {
    corners: [Vec3; 3],
    /// y and z of the corners, in 1/65536 of a cell.
    flat: [[i64; 2]; 3],
    normal: Vec3,
    /// 1 where its normal points towards larger x, otherwise -1.
    pub(super) turn: i32,
}

impl SnappedFace {
    /// None of a face along x, which no row passes, or one that is too far away to be snapped.
    pub(super) fn new(corners: [Vec3; 3]) -> Option<Self> {
        let limit = f64::from(1_u32 << 30);
        if corners.iter().flatten().any(|x| x.is_nan() || x.abs() > limit) {
            return None;
        }
        let snapped = |x: f64| (x * ONE as f64).round() as i64;
        let flat = corners.map(|p| [snapped(p[1]), snapped(p[2])]);
        let area = side(flat[0], flat[1], flat[2]);
        let turn = if area > 0 { 1 } else { -1 };
        (area != 0).then(|| Self { corners, flat, normal: area_vector(corners), turn })
    }

    /// From where to where it reaches along y and z, each with the number of its axis.
    pub(super) fn bounds(&self) -> [(usize, f64, f64); 2] {
        [0, 1].map(|k| {
            let values = self.flat.map(|p| p[k] as f64 / ONE as f64);
            let low = values.into_iter().fold(f64::INFINITY, f64::min);
            let high = values.into_iter().fold(f64::NEG_INFINITY, f64::max);
            (k + 1, low, high)
        })
    }

    /// Whether the row of the middles of these cells passes it.
    pub(super) fn covers(&self, y: usize, z: usize) -> bool {
        let middle = [y as i64 * ONE + ONE / 2, z as i64 * ONE + ONE / 2];
        (0..3).all(|k| {
            let (a, b) = (self.flat[k], self.flat[(k + 1) % 3]);
            let s = side(a, b, middle) * i128::from(self.turn);
            // On the edge itself: it belongs to the face on one side of it only.
            let turn = i64::from(self.turn);
            let (dy, dz) = ((b[0] - a[0]) * turn, (b[1] - a[1]) * turn);
            s > 0 || (s == 0 && (dz > 0 || (dz == 0 && dy < 0)))
        })
    }

    /// Where along x that row passes it: its plane, within its corners. The plane of a face that is almost along x may be passed far beyond
    /// these by a row that its snapped corners still hold.
    pub(super) fn crossing(&self, y: usize, z: usize) -> f64 {
        let (corner, normal) = (self.corners[0], self.normal);
        let away = [0.0, y as f64 + 0.5 - corner[1], z as f64 + 0.5 - corner[2]];
        let x = corner[0] - (normal[1] * away[1] + normal[2] * away[2]) / normal[0];
        let xs = self.corners.map(|corner| corner[0]);
        let low = xs.into_iter().fold(f64::INFINITY, f64::min);
        let high = xs.into_iter().fold(f64::NEG_INFINITY, f64::max);
        if x.is_nan() { 0.5 * (low + high) } else { x.clamp(low, high) }
    }
}

/// Twice the area of a triangle of snapped corners, positive where they go round from y to z.
fn side([ay, az]: [i64; 2], [by, bz]: [i64; 2], [cy, cz]: [i64; 2]) -> i128 {
    i128::from(by - ay) * i128::from(cz - az) - i128::from(bz - az) * i128::from(cy - ay)
}
