//! Sides that outlines touch at their edges alone become even, edges sharp.
//!
//! An outline is a curve on the surface that is known, its normals too where it does not run along an edge. Between them, normals are
//! diffused, breaking at creases, and vertices follow; then outlines are fitted again. Each turn reaches farther, so that what is a crease has become
//! one before sides on both ends of it are evened out.

use mesh_core::vector::sub;
use mesh_core::{NormalDiffusion, Topology, face_normals, integrate_normals};
use rayon::prelude::*;

use super::error::FitError;
use super::shape::Shape;
use super::target::Target;

/// Turns of diffusion and fitting.
const TURNS: i32 = 8;
/// How far the first turn reaches, in faces, how much farther each next one, and at most.
const REACH: [f32; 3] = [3.0, 1.5, 50.0];
/// Difference of unit normals that makes a crease.
const CREASE: f32 = 0.3;
/// What a vertex that no outline touches is held by.
const HOLD: f32 = 0.01;
/// Views that are summed one after the other; the sums are added in order.
const CHUNK: usize = 8;
/// An outline farther from its mask, in pixels, knows nothing.
const NEAR: f32 = 1.0;
/// Rings over which what outlines lose is averaged before it is judged.
const RINGS: usize = 8;
/// What may be lost at a vertex, for each pixel of outline: the square of the distance to the masks' edges, in pixels, summed over the outline.
const LOSS: f32 = 0.004;
/// Mask IoU that may be lost at the end; where it is more, all is taken back.
const WORSE: f64 = 0.0005;
/// How often what lost more is brought back.
const JUDGEMENTS: usize = 2;

/// Makes a surface fair where outlines leave it open, and gives its mask IoU with `targets`. If that fell, vertices go back where
/// outlines miss the masks by more than before.
///
/// `fit` moves the shape a little against the outlines, and gives the mask IoU. Cancelled, it ends with the turn, or with what was given.
///
/// # Errors
/// As `fit`.
pub(super) fn fair(
    shape: &mut Shape,
    targets: &[Target],
    fit: &mut impl FnMut(&mut Shape) -> Result<f64, FitError>,
    is_cancelled: &dyn Fn() -> bool,
) -> Result<f64, FitError> {
    let (first, given) = (shape.mask_iou(targets), shape.positions.clone());
    let before = misfit(shape, targets);
    let mut iou = first;
    for turn in 0..TURNS {
        if is_cancelled() {
            break;
        }
        shape.place(diffused(shape, targets, turn));
        iou = fit(shape)?;
    }
    if iou >= first {
        return Ok(iou);
    }
    if is_cancelled() {
        shape.place(given);
        return Ok(first);
    }
    let mut freedom = vec![1.0; given.len()];
    for _ in 0..JUDGEMENTS {
        judge(shape, &before, &misfit(shape, targets), &mut freedom);
        let between = |((x, g), f): ((&[f32; 3], &[f32; 3]), &f32)| {
            std::array::from_fn(|k| g[k] + f * (x[k] - g[k]))
        };
        let placed = shape.positions.iter().zip(&given).zip(&freedom).map(between).collect();
        shape.place(placed);
        iou = fit(shape)?;
    }
    if iou < first - WORSE {
        shape.place(given);
        return Ok(first);
    }
    Ok(iou)
}

/// Where vertices are once normals are diffused as far as in this turn.
fn diffused(shape: &Shape, targets: &[Target], turn: i32) -> Vec<[f32; 3]> {
    let Shape { positions, topology, .. } = shape;
    let [reach, growth, most] = REACH;
    let reach = (reach * growth.powi(turn)).min(most);
    let touched = touched(shape, targets);
    let creased = creased(positions, topology);
    let known = |&v: &u32| if creased[v as usize] { 0.0 } else { touched[v as usize] };
    let trust: Vec<f32> =
        topology.faces.iter().map(|face| face.iter().map(known).sum::<f32>() / 3.0).collect();
    let diffusion = NormalDiffusion { reach, crease: CREASE, rounds: 2 };
    let normals = diffusion.normals(positions, topology, &trust);
    let hold: Vec<f32> = touched.iter().map(|touched| touched + HOLD).collect();
    integrate_normals(positions, topology, &normals, &hold)
}

