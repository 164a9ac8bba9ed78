//! One subdivision level of the template.

use autodiff_lite::{SparseMatrix, Var};
use mesh_core::{TriMesh, primitives};
use ndarray::Array2;

use super::config::Img2MeshConfig;
use super::offsets::carried;
use super::render::ViewRenderer;

/// The icosphere of a level: how it is drawn, how its vertices speak with each other and with the next level's.
#[derive(Debug)]
pub(super) struct Level {
    pub(super) renderer: ViewRenderer,
    /// The mean over the neighbours of each vertex: `[V, V]`.
    pub(super) graph: SparseMatrix,
    /// Values here to those of the next level: `[V next, V]`; none on the finest.
    pub(super) up: Option<SparseMatrix>,
    /// Before it is deformed.
    pub(super) template: TriMesh,
    /// The mean squared length of the template's edges.
    pub(super) squared_edge: f64,
}

impl Level {
    /// All levels that have meshes of their own, coarsest first; the last is `config.level`.
    pub(super) fn all(config: &Img2MeshConfig) -> Vec<Self> {
        let levels = config.base_level()..=config.level;
        levels.map(|level| Self::new(level, config)).collect()
    }

    /// The bending energy of the deformation of meshes `[N, V, 3]`: the mean square of its Laplacian in units of the template's
    /// edges, over their square, so that a smooth deformation has about the same at each level.
    pub(super) fn bending<'t>(&self, positions: Var<'t>) -> Var<'t> {
        let template = positions.tape().constant(Array2::from(self.template.positions.clone()));
        let near = &self.renderer.topology.vertex_vertices;
        let sum = losses::laplacian_squared(positions - template, near);
        let unit = self.template.positions.len() as f64 * self.squared_edge.powi(2);
        sum.scale((1.0 / unit) as f32)
    }

    fn new(level: u32, config: &Img2MeshConfig) -> Self {
        let template = primitives::icosphere(level).scaled([config.radius as f32; 3]);
        let renderer = ViewRenderer::new(&template, config);
        let near = &renderer.topology.vertex_vertices;
        let vertices = template.positions.len();
        let entries: Vec<(usize, usize, f32)> = (0..vertices)
            .flat_map(|v| {
                let row = near.row(v);
                row.iter().map(move |&other| (v, other as usize, 1.0 / row.len() as f32))
            })
            .collect();
        let graph = SparseMatrix::from_triplets(vertices, vertices, &entries)
            .expect("neighbours are vertices");
        let squares = renderer.topology.edges.iter().map(|&[a, b]| {
            let [p, q] = [a, b].map(|v| template.positions[v as usize]);
            (0..3).map(|k| f64::from(p[k] - q[k]).powi(2)).sum::<f64>()
        });
        let squared_edge = squares.sum::<f64>() / renderer.topology.edges.len() as f64;
        let up = (level < config.level).then(|| carried(level, level + 1));
        Self { renderer, graph, up, template, squared_edge }
    }
}
