//! A mesh that grew from a sphere spans what no outline shows like a skin, and cuts off the edges behind it: it is blown up against the
//! visual hull.

use mesh_core::vertex_normals;
use rayon::prelude::*;

use super::config::FitConfig;
use super::error::FitError;
use super::order::Order;
use super::shape::Shape;
use super::target::Target;

/// Rounds of blowing up and fitting.
const ROUNDS: usize = 20;
/// How far a vertex goes in a round, of the way that all masks leave it.
const SHARE: f32 = 0.3;
/// How far inside all masks it may stay, in pixels.
const SLACK: f32 = 1.0;
/// Steps of fitting in a round.
const STEPS: usize = 2;
/// Their length, as a share of a level's first step.
const RATE: f32 = 0.2;

/// Moves vertices that are well inside all masks outward, and fits outlines and smoothness in between: of the surfaces that the masks allow
/// the largest is that of their visual hull (Laurentini 1994), on which edges are that no outline shows all along, as those of stairs.
/// Cancelled, it ends with the round.
///
/// # Errors
/// As [`Shape::step`].
pub(super) fn inflate(
    shape: &mut Shape,
    targets: &[Target],
    order: &mut Order,
    config: &FitConfig,
    step: usize,
    is_cancelled: &dyn Fn() -> bool,
) -> Result<(), FitError> {
    for _ in 0..ROUNDS {
        if is_cancelled() {
            break;
        }
        shape.place(blown(shape, targets));
        for _ in 0..STEPS {
            let rate = RATE * config.learning_rate;
            shape.step(targets, order.next(), config, rate, step)?;
        }
    }
    Ok(())
}

/// Where the vertices are after one round outward.
fn blown(shape: &Shape, targets: &[Target]) -> Vec<[f32; 3]> {
    let normals = vertex_normals(&shape.positions, &shape.faces);
    let moved = |(&p, n): (&[f32; 3], &[f32; 3])| {
        let distance = SHARE * room(p, targets).max(0.0);
        std::array::from_fn(|k| p[k] + distance * n[k])
    };
    shape.positions.par_iter().zip(&normals).map(moved).collect()
}

/// How far a point may move without coming within [`SLACK`] of a mask's edge, negative where it is within.
fn room(p: [f32; 3], targets: &[Target]) -> f32 {
    let inside = |target: &Target| {
        let [column, row, depth] = target.project(p);
        (-target.distance(column, row) - SLACK) / target.pixels_per_unit(depth)
    };
    targets.iter().map(inside).fold(f32::INFINITY, f32::min)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::vector::norm;
    use synth::{Orbit, RenderOptions, render_views};

    use super::*;
    use crate::fit::distance::Blur;

    /// A ball with a dent that no outline shows, in views of the whole ball.
    #[test]
    fn what_all_masks_contain_is_filled() {
        let config = FitConfig::default();
        let mut shape = Shape::sphere(3, &config);
        let ball = mesh_core::TriMesh::new(shape.positions.clone(), shape.faces.clone());
        let orbit = Orbit { count: 8, target: [0.0; 3], width: 64, height: 64, ..Orbit::default() };
        let views =
            render_views(&ball, &orbit.cameras(), &RenderOptions::default(), &|_, _| {}).unwrap();
        let target = |view| Target::new(view, Blur::plain(1.0), 0.3, 0.3).unwrap();
        let targets: Vec<Target> = views.iter().map(target).collect();
        let dented = |p: &[f32; 3]| p.map(|x| if p[1] > 0.8 { 0.7 * x } else { x });
        shape.place(shape.positions.iter().map(dented).collect());
        let shortest = |shape: &Shape| shape.positions.iter().map(|&p| norm(p)).fold(1.0, f32::min);
        let mut order = Order::new(8, &config);
        let dent = shortest(&shape);
        assert!(dent < 0.71);
        inflate(&mut shape, &targets, &mut order, &config, 0, &|| true).unwrap();
        assert!(shortest(&shape) == dent, "cancelled, and moved");
        inflate(&mut shape, &targets, &mut order, &config, 0, &|| false).unwrap();
        let pixel = 1.0 / targets[0].pixels_per_unit(targets[0].project([0.0; 3])[2]);
        let left = (1.0 - shortest(&shape)) / pixel;
        assert!(left < 2.0 * SLACK, "{left} pixels are left of the dent");
        let farthest = shape.positions.iter().map(|&p| norm(p)).fold(0.0, f32::max);
        assert!(farthest < 1.0 + pixel, "{farthest}");
    }
}
