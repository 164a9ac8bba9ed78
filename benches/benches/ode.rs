//! Integration: what a step costs beyond the field's evaluations, and a training step by each adjoint.

use autodiff_lite::{Activation, Tape, Tensor, Var};
use benches::{criterion, numbers, pool};
use criterion::{BatchSize, Criterion};
use ndarray::{Array2, ArrayD};
use nets::{Init, Mlp};
use ode_deform::solve::{DOPRI5, EULER, Pid, Problem, StepController, Tolerance, solve};
use ode_deform::{Adjoint, field_fn};

const VERTICES: usize = 2466;
const STEPS: usize = 100;

fn vertices() -> Array2<f32> {
    Array2::from_shape_vec((VERTICES, 3), numbers(3 * VERTICES, 1)).expect("three numbers each")
}

/// A hundred steps whose field hands out a slope that is there already: what is left is the solver.
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
        let slope = vertices().into_shared();
        let start = vertices().into_shared();
        group.bench_function(format!("overhead/{name}/2466x3/{STEPS}-steps/1t"), |b| {
            b.iter(|| {
                let solution = solve(|_, _| slope.clone(), start.clone(), &problem);
                let solution = solution.expect("a constant slope");
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
            let (start, slope) = (tape.constant(vertices()), tape.constant(vertices()));
            let end =
                solve(|_, _: &Var<'_>| slope, start, &problem).map(|solution| solution.end.value());
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
        .into_shared();
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

fn main() {
    let mut criterion = criterion();
    overhead(&mut criterion);
    adjoints(&mut criterion);
    criterion.final_summary();
}
