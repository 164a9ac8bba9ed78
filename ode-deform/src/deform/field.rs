//! The velocity of vertices, from where they are, what the image shows there, and the time.

use autodiff_lite::{Activation, GraphWeights, Param, Real, SparseMatrix, Tape, Var, impl_module};
use ndarray::ArrayD;
use nets::{ChebyshevConv, Init, MapSampling, pool_features};

use crate::VectorField;

/// Sizes and choices of a [`DeformationField`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldConfig {
    /// Channels of all feature maps together.
    pub features: usize,
    /// Columns in which the time is repeated. Published: 196; 1 says the same, and with 0 the field does not know it.
    pub time: usize,
    /// Columns between graph convolutions.
    pub hidden: usize,
    /// Columns of the state beside the three of the position, which begin at 0 and flow with it: what a vertex
    /// remembers of its way (Dupont et al. 2019, *Augmented neural ODEs*). Published: 0.
    pub augment_dim: usize,
    /// Graph convolutions, at least 2, as published: how far a vertex sees along edges at an evaluation.
    pub layers: usize,
    /// After all of them but the last. The paper states none, and the code that it started from has none.
    pub activation: Activation,
    /// How feature maps are read between their pixels.
    pub sampling: MapSampling,
}

impl FieldConfig {
    /// As published, on maps of together `features` channels: 196 columns of time, 192 hidden ones.
    /// With a ReLU, without which each evaluation is affine in its features.
    pub fn published(features: usize) -> Self {
        let (time, hidden, augment_dim, layers) = (196, 192, 0, 2);
        let (activation, sampling) = (Activation::Relu, MapSampling::Bilinear);
        Self { features, time, hidden, augment_dim, layers, activation, sampling }
    }

    /// Parameters of the field.
    pub fn parameters(&self) -> usize {
        let conv = |inputs: usize, outputs: usize| 2 * inputs * outputs + outputs;
        let inner = self.layers.saturating_sub(2) * conv(self.hidden, self.hidden);
        conv(self.state() + self.features + self.time, self.hidden)
            + inner
            + conv(self.hidden, self.state())
    }

    /// Columns of the state: the position, then the memory.
    pub fn state(&self) -> usize {
        3 + self.augment_dim
    }
}

/// `dM/dt = GCN([v; f(v); t 1ᵀ])` of the vertices `v` of a mesh; published are two graph convolutions.
///
/// The state is `[N, V, 3]` in the world of the cameras, with more columns where the field has a memory. Inputs are first the cameras `[N, 3, 4]` (a world's point to
/// normalised device coordinates, y up), then feature maps `[N, H, W, C]` of any sizes; features are read anew at every
/// evaluation, where the vertices then are. The graph is constant: the same vertices and edges from sphere to shape.
///
/// ```
/// use autodiff_lite::{SparseMatrix, Tape};
/// use nets::Init;
/// use ode_deform::deform::{DeformationField, FieldConfig};
/// use ode_deform::solve::{HEUN, Problem, StepController};
/// use ode_deform::Adjoint;
///
/// let edges = [(0, 1, 0.5), (1, 0, 0.5), (1, 2, 0.5), (2, 1, 0.5)];
/// let graph = SparseMatrix::from_triplets(3, 3, &edges)?;
/// let config = FieldConfig { hidden: 8, time: 1, ..FieldConfig::published(5) };
/// let field = DeformationField::<f32>::new(&Init::new(0), config, graph);
///
/// let tape = Tape::train(0);
/// let mesh = tape.leaf(ndarray::arr3(&[[[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.3]]]));
/// let camera = ndarray::arr3(&[[[2.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, -1.0, 2.0]]]);
/// let maps = tape.leaf(ndarray::Array4::ones((1, 8, 8, 5)));
/// let problem = Problem::new([0.0, 1.0], &HEUN, StepController::Fixed { step: 0.25 });
/// let flow = Adjoint::Checkpointed.integrate(&field, mesh, &[tape.constant(camera), maps], &problem)?;
/// assert_eq!((flow.end.shape(), flow.stats.evaluations), (vec![1, 3, 3], 8));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # References
/// The paper on neural ODEs for Pixel2Mesh, equations 1 to 3; Chen et al. 2018, *Neural ordinary differential equations*.
#[derive(Clone, Debug)]
pub struct DeformationField<F: Real = f32> {
    /// To the hidden columns: rows of the state, then of features, then of the time.
    pub conv1: ChebyshevConv<F>,
    /// Between hidden columns, where the field has more than two layers.
    pub inner: Vec<ChebyshevConv<F>>,
    /// To velocities.
    pub conv2: ChebyshevConv<F>,
    pub(super) config: FieldConfig,
    pub(super) graph: SparseMatrix<F>,
}
impl_module!(DeformationField { conv1, inner, conv2 } fixed { config, graph });

