//! Deformation in continuous time, and the residual networks beside it.

use autodiff_lite::{Var, impl_module};
use ndarray::Array3;
use nets::Init;
use ode_deform::Adjoint;
use ode_deform::deform::{DeformationField, ResidualDeformation, positions};
use ode_deform::solve::{SolveError, Stats};

use super::config::{DeformationKind, OdeConfig, SharedConfig};
use super::deformer::{Deformed, Deformer, Run, Stage};
use super::template::Template;

/// A field that is integrated from the ellipsoid to the shape, or separate residual blocks.
#[derive(Clone, Debug)]
pub struct Continuous {
    field: Option<DeformationField>,
    residual: Option<ResidualDeformation>,
    config: OdeConfig,
}
impl_module!(Continuous: f32 { field, residual } fixed { config });

impl Continuous {
    /// Makes the first velocities small: the last layer's weights and biases.
    fn calm(field: &mut DeformationField, factor: f64) {
        let conv = &mut field.conv2;
        for param in [&mut conv.weight, &mut conv.loop_weight].into_iter().chain(&mut conv.bias) {
            param.as_slice_mut().iter_mut().for_each(|x| *x *= factor as f32);
        }
    }
}

impl Continuous {
    /// Positions, and beside them a memory in which nothing is yet.
    fn remembering<'t>(&self, before: Var<'t>) -> Var<'t> {
        let [n, v, _] = before.dims();
        if self.config.memory == 0 {
            return before;
        }
        let nothing = Array3::zeros((n, v, self.config.memory));
        before.tape().concat(&[before, before.tape().constant(nothing)], 2)
    }
}

impl Deformer for Continuous {
    const NAME: &'static str = "ode-pixel2mesh";
    const PRESETS: &'static [(&'static str, &'static str)] = &[
        ("tiny", include_str!("../../presets/ode-pixel2mesh/tiny.toml")),
        ("small", include_str!("../../presets/ode-pixel2mesh/small.toml")),
        ("paper", include_str!("../../presets/ode-pixel2mesh/paper.toml")),
        ("table", include_str!("../../presets/ode-pixel2mesh/table.toml")),
    ];
    const TRAINING: &'static str =
        "`unsphere train ode-pixel2mesh -o runs/mine` trains one on procedural airplanes";

    type Config = OdeConfig;

    fn shared(config: &OdeConfig) -> &SharedConfig {
        &config.shared
    }

    fn check(config: &OdeConfig) -> Vec<String> {
        config.check()
    }

    fn size(config: &OdeConfig) -> (usize, Vec<(String, String)>) {
        let field = config.field();
        let vertices = 2 + (156 - 2) * 4_usize.pow(config.shared.level);
        let inputs = field.state() + field.features + field.time;
        let what = match config.deformation {
            DeformationKind::Ode => "field, integrated".to_owned(),
            DeformationKind::Residual => format!("{} residual blocks", config.blocks),
        };
        let hidden = format!("{} -> ", field.hidden).repeat(field.layers - 1);
        let conv = format!("[N, {vertices}, {inputs}] -> {hidden}{}", field.state());
        (config.deformation_parameters(), vec![(what, conv)])
    }

    fn new(config: &OdeConfig, init: &Init, template: &Template) -> Self {
        let graph = &template.finest().support;
        let (mut field, mut residual) = (None, None);
        match config.deformation {
            DeformationKind::Ode => {
                let mut one =
                    DeformationField::new(&init.at("field"), config.field(), graph.clone());
                Self::calm(&mut one, config.first_velocity);
                field = Some(one);
            }
            DeformationKind::Residual => {
                let at = init.at("residual");
                let mut all = ResidualDeformation::new(&at, config.blocks, config.field(), graph);
                // Together they move as far at first as the field does in a unit of time.
                let factor = config.first_velocity / config.blocks as f64;
                all.blocks.iter_mut().for_each(|block| Self::calm(block, factor));
                residual = Some(all);
            }
        }
        Self { field, residual, config: config.clone() }
    }

    fn deform<'t>(
        &self,
        template: &Template,
        inputs: &[Var<'t>],
        run: Run,
    ) -> Result<Deformed<'t>, SolveError> {
        let (camera, maps) = inputs.split_first().expect("a camera");
        let before = start(template.levels.len() - 1, template, *camera);
        let (positions, sequence, stats) = if let Some(field) = &self.field {
            let mut problem = match run {
                Run::Training { seed, step } => self.config.training_problem(seed, step),
                Run::Test | Run::Sequence { .. } => self.config.test_problem(),
            };
            if let Run::Sequence { frames } = run {
                let [first, last] = problem.span;
                let time = |i: usize| first + (last - first) * i as f64 / (frames - 1) as f64;
                problem = problem.asking((0..frames).map(time));
            }
            let (field, maps) = field.reduced(maps);
            let inputs: Vec<Var<'t>> = std::iter::once(*camera).chain(maps).collect();
            let adjoint: Adjoint = self.config.adjoint.into();
            let flow = adjoint.integrate(&field, self.remembering(before), &inputs, &problem)?;
            let states = flow.states.into_iter().map(positions).collect();
            (positions(flow.end), states, flow.stats)
        } else {
            let blocks = self.residual.as_ref().expect("a field or blocks");
            let meshes = blocks.forward(before, inputs);
            let steps = blocks.blocks.len();
            let stats = Stats { evaluations: steps, accepted: steps, ..Stats::default() };
            (*meshes.last().expect("the start"), meshes, stats)
        };
        let level = template.levels.len() - 1;
        let stage = Stage { level, positions, before, laplacian: 1.0, displacement: 1.0 };
        Ok(Deformed { stages: vec![stage], sequence, stats })
    }
}

/// The template's vertices once for each camera of `[N, 3, 4]`: `[N, V, 3]`.
pub(super) fn start<'t>(level: usize, template: &Template, camera: Var<'t>) -> Var<'t> {
    let (n, tape) = (camera.shape()[0], camera.tape());
    let positions = &template.levels[level].mesh.positions;
    let one = positions.as_flattened();
    crate::stacked::stacked(tape, std::iter::repeat_n(one, n), &[n, positions.len(), 3])
}
