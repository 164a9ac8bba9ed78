//! The solids that furniture and clocks are made of, all closed, in the metre of the thing made.

use std::f64::consts::{FRAC_PI_2, TAU};

use mesh_core::vector::{cross, dot, narrow, norm};
use mesh_core::{TriMesh, primitives};

use super::paint::Paint;
use super::solid::on_ellipse;

pub(super) use mesh_core::vector::{Vec3 as Point, add, scale, sub, unit};

/// A surface over rings of equally many points, closed by a fan at each end.
///
/// Rings run counter-clockwise seen from where the loft ends.
pub(super) fn loft(rings: &[Vec<Point>]) -> TriMesh {
    let n = rings[0].len();
    let mut positions: Vec<Point> = rings.iter().flatten().copied().collect();
    for ring in [&rings[0], &rings[rings.len() - 1]] {
        let sum = ring.iter().fold([0.0; 3], |sum, p| add(sum, *p));
        positions.push(sum.map(|x| x / n as f64));
    }
    let positions = positions.into_iter().map(narrow).collect();
    TriMesh::new(positions, primitives::closed_rings(rings.len(), n))
}

/// A round bar along a path, its radius a function of the share of the path, its ends rounded.
pub(super) fn rod(path: &[Point], radius: impl Fn(f64) -> f64, sides: usize) -> TriMesh {
    let last = path.len() - 1;
    let direction = |i: usize| unit(sub(path[(i + 1).min(last)], path[i.saturating_sub(1)]));
    let first = direction(0);
    // Any direction across the first; carried along the path without twisting.
    let mut across = if first[1].abs() < 0.9 { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] };
    let mut rings = Vec::new();
    for (i, &point) in path.iter().enumerate() {
        let along = direction(i);
        across = unit(sub(across, scale(along, dot(across, along))));
        let up = cross(along, across);
        let r = radius(i as f64 / last as f64);
        let mut ring = |share: f64, ahead: f64| {
            let center = add(point, scale(along, ahead));
            rings.push(
                (0..sides)
                    .map(|j| {
                        let (sin, cos) = (TAU * j as f64 / sides as f64).sin_cos();
                        let out = add(scale(across, cos), scale(up, sin));
                        add(center, scale(out, r * share))
                    })
                    .collect(),
            );
        };
        if i == 0 {
            ring(0.5, -0.5 * r);
            ring(0.87, -0.3 * r);
        }
        ring(1.0, 0.0);
        if i == last {
            ring(0.87, 0.3 * r);
            ring(0.5, 0.5 * r);
        }
    }
    loft(&rings)
}

/// A smooth path through points: `parts` pieces between each two.
pub(super) fn curve(points: &[Point], parts: usize) -> Vec<Point> {
    let last = points.len() - 1;
    let mut path = Vec::with_capacity(last * parts + 1);
    for i in 0..last {
        let [a, b] = [points[i], points[i + 1]];
        let before = if i == 0 { sub(scale(a, 2.0), b) } else { points[i - 1] };
        let after = if i + 1 == last { sub(scale(b, 2.0), a) } else { points[i + 2] };
        for k in 0..parts {
            // Catmull and Rom's cubic.
            let t = k as f64 / parts as f64;
            path.push(std::array::from_fn(|d| {
                let (p, q, r, s) = (before[d], a[d], b[d], after[d]);
                q + 0.5
                    * t
                    * (r - p + t * (2.0 * p - 5.0 * q + 4.0 * r - s + t * (3.0 * (q - r) + s - p)))
            }));
        }
    }
    path.push(points[last]);
    path
}

