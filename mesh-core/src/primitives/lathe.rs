//! Surfaces of revolution around the Y axis, and the shapes that are special cases of them.

use std::f64::consts::{FRAC_PI_2, TAU};

use crate::TriMesh;
use crate::vector::narrow;

/// Turns a profile around the Y axis into a closed mesh.
///
/// `profile` lists `[radius, height]` from bottom to top. A radius of zero is a point on the axis
/// and allowed only at the two ends; where an end is not on the axis, a flat disc closes it.
///
/// ```
/// use mesh_core::primitives;
/// let vase = primitives::lathe(&[[0.4, 0.0], [0.7, 0.4], [0.3, 0.9], [0.45, 1.1]], 48);
/// assert!(vase.volume() > 0.0);
/// ```
///
/// # Panics
/// If there are fewer than 3 segments; if a value is not finite, a radius is negative, or zero away
/// from the ends; or if the profile has not at least one point off the axis, and two points.
pub fn lathe(profile: &[[f32; 2]], segments: usize) -> TriMesh {
    let wide: Vec<[f64; 2]> = profile.iter().map(|p| p.map(f64::from)).collect();
    turn(&wide, segments)
}

fn turn(profile: &[[f64; 2]], segments: usize) -> TriMesh {
    assert!(segments >= 3, "lathe: {segments} segments, expected at least 3");
    assert!(profile.len() >= 2, "lathe: {} profile points, expected 2 or more", profile.len());
    for (i, &[radius, height]) in profile.iter().enumerate() {
        let end = i == 0 || i + 1 == profile.len();
        assert!(
            radius.is_finite() && height.is_finite() && (radius > 0.0 || (end && radius == 0.0)),
            "lathe: profile point {i} is ({radius}, {height}), expected a positive radius"
        );
    }
    let rings: Vec<[f64; 2]> = profile.iter().copied().filter(|p| p[0] > 0.0).collect();
    assert!(!rings.is_empty(), "lathe: the whole profile is on the axis");
    assert!(profile.len() > 2 || rings.len() == 2, "lathe: the profile encloses nothing");

    let mut positions = Vec::with_capacity(rings.len() * segments + 2);
    for &[radius, height] in &rings {
        for j in 0..segments {
            let (sin, cos) = (TAU * j as f64 / segments as f64).sin_cos();
            positions.push(narrow([radius * cos, height, -radius * sin]));
        }
    }
    positions.push(narrow([0.0, profile[0][1], 0.0]));
    positions.push(narrow([0.0, profile[profile.len() - 1][1], 0.0]));

    TriMesh::new(positions, closed_rings(rings.len(), segments))
}

/// The faces of a tube of rings of so many vertices each, numbered ring after ring, and of a fan at each end, whose
/// middles are the two vertices after them.
///
/// Rings run counter-clockwise seen from the last of them.
///
/// # Panics
/// If there are no rings.
pub fn closed_rings(rings: usize, segments: usize) -> Vec<[u32; 3]> {
    assert!(rings >= 1, "closed_rings: no rings");
    let at = |ring: usize, j: usize| (ring * segments + j % segments) as u32;
    let (bottom, last) = ((rings * segments) as u32, rings - 1);
    let mut faces = Vec::with_capacity(2 * rings * segments);
    for j in 0..segments {
        faces.push([bottom, at(0, j + 1), at(0, j)]);
        for ring in 0..last {
            let (a, b) = (at(ring, j), at(ring, j + 1));
            let (c, d) = (at(ring + 1, j + 1), at(ring + 1, j));
            faces.extend([[a, b, c], [a, c, d]]);
        }
        faces.push([bottom + 1, at(last, j), at(last, j + 1)]);
    }
    faces
}

/// The unit sphere of `rows` bands from pole to pole and `columns` meridians.
///
/// `columns (rows - 1) + 2` vertices, `2 columns (rows - 1)` faces; the poles are on the Y axis.
///
/// # Panics
/// If there are fewer than 2 rows or 3 columns.
pub fn uv_sphere(rows: usize, columns: usize) -> TriMesh {
    assert!(rows >= 2, "uv_sphere: {rows} rows, expected at least 2");
    turn(&arc(1.0, 0.0, -FRAC_PI_2, FRAC_PI_2, rows), columns)
}