impl<F: Real> DeformationField<F> {
    /// On a graph `[V, V]`, for [`ChebyshevConv`].
    ///
    /// # Panics
    /// If the field would have fewer than two layers.
    #[track_caller]
    pub fn new(init: &Init, config: FieldConfig, graph: SparseMatrix<F>) -> Self {
        assert!(
            config.layers >= 2,
            "DeformationField: {} layers, expected 2 or more",
            config.layers
        );
        let (inputs, hidden) = (config.state() + config.features + config.time, config.hidden);
        let at = init.at("inner");
        let inner = |i| ChebyshevConv::new(&at.index(i), hidden, hidden);
        Self {
            conv1: ChebyshevConv::new(&init.at("conv1"), inputs, hidden),
            inner: (0..config.layers - 2).map(inner).collect(),
            conv2: ChebyshevConv::new(&init.at("conv2"), hidden, config.state()),
            config,
            graph,
        }
    }

    /// Velocities of what the first layer made: the layers behind it.
    pub(super) fn velocities<'t>(&self, hidden: Var<'t, F>) -> Var<'t, F> {
        let inner = self
            .inner
            .iter()
            .fold(hidden, |x, conv| conv.forward_then(x, &self.graph, self.config.activation));
        self.conv2.forward(inner, &self.graph)
    }

    /// Features of vertices with states `[N, V, 3..]` where they are seen: `[N, V, C]`.
    #[track_caller]
    fn pooled<'t>(&self, y: Var<'t, F>, inputs: &[Var<'t, F>]) -> Var<'t, F> {
        let (points, maps) = seen(y, inputs);
        pool_features(maps, points, self.config.sampling)
    }

    /// The first layer's matrix with the rows of the time, which multiply the same number, summed.
    fn folded<'t>(&self, weight: &Param<F>, tape: &'t Tape<F>) -> Var<'t, F> {
        let (weight, rest) = (tape.param(weight), self.config.state() + self.config.features);
        let features = weight.slice_axis(0, 0..rest);
        match self.time_row(weight) {
            Some(time) => tape.concat(&[features, time], 0),
            None => features,
        }
    }

    /// The sum `[1, hidden]` of the first layer's rows of the time, which multiply the same number.
    pub(super) fn time_row<'t>(&self, weight: Var<'t, F>) -> Option<Var<'t, F>> {
        let (rest, time) = (self.config.state() + self.config.features, self.config.time);
        (time > 0).then(|| {
            weight.slice_axis(0, rest..rest + time).sum_axis(0).reshape(&[1, self.config.hidden])
        })
    }

    /// The time beside each vertex, `[N, V, 1]`; none where the field is not told it.
    pub(super) fn time_column<'t>(&self, t: f64, y: Var<'t, F>) -> Option<Var<'t, F>> {
        let [n, v, _] = y.dims();
        let column = || y.tape().pool().filled(&[n, v, 1], F::from_f64(t));
        (self.config.time > 0).then(|| y.tape().constant(column()))
    }
}

