//! SoftRas's aggregation, pixel by pixel and face by face.

use super::{Point, cross, flat, sub};
use crate::kernels::softras::TEXEL_GUARD;
use crate::{Settings, SoftRasSettings};

/// Colours of faces in the slow twin.
#[derive(Clone, Copy, Debug)]
pub enum Colored<'a> {
    /// `[V][C]`
    Vertices(&'a [Vec<f64>]),
    /// `[F][side²][C]` and `side`.
    Texels(&'a [Vec<Vec<f64>>], usize),
}

/// `[H W][C + 1]`, as [`softras`](fn@crate::softras): two passes over all faces for each pixel.
pub fn softras(
    points: &[Point],
    faces: &[[u32; 3]],
    paint: Colored<'_>,
    channels: usize,
    settings: &SoftRasSettings,
) -> Vec<Vec<f64>> {
    let grid = Settings::new(settings.height, settings.width);
    let pixel = |at: usize| {
        let p = super::center(&grid, at);
        let mut clear = 1.0;
        // Coverage, height and colour of each face that is seen.
        let mut seen: Vec<(f64, f64, Vec<f64>)> = Vec::new();
        for (face, corners) in faces.iter().enumerate() {
            let v = corners.map(|v| points[v as usize]);
            let Some((covered, raw)) = coverage(&v, p, settings) else { continue };
            clear *= 1.0 - covered;
            let cut = raw.map(|w| w.clamp(0.0, 1.0));
            let sum = cut.iter().sum::<f64>().max(1e-5);
            let cut = cut.map(|w| w / sum);
            let depth = 1.0 / (0..3).map(|k| cut[k] / v[k][2]).sum::<f64>();
            if !(settings.near..=settings.far).contains(&depth) {
                continue;
            }
            let blend = |k: usize| {
                if settings.perspective { cut[k] * depth / v[k][2] } else { cut[k] }
            };
            let color = |c: usize| match paint {
                Colored::Vertices(all) => {
                    (0..3).map(|k| blend(k) * all[corners[k] as usize][c]).sum()
                }
                Colored::Texels(all, side) => all[face][texel(cut, side)][c],
            };
            let height = (settings.far - depth) / (settings.far - settings.near);
            seen.push((covered, height, (0..channels).map(color).collect()));
        }
        let peak = seen.iter().fold(settings.background, |peak, s| peak.max(s.1));
        let weight = |height: f64| ((height - peak) / settings.gamma).exp();
        let total =
            weight(settings.background) + seen.iter().map(|s| s.0 * weight(s.1)).sum::<f64>();
        let behind = |c: usize| settings.background_color.get(c).copied().unwrap_or(0.0);
        let color = |c: usize| {
            let own = seen.iter().map(|s| s.0 * weight(s.1) * s.2[c]).sum::<f64>();
            (own + weight(settings.background) * behind(c)) / total
        };
        (0..channels).map(color).chain([1.0 - clear]).collect()
    };
    (0..settings.height * settings.width).map(pixel).collect()
}

/// How much a face covers a pixel, and its barycentric coordinates there.
fn coverage(v: &[Point; 3], p: [f64; 2], settings: &SoftRasSettings) -> Option<(f64, [f64; 3])> {
    let drawable = v.iter().all(|p| p.iter().all(|x| x.is_finite()) && p[2] > 0.0);
    let s = v.map(flat);
    let area = cross(sub(s[1], s[0]), sub(s[2], s[0]));
    if !drawable || area == 0.0 {
        return None;
    }
    let raw = [0, 1, 2].map(|k| cross(sub(s[(k + 1) % 3], p), sub(s[(k + 2) % 3], p)) / area);
    let inside = raw.iter().all(|&w| w > 0.0);
    let square = |k: usize| {
        let (along, to) = (sub(s[(k + 1) % 3], s[k]), sub(p, s[k]));
        let length = along[0] * along[0] + along[1] * along[1];
        let t = ((to[0] * along[0] + to[1] * along[1]) / length).clamp(0.0, 1.0);
        (to[0] - t * along[0]).powi(2) + (to[1] - t * along[1]).powi(2)
    };
    let nearest = (0..3).map(square).fold(f64::INFINITY, f64::min);
    let sign = if inside { 1.0 } else { -1.0 };
    let covered = 1.0 / (1.0 + (-sign * nearest / settings.sigma).exp());
    (inside || nearest < settings.reach().powi(2)).then_some((covered, raw))
}

/// The face's square is cut into `side²` cells of two triangles; the upper ones stand for the half of the
/// square that the face does not have.
fn texel(cut: [f64; 3], side: usize) -> usize {
    let place = |w: f64| ((w * side as f64) as usize).min(side - 1);
    let (column, row) = (place(cut[0]), place(cut[1]));
    let rest = (cut[0] + cut[1]) * side as f64 - (column + row) as f64;
    if rest <= 1.0 + TEXEL_GUARD {
        row * side + column
    } else {
        (side - 1 - row) * side + side - 1 - column
    }
}
