//! The vertex colours that best explain all images at once.
//!
//! An image of a mesh with fixed shape is linear in its vertex colours: each pixel is the
//! barycentric mix of three of them. The best colours are the solution of one weighted linear
//! least squares problem over all pixels of all views. Its matrix has an entry per vertex and one per
//! edge, so it is summed pixel by pixel and solved by conjugate gradients in milliseconds; what
//! optimising colours by gradient steps would approach slowly.

use mesh_core::Topology;
use rayon::prelude::*;

use super::exposure::Exposure;
use super::sight::{Photographed, Sample, Sight};

/// Parts in which views are summed; fixed, so that sums do not depend on the number of threads.
const PARTS: usize = 8;
/// Rounds of reweighting: highlights and misplaced edges count less in the second and third.
const ROUNDS: usize = 3;
/// Colour difference at which a pixel's weight has fallen to a half.
const OUTLIER: f32 = 0.15;
/// Smoothness relative to the mean weight of a vertex: what decides where nothing is seen.
const SMOOTHNESS: f64 = 0.003;

/// The normal equations: one unknown colour per vertex.
#[derive(Clone, Debug)]
struct Normal {
    diagonal: Vec<f32>,
    /// One per edge.
    beside: Vec<f32>,
    right: Vec<[f32; 3]>,
}

impl Normal {
    fn new(topology: &Topology, vertices: usize) -> Self {
        Self {
            diagonal: vec![0.0; vertices],
            beside: vec![0.0; topology.edges.len()],
            right: vec![[0.0; 3]; vertices],
        }
    }

    fn add(&mut self, topology: &Topology, face: [u32; 3], sample: &Sample, weight: f32) {
        let b = sample.barycentric;
        let edges = topology.face_edges[sample.face as usize];
        for k in 0..3 {
            let v = face[k] as usize;
            let w = weight * b[k];
            self.diagonal[v] += w * b[k];
            self.beside[edges[k] as usize] += w * b[(k + 1) % 3];
            for c in 0..3 {
                self.right[v][c] += w * sample.color[c];
            }
        }
    }

    fn sum(&mut self, other: &Self) {
        for (a, b) in self.diagonal.iter_mut().zip(&other.diagonal) {
            *a += b;
        }
        for (a, b) in self.beside.iter_mut().zip(&other.beside) {
            *a += b;
        }
        for (a, b) in self.right.iter_mut().flatten().zip(other.right.iter().flatten()) {
            *a += b;
        }
    }

    /// Asks for what is to be added to `colors` instead.
    fn take(&mut self, topology: &Topology, colors: &[[f32; 3]]) {
        for ((right, color), &own) in self.right.iter_mut().zip(colors).zip(&self.diagonal) {
            *right = std::array::from_fn(|c| right[c] - own * color[c]);
        }
        for (&[a, b], &beside) in topology.edges.iter().zip(&self.beside) {
            for c in 0..3 {
                self.right[a as usize][c] -= beside * colors[b as usize][c];
                self.right[b as usize][c] -= beside * colors[a as usize][c];
            }
        }
    }

    /// Solves with smoothness added, from the colours given.
    fn solve(&self, topology: &Topology, colors: &mut [[f32; 3]]) {
        let n = self.diagonal.len();
        let seen: Vec<f64> =
            self.diagonal.iter().filter(|d| **d > 0.0).map(|&d| f64::from(d)).collect();
        if seen.is_empty() {
            return;
        }
        let smooth = (SMOOTHNESS * seen.iter().sum::<f64>() / seen.len() as f64) as f32;
        let diagonal: Vec<f32> = (0..n)
            .map(|v| self.diagonal[v] + smooth * topology.vertex_vertices.row(v).len() as f32)
            // Of a vertex without a face nothing is asked.
            .map(|diagonal| if diagonal > 0.0 { diagonal } else { 1.0 })
            .collect();
        let apply = |x: &[[f32; 3]], y: &mut [[f32; 3]]| {
            for v in 0..n {
                y[v] = x[v].map(|c| c * diagonal[v]);
            }
            for (&[a, b], &w) in topology.edges.iter().zip(&self.beside) {
                let (a, b, w) = (a as usize, b as usize, w - smooth);
                for c in 0..3 {
                    y[a][c] += w * x[b][c];
                    y[b][c] += w * x[a][c];
                }
            }
        };
        let dots = |a: &[[f32; 3]], b: &[[f32; 3]]| -> [f64; 3] {
            let mut sum = [0.0; 3];
            for (a, b) in a.iter().zip(b) {
                for c in 0..3 {
                    sum[c] += f64::from(a[c]) * f64::from(b[c]);
                }
            }
            sum
        };
        let mut image = vec![[0.0; 3]; n];
        apply(colors, &mut image);
        let mut r: Vec<[f32; 3]> =
            (0..n).map(|v| std::array::from_fn(|c| self.right[v][c] - image[v][c])).collect();
        let mut z: Vec<[f32; 3]> = (0..n).map(|v| r[v].map(|c| c / diagonal[v])).collect();
        let mut p = z.clone();
        let target = dots(&self.right, &self.right).map(|d| d * 1e-10);
        let mut rz = dots(&r, &z);
        for _ in 0..400 {
            let rr = dots(&r, &r);
            if (0..3).all(|c| rr[c] <= target[c]) {
                break;
            }
            apply(&p, &mut image);
            let curvature = dots(&p, &image);
            let step: [f32; 3] = std::array::from_fn(|c| quotient(rz[c], curvature[c]));
            for v in 0..n {
                for c in 0..3 {
                    colors[v][c] += step[c] * p[v][c];
                    r[v][c] -= step[c] * image[v][c];
                    z[v][c] = r[v][c] / diagonal[v];
                }
            }
            let next = dots(&r, &z);
            let carry: [f32; 3] = std::array::from_fn(|c| quotient(next[c], rz[c]));
            rz = next;
            for v in 0..n {
                for c in 0..3 {
                    p[v][c] = z[v][c] + carry[c] * p[v][c];
                }
            }
        }
    }
}

