//! The slow, obvious twin: every pixel looks at every face, in double precision.
//!
//! It follows the published description line by line, scaled coordinates and guards included, and
//! keeps the lists of faces per pixel that the production kernels do without. Use it to check, and
//! to read: nothing here is fast, parallel or clever.

mod softras;

pub use softras::{Colored, softras};

use crate::faces::NONE;
use crate::{Rule, Settings};

/// DIB-R computes in NDC times this.
const MULTIPLIER: f64 = 1000.0;
/// Guard of the barycentric coordinates.
const AREA_GUARD: f64 = 1e-8;
/// Guard of the soft silhouette.
const GUARD: f64 = 1e-7;

/// A vertex on the screen: NDC `x`, NDC `y`, planar depth.
pub type Point = [f64; 3];

/// What one image shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// The nearest face, [`NONE`] at background. `[H, W]`
    pub face: Vec<u32>,
    /// Its barycentric coordinates on the screen, zero at background.
    pub screen: Vec<[f64; 3]>,
    /// Its barycentric coordinates for attributes: perspective-correct if the settings say so.
    pub barycentric: Vec<[f64; 3]>,
    /// Its depth, `+∞` at background.
    pub depth: Vec<f64>,
}

/// A face on the list of a background pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Near {
    /// Which face.
    pub face: u32,
    /// What of it is nearest: edges 0-1, 1-2, 2-0 are 1 to 3, corners 0 to 2 are 4 to 6.
    pub kind: u8,
    /// `exp(-sigma_inv d²)`
    pub probability: f64,
}

/// The soft silhouette of one image.
#[derive(Clone, Debug, PartialEq)]
pub struct Soft {
    /// The value of each pixel. `[H, W]`
    pub value: Vec<f64>,
    /// The faces that made it, by index.
    pub lists: Vec<Vec<Near>>,
}

fn center(settings: &Settings, pixel: usize) -> [f64; 2] {
    let (h, w) = (settings.height as f64, settings.width as f64);
    let (i, j) = ((pixel / settings.width) as f64, (pixel % settings.width) as f64);
    [(2.0 * j + 1.0 - w) / w, (h - 2.0 * i - 1.0) / h]
}

fn is_drawable(points: &[Point], corners: [u32; 3], settings: &Settings) -> bool {
    let near = if settings.perspective { settings.near.max(0.0) } else { settings.near };
    corners.iter().all(|&v| {
        let p = points[v as usize];
        p.iter().all(|x| x.is_finite()) && p[2] > near
    })
}

fn scaled(p: Point) -> [f64; 2] {
    [MULTIPLIER * p[0], MULTIPLIER * p[1]]
}

/// Lowest and highest coordinates of three points, moved outwards.
fn bounds(p: [[f64; 2]; 3], by: f64) -> [[f64; 2]; 2] {
    [0, 1].map(|k| {
        let low = p.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min);
        let high = p.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max);
        [low - by, high + by]
    })
}

fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn sub(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

/// Visibility, as [`rasterize`](crate::rasterize()).
pub fn rasterize(points: &[Point], faces: &[[u32; 3]], settings: &Settings) -> Image {
    let pixels = settings.pixels();
    let mut image = Image {
        face: vec![NONE; pixels],
        screen: vec![[0.0; 3]; pixels],
        barycentric: vec![[0.0; 3]; pixels],
        depth: vec![f64::INFINITY; pixels],
    };
    for pixel in 0..pixels {
        let p = center(settings, pixel).map(|x| MULTIPLIER * x);
        let mut best = f64::NEG_INFINITY;
        for (face, &corners) in faces.iter().enumerate() {
            if !is_drawable(points, corners, settings) {
                continue;
            }
            let v = corners.map(|v| points[v as usize]);
            let area = cross(sub(flat(v[1]), flat(v[0])), sub(flat(v[2]), flat(v[0])));
            if area == 0.0 || (settings.cull_back_faces && area < 0.0) {
                continue;
            }
            let s = v.map(scaled);
            let outside = |x: f64, [low, high]: [f64; 2]| match settings.rule {
                Rule::Published => x < low || x >= high,
                Rule::Closed => x < low || x > high,
            };
            let box_ = bounds(s, 0.0);
            if outside(p[0], box_[0]) || outside(p[1], box_[1]) {
                continue;
            }
            let mut w = [0, 1, 2].map(|k| cross(sub(s[(k + 1) % 3], p), sub(s[(k + 2) % 3], p)));
            let sum = w[0] + w[1] + w[2];
            let sum = sum + AREA_GUARD.copysign(sum);
            w = w.map(|w| w / sum);
            if w.iter().any(|&w| w < 0.0) {
                continue;
            }
            let key = |k: usize| if settings.perspective { 1.0 / v[k][2] } else { -v[k][2] };
            let nearness = w[0] * key(0) + w[1] * key(1) + w[2] * key(2);
            if nearness > best {
                best = nearness;
                image.face[pixel] = face as u32;
                image.screen[pixel] = w;
                if settings.perspective {
                    image.depth[pixel] = 1.0 / nearness;
                    image.barycentric[pixel] = [0, 1, 2].map(|k| w[k] * key(k) / nearness);
                } else {
                    image.depth[pixel] = -nearness;
                    image.barycentric[pixel] = w;
                }
            }
        }
    }
    image
}

fn flat(p: Point) -> [f64; 2] {
    [p[0], p[1]]
}

/// The soft silhouette, as [`soft_silhouette`](crate::soft_silhouette), with its lists.
pub fn soft_silhouette(
    points: &[Point],
    faces: &[[u32; 3]],
    settings: &Settings,
    image: &Image,
) -> Soft {
    let pixels = settings.pixels();
    let mut soft = Soft { value: vec![1.0; pixels], lists: vec![Vec::new(); pixels] };
    for pixel in (0..pixels).filter(|&pixel| image.face[pixel] == NONE) {
        let p = center(settings, pixel).map(|x| MULTIPLIER * x);
        let list = &mut soft.lists[pixel];
        for (face, &corners) in faces.iter().enumerate() {
            if settings.max_faces.is_some_and(|limit| list.len() >= limit) {
                break;
            }
            if !is_drawable(points, corners, settings) {
                continue;
            }
            let s = corners.map(|v| scaled(points[v as usize]));
            let [x, y] = bounds(s, MULTIPLIER * settings.box_length);
            if p[0] < x[0] || p[0] >= x[1] || p[1] < y[0] || p[1] >= y[1] {
                continue;
            }
            let candidates = [0, 1, 2]
                .map(|k| edge_distance(s[k], s[(k + 1) % 3], p))
                .into_iter()
                .chain(s.map(|v| squared(sub(p, v))));
            let (mut kind, mut nearest) = (0, f64::INFINITY);
            for (k, distance) in candidates.enumerate() {
                if distance < nearest {
                    (kind, nearest) = (k as u8 + 1, distance);
                }
            }
            let probability = (-settings.sigma_inv * nearest / (MULTIPLIER * MULTIPLIER)).exp();
            list.push(Near { face: face as u32, kind, probability });
        }
        let clear: f64 = list.iter().map(|near| 1.0 - near.probability).product();
        soft.value[pixel] = 1.0 - clear;
    }
    soft
}

fn squared(d: [f64; 2]) -> f64 {
    d[0] * d[0] + d[1] * d[1]
}

/// The line `A x + B y + C = 0` through two points.
fn line(a: [f64; 2], b: [f64; 2]) -> [f64; 3] {
    [b[1] - a[1], a[0] - b[0], b[0] * a[1] - a[0] * b[1]]
}

/// Squared distance to the inside of an edge; a large number where its foot lies outside.
fn edge_distance(v1: [f64; 2], v2: [f64; 2], p: [f64; 2]) -> f64 {
    let [a, b, c] = line(v1, v2);
    let up = a * p[0] + b * p[1] + c;
    let down = a * a + b * b;
    let foot = [
        (b * b * p[0] - a * b * p[1] - a * c) / (down + GUARD),
        (a * a * p[1] - a * b * p[0] - b * c) / (down + GUARD),
    ];
    let (d1, d2) = (sub(foot, v1), sub(foot, v2));
    if d1[0] * d2[0] + d1[1] * d2[1] > 0.0 {
        4.0 * MULTIPLIER * MULTIPLIER
    } else {
        up * up / (down + GUARD)
    }
}

/// The gradient of [`soft_silhouette`] to the screen positions of the vertices.
pub fn soft_silhouette_grad(
    points: &[Point],
    faces: &[[u32; 3]],
    settings: &Settings,
    soft: &Soft,
    grad: &[f64],
) -> Vec<[f64; 2]> {
    let mut out = vec![[0.0; 2]; points.len()];
    for (pixel, list) in soft.lists.iter().enumerate() {
        let p = center(settings, pixel).map(|x| MULTIPLIER * x);
        for (place, near) in list.iter().enumerate() {
            let others = match settings.rule {
                Rule::Published => (1.0 - soft.value[pixel]) / (1.0 - near.probability + GUARD),
                Rule::Closed => {
                    let others = list.iter().enumerate().filter(|(k, _)| *k != place);
                    others.map(|(_, other)| 1.0 - other.probability).product()
                }
            };
            let pull = -settings.sigma_inv * grad[pixel] * others * near.probability;
            let corners = faces[near.face as usize];
            let mut add = |corner: usize, by: [f64; 2]| {
                let out = &mut out[corners[corner] as usize];
                out[0] += pull * by[0] / MULTIPLIER;
                out[1] += pull * by[1] / MULTIPLIER;
            };
            let at = |corner: usize| scaled(points[corners[corner] as usize]);
            let kind = near.kind as usize;
            if kind > 3 {
                let v = at(kind - 4);
                add(kind - 4, [2.0 * (v[0] - p[0]), 2.0 * (v[1] - p[1])]);
                continue;
            }
            let (first, second) = (kind - 1, kind % 3);
            let (v1, v2) = (at(first), at(second));
            let [a, b, c] = line(v1, v2);
            let down = a * a + b * b + GUARD;
            let up = a * p[0] + b * p[1] + c;
            let distance = up * up / down;
            let za = 2.0 * (p[0] * up - distance * a) / down;
            let zb = 2.0 * (p[1] * up - distance * b) / down;
            let zc = 2.0 * up / down;
            add(first, [zb - v2[1] * zc, v2[0] * zc - za]);
            add(second, [v1[1] * zc - zb, za - v1[0] * zc]);
        }
    }
    out
}

/// Attributes `[V, C]` at each pixel, `[H, W, C]`, as [`interpolate`](crate::interpolate).
pub fn interpolate(
    faces: &[[u32; 3]],
    image: &Image,
    attributes: &[f64],
    channels: usize,
) -> Vec<f64> {
    let mut out = vec![0.0; image.face.len() * channels];
    for (pixel, &face) in image.face.iter().enumerate().filter(|(_, face)| **face != NONE) {
        for (k, &vertex) in faces[face as usize].iter().enumerate() {
            for c in 0..channels {
                out[pixel * channels + c] +=
                    image.barycentric[pixel][k] * attributes[vertex as usize * channels + c];
            }
        }
    }
    out
}

/// The gradient of [`interpolate`] to attributes `[V, C]` and positions `[V, 3]`.
pub fn interpolate_grad(
    points: &[Point],
    faces: &[[u32; 3]],
    settings: &Settings,
    image: &Image,
    (attributes, channels): (&[f64], usize),
    grad: &[f64],
) -> (Vec<f64>, Vec<Point>) {
    let mut of_attributes = vec![0.0; attributes.len()];
    let mut of_points = vec![[0.0; 3]; points.len()];
    for (pixel, &face) in image.face.iter().enumerate().filter(|(_, face)| **face != NONE) {
        let corners = faces[face as usize].map(|v| v as usize);
        let v = corners.map(|v| points[v]);
        let w = image.screen[pixel];
        let derivatives = barycentric_derivatives(v, w);
        for c in 0..channels {
            let g = grad[pixel * channels + c];
            let f = corners.map(|v| attributes[v * channels + c]);
            for k in 0..3 {
                of_attributes[corners[k] * channels + c] += g * image.barycentric[pixel][k];
            }
            // f = Σ w_k f_k u_k / Σ w_k u_k, with u_k = 1 / z_k, or 1 without perspective.
            let u = if settings.perspective { v.map(|v| 1.0 / v[2]) } else { [1.0; 3] };
            let down: f64 = (0..3).map(|k| w[k] * u[k]).sum();
            let value: f64 = (0..3).map(|k| w[k] * u[k] * f[k]).sum::<f64>() / down;
            for j in 0..3 {
                for axis in 0..2 {
                    let derivative =
                        |k: usize| derivatives[k][j][axis] * u[k] * (f[k] - value) / down;
                    of_points[corners[j]][axis] +=
                        g * (derivative(0) + derivative(1) + derivative(2));
                }
                if settings.perspective {
                    let of_u = w[j] * (f[j] - value) / down;
                    of_points[corners[j]][2] -= g * of_u * u[j] * u[j];
                }
            }
        }
    }
    (of_attributes, of_points)
}

/// Derivatives of the three screen barycentrics of a fixed pixel by `x` and `y` of each corner:
/// `[k][corner][axis]`, from the quotients `w1 = k1 / k3` and `w2 = k2 / k3`.
fn barycentric_derivatives(v: [Point; 3], w: [f64; 3]) -> [[[f64; 2]; 3]; 3] {
    let pixel = [0, 1].map(|axis| w[0] * v[0][axis] + w[1] * v[1][axis] + w[2] * v[2][axis]);
    let [m, p] = sub(flat(v[1]), flat(v[0]));
    let [n, q] = sub(flat(v[2]), flat(v[0]));
    let [s, t] = sub(pixel, flat(v[0]));
    let (k1, k2, k3) = (s * q - n * t, m * t - s * p, m * q - n * p);
    let over = |x: f64| x / (k3 * k3);
    // By m, p, n, q, s, t.
    let w1 = [-q * k1, n * k1, -t * k3 + p * k1, s * k3 - m * k1, q * k3, -n * k3].map(over);
    let w2 = [t * k3 - q * k2, -s * k3 + n * k2, p * k2, -m * k2, -p * k3, m * k3].map(over);
    let corners = |d: [f64; 6]| {
        let first = [-(d[0] + d[2] + d[4]), -(d[1] + d[3] + d[5])];
        [first, [d[0], d[1]], [d[2], d[3]]]
    };
    let (d1, d2) = (corners(w1), corners(w2));
    let d0 = [0, 1, 2].map(|j| [0, 1].map(|axis| -d1[j][axis] - d2[j][axis]));
    [d0, d1, d2]
}
