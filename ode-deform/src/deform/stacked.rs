//! A field whose weights change with the time, which reads the image through a few columns.

use autodiff_lite::{Activation, Param, Real, SparseMatrix, Tape, Var, impl_module};
use nets::{Init, MapSampling};

use super::field::{positions, project_points};
use super::reading::{add_readings, reduced_maps};
use crate::VectorField;

/// Numbers of an affine map of the space.
const AFFINE: usize = 12;

/// Sizes and choices of a [`StackedField`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StackedConfig {
    /// Channels of all feature maps together.
    pub features: usize,
    /// Columns that features are reduced to, once an image and the same at all times.
    pub feature_dim: usize,
    /// Segments of equal length from time 0 to 1, each with weights of its own. At least 1.
    pub segments: usize,
    /// Columns between the two graph convolutions.
    pub hidden: usize,
    /// Columns of the state beside the three of the position, as in [`FieldConfig`](super::FieldConfig).
    pub augment_dim: usize,
    /// What the second graph convolution's sums are multiplied by to be velocities. In `n` steps of `1 / n` a factor of
    /// `n` lets a change of the weights move vertices as far as it would in `n` residual blocks.
    pub output_scale: f64,
    /// After the first graph convolution.
    pub activation: Activation,
    /// How feature maps are read between their pixels.
    pub sampling: MapSampling,
}

impl StackedConfig {
    /// Columns of the state: the position, then the memory.
    pub fn state(&self) -> usize {
        3 + self.augment_dim
    }

    /// Parameters of the field.
    pub fn parameters(&self) -> usize {
        let conv = |sent: usize, kept: usize, outputs: usize| (sent + kept + 1) * outputs;
        let first = conv(self.state(), self.state() + self.feature_dim, self.hidden);
        let second = conv(self.hidden, self.hidden, self.state());
        self.features * (self.feature_dim + AFFINE) + self.segments * (first + second)
    }
}

/// `dM/dt = A(v) (v - v̄) + b(v) + GCN_k([v; R f(v)])` of the vertices `v` of a mesh, `k` the segment of the time.
///
/// - Two graph convolutions, with weights of their own in each segment, on features `f` that a matrix `R` reduces to a few
///   columns. What separate residual blocks have at a fraction of their parameters: most of a block's are for reading features, of
///   a vertex and of its neighbours. Here the matrix that reads is shared, and neighbours send their states alone, since
///   what they see differs little.
/// - An affine flow about the mean vertex `v̄`: `A` and `b` are linear in the features where a vertex is seen, by the same matrix at all times.
///   Coarse maps, which see the whole image, so turn, stretch and move the whole, fine ones its parts: products of image
///   and place that a network with few hidden columns is slow to learn.
///
/// States and inputs are those of a [`DeformationField`](super::DeformationField), but for what is made of the maps by
/// [`read`](Self::read).
///
/// At the ends of the segments the velocity jumps. Euler's and the midpoint method keep their order if their steps end there. A method with a stage
/// at the end of its step (Heun's, RK4, `bosh3`, `dopri5`, `tsit5`) reads the next segment's velocity there: of first order across each such end.
///
/// ```
/// use autodiff_lite::{Activation, SparseMatrix, Tape};
/// use nets::{Init, MapSampling};
/// use ode_deform::deform::{StackedConfig, StackedField};
/// use ode_deform::solve::{EULER, Problem, StepController};
/// use ode_deform::Adjoint;
///
/// let (activation, sampling) = (Activation::Relu, MapSampling::Bilinear);
/// let config = StackedConfig {
///     features: 5, feature_dim: 2, segments: 4, hidden: 8, augment_dim: 0, output_scale: 4.0, activation, sampling,
/// };
/// let graph = SparseMatrix::from_triplets(2, 2, &[(0, 1, 1.0), (1, 0, 1.0)])?;
/// let field = StackedField::<f32>::new(&Init::new(0), config, graph);
///
/// let tape = Tape::train(0);
/// let mesh = tape.leaf(ndarray::arr3(&[[[0.1, 0.0, -1.0], [0.0, 0.2, -1.0]]]));
/// let camera = ndarray::arr3(&[[[2.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]]]);
/// let mut inputs = vec![tape.constant(camera)];
/// inputs.extend(field.read(&[tape.leaf(ndarray::Array4::ones((1, 8, 8, 5)))]));
/// let problem = Problem::new([0.0, 1.0], &EULER, StepController::Fixed { step: 0.25 });
/// let flow = Adjoint::Checkpointed.integrate(&field, mesh, &inputs, &problem)?;
/// assert_eq!((flow.end.shape(), flow.stats.evaluations), (vec![1, 2, 3], 4));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # References
/// Massaroli et al. 2020, *Dissecting neural ODEs*: weights that depend on the depth, there called stacked where they are
/// constant by parts.
#[derive(Clone, Debug)]
pub struct StackedField<F: Real = f32> {
    /// `R`, `[features, feature_dim]`.
    pub reading: Param<F>,
    /// To the hidden columns. What stays at a vertex has rows of the state, then of what was read; what is sent, of the state.
    pub conv1: StackedConv<F>,
    /// To velocities.
    pub conv2: StackedConv<F>,
    /// `[features, 12]`, to the affine flow: the three columns of `A`, then `b`.
    pub affine: Param<F>,
    config: StackedConfig,
    graph: SparseMatrix<F>,
}
impl_module!(StackedField { reading, conv1, conv2, affine } fixed { config, graph });

