//! Three-vectors in `f64`: what the geometry of this crate computes in.

pub(crate) type Vec3 = [f64; 3];

#[inline]
pub(crate) fn widen(a: [f32; 3]) -> Vec3 {
    a.map(f64::from)
}

#[inline]
pub(crate) fn narrow(a: Vec3) -> [f32; 3] {
    a.map(|x| x as f32)
}

#[inline]
pub(crate) fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline]
pub(crate) fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline]
pub(crate) fn scale(a: Vec3, s: f64) -> Vec3 {
    a.map(|x| x * s)
}

#[inline]
pub(crate) fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
pub(crate) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline]
pub(crate) fn norm(a: Vec3) -> f64 {
    dot(a, a).sqrt()
}

/// The unit vector along `a`, or zero where `a` is zero or not finite.
#[inline]
pub(crate) fn unit(a: Vec3) -> Vec3 {
    let length = norm(a);
    if length > 0.0 && length.is_finite() { scale(a, 1.0 / length) } else { [0.0; 3] }
}

/// The angle between two vectors in radians, exact to rounding even near 0 and π.
#[inline]
pub(crate) fn angle(a: Vec3, b: Vec3) -> f64 {
    norm(cross(a, b)).atan2(dot(a, b))
}

/// The corners of a face.
#[inline]
pub(crate) fn triangle(positions: &[[f32; 3]], face: [u32; 3]) -> [Vec3; 3] {
    face.map(|v| widen(positions[v as usize]))
}

/// `(b - a) × (c - a)`: twice the area long, along the outward normal.
#[inline]
pub(crate) fn area_vector([a, b, c]: [Vec3; 3]) -> Vec3 {
    cross(sub(b, a), sub(c, a))
}