/// A painted box with rounded edges, in at least `cells` pieces along each axis.
pub(super) fn block(sides: Point, round: f64, cells: [usize; 3], paint: Paint) -> TriMesh {
    let half = sides.map(|s| 0.5 * s);
    let round = half.iter().fold(round, |r, h| r.min(0.9 * h));
    let lines: [Vec<f64>; 3] = std::array::from_fn(|k| {
        let flat = half[k] - round;
        let mut lines: Vec<f64> =
            (0..=cells[k]).map(|i| flat * (2.0 * i as f64 / cells[k] as f64 - 1.0)).collect();
        // Equal steps of the angle around the edge.
        for degrees in [15.0_f64, 30.0, 45.0] {
            let out = flat + round * degrees.to_radians().tan();
            lines.extend([-out, out]);
        }
        lines.extend(paint.cuts(k, flat));
        lines.sort_by(f64::total_cmp);
        lines.dedup_by(|b, a| *b - *a < 2e-4);
        lines
    });
    let rounded = |p: Point| {
        let inner: Point = std::array::from_fn(|k| p[k].clamp(round - half[k], half[k] - round));
        let out = sub(p, inner);
        if dot(out, out) > 0.0 { add(inner, scale(unit(out), round)) } else { p }
    };
    let mut mesh = grid(&lines);
    for p in &mut mesh.positions {
        *p = rounded(p.map(f64::from)).map(|x| x as f32);
    }
    paint.on(mesh)
}

/// The surface of a box, divided along the given lines.
fn grid(lines: &[Vec<f64>; 3]) -> TriMesh {
    let count: [usize; 3] = std::array::from_fn(|k| lines[k].len());
    let slot = |i: [usize; 3]| (i[0] * count[1] + i[1]) * count[2] + i[2];
    let mut numbers = vec![u32::MAX; count[0] * count[1] * count[2]];
    let mut positions = Vec::new();
    let mut faces = Vec::new();
    let mut vertex = |i: [usize; 3]| {
        let number = &mut numbers[slot(i)];
        if *number == u32::MAX {
            *number = positions.len() as u32;
            positions.push(std::array::from_fn(|k| lines[k][i[k]] as f32));
        }
        *number
    };
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (end, far) in [(0, false), (count[axis] - 1, true)] {
            for i in 0..count[u] - 1 {
                for j in 0..count[v] - 1 {
                    let mut corner = |di: usize, dj: usize| {
                        let mut at = [0; 3];
                        (at[axis], at[u], at[v]) = (end, i + di, j + dj);
                        vertex(at)
                    };
                    let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                    let quad = if far { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
                    faces.extend(quad);
                }
            }
        }
    }
    TriMesh::new(positions, faces)
}

/// A bar of rectangular section from one place to another, its far end `taper` times as thick.
pub(super) fn beam(from: Point, to: Point, section: [f64; 2], taper: f64, paint: Paint) -> TriMesh {
    let length = norm(sub(to, from));
    let round = 0.16 * section[0].min(section[1]);
    let bar = block([section[0], length, section[1]], round, [1, 6, 1], paint);
    let slim = bar.map_positions(|[x, y, z]| {
        let share = 0.5 + f64::from(y) / length;
        let s = (1.0 + (taper - 1.0) * share) as f32;
        [x * s, y, z * s]
    });
    slim.transformed(&upright_along(unit(sub(to, from)), scale(add(from, to), 0.5)))
}

/// The motion that turns +Y to a unit vector and brings the origin to a place.
pub(super) fn upright_along(along: Point, place: Point) -> [[f64; 4]; 3] {
    let guess = if along[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] };
    let x = unit(sub(guess, scale(along, dot(guess, along))));
    let z = cross(x, along);
    std::array::from_fn(|k| [x[k], along[k], z[k], place[k]])
}

/// A plate over a convex outline in the XY plane, its middle at the origin, its edges rounded.
///
/// `rings` more rings divide each of its two faces, for patterns.
pub(super) fn plate(outline: &[[f64; 2]], thickness: f64, round: f64, rings: usize) -> TriMesh {
    let half = 0.5 * thickness;
    let round = round.min(0.95 * half);
    let inset = |by: f64, z: f64| -> Vec<Point> {
        let n = outline.len();
        (0..n)
            .map(|i| {
                let (a, b) = (outline[(i + n - 1) % n], outline[(i + 1) % n]);
                let tangent = unit([b[0] - a[0], b[1] - a[1], 0.0]);
                [outline[i][0] - by * tangent[1], outline[i][1] + by * tangent[0], z]
            })
            .collect()
    };
    let shrunk = |ring: &[Point], share: f64| -> Vec<Point> {
        ring.iter().map(|p| [p[0] * share, p[1] * share, p[2]]).collect()
    };
    let edge = |k: usize, side: f64| {
        let (sin, cos) = (FRAC_PI_2 * k as f64 / 3.0).sin_cos();
        inset(round * (1.0 - sin), side * (half - round + round * cos))
    };
    let mut layers = Vec::new();
    let back = edge(0, -1.0);
    layers.extend((1..=rings).map(|k| shrunk(&back, k as f64 / (rings + 1) as f64)));
    layers.extend((0..=3).map(|k| edge(k, -1.0)));
    layers.extend((0..=3).rev().map(|k| edge(k, 1.0)));
    let front = edge(0, 1.0);
    layers.extend((1..=rings).rev().map(|k| shrunk(&front, k as f64 / (rings + 1) as f64)));
    loft(&layers)
}

