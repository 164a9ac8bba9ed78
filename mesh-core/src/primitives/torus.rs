//! The torus: the simplest closed surface that is no sphere.

use std::f64::consts::TAU;

use crate::TriMesh;
use crate::vector::narrow;

/// A torus around the Y axis: `rings` circles of `sides` points each.
///
/// `major` is the distance from the axis to the middle of the tube, `minor` the tube's radius.
///
/// # Panics
/// Unless `0 < minor < major` and there are at least 3 rings and sides.
pub fn torus(major: f32, minor: f32, rings: usize, sides: usize) -> TriMesh {
    assert!(
        0.0 < minor && minor < major && major.is_finite(),
        "torus: radii {major} and {minor}, expected 0 < minor < major"
    );
    assert!(rings >= 3 && sides >= 3, "torus: {rings} rings, {sides} sides, expected at least 3");
    let (major, minor) = (f64::from(major), f64::from(minor));
    let mut positions = Vec::with_capacity(rings * sides);
    let mut faces = Vec::with_capacity(2 * rings * sides);
    for i in 0..rings {
        let (sin_u, cos_u) = (TAU * i as f64 / rings as f64).sin_cos();
        for j in 0..sides {
            let (sin_v, cos_v) = (TAU * j as f64 / sides as f64).sin_cos();
            let radius = major + minor * cos_v;
            positions.push(narrow([radius * cos_u, minor * sin_v, radius * sin_u]));
            let at = |i: usize, j: usize| ((i % rings) * sides + j % sides) as u32;
            let (a, b, c, d) = (at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j));
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    TriMesh::new(positions, faces)
}

#[cfg(test)]
mod tests {
    use super::super::tests::assert_sound;
    use super::*;

    #[test]
    fn volume_and_area_by_pappus() {
        let mesh = torus(2.0, 0.5, 160, 120);
        assert_sound(&mesh, 0);
        let pi = std::f64::consts::PI;
        approx::assert_relative_eq!(mesh.volume(), pi * pi, max_relative = 2e-3);
        approx::assert_relative_eq!(mesh.area(), 4.0 * pi * pi, max_relative = 2e-3);
        assert_sound(&torus(1.0, 0.99, 3, 3), 0);
    }
}
