//! Prisms over a polygon.

use crate::TriMesh;

/// What is wrong with a polygon.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PolygonError {
    /// Fewer than three corners.
    #[error("the polygon has {found} corners, expected at least 3")]
    TooFew {
        /// How many there are.
        found: usize,
    },
    /// A corner is NaN or infinite.
    #[error("corner {corner} of the polygon is {position:?}, expected finite coordinates")]
    NotFinite {
        /// Which corner.
        corner: usize,
        /// Where it is.
        position: [f32; 2],
    },
    /// The outline crosses or touches itself, or encloses nothing.
    #[error("the polygon crosses or touches itself, or encloses nothing, expected a simple one")]
    NotSimple,
    /// The height is not positive and finite.
    #[error("the height is {found}, expected a positive one")]
    Height {
        /// The height.
        found: f32,
    },
}

/// A prism over a simple polygon in the XY plane, from `-height / 2` to `height / 2` along Z.
///
/// The polygon may run either way round and need not be convex; `2 n` vertices and `4 n - 4` faces.
///
/// ```
/// use mesh_core::primitives;
/// let l = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
/// let mesh = primitives::extrude(&l, 0.5).unwrap();
/// assert_eq!(mesh.volume(), 1.5);
/// ```
///
/// # Errors
/// If the polygon is not a simple one, or the height not positive.
/// # Cost
/// Up to cubic in the number of corners (ear clipping), quadratic for most outlines.
pub fn extrude(polygon: &[[f32; 2]], height: f32) -> Result<TriMesh, PolygonError> {
    if !(height > 0.0 && height.is_finite()) {
        return Err(PolygonError::Height { found: height });
    }
    let n = polygon.len();
    if n < 3 {
        return Err(PolygonError::TooFew { found: n });
    }
    for (corner, &position) in polygon.iter().enumerate() {
        if !position.iter().all(|x| x.is_finite()) {
            return Err(PolygonError::NotFinite { corner, position });
        }
    }
    let mut outline: Vec<[f64; 2]> = polygon.iter().map(|p| p.map(f64::from)).collect();
    let area: f64 = (0..n).map(|i| turn([0.0; 2], outline[i], outline[(i + 1) % n])).sum();
    if area < 0.0 {
        outline.reverse();
    }

    let cap = triangulate(&outline)?;
    let half = 0.5 * height;
    let at = |z: f32| outline.iter().map(move |p| [p[0] as f32, p[1] as f32, z]);
    let positions = at(-half).chain(at(half)).collect();
    let n = n as u32;
    let mut faces = Vec::with_capacity(4 * outline.len());
    faces.extend(cap.iter().map(|&[a, b, c]| [a, c, b]));
    faces.extend(cap.iter().map(|face| face.map(|v| v + n)));
    for a in 0..n {
        let b = (a + 1) % n;
        faces.extend([[a, b, b + n], [a, b + n, a + n]]);
    }
    Ok(TriMesh::new(positions, faces))
}

/// The triangles of a simple polygon that runs counter-clockwise, which run so too.
pub(super) fn triangulate(outline: &[[f64; 2]]) -> Result<Vec<[u32; 3]>, PolygonError> {
    if crosses_itself(outline) {
        return Err(PolygonError::NotSimple);
    }
    clip_ears(outline).ok_or(PolygonError::NotSimple)
}

/// Twice the signed area of a triangle: positive where `a, b, c` turns left.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether any two sides that are not neighbours meet, or neighbours fold back on each other.
fn crosses_itself(outline: &[[f64; 2]]) -> bool {
    let n = outline.len();
    let between = |a: f64, b: f64, x: f64| a.min(b) <= x && x <= a.max(b);
    let on = |a: [f64; 2], b: [f64; 2], p: [f64; 2]| {
        turn(a, b, p) == 0.0 && between(a[0], b[0], p[0]) && between(a[1], b[1], p[1])
    };
    for i in 0..n {
        let (a, b) = (outline[i], outline[(i + 1) % n]);
        if a == b || on(a, b, outline[(i + 2) % n]) || on(b, outline[(i + 2) % n], a) {
            return true;
        }
        for j in i + 2..n {
            if (j + 1) % n == i {
                continue;
            }
            let (c, d) = (outline[j], outline[(j + 1) % n]);
            let opposite = |s: f64, t: f64| (s > 0.0 && t < 0.0) || (s < 0.0 && t > 0.0);
            if (opposite(turn(a, b, c), turn(a, b, d)) && opposite(turn(c, d, a), turn(c, d, b)))
                || on(a, b, c)
                || on(a, b, d)
                || on(c, d, a)
                || on(c, d, b)
            {
                return true;
            }
        }
    }
    false
}