/// Graph convolutions, one for each segment of the time: `y = x loop_weight + A s weight + bias` of what stays at a vertex
/// and what it sends; see [`ChebyshevConv`](nets::ChebyshevConv).
#[derive(Clone, Debug)]
pub struct StackedConv<F: Real = f32> {
    /// `[segments, in, out]`, for what arrives over the graph.
    pub weight: Param<F>,
    /// `[segments, in, out]`, for the vertex.
    pub loop_weight: Param<F>,
    /// `[segments, out]`.
    pub bias: Param<F>,
}
impl_module!(StackedConv { weight, loop_weight, bias });

impl<F: Real> StackedConv<F> {
    fn new(init: &Init, segments: usize, [sent, kept]: [usize; 2], outputs: usize) -> Self {
        let bound = 1.0 / (outputs.max(1) as f64).sqrt();
        let weight = |name: &str, shape: &[usize]| init.at(name).uniform(shape, -bound, bound);
        Self {
            weight: weight("weight", &[segments, sent, outputs]),
            loop_weight: weight("loop_weight", &[segments, kept, outputs]),
            bias: weight("bias", &[segments, outputs]),
        }
    }

    fn forward<'t>(
        &self,
        segment: usize,
        [sent, kept]: [Var<'t, F>; 2],
        graph: &SparseMatrix<F>,
        activation: Activation,
    ) -> Var<'t, F> {
        let tape = kept.tape();
        let of = |param: &Param<F>| one(param, segment, tape);
        let own = kept.matmul(of(&self.loop_weight));
        let across = sent.matmul(of(&self.weight));
        tape.concat(&[own, across], 2).graph_sum(graph, Some(of(&self.bias)), activation)
    }
}

/// One of the entries of a parameter's first axis.
fn one<'t, F: Real>(param: &Param<F>, index: usize, tape: &'t Tape<F>) -> Var<'t, F> {
    tape.param(param).slice_axis(0, index..index + 1).reshape(&param.shape()[1..])
}

impl<F: Real> StackedField<F> {
    /// On a graph `[V, V]`, for [`ChebyshevConv`](nets::ChebyshevConv).
    ///
    /// # Panics
    /// If the field would have no segment.
    #[track_caller]
    pub fn new(init: &Init, config: StackedConfig, graph: SparseMatrix<F>) -> Self {
        assert!(config.segments >= 1, "StackedField: no segments, expected 1 or more");
        let StackedConfig { features, feature_dim, segments, hidden, .. } = config;
        let (state, bound) = (config.state(), (3.0 / features.max(1) as f64).sqrt());
        let first = [state, state + feature_dim];
        Self {
            reading: init.at("reading").uniform(&[features, feature_dim], -bound, bound),
            conv1: StackedConv::new(&init.at("conv1"), segments, first, hidden),
            conv2: StackedConv::new(&init.at("conv2"), segments, [hidden, hidden], state),
            affine: init.at("affine").zeros(&[features, AFFINE]),
            config,
            graph,
        }
    }

