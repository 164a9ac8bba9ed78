//! Boxes with round edges and corners.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_4;

use crate::TriMesh;
use crate::vector::{narrow, scale, unit};

/// A box of `[width, height, depth]` whose edges and corners are rounded, `parts` bands to each.
///
/// With one band edges are bevelled. `6 (2 parts + 1)²` quadrilaterals.
///
/// # Panics
/// Unless `0 < radius < side / 2` for every side, all are finite, and there is at least one part.
pub fn rounded_cuboid(sides: [f32; 3], radius: f32, parts: usize) -> TriMesh {
    assert!(parts >= 1, "rounded_cuboid: no parts");
    for side in sides {
        assert!(
            radius > 0.0 && 2.0 * radius < side && side.is_finite(),
            "rounded_cuboid: radius {radius} for sides {sides:?}, expected less than half of each"
        );
    }
    // Steps along an axis: `parts + 1` points of the lower edge, then as many of the upper one.
    let last = 2 * parts + 1;
    let side_of = |i: usize| if i <= parts { -1.0 } else { 1.0 };
    // Equal angles rather than equal steps on the cube that is pushed out to the ball.
    let lean = |i: usize| {
        let from = if i <= parts { i } else { i - 1 } as f64 / parts as f64 - 1.0;
        (FRAC_PI_4 * from).tan()
    };
    let radius = f64::from(radius);
    let place = |at: [usize; 3]| {
        let out = scale(unit(at.map(lean)), radius);
        narrow(std::array::from_fn(|k| {
            side_of(at[k]) * (0.5 * f64::from(sides[k]) - radius) + out[k]
        }))
    };
    let mut known = BTreeMap::new();
    let mut positions = Vec::new();
    let mut faces = Vec::new();
    for axis in 0..3 {
        for end in [0, last] {
            let mut corner = |i: usize, j: usize| {
                let mut at = [0; 3];
                (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (end, i, j);
                *known.entry(at).or_insert_with(|| {
                    positions.push(place(at));
                    positions.len() as u32 - 1
                })
            };
            for i in 0..last {
                for j in 0..last {
                    let [a, b] = [corner(i, j), corner(i + 1, j)];
                    let [c, d] = [corner(i + 1, j + 1), corner(i, j + 1)];
                    let [b, d] = if end == 0 { [d, b] } else { [b, d] };
                    faces.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
    }
    TriMesh::new(positions, faces)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::super::tests::assert_sound;
    use super::*;

    #[test]
    fn volume_by_steiner() {
        let (sides, r) = ([2.0, 3.0, 4.0], 0.5);
        let mesh = rounded_cuboid(sides, r, 12);
        assert_sound(&mesh, 2);
        assert_eq!(mesh.faces.len(), 2 * 6 * 25 * 25);
        assert_eq!(mesh.bounds(), Some(([-1.0, -1.5, -2.0], [1.0, 1.5, 2.0])));
        // Core, slabs on its sides, quarter cylinders on its edges, a ball at its corners.
        let [a, b, c] = sides.map(|s| f64::from(s - 2.0 * r));
        let r = f64::from(r);
        let volume = a * b * c
            + 2.0 * r * (a * b + b * c + c * a)
            + PI * r * r * (a + b + c)
            + 4.0 / 3.0 * PI * r.powi(3);
        approx::assert_relative_eq!(mesh.volume(), volume, max_relative = 2e-3);
        assert_sound(&rounded_cuboid([1.0; 3], 0.49, 1), 2);
    }

    #[test]
    #[should_panic(expected = "less than half")]
    fn a_radius_that_does_not_fit_is_refused() {
        rounded_cuboid([1.0, 2.0, 3.0], 0.5, 2);
    }
}
