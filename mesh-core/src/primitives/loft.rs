//! Solids through a row of cross-sections.

use super::PolygonError;
use super::extrude::triangulate;
use crate::TriMesh;
use crate::vector::{Vec3, add, cross, norm, sub, unit, widen};

/// A solid through cross-sections: closed rings of equal count, joined point by point and capped.
///
/// Neighbouring rings are joined by quadrilaterals, each cut along its shorter diagonal. The first
/// and the last section may be a single point, where the solid ends in a tip; other ends are
/// closed by triangles between the ring's own points and may be concave, but should be near a
/// plane. Rings may run either way round, all alike: the result is turned outward.
///
/// ```
/// use mesh_core::primitives;
/// let square = |y: f32, r: f32| vec![[r, y, r], [r, y, -r], [-r, y, -r], [-r, y, r]];
/// let roof = primitives::loft(&[square(0.0, 1.0), square(1.0, 1.0), vec![[0.0, 2.0, 0.0]]]).unwrap();
/// assert!(roof.health().is_watertight());
/// ```
///
/// # Errors
/// If an end cannot be closed: seen along its normal the ring crosses itself or encloses nothing;
/// or if a coordinate is not finite.
/// # Panics
/// If there are fewer than two sections, rings of fewer than 3 points or of different counts, a
/// single point elsewhere than at an end, or no ring at all.
pub fn loft(sections: &[Vec<[f32; 3]>]) -> Result<TriMesh, PolygonError> {
    assert!(sections.len() >= 2, "loft: {} sections, expected at least 2", sections.len());
    let n = sections.iter().map(Vec::len).max().unwrap_or(0);
    assert!(n >= 3, "loft: rings of {n} points, expected at least 3");
    let last = sections.len() - 1;
    for (i, section) in sections.iter().enumerate() {
        let tip = section.len() == 1 && (i == 0 || i == last);
        let found = section.len();
        assert!(tip || found == n, "loft: section {i} has {found} points, others {n}");
    }
    let positions: Vec<[f32; 3]> = sections.iter().flatten().copied().collect();
    let wide: Vec<Vec3> = positions.iter().map(|&p| widen(p)).collect();
    if let Some(corner) = wide.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        let [x, y, _] = positions[corner];
        return Err(PolygonError::NotFinite { corner, position: [x, y] });
    }

    let mut faces = Vec::with_capacity(2 * n * sections.len());
    let mut start = 0;
    for (i, section) in sections.iter().enumerate() {
        let (ring, next) = (start as u32, (start + section.len()) as u32);
        start += section.len();
        let single = section.len() == 1;
        if i == 0 && !single {
            faces.extend(cap(&wide[..n])?.into_iter().map(|[a, b, c]| [a, c, b]));
        }
        if i == last {
            if !single {
                faces.extend(cap(&wide[ring as usize..])?.into_iter().map(|f| f.map(|v| v + ring)));
            }
            break;
        }
        let point = sections[i + 1].len() == 1;
        for j in 0..n as u32 {
            let k = (j + 1) % n as u32;
            if single {
                faces.push([ring, next + k, next + j]);
            } else if point {
                faces.push([ring + j, ring + k, next]);
            } else {
                faces.extend(quad(&wide, [ring + j, ring + k, next + k, next + j]));
            }
        }
    }
    let mesh = TriMesh::new(positions, faces);
    Ok(if mesh.volume() < 0.0 { mesh.flipped() } else { mesh })
}

/// A plate between two surfaces given as grids of points, row by row: a window in a curved body,
/// a fender over a wheel.
///
/// `front` and `back` have the same counts, at least 2 x 2; the rim joins their borders. It does
/// not matter which of them is outside: the result is turned outward.
///
/// # Panics
/// If the grids are smaller, ragged, or different in size.
pub fn plate(front: &[Vec<[f32; 3]>], back: &[Vec<[f32; 3]>]) -> TriMesh {
    let (rows, columns) = (front.len(), front.first().map_or(0, Vec::len));
    assert!(rows >= 2 && columns >= 2, "plate: {rows} x {columns} points, expected 2 x 2 or more");
    assert!(
        back.len() == rows && front.iter().chain(back).all(|row| row.len() == columns),
        "plate: ragged or different grids"
    );
    let positions: Vec<[f32; 3]> = front.iter().chain(back).flatten().copied().collect();
    let wide: Vec<Vec3> = positions.iter().map(|&p| widen(p)).collect();
    let at = |i: usize, j: usize| (i * columns + j) as u32;
    let behind = (rows * columns) as u32;
    let mut faces = Vec::with_capacity(4 * rows * columns + 4 * (rows + columns));
    for i in 0..rows - 1 {
        for j in 0..columns - 1 {
            let corners = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
            faces.extend(quad(&wide, corners));
            faces.extend(quad(&wide, corners.map(|v| v + behind)).map(|[a, b, c]| [a, c, b]));
        }
    }
    let mut rim: Vec<u32> = (0..columns).map(|j| at(0, j)).collect();
    rim.extend((1..rows).map(|i| at(i, columns - 1)));
    rim.extend((0..columns - 1).rev().map(|j| at(rows - 1, j)));
    rim.extend((1..rows - 1).rev().map(|i| at(i, 0)));
    for (i, &a) in rim.iter().enumerate() {
        let b = rim[(i + 1) % rim.len()];
        faces.extend(quad(&wide, [b, a, a + behind, b + behind]));
    }
    let mesh = TriMesh::new(positions, faces);
    if mesh.volume() < 0.0 { mesh.flipped() } else { mesh }
}

