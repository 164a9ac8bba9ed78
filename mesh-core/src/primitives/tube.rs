//! Tubes along curves.

use std::f64::consts::{FRAC_PI_2, TAU};

use crate::TriMesh;
use crate::vector::{Vec3, add, cross, dot, narrow, norm, scale, sub, unit, widen};

/// How a [`tube`] ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TubeEnds {
    /// With flat discs through the first and the last point.
    Flat,
    /// With half balls around the first and the last point.
    Round,
    /// Nowhere: the last point is joined to the first.
    Loop,
}

/// Bands of a round end.
const CAP_BANDS: usize = 3;

/// A tube of round cross-section along a path, with `sides` points around it.
///
/// `radii` holds one radius for all points, or one for each. The frames turn as little as possible
/// along the path (Wang, Jüttler, Zheng, Liu: "Computation of Rotation Minimizing Frames", 2008,
/// double reflection); round a loop what twist remains is spread evenly. Rings stand across the
/// path and are not widened at bends, so bends should be round: see [`smooth_path`].
///
/// ```
/// use mesh_core::primitives::{TubeEnds, smooth_path, tube};
/// let hook = smooth_path(&[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 1.4, 0.0]], 8);
/// let mesh = tube(&hook, &[0.1], 12, TubeEnds::Round);
/// assert!(mesh.health().is_watertight());
/// ```
///
/// # Panics
/// If there are fewer than 2 points (3 for a loop) or 3 sides, neighbouring points coincide, the
/// number of radii is neither 1 nor that of the points, or a value is not finite or a radius not
/// positive.
pub fn tube(path: &[[f32; 3]], radii: &[f32], sides: usize, ends: TubeEnds) -> TriMesh {
    let closed = ends == TubeEnds::Loop;
    let n = path.len();
    assert!(n >= if closed { 3 } else { 2 }, "tube: {n} points for {ends:?} ends");
    assert!(sides >= 3, "tube: {sides} sides, expected at least 3");
    assert!(
        radii.len() == 1 || radii.len() == n,
        "tube: {} radii for {n} points, expected 1 or as many",
        radii.len()
    );
    assert!(radii.iter().all(|&r| r > 0.0 && r.is_finite()), "tube: a radius is not positive");
    let path: Vec<Vec3> = path.iter().map(|&p| widen(p)).collect();
    let radius = |i: usize| f64::from(radii[if radii.len() == 1 { 0 } else { i }]);
    let frames = frames(&path, closed);

    let mut rings: Vec<(Vec3, [Vec3; 2], f64)> = Vec::new();
    let cap = |i: usize, sign: f64, band: usize| {
        let (sin, cos) = (FRAC_PI_2 * band as f64 / CAP_BANDS as f64).sin_cos();
        let [tangent, u, v] = frames[i];
        (add(path[i], scale(tangent, sign * radius(i) * sin)), [u, v], radius(i) * cos)
    };
    if ends == TubeEnds::Round {
        rings.extend((1..CAP_BANDS).rev().map(|band| cap(0, -1.0, band)));
    }
    rings.extend((0..n).map(|i| (path[i], [frames[i][1], frames[i][2]], radius(i))));
    if ends == TubeEnds::Round {
        rings.extend((1..CAP_BANDS).map(|band| cap(n - 1, 1.0, band)));
    }

    let mut positions = Vec::with_capacity(rings.len() * sides + 2);
    for &(center, [u, v], r) in &rings {
        for j in 0..sides {
            let (sin, cos) = (TAU * j as f64 / sides as f64).sin_cos();
            positions.push(narrow(add(center, add(scale(u, r * cos), scale(v, r * sin)))));
        }
    }
    let mut faces = Vec::with_capacity(2 * rings.len() * sides);
    let count = rings.len();
    let at = |ring: usize, j: usize| ((ring % count) * sides + j % sides) as u32;
    for ring in 0..count - usize::from(!closed) {
        for j in 0..sides {
            let (a, b) = (at(ring, j), at(ring, j + 1));
            let (c, d) = (at(ring + 1, j + 1), at(ring + 1, j));
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    if !closed {
        let first = positions.len() as u32;
        let out = if ends == TubeEnds::Round { 1.0 } else { 0.0 };
        let tip =
            |i: usize, sign: f64| narrow(add(path[i], scale(frames[i][0], sign * out * radius(i))));
        positions.extend([tip(0, -1.0), tip(n - 1, 1.0)]);
        for j in 0..sides {
            faces.push([first, at(0, j + 1), at(0, j)]);
            faces.push([first + 1, at(count - 1, j), at(count - 1, j + 1)]);
        }
    }
    TriMesh::new(positions, faces)
}

/// A path through all points, with `parts` segments from each to the next: a centripetal
/// Catmull-Rom curve (Barry and Goldman's pyramid), which has no loops or cusps.
///
/// # Panics
/// If there are no points, or no parts.
pub fn smooth_path(points: &[[f32; 3]], parts: usize) -> Vec<[f32; 3]> {
    assert!(!points.is_empty() && parts > 0, "smooth_path: no points or no parts");
    let p: Vec<Vec3> = points.iter().map(|&p| widen(p)).collect();
    let n = p.len();
    let mut path = Vec::with_capacity((n - 1) * parts + 1);
    for i in 0..n - 1 {
        let (b, c) = (p[i], p[i + 1]);
        // Beyond the ends the curve goes on as its mirror image.
        let a = if i > 0 { p[i - 1] } else { sub(scale(b, 2.0), c) };
        let d = if i + 2 < n { p[i + 2] } else { sub(scale(c, 2.0), b) };
        let gap = |a: Vec3, b: Vec3| norm(sub(b, a)).sqrt().max(1e-9);
        let t1 = gap(a, b);
        let t2 = t1 + gap(b, c);
        let t3 = t2 + gap(c, d);
        let mix = |p: Vec3, q: Vec3, s: f64, e: f64, t: f64| {
            add(scale(p, (e - t) / (e - s)), scale(q, (t - s) / (e - s)))
        };
        for k in 0..parts {
            let t = t1 + (t2 - t1) * k as f64 / parts as f64;
            let (ab, bc, cd) = (mix(a, b, 0.0, t1, t), mix(b, c, t1, t2, t), mix(c, d, t2, t3, t));
            path.push(narrow(mix(mix(ab, bc, 0.0, t2, t), mix(bc, cd, t1, t3, t), t1, t2, t)));
        }
    }
    path.push(points[n - 1]);
    path
}

/// At each point the tangent and two directions across it.
fn frames(path: &[Vec3], closed: bool) -> Vec<[Vec3; 3]> {
    let n = path.len();
    let along: Vec<Vec3> = (0..if closed { n } else { n - 1 })
        .map(|i| {
            let step = sub(path[(i + 1) % n], path[i]);
            assert!(norm(step) > 0.0 && norm(step).is_finite(), "tube: points {i} and the next");
            unit(step)
        })
        .collect();
    let tangents: Vec<Vec3> = (0..n)
        .map(|i| {
            let after = along[i.min(along.len() - 1)];
            let before = if i > 0 { along[i - 1] } else { along[if closed { n - 1 } else { 0 }] };
            let sum = add(before, after);
            // Where the path turns back on itself, any direction is as good.
            if norm(sum) > 1e-6 { unit(sum) } else { after }
        })
        .collect();
    let least = (0..3).min_by(|&a, &b| tangents[0][a].abs().total_cmp(&tangents[0][b].abs()));
    let mut axis = [0.0; 3];
    axis[least.expect("three axes")] = 1.0;
    let mut across = Vec::with_capacity(n);
    across.push(unit(cross(tangents[0], axis)));
    for i in 1..n {
        across.push(carry(across[i - 1], [path[i - 1], path[i]], [tangents[i - 1], tangents[i]]));
    }
    let twist = if closed {
        let back = carry(across[n - 1], [path[n - 1], path[0]], [tangents[n - 1], tangents[0]]);
        let v = cross(tangents[0], across[0]);
        dot(back, v).atan2(dot(back, across[0]))
    } else {
        0.0
    };
    (0..n)
        .map(|i| {
            let (u, v) = (across[i], unit(cross(tangents[i], across[i])));
            let (sin, cos) = (-twist * i as f64 / n as f64).sin_cos();
            let turned = add(scale(u, cos), scale(v, sin));
            [tangents[i], turned, unit(cross(tangents[i], turned))]
        })
        .collect()
}

/// Carries a direction across the path from one point to the next without turning about the path.
fn carry(u: Vec3, [p, q]: [Vec3; 2], [from, to]: [Vec3; 2]) -> Vec3 {
    let reflect = |x: Vec3, v: Vec3| {
        let square = dot(v, v);
        if square < 1e-24 { x } else { sub(x, scale(v, 2.0 * dot(v, x) / square)) }
    };
    let v1 = sub(q, p);
    let (left, tangent) = (reflect(u, v1), reflect(from, v1));
    let carried = reflect(left, sub(to, tangent));
    // Rounding must not let it lean along the path.
    unit(sub(carried, scale(to, dot(carried, to))))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::super::tests::assert_sound;
    use super::*;

    fn circle(n: usize, radius: f64) -> Vec<[f32; 3]> {
        (0..n)
            .map(|i| {
                let (sin, cos) = (TAU * i as f64 / n as f64).sin_cos();
                narrow([radius * cos, radius * sin, 0.0])
            })
            .collect()
    }

    #[test]
    fn a_straight_tube_is_a_cylinder_or_a_capsule() {
        let path = [[1.0, 2.0, 3.0], [1.0, 2.0, 5.0]];
        let flat = tube(&path, &[0.5], 64, TubeEnds::Flat);
        assert_sound(&flat, 2);
        approx::assert_relative_eq!(flat.volume(), 2.0 * 0.25 * PI, max_relative = 3e-3);
        let round = tube(&path, &[0.5], 64, TubeEnds::Round);
        assert_sound(&round, 2);
        assert_eq!(round.bounds().map(|(low, high)| (low[2], high[2])), Some((2.5, 5.5)));
        let cone = tube(&path, &[0.5, 0.25], 64, TubeEnds::Flat);
        let third = PI * 2.0 / 3.0 * (0.25 + 0.125 + 0.0625);
        approx::assert_relative_eq!(cone.volume(), third, max_relative = 3e-3);
    }

    #[test]
    fn a_loop_is_a_torus() {
        let ring = tube(&circle(96, 2.0), &[0.5], 48, TubeEnds::Loop);
        assert_sound(&ring, 0);
        approx::assert_relative_eq!(ring.volume(), PI * PI, max_relative = 5e-3);
    }

    /// A knot comes back to its start with a twist, which must not be left to the last band.
    #[test]
    fn the_twist_of_a_loop_is_spread() {
        let (n, sides) = (160, 12);
        let knot: Vec<[f32; 3]> = (0..n)
            .map(|i| {
                let t = TAU * i as f64 / n as f64;
                let radius = 2.0 + (3.0 * t).cos();
                narrow([radius * (2.0 * t).cos(), radius * (2.0 * t).sin(), (3.0 * t).sin()])
            })
            .collect();
        let mesh = tube(&knot, &[0.25], sides, TubeEnds::Loop);
        assert_sound(&mesh, 0);
        let step = |ring: usize| {
            let length = |j: usize| {
                let [a, b] = [ring, (ring + 1) % n].map(|i| mesh.positions[i * sides + j]);
                norm(sub(widen(a), widen(b)))
            };
            (0..sides).map(length).fold(0.0, f64::max)
        };
        let longest = (0..n - 1).map(step).fold(0.0, f64::max);
        assert!(step(n - 1) < 1.02 * longest, "{} after at most {longest}", step(n - 1));
    }

    #[test]
    fn frames_do_not_turn_about_the_path() {
        let helix: Vec<[f32; 3]> = (0..80)
            .map(|i| {
                let (sin, cos) = (0.2 * f64::from(i)).sin_cos();
                narrow([cos, 0.05 * f64::from(i), sin])
            })
            .collect();
        assert_sound(&tube(&helix, &[0.1], 8, TubeEnds::Round), 2);
        let health = tube(&helix, &[0.1], 8, TubeEnds::Flat).health();
        assert!(health.smallest_angle_degrees > 15.0, "{health}");
    }

    #[test]
    fn a_smooth_path_passes_its_points() {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [4.0, 2.0, 1.0]];
        let path = smooth_path(&points, 5);
        assert_eq!(path.len(), 16);
        for (i, p) in points.iter().enumerate() {
            for k in 0..3 {
                approx::assert_abs_diff_eq!(path[5 * i][k], p[k], epsilon = 1e-6);
            }
        }
        assert_eq!(smooth_path(&points[..1], 3), points[..1]);
    }

    #[test]
    #[should_panic(expected = "2 radii for 3 points")]
    fn a_missing_radius_is_refused() {
        tube(&[[0.0; 3], [1.0; 3], [2.0; 3]], &[0.1, 0.2], 8, TubeEnds::Flat);
    }
}
