//! Three-vectors: geometry is computed in `f64`, and in `f32` where precision is not what matters.
//!
//! ```
//! use mesh_core::vector::{cross, dot, scale, unit};
//! let (x, y) = (unit([2.0, 0.0, 0.0]), [0.0, 1.0, 0.0]);
//! assert_eq!(scale(cross(x, y), 0.5), [0.0, 0.0, 0.5]);
//! assert_eq!(dot(x, y), 0.0);
//! ```

use crate::Scalar;

/// A place or a direction.
pub type Vec3 = [f64; 3];

/// In `f64`.
#[inline]
pub fn widen(a: [f32; 3]) -> Vec3 {
    a.map(f64::from)
}

/// Rounded to `f32`.
#[inline]
pub fn narrow(a: Vec3) -> [f32; 3] {
    a.map(|x| x as f32)
}

/// `a + b`.
#[inline]
pub fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
#[inline]
pub fn sub<T: Scalar>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `s a`.
#[inline]
pub fn scale(a: Vec3, s: f64) -> Vec3 {
    a.map(|x| x * s)
}

/// The inner product.
#[inline]
pub fn dot<T: Scalar>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a × b`.
#[inline]
pub fn cross<T: Scalar>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The length, computed in the precision of the vector.
#[inline]
pub fn norm<T: Scalar>(a: [T; 3]) -> T {
    // The root of an `f32`, taken in `f64`, rounds to the same `f32`.
    T::narrowed(dot(a, a).widened().sqrt())
}

/// The unit vector along `a`, or zero where `a` is zero or not finite.
#[inline]
pub fn unit(a: Vec3) -> Vec3 {
    let length = norm(a);
    if length > 0.0 && length.is_finite() { scale(a, 1.0 / length) } else { [0.0; 3] }
}

/// The angle between two vectors in radians, exact to rounding even near 0 and π.
#[inline]
pub fn angle(a: Vec3, b: Vec3) -> f64 {
    norm(cross(a, b)).atan2(dot(a, b))
}

/// The corners of a face.
///
/// # Panics
/// If it names a vertex that does not exist.
#[inline]
pub fn triangle<T: Scalar>(positions: &[[T; 3]], face: [u32; 3]) -> [Vec3; 3] {
    face.map(|v| positions[v as usize].map(T::widened))
}

/// `A p + t`, the rows of a matrix being `[A | t]`: a point moved, or projected before the division by its last number.
///
/// ```
/// use mesh_core::vector::affine;
/// assert_eq!(affine(&[[1.0, 0.0, 0.0, 5.0], [0.0, 2.0, 0.0, 0.0]], [1.0, 2.0, 3.0]), [6.0, 4.0]);
/// ```
#[inline]
pub fn affine<T: Scalar, const N: usize>(rows: &[[T; 4]; N], p: [T; 3]) -> [T; N] {
    rows.map(|r| r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + r[3])
}

/// `u a + v b + w c`: a value known at the corners of a triangle, at barycentric coordinates.
///
/// ```
/// use mesh_core::vector::interpolate;
/// assert_eq!(interpolate([0.5, 0.25, 0.25], &[[0.0, 1.0], [4.0, 1.0], [8.0, 1.0]]), [3.0, 1.0]);
/// ```
#[inline]
pub fn interpolate<T: Scalar, const K: usize>(
    [u, v, w]: [T; 3],
    [a, b, c]: &[[T; K]; 3],
) -> [T; K] {
    std::array::from_fn(|k| u * a[k] + v * b[k] + w * c[k])
}

/// `(b - a) × (c - a)`: twice the area long, along the outward normal.
#[inline]
pub fn area_vector([a, b, c]: [Vec3; 3]) -> Vec3 {
    cross(sub(b, a), sub(c, a))
}
