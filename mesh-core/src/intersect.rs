//! Whether two triangles pass through each other, decided in exact arithmetic.

/// A point in the integers that all tests are made in.
pub(crate) type Point = [i64; 3];

/// Coordinates are at most `2^40`; see [`orient`].
pub(crate) const BITS: i32 = 40;

fn sub(a: Point, b: Point) -> Point {
    std::array::from_fn(|k| a[k] - b[k])
}

pub(crate) fn normal(&[a, b, c]: &[Point; 3]) -> [i128; 3] {
    let (u, v) = (sub(b, a).map(i128::from), sub(c, a).map(i128::from));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

/// The sign of the volume of the tetrahedron `a, b, c, d`, exactly.
///
/// Differences have 41 bits and a sign, so their products of three and the sum of six of those
/// stay below `2^127`. Nearly always `f64` is enough to know the sign: the differences are exact in
/// it, and the rounding of the products is bounded by a few units in the last place of the largest.
fn orient(a: Point, b: Point, c: Point, d: Point) -> i32 {
    let (u, v, w) = (sub(b, a), sub(c, a), sub(d, a));
    let [x, y, z] = [u, v, w].map(|p| p.map(|x| x as f64));
    let minors = [y[1] * z[2], y[2] * z[1], y[2] * z[0], y[0] * z[2], y[0] * z[1], y[1] * z[0]];
    let value = x[0] * (minors[0] - minors[1])
        + x[1] * (minors[2] - minors[3])
        + x[2] * (minors[4] - minors[5]);
    let size = x[0].abs() * (minors[0].abs() + minors[1].abs())
        + x[1].abs() * (minors[2].abs() + minors[3].abs())
        + x[2].abs() * (minors[4].abs() + minors[5].abs());
    if value.abs() > 16.0 * f64::EPSILON * size {
        return if value > 0.0 { 1 } else { -1 };
    }
    let [x, y, z] = [u, v, w].map(|p| p.map(i128::from));
    let exact = x[0] * (y[1] * z[2] - y[2] * z[1])
        + x[1] * (y[2] * z[0] - y[0] * z[2])
        + x[2] * (y[0] * z[1] - y[1] * z[0]);
    exact.signum() as i32
}

/// A triangle that others are compared with, and its plane.
pub(crate) struct Facet {
    corners: [Point; 3],
    /// The normal, and the sizes of what its coordinates are the differences of.
    normal: [f64; 3],
    size: [f64; 3],
    /// As [`flat_axes`] has them.
    axes: [usize; 2],
}

impl Facet {
    pub(crate) fn new(corners: [Point; 3]) -> Self {
        let [a, b, c] = corners;
        let [u, v] = [sub(b, a), sub(c, a)].map(|p| p.map(|x| x as f64));
        let products = [0, 1, 2].map(|k| {
            let (y, z) = ((k + 1) % 3, (k + 2) % 3);
            [u[y] * v[z], u[z] * v[y]]
        });
        let normal = products.map(|[p, q]| p - q);
        let size = products.map(|[p, q]| p.abs() + q.abs());
        Self { corners, normal, size, axes: flat_axes(&corners) }
    }

    /// As [`orient`] of the corners and a point.
    #[inline]
    fn side(&self, p: Point) -> i32 {
        let Self { corners: [a, b, c], normal, size, .. } = self;
        let offset = sub(p, *a).map(|x| x as f64);
        let value = offset[0] * normal[0] + offset[1] * normal[1] + offset[2] * normal[2];
        let size =
            offset[0].abs() * size[0] + offset[1].abs() * size[1] + offset[2].abs() * size[2];
        // The error is bounded as there.
        if value.abs() > 16.0 * f64::EPSILON * size {
            return if value > 0.0 { 1 } else { -1 };
        }
        // Each product is of a number that is 0: in a plane along two axes, where many faces of what people draw lie.
        if size == 0.0 {
            return 0;
        }
        orient(*a, *b, *c, p)
    }
}

/// Whether two triangles pass through each other or overlap in one plane.
pub(crate) fn cross(facet: &Facet, b: &[Point; 3]) -> bool {
    let a = &facet.corners;
    // On which side of the other's plane each corner is; most triangles that are compared have corners in common.
    let shared = b.map(|p| a.contains(&p));
    let sides_b = [0, 1, 2].map(|k| if shared[k] { 0 } else { facet.side(b[k]) });
    let others_are = |sign: i32| (0..3).all(|k| shared[k] || sides_b[k] == sign);
    // Then they have no more in common than those.
    if shared != [true; 3] && (others_are(1) || others_are(-1)) {
        return false;
    }
    if sides_b == [0; 3] {
        return overlap(a, b, facet.axes);
    }
    let sides_a = a.map(|p| orient(b[0], b[1], b[2], p));
    if sides_a.iter().all(|&s| s > 0) || sides_a.iter().all(|&s| s < 0) {
        return false;
    }
    // Two triangles that pass through each other share a segment of a line. Each end of it is where
    // a side of one runs through the other, or a corner of one on the other; one end of the first
    // kind is enough to know.
    if pierces(a, &sides_a, b) || pierces(b, &sides_b, a) {
        return true;
    }
    // Both ends are corners: one of each triangle, whose other corners are on both sides.
    match (corner_between(a, &sides_a), corner_between(b, &sides_b)) {
        (Some(p), Some(q)) => p != q && holds(b, p) && holds(a, q),
        _ => false,
    }
}

/// The corner on the other's plane, if the other two corners are on either side of it.
fn corner_between(a: &[Point; 3], sides: &[i32; 3]) -> Option<Point> {
    let between = |i: usize| sides[i] == 0 && sides[(i + 1) % 3] * sides[(i + 2) % 3] < 0;
    (0..3).find(|&i| between(i)).map(|i| a[i])
}

/// Whether a point in the plane of a triangle is in the triangle or on its border.
fn holds(triangle: &[Point; 3], p: Point) -> bool {
    let axes = flat_axes(triangle);
    let corners = triangle.map(|p| flatten(p, axes));
    let p = flatten(p, axes);
    let sides = [0, 1, 2].map(|i| side(corners[i], corners[(i + 1) % 3], p));
    sides.iter().all(|&s| s >= 0) || sides.iter().all(|&s| s <= 0)
}

/// The two axes that a triangle's plane is seen best along: those that its normal points least to.
fn flat_axes(triangle: &[Point; 3]) -> [usize; 2] {
    let normal = normal(triangle);
    let drop = (0..3).max_by_key(|&k| normal[k].unsigned_abs()).unwrap_or(0);
    [(drop + 1) % 3, (drop + 2) % 3]
}

fn flatten(p: Point, [x, y]: [usize; 2]) -> [i64; 2] {
    [p[x], p[y]]
}

/// Whether a side of `a` runs through `b` from one side of its plane to the other.
fn pierces(a: &[Point; 3], sides: &[i32; 3], b: &[Point; 3]) -> bool {
    (0..3).any(|i| {
        let j = (i + 1) % 3;
        sides[i] * sides[j] < 0 && {
            let around = [0, 1, 2].map(|k| orient(a[i], a[j], b[k], b[(k + 1) % 3]));
            around.iter().all(|&s| s >= 0) || around.iter().all(|&s| s <= 0)
        }
    })
}

/// Whether two triangles in one plane, which is seen well along these axes, have an area in common.
fn overlap(a: &[Point; 3], b: &[Point; 3], axes: [usize; 2]) -> bool {
    let flat = |t: &[Point; 3]| {
        let mut t = t.map(|p| flatten(p, axes));
        if side(t[0], t[1], t[2]) < 0 {
            t.swap(1, 2);
        }
        t
    };
    let (a, b) = (flat(a), flat(b));
    // Convex shapes have no area in common just when a side of one keeps the other out.
    let keeps_out = |a: &[[i64; 2]; 3], b: &[[i64; 2]; 3]| {
        (0..3).any(|i| b.iter().all(|&p| side(a[i], a[(i + 1) % 3], p) <= 0))
    };
    !keeps_out(&a, &b) && !keeps_out(&b, &a)
}

/// On which side of the line from `a` to `b` a third point is, exactly; `f64` is asked first, as in [`orient`].
fn side(a: [i64; 2], b: [i64; 2], c: [i64; 2]) -> i32 {
    let (u, v) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
    let [p, q] = [[u[0], v[1]], [u[1], v[0]]].map(|[x, y]| x as f64 * y as f64);
    if (p - q).abs() > 4.0 * f64::EPSILON * (p.abs() + q.abs()) {
        return if p > q { 1 } else { -1 };
    }
    let [u, v] = [u, v].map(|w| w.map(i128::from));
    (u[0] * v[1] - u[1] * v[0]).signum() as i32
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use crate::{TriMesh, primitives};

    fn pair(a: [[f32; 3]; 3], b: [[f32; 3]; 3]) -> usize {
        let positions = a.into_iter().chain(b).collect();
        let found = TriMesh::new(positions, vec![[0, 1, 2], [3, 4, 5]]).self_intersections();
        let turned = b.into_iter().chain(a).map(|[x, y, z]| [z, x, y]).collect();
        let again = TriMesh::new(turned, vec![[2, 1, 0], [4, 5, 3]]).self_intersections();
        assert_eq!(found, again);
        found.len()
    }

    const FLOOR: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]];

    #[test]
    fn crossing_touching_and_apart() {
        assert_eq!(pair(FLOOR, [[1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [9.0, 9.0, 0.5]]), 1);
        assert_eq!(pair(FLOOR, [[1.0, 1.0, 0.1], [1.0, 1.0, 1.0], [9.0, 9.0, 0.5]]), 0);
        // A corner on the face, from one side and through it.
        assert_eq!(pair(FLOOR, [[1.0, 1.0, 0.0], [1.0, 2.0, 1.0], [2.0, 1.0, 1.0]]), 0);
        assert_eq!(pair(FLOOR, [[1.0, 1.0, 0.0], [1.0, 2.0, 1.0], [2.0, 1.0, -1.0]]), 1);
        // A side that lies in the face.
        assert_eq!(pair(FLOOR, [[1.0, 1.0, 0.0], [2.0, 1.0, 0.0], [1.0, 1.0, 1.0]]), 0);
        // A side exactly through an edge.
        assert_eq!(pair(FLOOR, [[1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [1.0, 5.0, 0.0]]), 1);
    }

    #[test]
    fn both_ends_are_corners() {
        // The corner of each is on the other, and the segment between them is all they share.
        let other = |x: f32| [[x, 1.0, 0.0], [-5.0, 1.0, 1.0], [-5.0, 1.0, -1.0]];
        let floor = [[1.0, 1.0, 0.0], [9.0, -9.0, 0.0], [9.0, 11.0, 0.0]];
        assert_eq!(pair(floor, other(2.0)), 1);
        assert_eq!(pair(floor, other(1.0)), 0);
        assert_eq!(pair(floor, other(0.5)), 0);
    }

    #[test]
    fn shared_corners_and_edges() {
        // One corner in common and nothing else, then crossing beyond it.
        assert_eq!(pair(FLOOR, [[0.0; 3], [-1.0, 0.0, 1.0], [-1.0, 0.0, -1.0]]), 0);
        assert_eq!(pair(FLOOR, [[0.0; 3], [1.0, 1.0, 1.0], [1.0, 1.0, -1.0]]), 1);
        assert_eq!(pair(FLOOR, [[0.0; 3], [9.0, 9.0, 1.0], [9.0, 9.0, -1.0]]), 1);
        // An edge in common: a roof, a flat continuation, and a fold onto itself.
        let beside = |apex: [f32; 3]| [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0], apex];
        assert_eq!(pair(FLOOR, beside([1.0, 1.0, 1.0])), 0);
        assert_eq!(pair(FLOOR, beside([4.0, 4.0, 0.0])), 0);
        assert_eq!(pair(FLOOR, beside([1.0, 1.0, 0.0])), 1);
        assert_eq!(pair(FLOOR, FLOOR), 1);
    }

    #[test]
    fn in_one_plane() {
        let beside = |x: f32, y: f32| FLOOR.map(|p| [p[0] + x, p[1] + y, 0.0]);
        assert_eq!(pair(FLOOR, beside(4.0, 0.0)), 0);
        assert_eq!(pair(FLOOR, beside(2.0, 2.0)), 0);
        assert_eq!(pair(FLOOR, beside(1.0, 1.0)), 1);
        let within = FLOOR.map(|p| [p[0] * 0.1 + 1.0, p[1] * 0.1 + 1.0, 0.0]);
        assert_eq!(pair(FLOOR, within), 1);
    }

    #[test]
    fn primitives_have_none_and_two_balls_have_a_ring() {
        for mesh in [
            primitives::icosphere(3),
            primitives::torus(1.0, 0.5, 24, 16),
            primitives::capsule(0.3, 1.0, 8, 24),
            primitives::pixel2mesh_ellipsoid(1),
            primitives::cuboid([1.0; 3]),
        ] {
            assert!(mesh.self_intersections().is_empty());
        }
        let ball = primitives::icosphere(3);
        let mut two = ball.clone();
        two.append(&ball.translated([1.0, 0.1, 0.0])).unwrap();
        let found = two.self_intersections();
        // The circle of intersection is 5.4 long and the edges about 0.14.
        assert!((40..300).contains(&found.len()), "{}", found.len());
        assert!(found.iter().all(|&[a, b]| a < 1280 && b >= 1280));
        assert!(found.is_sorted());
    }

    #[test]
    fn a_seam_is_no_intersection() {
        let mesh = primitives::icosphere(2);
        let soup = TriMesh::new(
            mesh.faces.iter().flat_map(|f| f.map(|v| mesh.positions[v as usize])).collect(),
            (0..mesh.faces.len() as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect(),
        );
        assert!(soup.self_intersections().is_empty());
    }

    #[test]
    fn size_and_broken_faces_do_not_matter() {
        for scale in [1e-30_f32, 1e-42, 1e30] {
            let ball = primitives::icosphere(1).scaled([scale; 3]);
            let mut two = ball.clone();
            two.append(&ball.translated([scale, 0.0, 0.0])).unwrap();
            two.faces.extend([[0, 0, 1], [0, 1, 999]]);
            two.positions.push([f32::NAN; 3]);
            assert!(!two.self_intersections().is_empty(), "{scale}");
        }
        assert!(TriMesh::default().self_intersections().is_empty());
    }
}