/// How much is known of each vertex, 0 to 1: the pixels of outline that are on it.
fn touched(shape: &Shape, targets: &[Target]) -> Vec<f32> {
    let near = |distance: f32| if distance.abs() < NEAR { 1.0 } else { 0.0 };
    on_vertices(shape, targets, near).into_iter().map(|[_, known]| known.min(1.0)).collect()
}

/// What outlines are off at each vertex: their length there, and the sum of squares over it.
fn misfit(shape: &Shape, targets: &[Target]) -> Vec<[f32; 2]> {
    on_vertices(shape, targets, |distance| distance * distance)
}

/// The outlines' length at each vertex in pixels, and that times a measure of their distance from the masks' edges.
fn on_vertices(
    shape: &Shape,
    targets: &[Target],
    measure: impl Fn(f32) -> f32 + Sync,
) -> Vec<[f32; 2]> {
    let (edge, planes) = (shape.mean_edge(), shape.planes());
    let stride = |target: &Target| target.lines_between_samples(edge);
    let of = |targets: &[Target]| {
        let mut sums = vec![[0.0f32; 2]; shape.positions.len()];
        shape.borders(&planes, targets, stride, |_, border| {
            for (v, share) in border.ends.into_iter().zip([1.0 - border.share, border.share]) {
                let length = share * border.weight;
                sums[v as usize][0] += length;
                sums[v as usize][1] += length * measure(border.distance);
            }
        });
        sums
    };
    let parts: Vec<Vec<[f32; 2]>> = targets.par_chunks(CHUNK).map(of).collect();
    parts.into_iter().fold(vec![[0.0; 2]; shape.positions.len()], |mut total, part| {
        for (total, part) in total.iter_mut().zip(part) {
            *total = [total[0] + part[0], total[1] + part[1]];
        }
        total
    })
}

/// Vertices of which a face meets its neighbour in a crease.
fn creased(positions: &[[f32; 3]], topology: &Topology) -> Vec<bool> {
    let normals = face_normals(positions, &topology.faces);
    let mut creased = vec![false; positions.len()];
    for pair in topology.edge_faces.iter().filter(|pair| !pair.contains(&Topology::NONE)) {
        let [a, b] = pair.map(|face| normals[face as usize]);
        // A face without area has no normal.
        let both = [a, b].iter().all(|n| *n != [0.0; 3]);
        if both && sub(a, b).iter().map(|d| d * d).sum::<f32>() > CREASE * CREASE {
            for v in pair.iter().flat_map(|&face| topology.faces[face as usize]) {
                creased[v as usize] = true;
            }
        }
    }
    creased
}

/// Takes the freedom to move from where outlines lost more than they may.
fn judge(shape: &Shape, before: &[[f32; 2]], after: &[[f32; 2]], freedom: &mut Vec<f32>) {
    let (mut before, mut after) = (before.to_vec(), after.to_vec());
    for sums in [&mut before, &mut after] {
        average(shape, sums);
    }
    let mut kept: Vec<[f32; 1]> = freedom.iter().map(|&f| [f]).collect();
    for (kept, (before, after)) in kept.iter_mut().zip(before.iter().zip(&after)) {
        if after[1] > before[1] + LOSS * before[0].max(after[0]) {
            kept[0] = 0.0;
        }
    }
    average(shape, &mut kept);
    *freedom = kept.into_iter().map(|[f]| f).collect();
}

