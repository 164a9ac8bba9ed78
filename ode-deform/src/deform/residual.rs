//! The residual network that a deformation in continuous time is compared with.

use autodiff_lite::{Real, SparseMatrix, Var, impl_module};
use nets::Init;

use super::{DeformationField, FieldConfig};
use crate::VectorField;

/// Separate blocks with skips: `M <- M + GCN_k([M; f(M)])`, each with parameters of its own and without the time or a memory.
///
/// The paper's RES_d has 8 of them and its RES_s 4. What Euler's method with steps of 1 would do with a field that is
/// another one in each step.
///
/// ```
/// use autodiff_lite::{Module, SparseMatrix};
/// use nets::Init;
/// use ode_deform::deform::{DeformationField, FieldConfig, ResidualDeformation};
///
/// let graph = SparseMatrix::from_triplets(2, 2, &[(0, 1, 1.0), (1, 0, 1.0)])?;
/// let config = FieldConfig::published(960);
/// let field = DeformationField::<f32>::new(&Init::new(0), config, graph.clone());
/// let deep = ResidualDeformation::<f32>::new(&Init::new(0), 8, config, &graph);
/// let share = field.parameter_count() as f64 / deep.parameter_count() as f64;
/// assert!((1.0 / share - 6.7).abs() < 0.1); // The time takes 196 columns of the field.
/// # Ok::<(), autodiff_lite::SparseError>(())
/// ```
#[derive(Clone, Debug)]
pub struct ResidualDeformation<F: Real = f32> {
    /// In their order.
    pub blocks: Vec<DeformationField<F>>,
}
impl_module!(ResidualDeformation { blocks });

impl<F: Real> ResidualDeformation<F> {
    /// So many blocks, each as `config` says but for the time and the memory.
    pub fn new(init: &Init, blocks: usize, config: FieldConfig, graph: &SparseMatrix<F>) -> Self {
        let config = FieldConfig { time: 0, augment_dim: 0, ..config };
        let at = init.at("blocks");
        let block = |i| DeformationField::new(&at.index(i), config, graph.clone());
        Self { blocks: (0..blocks).map(block).collect() }
    }

    /// The mesh before the first block and after each.
    ///
    /// # Shapes
    /// `start [N, V, 3]`, `inputs` those of a [`DeformationField`], cameras `[N, 3, 4]` and maps `[N, H, W, C]` →
    /// `[N, V, 3]`, one more than there are blocks.
    ///
    /// # Panics
    /// If the inputs are not those of the field.
    #[track_caller]
    pub fn forward<'t>(&self, start: Var<'t, F>, inputs: &[Var<'t, F>]) -> Vec<Var<'t, F>> {
        let [camera, maps @ ..] = inputs else {
            panic!("ResidualDeformation: no inputs, expected cameras and feature maps");
        };
        let mut meshes = vec![start];
        let mut mesh = start;
        for block in &self.blocks {
            let (block, reduced) = block.reduced(maps);
            let inputs: Vec<_> = std::iter::once(*camera).chain(reduced).collect();
            mesh = mesh + block.eval(0.0, mesh, &inputs);
            meshes.push(mesh);
        }
        meshes
    }
}
