//! Integration: what a step costs beyond the field's evaluations, a step by each adjoint, and a whole training step.

use autodiff_lite::optim::Adam;
use autodiff_lite::{Activation, SparseMatrix, Tape, Tensor, Var, impl_module};
use benches::{criterion, numbers, pool, yardsticks};
use criterion::{BatchSize, Criterion};
use mesh_core::Topology;
use mesh_core::primitives::pixel2mesh_ellipsoid;
use ndarray::{Array2, ArrayD};
use nets::{Init, Mlp, Vgg16};
use ode_deform::deform::{DeformationField, FieldConfig};
use ode_deform::solve::{DOPRI5, EULER, Pid, Problem, StepController, Tolerance, solve};
use ode_deform::{Adjoint, field_fn};

const VERTICES: usize = 2466;
const STEPS: usize = 100;

fn vertices() -> Array2<f32> {
    Array2::from_shape_vec((VERTICES, 3), numbers(3 * VERTICES, 1)).expect("three numbers each")
}

/// A hundred steps whose field hands out a derivative that is there already: what is left is the solver.
fn overhead(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("ode");
    let step = 1.0 / STEPS as f64;
    // A tolerance that every step meets by far, and sizes kept at the first: as many steps, judged like any other.
    let tolerance = Tolerance { relative: 1e3, absolute: 1e3 };
    let pid = Pid { grow: 1.0, first: Some(step), ..Pid::new(tolerance) };
    for (name, tableau, control) in [
        ("dopri5-adaptive", &DOPRI5, StepController::Pid(pid)),
        ("dopri5-fixed", &DOPRI5, StepController::Fixed { step }),
        ("euler-fixed", &EULER, StepController::Fixed { step }),
    ] {
        let problem = Problem::new([0.0, 1.0], tableau, control);
        let derivative = vertices().into_shared();
        let start = vertices().into_shared();
        group.bench_function(format!("overhead/{name}/2466x3/{STEPS}-steps/1t"), |b| {
            b.iter(|| {
                let solution = solve(|_, _| derivative.clone(), start.clone(), &problem);
                let solution = solution.expect("a constant derivative");
                assert_eq!(solution.stats.accepted, STEPS);
                solution
            });
        });
    }
    // On a tape, as Checkpointed and Direct make their steps.
    let problem = Problem::new([0.0, 1.0], &DOPRI5, StepController::Pid(pid));
    let mut tape = Tape::eval();
    group.bench_function(format!("overhead/dopri5-adaptive-tape/2466x3/{STEPS}-steps/1t"), |b| {
        b.iter(|| {
            let (start, derivative) = (tape.constant(vertices()), tape.constant(vertices()));
            let end = solve(|_, _: &Var<'_>| derivative, start, &problem)
                .map(|solution| solution.end.value());
            drop(end);
            tape.reset();
        });
    });
    group.finish();
}

/// Eight Euler steps of a field 96 wide, forward and backward.
fn adjoints(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("ode");
    let mlp = Mlp::new(&Init::new(0), &[3, 96, 96, 3], Activation::Relu);
    let field = field_fn(mlp, |mlp: &Mlp, _, y: Var<'_>, _| mlp.forward(y));
    let problem = Problem::new([0.0, 1.0], &EULER, StepController::Fixed { step: 0.125 });
    let start: Tensor = ArrayD::from_shape_vec(vec![VERTICES, 3], numbers(3 * VERTICES, 1))
        .expect("three numbers each")
        .into();
    for adjoint in Adjoint::ALL {
        let mut tape = Tape::train(0);
        group.bench_function(
            format!("{adjoint:?}/8-euler-steps/2466x96/forward-backward/2t"),
            |b| {
                pool(2).install(|| {
                    b.iter_batched(
                        || start.clone(),
                        |start| {
                            let flow = adjoint.integrate(&field, tape.leaf(start), &[], &problem);
                            drop(flow.expect("tame").end.square().sum().backward());
                            tape.reset();
                        },
                        BatchSize::SmallInput,
                    );
                });
            },
        );
    }
    group.finish();
}

/// The networks of a whole training step.
struct Networks {
    encoder: Vgg16,
    field: DeformationField,
}
impl_module!(Networks: f32 { encoder, field });

/// A step of the deformation in continuous time at the published size: VGG16's maps of an image of 224 pixels, eight
/// Euler steps of 2,466 vertices over 1,408 features, losses, gradients, Adam.
#[expect(clippy::print_stdout, reason = "memory is no time, which is all that criterion reports")]
fn training(criterion: &mut Criterion) {
    const SIDE: usize = 224;
    let template = pixel2mesh_ellipsoid(2);
    let topology = Topology::new(VERTICES, &template.faces);
    let share = |v: usize| 1.0 / topology.vertex_vertices.row(v).len() as f32;
    let entries: Vec<(usize, usize, f32)> = (0..VERTICES)
        .flat_map(|v| {
            let row = topology.vertex_vertices.row(v).iter();
            row.map(move |&u| (v, u as usize, share(v))).collect::<Vec<_>>()
        })
        .collect();
    let graph = SparseMatrix::from_triplets(VERTICES, VERTICES, &entries).expect("vertices");
    let init = Init::new(0);
    let mut networks = Networks {
        encoder: Vgg16::features_until_pool(&init.at("encoder"), 5),
        field: DeformationField::new(&init.at("field"), FieldConfig::published(1408), graph),
    };
    let image = ArrayD::from_shape_vec(vec![1, SIDE, SIDE, 3], numbers(SIDE * SIDE * 3, 1));
    let image: Tensor = image.expect("three numbers a pixel").into();
    let truth = ArrayD::from_shape_vec(vec![1, 9000, 3], numbers(27_000, 2));
    let truth: Tensor = truth.expect("three numbers a point").into();
    let start =
        ArrayD::from_shape_vec(vec![1, VERTICES, 3], template.positions.as_flattened().to_vec());
    let start: Tensor = start.expect("three numbers a vertex").into();
    let rows = [2.2, 0.0, 0.0, 0.0, 0.0, 2.2, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0];
    let camera = ArrayD::from_shape_vec(vec![1, 3, 4], rows.to_vec()).expect("twelve numbers");
    let camera: Tensor = camera.into();
    let problem = Problem::new([0.0, 1.0], &EULER, StepController::Fixed { step: 0.125 });
    let (mut tape, mut adam) = (Tape::train(0), Adam::new(1e-5));
    let mut step = || {
        let gradients = {
            let maps = networks.encoder.forward_maps(tape.constant(image.clone()));
            let (field, maps) = networks.field.reduced(&maps[1..]);
            let mut inputs = vec![tape.constant(camera.clone())];
            inputs.extend(maps);
            let start = tape.constant(start.clone());
            let flow = Adjoint::Checkpointed.integrate(&field, start, &inputs, &problem);
            let mesh = flow.expect("eight steps").end;
            let chamfer = losses::chamfer(mesh, tape.constant(truth.clone()));
            let edge = losses::edge_length(mesh, &topology.edges, 0.0);
            (chamfer.scale(100.0) + edge.scale(0.1)).backward()
        };
        tape.reset();
        adam.step(&mut networks, &gradients);
        tape.pool().bytes()
    };
    let bytes = pool(2).install(&mut step);
    println!(
        "training step: {:.0} MB of buffers, parameters and moments besides",
        bytes as f64 / 1e6
    );
    let mut group = criterion.benchmark_group("ode");
    group.bench_function("training-step/vgg16-224/2466-vertices/8-euler-steps/2t", |b| {
        pool(2).install(|| b.iter(&mut step));
    });
    group.finish();
}

fn main() {
    let mut criterion = criterion();
    yardsticks(&mut criterion, "ode");
    overhead(&mut criterion);
    adjoints(&mut criterion);
    training(&mut criterion);
    criterion.final_summary();
}