    /// The maps reduced to the columns that an evaluation reads, its inputs behind the cameras.
    ///
    /// # Shapes
    /// `maps [N, H, W, C]` of any sizes, `ΣC` the field's features → `[N, H, W, feature_dim + 12]` each.
    ///
    /// # Panics
    /// If the maps have together another number of channels than the field takes.
    #[track_caller]
    pub fn read<'t>(&self, maps: &[Var<'t, F>]) -> Vec<Var<'t, F>> {
        reduced_maps(maps, self.config.features, |tape, rows| {
            let both = [&self.reading, &self.affine];
            tape.concat(&both.map(|of| tape.param(of).slice_axis(0, rows.clone())), 1)
        })
    }

    /// `A (v - mean v) + b` of all vertices, and no change of the memory: `[N, V, 3..]`. Each vertex has its own `[A b]`, column by column
    /// in `[N, V, 12]`.
    fn turned<'t>(&self, y: Var<'t, F>, affine: Var<'t, F>) -> Var<'t, F> {
        let ([n, v, _], tape) = (y.dims(), y.tape());
        let places = positions(y);
        let from_middle = places - places.mean_axis(1).reshape(&[n, 1, 3]);
        let column = |i: usize| affine.slice_axis(2, 3 * i..3 * i + 3);
        let turned =
            (0..3).fold(column(3), |sum, i| sum + column(i) * from_middle.slice_axis(2, i..i + 1));
        if self.config.augment_dim == 0 {
            return turned;
        }
        let nothing = tape.pool().filled(&[n, v, self.config.augment_dim], F::zero());
        tape.concat(&[turned, tape.constant(nothing)], 2)
    }

    /// What is read where vertices with states `[N, V, 3..]` are seen: `[N, V, feature_dim]`, and the affine flows there, `[N, V, 12]`.
    fn seen_by<'t>(
        &self,
        y: Var<'t, F>,
        camera: Var<'t, F>,
        maps: &[Var<'t, F>],
    ) -> [Var<'t, F>; 2] {
        let ([n, v, _], columns) = (y.dims(), self.config.feature_dim);
        let nothing = y.tape().pool().filled(&[n, v, columns + AFFINE], F::zero());
        let points = project_points(positions(y), camera);
        let seen = add_readings(y.tape().constant(nothing), maps, points, self.config.sampling);
        [seen.slice_axis(2, 0..columns), seen.slice_axis(2, columns..columns + AFFINE)]
    }

    /// The segment that a time is in. Sums of steps may end a rounding short of where one begins.
    fn segment(&self, t: f64) -> usize {
        let segments = self.config.segments;
        ((t * segments as f64 + 1e-9).max(0.0) as usize).min(segments - 1)
    }
}

