//! Deformation in continuous time, and the residual networks beside it.

use autodiff_lite::{Module, Param, Var, Visitor, VisitorMut, join_path};
use ndarray::Array3;
use nets::Init;
use ode_deform::VectorField;
use ode_deform::deform::{DeformationField, ResidualDeformation, StackedField, positions};
use ode_deform::solve::{Problem, SolveError, Stats};
use train::Compiled;
use train::settings::Options as _;

use super::config::{DeformationKind, OdeConfig, SharedConfig};
use super::deformer::{Deformed, Deformer, Run, Stage};
use super::single_view::SingleView;
use super::template::Template;
use crate::instance::Instance;
use crate::paired::{Pair, Pairs};

/// A field that is integrated from the ellipsoid to the shape, or separate residual blocks.
#[derive(Clone, Debug)]
pub struct Continuous {
    network: Network,
    config: OdeConfig,
}

/// What there is to train.
#[derive(Clone, Debug)]
enum Network {
    Field(Box<DeformationField>),
    Stacked(Box<StackedField>),
    Residual(ResidualDeformation),
}

impl Network {
    /// Its part of the paths of parameters.
    fn name(&self) -> &'static str {
        match self {
            Self::Field(_) | Self::Stacked(_) => "field",
            Self::Residual(_) => "residual",
        }
    }
}

impl Module<f32> for Continuous {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<f32>) {
        let path = join_path(path, self.network.name());
        match &self.network {
            Network::Field(field) => field.visit(&path, visitor),
            Network::Stacked(field) => field.visit(&path, visitor),
            Network::Residual(blocks) => blocks.visit(&path, visitor),
        }
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<f32>) {
        let path = join_path(path, self.network.name());
        match &mut self.network {
            Network::Field(field) => field.visit_mut(&path, visitor),
            Network::Stacked(field) => field.visit_mut(&path, visitor),
            Network::Residual(blocks) => blocks.visit_mut(&path, visitor),
        }
    }
}

/// Makes the first velocities small: the last layer's weights and biases.
fn calm<'a>(last: impl IntoIterator<Item = &'a mut Param>, factor: f64) {
    for param in last {
        param.as_slice_mut().iter_mut().for_each(|x| *x *= factor as f32);
    }
}

/// [`calm`] of the last layer of a field or a block.
fn calm_field(field: &mut DeformationField, factor: f64) {
    let conv = &mut field.conv2;
    calm([&mut conv.weight, &mut conv.loop_weight].into_iter().chain(&mut conv.bias), factor);
}

impl Continuous {
    /// Positions, and beside them a memory in which nothing is yet.
    fn remembering<'t>(&self, before: Var<'t>) -> Var<'t> {
        let [n, v, _] = before.dims();
        if self.config.augment_dim == 0 {
            return before;
        }
        let nothing = Array3::zeros((n, v, self.config.augment_dim));
        before.tape().concat(&[before, before.tape().constant(nothing)], 2)
    }

    /// What is solved: in training random where the schedule is.
    fn problem(&self, run: Run) -> Problem {
        match run {
            Run::Training { seed, step } => self.config.training_problem(seed, step),
            Run::Test => self.config.test_problem(),
            Run::Sequence { frames } => {
                let problem = self.config.test_problem();
                let [first, last] = problem.span;
                let time = |i: usize| first + (last - first) * i as f64 / (frames - 1) as f64;
                problem.save_at((0..frames).map(time))
            }
        }
    }

    /// The way of the ellipsoid `before` under a field whose maps are already as it reads them.
    fn flow<'t, V: VectorField>(
        &self,
        field: &V,
        before: Var<'t>,
        [camera, maps]: [&[Var<'t>]; 2],
        run: Run,
    ) -> Result<Flowed<'t>, SolveError> {
        let adjoint = self.config.adjoint;
        let inputs = [camera, maps].concat();
        let flow =
            adjoint.integrate(field, self.remembering(before), &inputs, &self.problem(run))?;
        let states = flow.states.into_iter().map(positions).collect();
        Ok((positions(flow.end), states, flow.stats))
    }
}

/// The mesh at the end, at the asked times, and how much work it was.
type Flowed<'t> = (Var<'t>, Vec<Var<'t>>, Stats);