/// An ellipse of the given width and height, `n` corners.
pub(super) fn ellipse(width: f64, height: f64, n: usize) -> Vec<[f64; 2]> {
    let radii = [0.5 * width, 0.5 * height];
    (0..n).map(|j| on_ellipse([0.0; 2], radii, TAU * j as f64 / n as f64)).collect()
}

/// Turned on a lathe, bottom to top.
pub(super) fn turned(profile: &[[f64; 2]], segments: usize) -> TriMesh {
    let profile: Vec<[f32; 2]> = profile.iter().map(|p| p.map(|x| x as f32)).collect();
    primitives::lathe(&profile, segments)
}

/// A smooth profile for [`turned`] through `[radius, height]` points, not touching the axis.
pub(super) fn profile(points: &[[f64; 2]], parts: usize) -> Vec<[f64; 2]> {
    let points: Vec<Point> = points.iter().map(|p| [p[0], p[1], 0.0]).collect();
    curve(&points, parts).into_iter().map(|p| [p[0].max(1e-3), p[1]]).collect()
}

/// A sphere about the origin.
pub(super) fn sphere(radius: f64, segments: usize) -> TriMesh {
    primitives::uv_sphere(segments / 2, segments).scaled([radius as f32; 3])
}

/// What stood along Z laid flat, so that its front looks up.
pub(super) fn flat(mesh: TriMesh) -> TriMesh {
    pitched(mesh, -90.0)
}

/// Turned about X by degrees, +Y towards +Z.
pub(super) fn pitched(mesh: TriMesh, degrees: f64) -> TriMesh {
    let (sin, cos) = degrees.to_radians().sin_cos();
    mesh.transformed(&[[1.0, 0.0, 0.0, 0.0], [0.0, cos, -sin, 0.0], [0.0, sin, cos, 0.0]])
}

/// Turned about Y by degrees, +Z towards +X.
pub(super) fn yawed(mesh: TriMesh, degrees: f64) -> TriMesh {
    let (sin, cos) = degrees.to_radians().sin_cos();
    mesh.transformed(&[[cos, 0.0, sin, 0.0], [0.0, 1.0, 0.0, 0.0], [-sin, 0.0, cos, 0.0]])
}

/// Turned about Z by degrees, +X towards +Y.
pub(super) fn rolled(mesh: TriMesh, degrees: f64) -> TriMesh {
    let (sin, cos) = degrees.to_radians().sin_cos();
    mesh.transformed(&[[cos, -sin, 0.0, 0.0], [sin, cos, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
}

/// Moved.
pub(super) fn moved(mesh: TriMesh, by: Point) -> TriMesh {
    mesh.translated(narrow(by))
}

/// A path of straight lines whose corners are rounded by arcs that begin `radius` before them.
pub(super) fn bent(corners: &[Point], radius: f64) -> Vec<Point> {
    let last = corners.len() - 1;
    let mut path = vec![corners[0]];
    for i in 1..last {
        let [a, b, c] = [corners[i - 1], corners[i], corners[i + 1]];
        let reach = radius.min(0.45 * norm(sub(a, b))).min(0.45 * norm(sub(c, b)));
        let (from, to) = (scale(unit(sub(a, b)), reach), scale(unit(sub(c, b)), reach));
        path.extend((0..=6).map(|k| {
            let t = k as f64 / 6.0;
            add(b, add(scale(from, (1.0 - t).powi(2)), scale(to, t * t)))
        }));
    }
    path.push(corners[last]);
    path
}
