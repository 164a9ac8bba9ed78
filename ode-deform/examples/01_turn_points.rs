//! Learns a flow that turns points by a right angle, and prints what each way to the gradient costs.
#![allow(clippy::print_stdout, reason = "an example")]

use std::time::Instant;

use autodiff_lite::optim::Adam;
use autodiff_lite::{Activation, Tape, Var};
use ndarray::Array2;
use nets::{Init, Mlp};
use ode_deform::solve::{DOPRI5, Problem, SolveError, StepController};
use ode_deform::{Adjoint, field_fn};

fn main() -> Result<(), SolveError> {
    let points = Array2::from_shape_fn((64, 2), |(i, j)| {
        let angle = i as f32 * 0.1;
        if j == 0 { angle.cos() } else { angle.sin() }
    });
    let turned =
        Array2::from_shape_fn(
            (64, 2),
            |(i, j)| {
                if j == 0 { -points[[i, 1]] } else { points[[i, 0]] }
            },
        );
    let problem = Problem::new([0.0, 1.0], &DOPRI5, StepController::adaptive(1e-3, 1e-3));
    for adjoint in Adjoint::ALL {
        let mlp = Mlp::new(&Init::new(0), &[2, 32, 2], Activation::Tanh);
        let mut field = field_fn(mlp, |mlp: &Mlp, _, y: Var<'_>, _| mlp.forward(y));
        let (mut tape, mut adam) = (Tape::train(0), Adam::new(0.01));
        let (began, mut evaluations, mut last) = (Instant::now(), 0, 0.0);
        for _ in 0..200 {
            let start = tape.constant(points.clone());
            let flow = adjoint.integrate(&field, start, &[], &problem)?;
            evaluations += flow.stats.evaluations;
            let loss = (flow.end - tape.constant(turned.clone())).square().mean();
            last = loss.item();
            let gradients = loss.backward();
            tape.reset();
            adam.step(field.module_mut(), &gradients);
        }
        let seconds = began.elapsed().as_secs_f64();
        println!("{adjoint:?}: loss {last:.2e}, {evaluations} evaluations, {seconds:.2} s");
    }
    Ok(())
}