/// Where vertices are seen in the image, y down as maps count their rows, and the maps.
#[track_caller]
pub(super) fn seen<'a, 't, F: Real>(
    y: Var<'t, F>,
    inputs: &'a [Var<'t, F>],
) -> (Var<'t, F>, &'a [Var<'t, F>]) {
    let [camera, maps @ ..] = inputs else {
        panic!("DeformationField: no inputs, expected cameras and feature maps");
    };
    (project_points(positions(y), *camera), maps)
}

/// The positions within states.
///
/// # Shapes
/// `y [N, V, D]`, `D` at least 3 → `[N, V, 3]`.
pub fn positions<F: Real>(y: Var<'_, F>) -> Var<'_, F> {
    let [_, _, columns] = y.dims();
    if columns == 3 { y } else { y.slice_axis(2, 0..3) }
}

/// Where points are seen by cameras, as [`pool_features`] counts.
///
/// # Shapes
/// `points [N, V, 3]`, `cameras [N, 3, 4]` → `[N, V, 2]`, x to the right and y **down**, -1 to 1.
#[track_caller]
pub fn project_points<'t, F: Real>(points: Var<'t, F>, cameras: Var<'t, F>) -> Var<'t, F> {
    let (one, down) = (F::from_f64(1.0), F::from_f64(-1.0));
    let flip = ArrayD::from_shape_vec(vec![2], vec![one, down]).expect("two");
    points.project(cameras).slice_axis(2, 0..2) * points.tape().constant(flip)
}

impl<F: Real> VectorField<F> for DeformationField<F> {
    #[track_caller]
    fn eval<'t>(&self, t: f64, y: Var<'t, F>, inputs: &[Var<'t, F>]) -> Var<'t, F> {
        let tape = y.tape();
        let mut parts = vec![y, self.pooled(y, inputs)];
        parts.extend(self.time_column(t, y));
        let x = tape.concat(&parts, 2);
        let weights = GraphWeights {
            own: self.folded(&self.conv1.loop_weight, tape),
            across: self.folded(&self.conv1.weight, tape),
            output_first: false,
            bias: self.conv1.bias.as_ref().map(|bias| tape.param(bias)),
            across_bias: None,
        };
        let hidden = x.graph_conv(&self.graph, &weights, self.config.activation);
        self.velocities(hidden)
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::{Module, Tape, testkit};
    use ndarray::Array3;

    use super::super::fixtures::{cameras, function, map, mesh, path, state};
    use super::*;
    use crate::Adjoint;
    use crate::solve::{EULER, MIDPOINT, Problem, StepController};

    fn field(time: usize) -> DeformationField<f64> {
        field_of(time, 2, 0)
    }

    fn field_of(time: usize, layers: usize, augment_dim: usize) -> DeformationField<f64> {
        let config = FieldConfig {
            time,
            layers,
            augment_dim,
            hidden: 6,
            activation: Activation::Tanh,
            ..FieldConfig::published(4)
        };
        DeformationField::new(&Init::new(3), config, path(5))
    }

    #[test]
    fn parameters_are_as_many_as_published_say() {
        let config = FieldConfig::published(960);
        let field = DeformationField::<f32>::new(
            &Init::new(0),
            config,
            SparseMatrix::from_triplets(1, 1, &[]).expect("none"),
        );
        assert_eq!(field.parameter_count(), config.parameters());
        assert_eq!(config.parameters(), 2 * 1159 * 192 + 192 + 2 * 192 * 3 + 3);
        let field = field_of(3, 4, 2);
        assert_eq!(field.parameter_count(), field.config.parameters());
    }

    /// Folding the repeated time gives what the repeated columns give.
    #[test]
    fn the_repeated_time_is_one_column() {
        let field = field(7);
        let tape = Tape::eval();
        let (y, t) = (tape.constant(mesh()), 0.6);
        let inputs = [tape.constant(cameras()), tape.constant(map(6, 4))];
        let found = field.eval(t, y, &inputs).value();
        let times = tape.constant(Array3::from_elem((2, 5, 7), t));
        let x = tape.concat(&[y, field.pooled(y, &inputs), times], 2);
        let hidden = field.conv1.forward_then(x, &field.graph, Activation::Tanh);
        let expected = field.conv2.forward(hidden, &field.graph).value();
        for (a, b) in found.iter().zip(expected.iter()) {
            assert!((a - b).abs() < 1e-13, "{a} {b}");
        }
    }

    /// To rounding, with and without the time, whichever way maps are read; and the gradients are the same.
    #[test]
    fn maps_reduced_beforehand_give_the_same() {
        for (time, layers, augment_dim, sampling) in [
            (3, 2, 0, MapSampling::Bilinear),
            (0, 3, 2, MapSampling::Bilinear),
            (2, 2, 1, MapSampling::Nearest),
            (1, 2, 0, MapSampling::Corners),
            (0, 2, 0, MapSampling::Truncated),
            (1, 4, 0, MapSampling::Centers),
        ] {
            let mut field = field_of(time, layers, augment_dim);
            field.config.sampling = sampling;
            let problem = Problem::new([0.0, 1.0], &MIDPOINT, StepController::Fixed { step: 0.4 });
            let found = [false, true].map(|reduce| {
                let tape = Tape::train(0);
                let (start, maps) =
                    (tape.leaf(state(augment_dim)), [tape.leaf(map(6, 3)), tape.leaf(map(3, 1))]);
                let camera = tape.constant(cameras());
                let end = if reduce {
                    let (field, maps) = field.reduced(&maps);
                    let inputs = [camera, maps[0], maps[1]];
                    Adjoint::Checkpointed.integrate(&field, start, &inputs, &problem)
                } else {
                    let inputs = [camera, maps[0], maps[1]];
                    Adjoint::Checkpointed.integrate(&field, start, &inputs, &problem)
                };
                let end = end.expect("three steps").end;
                let gradients = end.square().sum().backward();
                let mut all: Vec<f64> = end.value().iter().copied().collect();
                for var in [start, maps[0], maps[1]] {
                    all.extend(gradients.wrt(var).expect("wanted").iter());
                }
                field.visit("", &mut |_: &str, param: &Param<f64>| {
                    all.extend_from_slice(gradients.slice_of(param).unwrap_or_default());
                });
                all
            });
            assert!(found[0].len() > 200 && found[0].len() == found[1].len());
            for (a, b) in found[0].iter().zip(&found[1]) {
                assert!((a - b).abs() < 1e-11 * a.abs().max(1.0), "{a} {b}");
            }
        }
    }

    /// To where the mesh began, to the maps and to the parameters, through two steps.
    #[test]
    fn gradients_flow_through_pooling_and_time() {
        let field = field(3);
        let problem = Problem::new([0.0, 1.0], &MIDPOINT, StepController::Fixed { step: 0.5 });
        let integrated = function(|x| {
            let camera = x[0].tape().constant(cameras());
            let flow =
                Adjoint::Checkpointed.integrate(&field, x[0], &[camera, x[1], x[2]], &problem);
            flow.expect("two steps").end
        });
        let inputs = [mesh().into_dyn(), map(6, 3).into_dyn(), map(3, 1).into_dyn()];
        testkit::check(&integrated, &inputs, &testkit::Options::default()).expect("exact rules");
    }

    #[test]
    fn every_parameter_gets_the_same_gradient_from_both_adjoints() {
        let field = field_of(3, 3, 0);
        let problem = Problem::new([0.0, 1.0], &EULER, StepController::Fixed { step: 0.2 });
        let gradients = [Adjoint::Direct, Adjoint::Checkpointed].map(|adjoint| {
            let tape = Tape::train(0);
            let inputs = [tape.constant(cameras()), tape.constant(map(6, 4))];
            let flow = adjoint.integrate(&field, tape.leaf(mesh()), &inputs, &problem);
            let gradients = flow.expect("five steps").end.square().sum().backward();
            let mut all = Vec::new();
            field.visit("", &mut |path: &str, param: &Param<f64>| {
                let gradient = gradients.slice_of(param).unwrap_or_default();
                assert!(gradient.iter().any(|&g| g != 0.0), "{path}");
                all.extend_from_slice(gradient);
            });
            all
        });
        for (a, b) in gradients[0].iter().zip(&gradients[1]) {
            assert!((a - b).abs() < 1e-10 * a.abs().max(1.0), "{a} {b}");
        }
    }
}