impl Deformer for Continuous {
    const NAME: &'static str = "ode-pixel2mesh";
    const PRESETS: &'static [(&'static str, &'static str)] = &[
        ("tiny", include_str!("presets/ode-pixel2mesh/tiny.toml")),
        ("small", include_str!("presets/ode-pixel2mesh/small.toml")),
        ("paper", include_str!("presets/ode-pixel2mesh/paper.toml")),
        ("paper-table", include_str!("presets/ode-pixel2mesh/paper-table.toml")),
        ("paper-shallow", include_str!("presets/ode-pixel2mesh/paper-shallow.toml")),
        ("paper-shallow-table", include_str!("presets/ode-pixel2mesh/paper-shallow-table.toml")),
        ("paper-res-deep", include_str!("presets/ode-pixel2mesh/paper-res-deep.toml")),
        ("paper-res-deep-table", include_str!("presets/ode-pixel2mesh/paper-res-deep-table.toml")),
        ("paper-res-shallow", include_str!("presets/ode-pixel2mesh/paper-res-shallow.toml")),
        (
            "paper-res-shallow-table",
            include_str!("presets/ode-pixel2mesh/paper-res-shallow-table.toml"),
        ),
        ("table", include_str!("presets/ode-pixel2mesh/table.toml")),
        ("object", include_str!("presets/ode-pixel2mesh/object.toml")),
        ("object-estimated", include_str!("presets/ode-pixel2mesh/object-estimated.toml")),
    ];
    const ABOUT: &'static str =
        "One image to a mesh in continuous time, learned from true surfaces";
    const TRAINING: &'static str =
        "`unsphere train ode-pixel2mesh -o runs/mine` trains one on procedural airplanes";

    type Config = OdeConfig;

    #[inline(never)]
    fn compiled() -> Compiled<SingleView<Self>> {
        Compiled::here()
    }

    #[inline(never)]
    fn instance(system: &SingleView<Self>) -> &dyn Instance<Pairs, Pair> {
        system
    }

    fn shared(config: &OdeConfig) -> &SharedConfig {
        &config.shared
    }

    fn check(config: &OdeConfig) -> Vec<String> {
        let mut problems = config.out_of_range();
        problems.extend(config.conflicts());
        problems
    }

    fn size(config: &OdeConfig) -> (usize, Vec<(String, String)>) {
        let vertices = 2 + (156 - 2) * 4_usize.pow(config.shared.level);
        let field = config.field();
        let (what, inputs, layers) = match config.deformation {
            DeformationKind::Ode => {
                let inputs = field.state() + field.features + field.time;
                ("field, integrated".to_owned(), inputs, field.layers)
            }
            DeformationKind::Stacked => {
                let what = format!("stacked field of {} parts, integrated", config.segments);
                (what, field.state() + config.feature_dim, 2)
            }
            DeformationKind::Residual => {
                let what = format!("{} residual blocks", config.blocks);
                (what, field.state() + field.features, 2)
            }
        };
        let hidden = format!("{} -> ", config.shared.hidden).repeat(layers - 1);
        let conv = format!("[N, {vertices}, {inputs}] -> {hidden}{}", field.state());
        (config.deformation_parameters(), vec![(what, conv)])
    }

    fn new(config: &OdeConfig, init: &Init, template: &Template) -> Self {
        let (graph, first) = (&template.finest().support, config.first_velocity);
        let network = match config.deformation {
            DeformationKind::Ode => {
                let mut field =
                    DeformationField::new(&init.at("field"), config.field(), graph.clone());
                calm_field(&mut field, first);
                Network::Field(Box::new(field))
            }
            DeformationKind::Stacked => {
                let mut field =
                    StackedField::new(&init.at("field"), config.stacked(), graph.clone());
                let conv = &mut field.conv2;
                let last = [&mut conv.weight, &mut conv.loop_weight, &mut conv.bias];
                calm(last, first / config.output_scale);
                Network::Stacked(Box::new(field))
            }
            DeformationKind::Residual => {
                let at = init.at("residual");
                let mut all = ResidualDeformation::new(&at, config.blocks, config.field(), graph);
                // Together they move as far at first as the field does in a unit of time.
                let factor = first / config.blocks as f64;
                all.blocks.iter_mut().for_each(|block| calm_field(block, factor));
                Network::Residual(all)
            }
        };
        Self { network, config: config.clone() }
    }

    fn deform<'t>(
        &self,
        template: &Template,
        inputs: &[Var<'t>],
        run: Run,
    ) -> Result<Deformed<'t>, SolveError> {
        let (camera, maps) = inputs.split_at(1);
        let before = start(template.levels.len() - 1, template, camera[0]);
        let (positions, sequence, stats) = match &self.network {
            Network::Field(field) => {
                let (field, maps) = field.reduced(maps);
                self.flow(&field, before, [camera, &maps], run)?
            }
            Network::Stacked(field) => {
                self.flow(field.as_ref(), before, [camera, &field.read(maps)], run)?
            }
            Network::Residual(blocks) => {
                let meshes = blocks.forward(before, inputs);
                let steps = blocks.blocks.len();
                let stats = Stats { evaluations: steps, accepted: steps, ..Stats::default() };
                (*meshes.last().expect("the start"), meshes, stats)
            }
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
