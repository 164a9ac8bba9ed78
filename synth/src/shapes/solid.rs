//! Closed solids in place, in `f64`: what families build their parts from.

use mesh_core::TriMesh;
use mesh_core::primitives::{self, TubeEnds};
use mesh_core::vector::{cross, narrow};

/// A point or direction is +X to the object's left hand, +Y up, +Z to its front.
pub(super) use mesh_core::vector::{Vec3 as Point, add, scale, sub, unit};

/// The point at a share of the way from `a` to `b`.
pub(super) fn mix(a: Point, b: Point, share: f64) -> Point {
    std::array::from_fn(|k| a[k] + (b[k] - a[k]) * share)
}

/// A box around a centre.
pub(super) fn block(center: Point, sides: Point) -> TriMesh {
    primitives::cuboid(narrow(sides)).translated(narrow(center))
}

/// A box whose edges are rounded; a radius too large for the shortest side is made smaller.
pub(super) fn rounded_block(center: Point, sides: Point, radius: f64) -> TriMesh {
    let least = sides.into_iter().fold(f64::INFINITY, f64::min);
    let radius = radius.min(0.45 * least) as f32;
    primitives::rounded_cuboid(narrow(sides), radius, 2).translated(narrow(center))
}

/// An ellipsoid around a centre.
pub(super) fn ellipsoid(center: Point, radii: Point, rows: usize) -> TriMesh {
    primitives::uv_sphere(rows, 2 * rows).scaled(narrow(radii)).translated(narrow(center))
}

/// A straight rod with flat ends, as thick at `a` as the first radius and at `b` as the second.
pub(super) fn rod(a: Point, b: Point, radii: [f64; 2], sides: usize) -> TriMesh {
    let radii = radii.map(|r| r as f32);
    primitives::tube(&[narrow(a), narrow(b)], &radii, sides, TubeEnds::Flat)
}

/// A round bar along a smooth curve through points, with round ends.
pub(super) fn bar(points: &[Point], radius: f64, parts: usize, sides: usize) -> TriMesh {
    let points: Vec<[f32; 3]> = points.iter().map(|&p| narrow(p)).collect();
    let path = primitives::smooth_path(&points, parts);
    primitives::tube(&path, &[radius as f32], sides, TubeEnds::Round)
}

/// A ring of round cross-section about an axis: a tyre, a rim.
pub(super) fn hoop(
    center: Point,
    axis: Point,
    [major, minor]: [f64; 2],
    [around, sides]: [usize; 2],
) -> TriMesh {
    stood(primitives::torus(major as f32, minor as f32, around, sides), center, axis)
}

/// A profile of `[radius, height]` turned about an axis through `origin`.
pub(super) fn turned(profile: &[[f64; 2]], segments: usize, origin: Point, axis: Point) -> TriMesh {
    let profile: Vec<[f32; 2]> = profile.iter().map(|p| p.map(|v| v as f32)).collect();
    stood(primitives::lathe(&profile, segments), origin, axis)
}

/// A closed ring of cross-section `[radius, height]` turned about an axis: a wheel with a hole.
pub(super) fn turned_ring(
    section: &[[f64; 2]],
    segments: usize,
    origin: Point,
    axis: Point,
) -> TriMesh {
    let (n, m) = (section.len() as u32, segments as u32);
    let mut positions = Vec::with_capacity(section.len() * segments);
    for i in 0..segments {
        let (sin, cos) = (std::f64::consts::TAU * i as f64 / segments as f64).sin_cos();
        positions.extend(section.iter().map(|&[r, y]| narrow([r * cos, y, -r * sin])));
    }
    let at = |i: u32, j: u32| (i % m) * n + j % n;
    let faces = (0..m)
        .flat_map(|i| (0..n).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let mesh = TriMesh::new(positions, faces);
    let mesh = if mesh.volume() < 0.0 { mesh.flipped() } else { mesh };
    stood(mesh, origin, axis)
}

/// Puts what stands on the origin along +Y onto another origin, along another axis.
pub(super) fn stood(mesh: TriMesh, origin: Point, axis: Point) -> TriMesh {
    let y = unit(axis);
    let aside = if y[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] };
    let z = unit(cross(aside, y));
    let x = cross(y, z);
    mesh.transformed(&std::array::from_fn(|k| [x[k], y[k], z[k], origin[k]]))
}

/// Turned about an axis through a point, by an angle in radians.
pub(super) fn rotated(mesh: TriMesh, about: Point, axis: Point, angle: f64) -> TriMesh {
    let [x, y, z] = unit(axis);
    let (s, c) = angle.sin_cos();
    let t = 1.0 - c;
    let rows = [
        [t * x * x + c, t * x * y - s * z, t * x * z + s * y],
        [t * x * y + s * z, t * y * y + c, t * y * z - s * x],
        [t * x * z - s * y, t * y * z + s * x, t * z * z + c],
    ];
    mesh.transformed(&std::array::from_fn(|k| {
        let r = rows[k];
        let moved = r[0] * about[0] + r[1] * about[1] + r[2] * about[2];
        [r[0], r[1], r[2], about[k] - moved]
    }))
}

