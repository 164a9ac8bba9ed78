//! What the mesh of each stage misses of the true surface, and how regular it is.

use autodiff_lite::Var;
use losses::{Directions, Matches};

use super::deformer::{Deformer, Stage};
use super::single_view::SingleView;
use super::sums::Sums;

fn add<'t>(sum: &mut Option<Var<'t>>, value: Var<'t>) {
    *sum = Some(sum.map_or(value, |sum| sum + value));
}

impl<D: Deformer> SingleView<D> {
    /// Adds what a stage's mesh misses of `truth` `[N, P, 3]`, whose `normals` are empty where it has none.
    pub(super) fn stage_terms<'t>(
        &self,
        stage: &Stage<'t>,
        truth: Var<'t>,
        normals: &[f32],
        sums: &mut Sums<'t>,
    ) {
        let shared = self.shared();
        let level = &self.template.levels[stage.level];
        let (edges, neighbors) = (&level.topology.edges, &level.topology.vertex_vertices);
        let mut matches = Matches::default();
        matches.find(stage.positions, truth);
        let directions = Directions { x_to_y: shared.chamfer_back, y_to_x: 1.0 };
        let vertices = level.mesh.positions.len() as f32;
        let moved = stage.positions - stage.before;
        let chamfer = losses::chamfer_distance(stage.positions, truth, &matches, directions);
        add(&mut sums.chamfer, chamfer);
        let listed = 2.0 * edges.len() as f32;
        let share = if shared.self_loops { listed / (listed + vertices) } else { 1.0 };
        let of_edges = |mean: Var<'t>| if share < 1.0 { mean.scale(share) } else { mean };
        let edge = losses::edge_length(stage.positions, edges, 0.0);
        add(&mut sums.edge, of_edges(edge));
        add(&mut sums.stretch, edge.scale((1.0 / level.squared_edge) as f32));
        if shared.normal_weight > 0.0 && !normals.is_empty() {
            let turned = losses::edge_normal(stage.positions, edges, normals, matches.x_to_y());
            add(&mut sums.normal, of_edges(turned));
        }
        if shared.laplacian_weight > 0.0 || shared.bending_weight > 0.0 {
            let change = losses::laplacian_squared(moved, neighbors);
            add(&mut sums.laplacian, change.scale(stage.laplacian as f32 / vertices));
            let unit = f64::from(vertices) * level.squared_edge.powi(2);
            add(&mut sums.bending, change.scale((1.0 / unit) as f32));
        }
        if shared.move_weight > 0.0 && stage.displacement > 0.0 {
            let moved = moved.square().mean().scale(3.0 * stage.displacement as f32);
            add(&mut sums.moved, moved);
        }
    }
}
