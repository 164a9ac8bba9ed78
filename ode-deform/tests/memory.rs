//! Memory of a training step against the number of evaluations: flat by replaying, linear by recording.
#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::testkit::CountingAllocator;
use autodiff_lite::{Activation, Tape, Tensor, Var};
use ndarray::ArrayD;
use nets::{Init, Mlp};
use ode_deform::solve::{EULER, Problem, StepController};
use ode_deform::{Adjoint, VectorField, field_fn};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator::new();

/// As much wider inside than its state as a graph network over 1,408 features is.
fn field() -> impl VectorField {
    let mlp = Mlp::<f32>::new(&Init::new(0), &[3, 96, 96, 3], Activation::Tanh);
    field_fn(mlp, |mlp: &Mlp, t, y: Var<'_>, _| mlp.forward(y).scale(1.0 - 0.5 * t as f32))
}

/// Peak bytes of a step on a new tape, and large blocks taken by the third step on it.
fn step(adjoint: Adjoint, evaluations: usize) -> (usize, usize) {
    let control = StepController::Fixed { step: 1.0 / evaluations as f64 };
    let problem = Problem::new([0.0, 1.0], &EULER, control);
    let vertices: Tensor = ArrayD::zeros(vec![618, 3]).into();
    let field = field();
    let mut tape = Tape::train(0);
    let mut run = || {
        let start = tape.leaf(vertices.clone());
        let flow = adjoint.integrate(&field, start, &[], &problem).unwrap();
        assert_eq!(flow.stats.evaluations, evaluations);
        drop(flow.end.square().sum().backward());
        tape.reset();
    };
    let before = ALLOCATOR.bytes();
    ALLOCATOR.take_peak();
    let held = ALLOCATOR.take_peak();
    run();
    let peak = ALLOCATOR.take_peak() - held;
    assert!(ALLOCATOR.bytes() > before);
    run();
    let before = ALLOCATOR.blocks();
    run();
    (peak, ALLOCATOR.blocks() - before)
}

/// One test, because the counter is that of the whole program.
#[test]
fn replaying_is_flat_and_recording_linear() {
    let all = [4, 8, 16, 32, 64];
    let flat = all.map(|n| step(Adjoint::Checkpointed, n).0);
    let linear = all.map(|n| step(Adjoint::Direct, n).0);
    let back = all.map(|n| step(Adjoint::Backsolve, n).0);
    let ratio = |peaks: &[usize; 5]| peaks[4] as f64 / peaks[0] as f64;
    assert!(ratio(&flat) < 1.10, "{flat:?}");
    assert!(ratio(&back) < 1.10, "{back:?}");
    assert!((8.0..17.0).contains(&ratio(&linear)), "{linear:?}");
    // The third step takes only what the gemm crate packs: for each evaluation on the way there one buffer a product at
    // most, on the way back three.
    for adjoint in [Adjoint::Checkpointed, Adjoint::Direct] {
        let blocks = step(adjoint, 16).1;
        assert!(blocks <= 16 * 3 * 5, "{adjoint:?}: {blocks} large blocks");
    }
}