/// The mirror image on the other side of the object.
pub(super) fn mirrored(mesh: &TriMesh) -> TriMesh {
    mesh.clone().scaled([-1.0, 1.0, 1.0])
}

/// A path from the middle outward, and its mirror image before it.
pub(super) fn both_sides(half: &[Point]) -> Vec<Point> {
    let other = half.iter().skip(1).rev().map(|&[x, y, z]| [-x, y, z]);
    other.chain(half.iter().copied()).collect()
}

/// A prism over an outline `[z, y]` seen from the side, between two values of x.
pub(super) fn side_prism(outline: &[[f64; 2]], [from, to]: [f64; 2]) -> TriMesh {
    // The outline's first axis becomes Z, the height X: a rotation once more.
    prism(outline, to - from).transformed(&[
        [0.0, 0.0, 1.0, 0.5 * (from + to)],
        [0.0, 1.0, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0],
    ])
}

/// A prism over an outline `[x, y]` seen from the front, between two values of z.
pub(super) fn front_prism(outline: &[[f64; 2]], [from, to]: [f64; 2]) -> TriMesh {
    prism(outline, to - from).translated([0.0, 0.0, (0.5 * (from + to)) as f32])
}

fn prism(outline: &[[f64; 2]], height: f64) -> TriMesh {
    let outline: Vec<[f32; 2]> = outline.iter().map(|p| p.map(|v| v as f32)).collect();
    primitives::extrude(&outline, height as f32).expect("families draw simple outlines")
}

/// A solid through cross-sections; a first or last section of one point is a tip.
pub(super) fn loft(sections: &[Vec<Point>]) -> TriMesh {
    let sections: Vec<Vec<[f32; 3]>> =
        sections.iter().map(|ring| ring.iter().map(|&p| narrow(p)).collect()).collect();
    primitives::loft(&sections).expect("families draw sections whose ends can be closed")
}

/// A plate that follows a surface over the unit square, from `depth` behind it to `proud` before it.
///
/// `grid` counts the cells along u and v. "Before" is where `u x v` points. Windows and stripes are
/// such plates: borders of colour without a seam in the body under them.
pub(super) fn plate(
    surface: impl Fn(f64, f64) -> Point,
    grid: [usize; 2],
    [depth, proud]: [f64; 2],
) -> TriMesh {
    let h = 1e-4;
    let offset = |u: f64, v: f64, by: f64| {
        let (du, dv) = (
            sub(surface((u + h).min(1.0), v), surface((u - h).max(0.0), v)),
            sub(surface(u, (v + h).min(1.0)), surface(u, (v - h).max(0.0))),
        );
        narrow(add(surface(u, v), scale(unit(cross(du, dv)), by)))
    };
    let side = |by: f64| -> Vec<Vec<[f32; 3]>> {
        let share = |i: usize, k: usize| i as f64 / grid[k] as f64;
        let row = |j: usize| (0..=grid[0]).map(|i| offset(share(i, 0), share(j, 1), by)).collect();
        (0..=grid[1]).map(row).collect()
    };
    primitives::plate(&side(proud), &side(-depth))
}

/// The point of a four-cornered patch: corners at `(0, 0)`, `(1, 0)`, `(1, 1)`, `(0, 1)`.
pub(super) fn bilinear([a, b, c, d]: [Point; 4], u: f64, v: f64) -> Point {
    mix(mix(a, b, u), mix(d, c, u), v)
}

/// A rectangle around the origin with round corners of `parts` segments each, counter-clockwise.
pub(super) fn rounded_rectangle([w, h]: [f64; 2], radius: f64, parts: usize) -> Vec<[f64; 2]> {
    let r = radius.min(0.499 * w.min(h));
    let corners = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]];
    let quarter = std::f64::consts::FRAC_PI_2;
    (0..4 * (parts + 1))
        .map(|i| {
            let (k, step) = (i / (parts + 1), i % (parts + 1));
            let center = [corners[k][0] * (0.5 * w - r), corners[k][1] * (0.5 * h - r)];
            on_ellipse(center, [r, r], quarter * (k as f64 + step as f64 / parts as f64))
        })
        .collect()
}

/// The point of an ellipse about a centre at an angle from the first axis, radians.
pub(super) fn on_ellipse(center: [f64; 2], radii: [f64; 2], angle: f64) -> [f64; 2] {
    let (sin, cos) = angle.sin_cos();
    [center[0] + radii[0] * cos, center[1] + radii[1] * sin]
}

/// `n` points of a superellipse, counter-clockwise: exponent 2 is an ellipse, more is squarer.
pub(super) fn superellipse([a, b]: [f64; 2], exponent: f64, n: usize) -> Vec<[f64; 2]> {
    (0..n)
        .map(|i| {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
            let bend = |v: f64| v.abs().powf(2.0 / exponent).copysign(v);
            [a * bend(cos), b * bend(sin)]
        })
        .collect()
}