/// A cylinder along Y of the given radius and height, closed by flat discs.
///
/// # Panics
/// If a size is not positive and finite, or if there are fewer than 3 segments.
pub fn cylinder(radius: f32, height: f32, segments: usize) -> TriMesh {
    assert_positive("cylinder", &[radius, height]);
    lathe(&[[radius, -0.5 * height], [radius, 0.5 * height]], segments)
}

/// A cone along Y with its apex on top, from `-height / 2` to `height / 2`.
///
/// # Panics
/// If a size is not positive and finite, or if there are fewer than 3 segments.
pub fn cone(radius: f32, height: f32, segments: usize) -> TriMesh {
    assert_positive("cone", &[radius, height]);
    lathe(&[[0.0, -0.5 * height], [radius, -0.5 * height], [0.0, 0.5 * height]], segments)
}

/// A cylinder along Y with a half ball on each end; `height` is that of the straight part.
///
/// Each half ball has `rows` bands.
///
/// # Panics
/// If a size is not positive and finite, without rows, or if there are fewer than 3 segments.
pub fn capsule(radius: f32, height: f32, rows: usize, segments: usize) -> TriMesh {
    assert_positive("capsule", &[radius, height]);
    assert!(rows >= 1, "capsule: no rows");
    let (radius, half) = (f64::from(radius), 0.5 * f64::from(height));
    let mut profile = arc(radius, -half, -FRAC_PI_2, 0.0, rows);
    profile.extend(arc(radius, half, 0.0, FRAC_PI_2, rows));
    turn(&profile, segments)
}

/// Points of a circle around `(0, center)` between two angles, exactly on the axis at the poles.
fn arc(radius: f64, center: f64, from: f64, to: f64, parts: usize) -> Vec<[f64; 2]> {
    (0..=parts)
        .map(|i| {
            let angle = from + (to - from) * i as f64 / parts as f64;
            let off_axis = if angle.abs() + 1e-9 > FRAC_PI_2 { 0.0 } else { angle.cos() };
            [radius * off_axis, center + radius * angle.sin()]
        })
        .collect()
}

fn assert_positive(shape: &str, sizes: &[f32]) {
    assert!(
        sizes.iter().all(|&x| x > 0.0 && x.is_finite()),
        "{shape}: sizes {sizes:?}, expected positive ones"
    );
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::super::tests::assert_sound;
    use super::*;

    /// How much of a circle's area a regular polygon of `n` corners on it has.
    fn polygon_share(n: usize) -> f64 {
        n as f64 / TAU * (TAU / n as f64).sin()
    }

    #[test]
    fn cylinder_and_cone_are_exact_prisms() {
        let mesh = cylinder(2.0, 3.0, 17);
        assert_sound(&mesh, 2);
        let disc = PI * 4.0 * polygon_share(17);
        approx::assert_relative_eq!(mesh.volume(), 3.0 * disc, max_relative = 1e-6);
        let mesh = cone(2.0, 3.0, 17);
        assert_sound(&mesh, 2);
        approx::assert_relative_eq!(mesh.volume(), disc, max_relative = 1e-6);
    }

    #[test]
    fn spheres_and_capsules_approach_the_round_shapes() {
        let mesh = uv_sphere(64, 128);
        assert_eq!(mesh.positions.len(), 128 * 63 + 2);
        assert_eq!(mesh.faces.len(), 2 * 128 * 63);
        assert_sound(&mesh, 2);
        approx::assert_relative_eq!(mesh.volume(), 4.0 / 3.0 * PI, max_relative = 2e-3);
        let mesh = capsule(0.5, 2.0, 32, 128);
        assert_sound(&mesh, 2);
        let expected = PI * 0.25 * 2.0 + 4.0 / 3.0 * PI * 0.125;
        approx::assert_relative_eq!(mesh.volume(), expected, max_relative = 2e-3);
        assert_sound(&uv_sphere(2, 3), 2);
        assert_sound(&capsule(1.0, 1.0, 1, 3), 2);
    }

    #[test]
    #[should_panic(expected = "profile point 1 is (0, 0.5)")]
    fn a_pinched_profile_is_refused() {
        lathe(&[[1.0, 0.0], [0.0, 0.5], [1.0, 1.0]], 8);
    }

    #[test]
    #[should_panic(expected = "encloses nothing")]
    fn a_disc_is_refused() {
        lathe(&[[0.0, 0.0], [1.0, 0.5]], 8);
    }
}