/// Means over the rings around each vertex.
fn average<const K: usize>(shape: &Shape, x: &mut Vec<[f32; K]>) {
    let mut means = x.clone();
    for _ in 0..RINGS {
        for (v, mean) in means.iter_mut().enumerate() {
            let ring = shape.topology.vertex_vertices.row(v);
            let share = 1.0 / (1.0 + ring.len() as f32);
            *mean = std::array::from_fn(|k| {
                share * (x[v][k] + ring.iter().map(|&j| x[j as usize][k]).sum::<f32>())
            });
        }
        std::mem::swap(x, &mut means);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use std::cell::Cell;

    use synth::{Orbit, RenderOptions, render_views};

    use super::*;
    use crate::fit::FitConfig;
    use crate::fit::distance::Blur;

    fn ball() -> (Shape, Vec<Target>) {
        let shape = Shape::sphere(4, &FitConfig::default());
        let orbit = Orbit { count: 6, target: [0.0; 3], width: 64, height: 64, ..Orbit::default() };
        let mesh = mesh_core::TriMesh::new(shape.positions.clone(), shape.faces.clone());
        let views =
            render_views(&mesh, &orbit.cameras(), &RenderOptions::default(), &|_, _| {}).unwrap();
        let targets =
            views.iter().map(|view| Target::new(view, Blur::plain(1.0), 0.3, 0.3).unwrap());
        (shape, targets.collect())
    }

    #[test]
    fn only_where_outlines_lost_are_vertices_held() {
        let (shape, _) = ball();
        let before = vec![[2.0, 0.02]; shape.positions.len()];
        let lost = |by: f32| -> Vec<f32> {
            let top = |p: &[f32; 3]| if p[2] > 0.7 { by } else { 0.0 };
            let after: Vec<_> = shape.positions.iter().map(|p| [2.0, 0.02 + top(p)]).collect();
            let mut freedom = vec![1.0; after.len()];
            judge(&shape, &before, &after, &mut freedom);
            freedom
        };
        let freedom_at = |freedom: &[f32], z: f32| {
            let far = |p: &[f32; 3]| (p[2] - z).abs();
            let nearest = |&a: &usize, &b: &usize| {
                far(&shape.positions[a]).total_cmp(&far(&shape.positions[b]))
            };
            freedom[(0..freedom.len()).min_by(nearest).unwrap()]
        };
        // Two pixels of outline may lose twice the limit, and no more.
        assert!(lost(1.9 * LOSS).iter().all(|f| *f > 0.999));
        let held = lost(2.5 * LOSS);
        assert!(freedom_at(&held, 1.0) < 0.2, "{}", freedom_at(&held, 1.0));
        assert!(freedom_at(&held, -1.0) > 0.999 && freedom_at(&held, 0.0) > 0.9);
    }

    #[test]
    fn what_costs_too_much_is_taken_back() {
        let (mut shape, targets) = ball();
        let (given, first) = (shape.positions.clone(), shape.mask_iou(&targets));
        let fitted = Cell::new(0);
        let mut worse = |_: &mut Shape| {
            fitted.set(fitted.get() + 1);
            Ok(first - 2.0 * WORSE)
        };
        let iou = fair(&mut shape, &targets, &mut worse, &|| false).unwrap();
        assert_eq!((iou, fitted.get()), (first, TURNS as usize + JUDGEMENTS));
        assert_eq!(shape.positions, given);
        // What costs a little is kept.
        let mut little = |_: &mut Shape| Ok(first - 0.5 * WORSE);
        let iou = fair(&mut shape, &targets, &mut little, &|| false).unwrap();
        assert_eq!(iou, first - 0.5 * WORSE);
        assert_ne!(shape.positions, given);
    }

    #[test]
    fn cancelled_it_is_no_worse_than_what_was_given() {
        let (mut shape, targets) = ball();
        let (given, first) = (shape.positions.clone(), shape.mask_iou(&targets));
        let fitted = Cell::new(0);
        let mut fit = |_: &mut Shape| {
            fitted.set(fitted.get() + 1);
            Ok(0.0)
        };
        let iou = fair(&mut shape, &targets, &mut fit, &|| fitted.get() == 2).unwrap();
        assert_eq!((iou, fitted.get()), (first, 2));
        assert_eq!(shape.positions, given);
    }
}