/// Triangulates a simple polygon that runs counter-clockwise.
fn clip_ears(outline: &[[f64; 2]]) -> Option<Vec<[u32; 3]>> {
    let mut left: Vec<u32> = (0..outline.len() as u32).collect();
    let mut faces = Vec::with_capacity(outline.len() - 2);
    while left.len() > 3 {
        let n = left.len();
        let corner = |i: usize| outline[left[i % n] as usize];
        let free = |i: usize| {
            let (a, b, c) = (corner(i + n - 1), corner(i), corner(i + 1));
            turn(a, b, c) > 0.0
                && (2..n - 1).all(|k| {
                    let p = corner(i + k);
                    turn(a, b, p) < 0.0 || turn(b, c, p) < 0.0 || turn(c, a, p) < 0.0
                })
        };
        // Of all ears, the one with the widest smallest angle: fewer slivers than the first found.
        let quality = |i: usize| {
            let (a, b, c) = (corner(i + n - 1), corner(i), corner(i + 1));
            let square = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2);
            turn(a, b, c) / (square(a, b) + square(b, c) + square(c, a))
        };
        let ear = (0..n)
            .filter(|&i| free(i))
            .max_by(|&i, &j| quality(i).total_cmp(&quality(j)).then(j.cmp(&i)))?;
        faces.push([left[(ear + n - 1) % n], left[ear], left[(ear + 1) % n]]);
        left.remove(ear);
    }
    let last = [left[0], left[1], left[2]];
    let [a, b, c] = last.map(|v| outline[v as usize]);
    (turn(a, b, c) > 0.0).then(|| {
        faces.push(last);
        faces
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::super::tests::assert_sound;
    use super::*;

    #[test]
    fn a_star_either_way_round() {
        let star: Vec<[f32; 2]> = (0..10)
            .map(|i| {
                let (sin, cos) = (i as f32 * std::f32::consts::PI / 5.0).sin_cos();
                let radius = if i % 2 == 0 { 1.0 } else { 0.4 };
                [radius * cos, radius * sin]
            })
            .collect();
        let mesh = extrude(&star, 2.0).unwrap();
        assert_sound(&mesh, 2);
        assert_eq!((mesh.positions.len(), mesh.faces.len()), (20, 36));
        // Ten triangles of sides 1 and 0.4 and an angle of 36 degrees between them.
        let area = 10.0 * 0.5 * 0.4 * (std::f64::consts::PI / 5.0).sin();
        approx::assert_relative_eq!(mesh.volume(), 2.0 * area, max_relative = 1e-6);
        let reversed: Vec<[f32; 2]> = star.into_iter().rev().collect();
        approx::assert_relative_eq!(
            extrude(&reversed, 2.0).unwrap().volume(),
            2.0 * area,
            max_relative = 1e-6
        );
    }

    #[test]
    fn corners_on_a_straight_side_are_kept() {
        let outline = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]];
        let mesh = extrude(&outline, 1.0).unwrap();
        assert_sound(&mesh, 2);
        assert_eq!(mesh.volume(), 2.0);
    }

    #[test]
    fn what_is_no_simple_polygon_is_refused() {
        let refused = |outline: &[[f32; 2]]| extrude(outline, 1.0).unwrap_err();
        let bow_tie = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]];
        assert_eq!(refused(&bow_tie), PolygonError::NotSimple);
        assert_eq!(refused(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]), PolygonError::NotSimple);
        assert_eq!(refused(&[[0.0, 0.0]; 4]), PolygonError::NotSimple);
        assert_eq!(refused(&[[0.0, 0.0], [1.0, 0.0]]), PolygonError::TooFew { found: 2 });
        assert!(
            refused(&[[0.0, 0.0], [1.0, 0.0], [f32::NAN, 1.0]]).to_string().contains("corner 2")
        );
        assert_eq!(extrude(&bow_tie, 0.0), Err(PolygonError::Height { found: 0.0 }));
    }
}
