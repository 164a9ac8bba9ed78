//! Three-vectors of either precision.

use autodiff_lite::Real;

/// Lengths below this count as this, and have no derivative: a degenerate face has a short normal and pulls at nothing.
pub const TINY: f64 = 1e-12;

/// A slice of coordinates as points; what is left over is cut off.
#[inline]
pub fn points<F>(x: &[F]) -> &[[F; 3]] {
    x.as_chunks().0
}

/// A slice of coordinates as points; what is left over is cut off.
#[inline]
pub fn points_mut<F>(x: &mut [F]) -> &mut [[F; 3]] {
    x.as_chunks_mut().0
}

/// `a + b`.
#[inline]
pub fn add<F: Real>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
#[inline]
pub fn sub<F: Real>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `s a`.
#[inline]
pub fn scale<F: Real>(a: [F; 3], s: F) -> [F; 3] {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// `a · b`.
#[inline]
pub fn dot<F: Real>(a: [F; 3], b: [F; 3]) -> F {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a × b`.
#[inline]
pub fn cross<F: Real>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a += b`.
#[inline]
pub fn accumulate<F: Real>(a: &mut [F; 3], b: [F; 3]) {
    *a = add(*a, b);
}

/// `a / max(|a|, TINY)` and the reciprocal of that length.
#[inline]
pub fn unit<F: Real>(a: [F; 3]) -> ([F; 3], F) {
    let tiny = F::from_f64(TINY);
    let length = dot(a, a).sqrt();
    let inverse = F::one() / if length > tiny { length } else { tiny };
    (scale(a, inverse), inverse)
}

/// The gradient of `a` from the gradient `g` of its [`unit()`] vector `u`: none where `a` is no longer than [`TINY`], for which the
/// true one is a million million times as long as that of other vectors.
#[inline]
pub fn unit_grad<F: Real>(u: [F; 3], inverse: F, g: [F; 3]) -> [F; 3] {
    if inverse >= F::from_f64(1.0 / TINY) {
        return [F::zero(); 3];
    }
    scale(sub(g, scale(u, dot(u, g))), inverse)
}

/// `(b - a) × (c - a)`: along the face's normal, twice its area long.
#[inline]
pub fn area_vector<F: Real>(positions: &[[F; 3]], face: [u32; 3]) -> [F; 3] {
    let [a, b, c] = face.map(|v| positions[v as usize]);
    cross(sub(b, a), sub(c, a))
}

/// Adds the gradient `g` of a face's [`area_vector`] to its corners.
#[inline]
pub fn area_vector_grad<F: Real>(
    positions: &[[F; 3]],
    face: [u32; 3],
    g: [F; 3],
    out: &mut [[F; 3]],
) {
    let [a, b, c] = face.map(|v| positions[v as usize]);
    let at_b = cross(sub(c, a), g);
    let at_c = cross(g, sub(b, a));
    accumulate(&mut out[face[1] as usize], at_b);
    accumulate(&mut out[face[2] as usize], at_c);
    let at_a = &mut out[face[0] as usize];
    *at_a = sub(*at_a, add(at_b, at_c));
}
