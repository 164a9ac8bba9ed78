//! What is inside of a closed mesh.

use crate::mesh::signed_volume;
use crate::vector::{Vec3, area_vector, cross, dot, norm, sub, triangle, widen};
use crate::{Topology, TriMesh};

impl TriMesh {
    /// How often the surface goes around a point: 1 inside of a closed mesh, 0 outside, -1 inside of one whose faces point
    /// inward, 2 where two pieces overlap; in between on the surface and where it is open. NaN for a point that is not finite.
    ///
    /// ```
    /// use mesh_core::primitives;
    /// let ball = primitives::icosphere(2);
    /// assert!((ball.winding_number([0.5, 0.1, 0.2]) - 1.0).abs() < 1e-6);
    /// assert!(ball.winding_number([1.5, 0.1, 0.2]).abs() < 1e-6);
    /// ```
    ///
    /// # Cost
    /// `O(F)`.
    ///
    /// # Panics
    /// If a face names a vertex that does not exist.
    ///
    /// # References
    /// Jacobson, Kavan, Sorkine-Hornung 2013, *Robust Inside-Outside Segmentation using Generalized Winding Numbers*.
    pub fn winding_number(&self, point: [f32; 3]) -> f64 {
        winding(self.faces.iter().map(|&face| triangle(&self.positions, face)), widen(point))
    }
}

/// The solid angles of triangles seen from `p`, as a share of the whole sphere. Triangles that are not finite are left out.
pub(crate) fn winding(triangles: impl Iterator<Item = [Vec3; 3]>, p: Vec3) -> f64 {
    let angle = |corners: [Vec3; 3]| {
        let [a, b, c] = corners.map(|q| sub(q, p));
        let [x, y, z] = [a, b, c].map(norm);
        let volume = dot(a, cross(b, c));
        let projected = x * y * z + dot(a, b) * z + dot(b, c) * x + dot(c, a) * y;
        2.0 * volume.atan2(projected)
    };
    if !p.iter().all(|x| x.is_finite()) {
        return f64::NAN;
    }
    let angles = triangles.map(angle).filter(|angle| angle.is_finite());
    angles.sum::<f64>() / (4.0 * std::f64::consts::PI)
}

/// Pairs of pieces that are compared, and faces that are looked at, before the rest counts as sound: among ten thousand pieces
/// that are nested in each other nobody looks for the one.
const MOST: u64 = 20_000_000;

/// A connected part of a closed surface.
struct Piece {
    faces: Vec<[u32; 3]>,
    low: Vec3,
    high: Vec3,
    points_inward: bool,
}

/// How many pieces of a closed, oriented surface point inward without being the wall of a hollow in another piece.
///
/// # Cost
/// Linear, but for pieces that point inward: each is compared with all, and with the faces of those around it.
pub(crate) fn inside_out(positions: &[[f32; 3]], faces: &[[u32; 3]], topology: &Topology) -> usize {
    let pieces = pieces(positions, faces, topology);
    let (mut work, mut count) = (0_u64, 0);
    for (k, piece) in pieces.iter().enumerate().filter(|(_, piece)| piece.points_inward) {
        work += pieces.len() as u64;
        if work > MOST {
            break;
        }
        let within = |other: &Piece| {
            (0..3).all(|k| other.low[k] <= piece.low[k] && piece.high[k] <= other.high[k])
        };
        let corner = widen(positions[piece.faces[0][0] as usize]);
        let mut turns = 0.0;
        for (_, around) in pieces.iter().enumerate().filter(|(o, other)| *o != k && within(other)) {
            work += around.faces.len() as u64;
            turns += winding(around.faces.iter().map(|&face| triangle(positions, face)), corner);
        }
        // A corner of the wall may lie on the surface around it: half a turn.
        count += usize::from(turns < 0.25);
    }
    count
}

fn pieces(positions: &[[f32; 3]], faces: &[[u32; 3]], topology: &Topology) -> Vec<Piece> {
    let component = topology.components();
    let mut of: Vec<Vec<[u32; 3]>> = vec![Vec::new(); topology.component_count()];
    for &face in faces {
        of[component[face[0] as usize] as usize].push(face);
    }
    let piece = |faces: Vec<[u32; 3]>| {
        let corners = || faces.iter().flatten().map(|&v| widen(positions[v as usize]));
        let fold = |start: f64, of: fn(f64, f64) -> f64| {
            corners().fold([start; 3], |most, p| std::array::from_fn(|k| of(most[k], p[k])))
        };
        let (low, high) = (fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max));
        // Flat pieces have a volume of rounding errors.
        let area: f64 =
            faces.iter().map(|&f| 0.5 * norm(area_vector(triangle(positions, f)))).sum();
        let points_inward = signed_volume(positions, &faces) < -1e-6 * area.powf(1.5);
        Piece { faces, low, high, points_inward }
    };
    of.into_iter().filter(|faces| !faces.is_empty()).map(piece).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use crate::{TriMesh, primitives};

    fn all(pieces: &[TriMesh]) -> TriMesh {
        let mut mesh = TriMesh::default();
        for piece in pieces {
            mesh.append(piece).unwrap();
        }
        mesh
    }

    #[test]
    fn hollows_are_walls_and_other_inward_pieces_are_not() {
        let ball = |radius: f32, x: f32| {
            primitives::icosphere(2).scaled([radius; 3]).translated([x, 0.0, 0.0])
        };
        let count = |pieces: &[TriMesh]| all(pieces).health().inward_pieces;
        assert_eq!(count(&[ball(1.0, 0.0), ball(0.5, 3.0)]), 0);
        assert_eq!(count(&[ball(1.0, 0.0), ball(0.5, 3.0).flipped()]), 1);
        // A shell, a shell with a kernel, and a hollow in no more than a hollow.
        let wall = ball(0.5, 0.1).flipped();
        assert_eq!(count(&[ball(1.0, 0.0), wall.clone()]), 0);
        assert_eq!(count(&[ball(1.0, 0.0), wall.clone(), ball(0.2, 0.1)]), 0);
        assert_eq!(count(&[ball(1.0, 0.0), wall.clone(), ball(0.2, 0.1).flipped()]), 1);
        // Within the box around a ball, and outside of it.
        let corner = ball(0.1, 0.0).flipped().translated([0.8; 3]);
        assert_eq!(count(&[ball(1.0, 0.0), corner]), 1);
        let shell = all(&[ball(1.0, 0.0), wall]);
        assert!(shell.examined().is_solid());
        assert!((shell.winding_number([0.8, 0.0, 0.0]) - 1.0).abs() < 1e-9);
        assert!(shell.winding_number([0.1, 0.0, 0.0]).abs() < 1e-9);
        assert!(shell.winding_number([f32::NAN; 3]).is_nan());

        let found = all(&[ball(1.0, 0.0), ball(0.5, 3.0).flipped()]).examined();
        assert!(!found.is_solid() && !found.health.is_watertight());
        assert_eq!(found.to_string(), "no solid: 1 piece points inward");
    }
}