/// A quadrilateral as two triangles, cut along its shorter diagonal.
fn quad(points: &[Vec3], [a, b, c, d]: [u32; 4]) -> [[u32; 3]; 2] {
    let length = |p: u32, q: u32| norm(sub(points[p as usize], points[q as usize]));
    // A hair of preference, so that rounding does not decide between equals.
    if length(a, c) <= length(b, d) * (1.0 + 1e-6) {
        [[a, b, c], [a, c, d]]
    } else {
        [[a, b, d], [b, c, d]]
    }
}

/// The triangles of a ring, which run round it as it does itself.
fn cap(ring: &[Vec3]) -> Result<Vec<[u32; 3]>, PolygonError> {
    // Newell's normal: the mean plane of a ring that need not be flat.
    let mut normal = [0.0; 3];
    for (i, &p) in ring.iter().enumerate() {
        normal = add(normal, cross(sub(p, ring[0]), sub(ring[(i + 1) % ring.len()], ring[0])));
    }
    let normal = unit(normal);
    let axis = if normal[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let u = unit(cross(axis, normal));
    let v = cross(normal, u);
    let flat: Vec<[f64; 2]> = ring
        .iter()
        .map(|&p| {
            let p = sub(p, ring[0]);
            [u, v].map(|axis| axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2])
        })
        .collect();
    triangulate(&flat)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::super::tests::assert_sound;
    use super::*;

    /// An L of six corners in the plane of the given height.
    fn l(y: f32, s: f32) -> Vec<[f32; 3]> {
        [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]]
            .map(|[x, z]| [s * x, y, s * z])
            .to_vec()
    }

    #[test]
    fn a_prism_over_a_concave_ring_either_way_round() {
        let mesh = loft(&[l(0.0, 1.0), l(0.5, 1.0), l(2.0, 1.0)]).unwrap();
        assert_sound(&mesh, 2);
        approx::assert_relative_eq!(mesh.volume(), 6.0, max_relative = 1e-6);
        let turned = [l(0.0, 1.0), l(2.0, 1.0)].map(|ring| ring.into_iter().rev().collect());
        assert_sound(&loft(&turned).unwrap(), 2);
    }

    #[test]
    fn tips_at_either_end() {
        let tip = |y: f32| vec![[0.3, y, 0.3]];
        for sections in [
            vec![tip(-1.0), l(0.0, 1.0), tip(1.0)],
            vec![l(0.0, 1.0), tip(1.0)],
            vec![tip(-1.0), l(0.0, 1.0), l(1.0, 0.5)],
        ] {
            assert_sound(&loft(&sections).unwrap(), 2);
        }
        let pyramid = loft(&[l(0.0, 1.0), tip(1.0)]).unwrap();
        approx::assert_relative_eq!(pyramid.volume(), 1.0, max_relative = 1e-6);
    }

    #[test]
    fn an_end_that_crosses_itself_is_refused() {
        let bow: Vec<[f32; 3]> =
            vec![[0.0, 0.0, 0.0], [1.0, 0.0, 1.1], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        let moved = bow.iter().map(|p| [p[0], 1.0, p[2]]).collect();
        assert_eq!(loft(&[bow, moved]), Err(PolygonError::NotSimple));
        let nan = vec![[f32::NAN; 3]; 3];
        assert!(matches!(loft(&[nan.clone(), nan]), Err(PolygonError::NotFinite { .. })));
    }

    #[test]
    #[should_panic(expected = "section 1 has 3 points, others 6")]
    fn different_counts_are_refused() {
        let _ = loft(&[l(0.0, 1.0), l(1.0, 1.0)[..3].to_vec()]);
    }

    #[test]
    fn a_plate_has_the_volume_between_its_sides() {
        let grid = |y: f32| -> Vec<Vec<[f32; 3]>> {
            (0..4).map(|i| (0..5).map(|j| [j as f32, y, i as f32]).collect()).collect()
        };
        for (front, back) in [(1.5, 1.0), (1.0, 1.5)] {
            let mesh = plate(&grid(front), &grid(back));
            assert_sound(&mesh, 2);
            approx::assert_relative_eq!(mesh.volume(), 6.0, max_relative = 1e-6);
        }
    }
}