fn quotient(a: f64, b: f64) -> f32 {
    if b > 0.0 { (a / b) as f32 } else { 0.0 }
}

/// Solves for the colours of the vertices, sRGB in `[0, 1]`.
///
/// Smooth is what colours differ by from those `before`, where there are some: what no view shows keeps its pattern.
pub(crate) fn vertex_colors(
    seen: &Photographed<'_>,
    topology: &Topology,
    exposure: &Exposure,
    before: Option<&[[f32; 3]]>,
) -> Vec<[f32; 3]> {
    let first = before.map_or_else(|| vec![[0.5; 3]; seen.positions.len()], <[_]>::to_vec);
    let mut colors = first.clone();
    for round in 0..ROUNDS {
        let known = (round > 0).then_some(&colors[..]);
        let Some(mut normal) = normal(seen, topology, exposure, known) else { break };
        if before.is_none() {
            normal.solve(topology, &mut colors);
            continue;
        }
        normal.take(topology, &first);
        let mut change: Vec<[f32; 3]> =
            colors.iter().zip(&first).map(|(c, f)| std::array::from_fn(|k| c[k] - f[k])).collect();
        normal.solve(topology, &mut change);
        for ((color, first), change) in colors.iter_mut().zip(&first).zip(&change) {
            *color = std::array::from_fn(|k| first[k] + change[k]);
        }
    }
    for c in colors.iter_mut().flatten() {
        *c = c.clamp(0.0, 1.0);
    }
    colors
}

/// Solves once more, from colours that are nearly right.
pub(crate) fn again(
    seen: &Photographed<'_>,
    topology: &Topology,
    exposure: &Exposure,
    colors: &mut [[f32; 3]],
) {
    if let Some(normal) = normal(seen, topology, exposure, Some(colors)) {
        normal.solve(topology, colors);
    }
}

/// The sums over all views; pixels that differ from the colours `known` count less.
fn normal(
    seen: &Photographed<'_>,
    topology: &Topology,
    exposure: &Exposure,
    known: Option<&[[f32; 3]]>,
) -> Option<Normal> {
    let count = seen.targets.len();
    let per_part = count.div_ceil(PARTS).max(1);
    let one = |part: usize| {
        let mut normal = Normal::new(topology, seen.positions.len());
        let mut sight = Sight::default();
        for view in part * per_part..((part + 1) * per_part).min(count) {
            seen.samples(&mut sight, view, |mut sample| {
                sample.color = exposure.brought(view, sample.color);
                let mut weight = sample.weight;
                if let Some(known) = known {
                    let mix = sample.interpolate(seen.faces, known);
                    let square: f32 = (0..3).map(|c| (sample.color[c] - mix[c]).powi(2)).sum();
                    weight /= 1.0 + square / (OUTLIER * OUTLIER);
                }
                normal.add(topology, seen.faces[sample.face as usize], &sample, weight);
            });
        }
        normal
    };
    let parts: Vec<Normal> = (0..count.div_ceil(per_part)).into_par_iter().map(one).collect();
    parts.into_iter().reduce(|mut total, part| {
        total.sum(&part);
        total
    })
}
