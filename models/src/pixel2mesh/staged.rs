//! Pixel2Mesh as it was published: three stages, from coarse to fine.

use autodiff_lite::{Activation, Module, Param, Var, impl_module};
use nets::{ChebyshevConv, GraphBottleneck, Init, pool_features};
use ode_deform::deform::project_points;
use ode_deform::solve::{SolveError, Stats};
use train::Compiled;
use train::settings::Options as _;

use super::config::{GraphInit, SharedConfig, StagesConfig};
use super::continuous::start;
use super::deformer::{Deformed, Deformer, Run, Stage};
use super::single_view::SingleView;
use super::template::Template;
use crate::instance::Instance;
use crate::paired::{Pair, Pairs};

/// Chains of graph convolutions, each on the vertices of the one before and the midpoints of its edges.
#[derive(Clone, Debug)]
pub struct Staged {
    gcns: Vec<GraphBottleneck>,
    gconv: Option<ChebyshevConv>,
    config: StagesConfig,
}
impl_module!(Staged: f32 { gcns, gconv } fixed { config });

/// What first displacements are multiplied by; see [`OdeConfig::first_velocity`](super::OdeConfig::first_velocity).
const FIRST_DISPLACEMENT: f32 = 0.05;

/// Weights as the first version of Pixel2Mesh begins them.
fn glorot<M: Module<f32>>(module: &mut M, init: &Init) {
    module.visit_mut("", &mut |path: &str, param: &mut Param| {
        let shape = param.shape().to_vec();
        let at = init.at(path);
        *param = if shape.len() == 2 { at.xavier_uniform(&shape, 1.0) } else { at.zeros(&shape) };
    });
}

impl Deformer for Staged {
    const NAME: &'static str = "pixel2mesh";
    const PRESETS: &'static [(&'static str, &'static str)] = &[
        ("tiny", include_str!("presets/pixel2mesh/tiny.toml")),
        ("small", include_str!("presets/pixel2mesh/small.toml")),
        ("paper", include_str!("presets/pixel2mesh/paper.toml")),
        ("paper-table", include_str!("presets/pixel2mesh/paper-table.toml")),
        ("table", include_str!("presets/pixel2mesh/table.toml")),
        ("object", include_str!("presets/pixel2mesh/object.toml")),
        ("object-estimated", include_str!("presets/pixel2mesh/object-estimated.toml")),
    ];
    const ABOUT: &'static str = "One image to a mesh in three stages, learned from true surfaces";
    const TRAINING: &'static str =
        "`unsphere train pixel2mesh -o runs/mine` trains one on procedural airplanes";

    type Config = StagesConfig;

    #[inline(never)]
    fn compiled() -> Compiled<SingleView<Self>> {
        Compiled::here()
    }

    #[inline(never)]
    fn instance(system: &SingleView<Self>) -> &dyn Instance<Pairs, Pair> {
        system
    }

    fn shared(config: &StagesConfig) -> &SharedConfig {
        &config.shared
    }

    fn check(config: &StagesConfig) -> Vec<String> {
        let mut problems = config.out_of_range();
        problems.extend(config.shared.conflicts());
        problems
    }

    fn size(config: &StagesConfig) -> (usize, Vec<(String, String)>) {
        let row = |(stage, [inputs, hidden, outputs]): (usize, [usize; 3])| {
            let vertices = 2 + (156 - 2) * 4_usize.pow(stage as u32);
            let blocks = config.blocks;
            let shape =
                format!("[N, {vertices}, {inputs}] -> {hidden} x {blocks} blocks -> {outputs}");
            (format!("stage {}", stage + 1), shape)
        };
        let shapes = config.sizes().into_iter().enumerate().map(row).collect();
        (config.deformation_parameters(), shapes)
    }

    fn new(config: &StagesConfig, init: &Init, _: &Template) -> Self {
        let activation: Activation = config.shared.activation;
        let sizes = config.sizes();
        let at = init.at("gcns");
        let chain = |(i, size): (usize, &[usize; 3])| {
            GraphBottleneck::new(&at.index(i), config.blocks, *size, activation)
        };
        let mut gcns: Vec<GraphBottleneck> = sizes.iter().enumerate().map(chain).collect();
        let mut gconv = (sizes.len() > 1)
            .then(|| ChebyshevConv::new(&init.at("gconv"), config.last_columns(), 3));
        if config.graph_init == GraphInit::Glorot {
            for (i, gcn) in gcns.iter_mut().enumerate() {
                glorot(gcn, &at.index(i));
            }
            if let Some(conv) = &mut gconv {
                glorot(conv, &init.at("gconv"));
            }
        }
        if config.offsets {
            let ends = gcns.iter_mut().map(|gcn| &mut gcn.conv2);
            let last = gconv.iter_mut();
            let whole = ends.filter(|conv| conv.weight.shape()[1] == 3).chain(last);
            for conv in whole {
                for param in
                    [&mut conv.weight, &mut conv.loop_weight].into_iter().chain(&mut conv.bias)
                {
                    param.as_slice_mut().iter_mut().for_each(|x| *x *= FIRST_DISPLACEMENT);
                }
            }
        }
        Self { gcns, gconv, config: config.clone() }
    }

    fn deform<'t>(
        &self,
        template: &Template,
        inputs: &[Var<'t>],
        _: Run,
    ) -> Result<Deformed<'t>, SolveError> {
        let (camera, maps) = inputs.split_first().expect("a camera");
        let tape = camera.tape();
        let first = start(0, template, *camera);
        let (mut mesh, mut hidden) = (first, None);
        let (mut stages, mut sequence) = (Vec::new(), vec![first]);
        for (i, gcn) in self.gcns.iter().enumerate() {
            // Features are read on the coarser mesh; new vertices take the mean of their ends', as published.
            let points = project_points(mesh, *camera);
            let features = pool_features(maps, points, self.config.shared.sampling);
            let mut x = tape.concat(&[mesh, features], 2);
            let mut before = mesh;
            if let Some(hidden) = hidden {
                let up = template.levels[i - 1].unpool.as_ref().expect("a finer level");
                x = tape.concat(&[features, hidden, mesh], 2).sparse_matmul(up);
                before = mesh.sparse_matmul(up);
            }
            let graph = &template.levels[i].support;
            let (out, inside) = gcn.forward(x, graph);
            let last = i + 1 == self.gcns.len();
            let out = match &self.gconv {
                Some(gconv) if last => {
                    let activation = self.config.shared.activation;
                    gconv.forward(nets::activate(out, activation), graph)
                }
                _ => out,
            };
            mesh = if self.config.offsets { before + out } else { out };
            hidden = Some(inside);
            let (laplacian, displacement) =
                if i == 0 { (self.config.first_laplacian, 0.0) } else { (1.0, 1.0) };
            stages.push(Stage { level: i, positions: mesh, before, laplacian, displacement });
            sequence.push(mesh);
        }
        let steps = self.gcns.len();
        let stats = Stats { evaluations: steps, accepted: steps, ..Stats::default() };
        Ok(Deformed { stages, sequence, stats })
    }
}