impl<F: Real> VectorField<F> for StackedField<F> {
    #[track_caller]
    fn eval<'t>(&self, t: f64, y: Var<'t, F>, inputs: &[Var<'t, F>]) -> Var<'t, F> {
        let (graph, segment) = (&self.graph, self.segment(t));
        let [camera, maps @ ..] = inputs else {
            panic!("StackedField: no inputs, expected cameras and feature maps");
        };
        let [seen, affine] = self.seen_by(y, *camera, maps);
        let x = y.tape().concat(&[y, seen], 2);
        let hidden = self.conv1.forward(segment, [y, x], graph, self.config.activation);
        let sums = self.conv2.forward(segment, [hidden, hidden], graph, Activation::None);
        sums * F::from_f64(self.config.output_scale) + self.turned(y, affine)
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::{Module, testkit};
    use nets::{ChebyshevConv, pool_features};
    use proptest::prelude::*;

    use super::super::fixtures::{cameras, function, map, mesh, path, state};
    use super::*;
    use crate::Adjoint;
    use crate::solve::{EULER, Problem, StepController};

    fn field(segments: usize, augment_dim: usize, sampling: MapSampling) -> StackedField<f64> {
        let config = StackedConfig {
            features: 4,
            feature_dim: 3,
            segments,
            hidden: 6,
            augment_dim,
            output_scale: 2.0,
            activation: Activation::Tanh,
            sampling,
        };
        let mut field = StackedField::new(&Init::new(3), config, path(5));
        field.affine = Init::new(4).uniform(&[4, AFFINE], -0.5, 0.5);
        field
    }

    /// Cameras, then what the field makes of two maps.
    fn inputs<'t>(field: &StackedField<f64>, maps: &[Var<'t, f64>]) -> Vec<Var<'t, f64>> {
        let camera = maps[0].tape().constant(cameras());
        std::iter::once(camera).chain(field.read(maps)).collect()
    }

    fn velocity(field: &StackedField<f64>, t: f64) -> Vec<f64> {
        let tape = Tape::eval();
        let inputs = inputs(field, &[tape.constant(map(6, 3)), tape.constant(map(3, 1))]);
        let y = tape.constant(state(field.config.augment_dim));
        field.eval(t, y, &inputs).value().iter().copied().collect()
    }

    /// As two whole graph convolutions on features that are read first and reduced then, and an affine map.
    #[test]
    fn a_part_is_two_graph_convolutions_and_an_affine_flow() {
        for sampling in [MapSampling::Bilinear, MapSampling::Nearest, MapSampling::Centers] {
            let field = field(3, 1, sampling);
            let tape = Tape::<f64>::eval();
            let (y, maps) =
                (tape.constant(state(1)), [tape.constant(map(6, 3)), tape.constant(map(3, 1))]);
            let points = project_points(positions(y), tape.constant(cameras()));
            let features = pool_features(&maps, points, sampling);
            let x = tape.concat(&[y, features.matmul(tape.param(&field.reading))], 2);
            let of = |param: &Param<f64>| Param::new(one(param, 1, &tape).value().to_owned());
            let conv = |conv: &StackedConv<f64>| ChebyshevConv {
                weight: of(&conv.weight),
                loop_weight: of(&conv.loop_weight),
                bias: Some(of(&conv.bias)),
            };
            let mut first = conv(&field.conv1);
            // Nothing of what was read is sent.
            let mut sent = ndarray::Array2::<f64>::zeros((7, 6));
            let rows =
                first.weight.value.to_shape((4, 6)).expect("four columns of state").to_owned();
            sent.slice_mut(ndarray::s![..4, ..]).assign(&rows);
            first.weight = Param::new(sent);
            let hidden = first.forward_then(x, &field.graph, Activation::Tanh);
            let mut expected = (conv(&field.conv2).forward(hidden, &field.graph)
                * tape.constant(ndarray::arr1(&[2.0])))
            .value()
            .to_owned();
            let affine = features.matmul(tape.param(&field.affine)).value();
            for ((n, mesh), mut rows) in
                mesh().outer_iter().enumerate().zip(expected.outer_iter_mut())
            {
                let middle = mesh.mean_axis(ndarray::Axis(0)).expect("five vertices");
                for (v, (place, mut row)) in
                    mesh.outer_iter().zip(rows.outer_iter_mut()).enumerate()
                {
                    for i in 0..3 {
                        let entry = |k: usize| affine[[n, v, 3 * k + i]];
                        let turned = (0..3).map(|k| entry(k) * (place[k] - middle[k]));
                        row[i] += turned.sum::<f64>() + entry(3);
                    }
                }
            }
            for (a, b) in velocity(&field, 0.5).iter().zip(expected.iter()) {
                assert!((a - b).abs() < 1e-13, "{a} {b}");
            }
        }
    }

    #[test]
    fn parameters_are_as_many_as_the_sizes_say() {
        let field = field(3, 2, MapSampling::Bilinear);
        assert_eq!(field.parameter_count(), field.config.parameters());
    }

    proptest! {
        /// Within a segment the time does not matter, and times outside of 0 to 1 belong to the first and the last.
        #[test]
        fn weights_are_those_of_the_part(t in -0.5f64..1.5) {
            let field = field(4, 0, MapSampling::Bilinear);
            let middle = ((t * 4.0).floor().clamp(0.0, 3.0) + 0.5) / 4.0;
            prop_assert_eq!(velocity(&field, t), velocity(&field, middle));
        }
    }

    /// Eighths, tenths and thirds summed up: each step has the segment that it begins.
    #[test]
    fn sums_of_steps_meet_the_parts() {
        for segments in [3, 8, 10] {
            let field = field(segments, 0, MapSampling::Bilinear);
            let mut t = 0.0;
            for segment in 0..segments {
                assert_eq!(field.segment(t), segment, "{t}");
                t += 1.0 / segments as f64;
            }
        }
    }

    /// To where the mesh began and to the maps, through all segments.
    #[test]
    fn gradients_flow_through_all_parts() {
        let field = field(2, 0, MapSampling::Bilinear);
        let problem = Problem::new([0.0, 1.0], &EULER, StepController::Fixed { step: 0.5 });
        let integrated = function(|x| {
            let inputs = inputs(&field, &x[1..]);
            let flow = Adjoint::Checkpointed.integrate(&field, x[0], &inputs, &problem);
            flow.expect("two steps").end
        });
        let inputs = [mesh().into_dyn(), map(6, 3).into_dyn(), map(3, 1).into_dyn()];
        testkit::check(&integrated, &inputs, &testkit::Options::default()).expect("exact rules");
    }

    /// Direct recording is the reference; every entry of every segment is reached.
    #[test]
    fn every_parameter_gets_the_same_gradient_from_both_adjoints() {
        let field = field(4, 1, MapSampling::Bilinear);
        let problem = Problem::new([0.0, 1.0], &EULER, StepController::Fixed { step: 0.25 });
        let [direct, replayed] = [Adjoint::Direct, Adjoint::Checkpointed].map(|adjoint| {
            let tape = Tape::train(0);
            let inputs = inputs(&field, &[tape.constant(map(6, 4))]);
            let flow = adjoint.integrate(&field, tape.leaf(state(1)), &inputs, &problem);
            let gradients = flow.expect("four steps").end.square().sum().backward();
            let mut all = Vec::new();
            field.visit("", &mut |path: &str, param: &Param<f64>| {
                let gradient = gradients.slice_of(param).unwrap_or_default();
                let segments = if path.starts_with("conv") { 4 } else { 1 };
                for segment in gradient.chunks(gradient.len() / segments) {
                    assert!(segment.iter().any(|&g| g != 0.0), "{path}");
                }
                all.extend_from_slice(gradient);
            });
            all
        });
        assert_eq!(direct.len(), field.parameter_count());
        for (a, b) in direct.iter().zip(&replayed) {
            assert!((a - b).abs() < 1e-10 * a.abs().max(1.0), "{a} {b}");
        }
    }
}
