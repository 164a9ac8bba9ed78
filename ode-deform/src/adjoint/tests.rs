#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::testkit::{Options, check, gradcheck};
use autodiff_lite::{Activation, Gradients, Module, Param, Tape, Var};
use ndarray::{ArrayD, IxDyn, arr1, arr2};
use nets::{Init, Mlp};

use super::*;
use crate::solve::{
    BOSH3, DOPRI5, EULER, HEUN, MIDPOINT, RK4, StepController, THREE_EIGHTHS, Tableau,
};

/// Layers over `[y, input]`, scaled by time: what a deformation field is, in small.
fn field() -> impl VectorField<f64> {
    let mlp = Mlp::<f64>::new(&Init::new(3), &[5, 7, 3], Activation::Tanh);
    field_fn(mlp, |mlp: &Mlp<f64>, t, y: Var<'_, f64>, inputs: &[Var<'_, f64>]| {
        let tape = y.tape();
        mlp.forward(tape.concat(&[y, inputs[0]], 1)).scale(1.0 + t)
    })
}

fn array(shape: &[usize], seed: usize) -> ArrayD<f64> {
    let mut k = seed as f64;
    ArrayD::from_shape_simple_fn(IxDyn(shape), || {
        k += 1.0;
        (k * 0.7).sin()
    })
}

fn problem(tableau: &'static Tableau, step: f64) -> Problem {
    Problem::new([0.1, 1.0], tableau, StepController::Fixed { step })
}

fn weigh(y: Var<'_, f64>, seed: usize) -> Var<'_, f64> {
    (y.square() * y.tape().constant(array(&[4, 3], seed))).sum()
}

/// Loss value and gradients with respect to state, input and all parameters.
fn gradients(adjoint: Adjoint, problem: &Problem) -> (f64, Vec<ArrayD<f64>>) {
    let (tape, field) = (Tape::<f64>::train(0), field());
    let (start, input) = (tape.leaf(array(&[4, 3], 0)), tape.leaf(array(&[4, 2], 50)));
    let flow = adjoint.integrate(&field, start, &[input], problem).unwrap();
    let mut loss = weigh(flow.end, 90);
    for (i, &state) in flow.states.iter().enumerate() {
        loss = loss + weigh(state, 7 * i);
    }
    let found = loss.backward();
    let mut all = vec![found.wrt(start).unwrap().to_owned(), found.wrt(input).unwrap().to_owned()];
    all.extend(of_params(&field, &found));
    (loss.item(), all)
}

fn of_params(field: &impl Module<f64>, found: &Gradients<f64>) -> Vec<ArrayD<f64>> {
    let mut all = Vec::new();
    field.visit("", &mut |_: &str, p: &Param<f64>| all.push(found.of(p).unwrap().to_owned()));
    all
}

fn worst(a: &[ArrayD<f64>], b: &[ArrayD<f64>]) -> f64 {
    assert_eq!(a.len(), b.len());
    let pairs = a.iter().zip(b).flat_map(|(a, b)| a.iter().zip(b));
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn replaying_gives_the_gradient_of_recording() {
    for tableau in Tableau::ALL {
        let save_at = [0.1, 0.25, 0.3, 0.31, 0.4, 0.99, 1.0];
        for problem in [
            problem(tableau, 0.1),
            problem(tableau, 0.15).save_at(save_at),
            problem(tableau, 0.2).overshooting().save_at(save_at),
            Problem::new(
                [1.0, -0.5],
                tableau,
                StepController::Random { low: 0.1, high: 0.3, seed: 1, sample: 2 },
            )
            .save_at([0.5, -0.5]),
            problem(tableau, 0.1).save_at([0.1]),
        ] {
            let (loss, direct) = gradients(Adjoint::Direct, &problem);
            let (same, replayed) = gradients(Adjoint::Checkpointed, &problem);
            assert_eq!(loss, same, "{}", tableau.name);
            let error = worst(&direct, &replayed);
            assert!(error < 1e-10, "{}: {error:e}, {problem:?}", tableau.name);
        }
    }
}

#[test]
fn steps_that_follow_the_error_are_replayed_as_they_were_accepted() {
    for tableau in [&HEUN, &MIDPOINT, &BOSH3, &DOPRI5] {
        let problem =
            Problem { control: StepController::adaptive(1e-5, 1e-5), ..problem(tableau, 1.0) };
        let problem = problem.save_at([0.2, 0.7]);
        let (loss, direct) = gradients(Adjoint::Direct, &problem);
        let (same, replayed) = gradients(Adjoint::Checkpointed, &problem);
        assert_eq!(loss, same);
        assert!(worst(&direct, &replayed) < 1e-10, "{}", tableau.name);
        let (tape, field) = (Tape::<f64>::train(0), field());
        let (start, input) = (tape.leaf(array(&[4, 3], 0)), tape.leaf(array(&[4, 2], 50)));
        let [a, b] = [Adjoint::Direct, Adjoint::Checkpointed]
            .map(|adjoint| adjoint.integrate(&field, start, &[input], &problem).unwrap());
        assert_eq!((a.times, a.stats), (b.times, b.stats));
    }
}

gradcheck!(of_recording: |y, x| Adjoint::Direct.integrate(&field(), y, &[x], &problem(&RK4, 0.3)).unwrap().end,
    shapes [[[4, 3], [4, 2]]]);
gradcheck!(of_replaying: |y, x| Adjoint::Checkpointed.integrate(&field(), y, &[x], &problem(&RK4, 0.3)).unwrap().end,
    shapes [[[4, 3], [4, 2]], [[1, 3], [1, 2]]]);
gradcheck!(of_replaying_what_lies_between: |y, x| {
    let problem = problem(&DOPRI5, 0.3).save_at([0.1, 0.2, 0.7, 1.0]);
    let flow = Adjoint::Checkpointed.integrate(&field(), y, &[x], &problem).unwrap();
    y.tape().stack(&flow.states, 0)
}, shapes [[[4, 3], [4, 2]]]);

/// Parameters, by differences: through a field whose weight is drawn by the check.
#[test]
fn parameters_that_come_as_inputs_have_the_same_gradient_as_their_own() {
    let own = field_fn(
        Param::new(arr2(&[[0.3, -0.2], [0.5, 0.1]])),
        |w: &Param<f64>, _, y: Var<'_, f64>, _| y.matmul(y.tape().param(w)).tanh(),
    );
    let handed = field_fn((), |(): &(), _, y: Var<'_, f64>, inputs: &[Var<'_, f64>]| {
        y.matmul(inputs[0]).tanh()
    });
    for adjoint in Adjoint::ALL {
        let tape = Tape::<f64>::train(0);
        let start = tape.leaf(array(&[3, 2], 1));
        let w = tape.leaf(own.module().value.clone());
        let problem = problem(&BOSH3, 0.05);
        let a =
            adjoint.integrate(&own, start, &[], &problem).unwrap().end.square().sum().backward();
        let b = adjoint
            .integrate(&handed, start, &[w], &problem)
            .unwrap()
            .end
            .square()
            .sum()
            .backward();
        let difference = a.of(own.module()).unwrap().to_owned() - &**b.wrt(w).unwrap();
        assert!(difference.iter().all(|d| d.abs() < 1e-12), "{adjoint:?}: {difference}");
    }
    let options = Options::default();
    let inputs = options.draw(&[vec![3, 2], vec![2, 2]]);
    let flow = autodiff_lite::testkit::function(|x| {
        Adjoint::Checkpointed.integrate(&handed, x[0], &[x[1]], &problem(&HEUN, 0.2)).unwrap().end
    });
    check(&flow, &inputs, &options).unwrap();
}

/// The error of the continuous adjoint falls with the step as the method's order says; at coarse steps it is large.
#[test]
fn solving_back_is_approximate_and_converges() {
    for (tableau, order) in [(&EULER, 1.0), (&HEUN, 2.0), (&RK4, 4.0)] {
        let errors = [0.09, 0.045, 0.0225].map(|step| {
            let problem = problem(tableau, step).save_at([0.37]);
            let (_, exact) = gradients(Adjoint::Checkpointed, &problem);
            worst(&exact, &gradients(Adjoint::Backsolve, &problem).1)
        });
        assert!(errors[0] > 1e-9, "{}: as good as exact", tableau.name);
        let observed = (errors[0] / errors[2]).log2() / 2.0;
        assert!(observed > order - 0.3, "{}: order {observed}, errors {errors:?}", tableau.name);
    }
}

#[test]
fn a_way_back_that_fails_leaves_no_number() {
    // Forward y' = -60 y is tame; backward it grows beyond all numbers.
    let field = field_fn((), |(): &(), _, y: Var<'_, f64>, _| y.scale(-60.0));
    let tape = Tape::<f64>::train(0);
    let start = tape.leaf(arr1(&[1.0]));
    let mut problem = Problem::new([0.0, 20.0], &DOPRI5, StepController::adaptive(1e-3, 1e-3));
    problem.limits.steps = 1000;
    let flow = Adjoint::Backsolve.integrate(&field, start, &[], &problem).unwrap();
    let gradients = flow.end.sum().backward();
    assert!(!gradients.is_finite());
}

#[test]
fn what_needs_no_gradient_keeps_nothing() {
    let field = field();
    for adjoint in Adjoint::ALL {
        let tape = Tape::<f64>::eval();
        let (start, input) = (tape.constant(array(&[4, 3], 0)), tape.constant(array(&[4, 2], 50)));
        let flow = adjoint.integrate(&field, start, &[input], &problem(&RK4, 0.1)).unwrap();
        assert!(flow.end.value().iter().all(|y| y.is_finite()));
        assert_eq!(flow.stats.evaluations, 36);
    }
    // An input without gradient, and frozen parameters.
    let tape = Tape::<f64>::train(0);
    let mut frozen = field.clone();
    frozen.set_trainable("", false);
    let (start, input) = (tape.leaf(array(&[4, 3], 0)), tape.constant(array(&[4, 2], 50)));
    let flow =
        Adjoint::Checkpointed.integrate(&frozen, start, &[input], &problem(&RK4, 0.1)).unwrap();
    let found = flow.end.sum().backward();
    assert!(found.wrt(start).is_some() && found.wrt(input).is_none());
    frozen.visit("", &mut |_: &str, p: &Param<f64>| assert!(found.of(p).is_none()));
}

/// A field that draws is one function for the whole integration: replay sees what forward saw.
#[test]
fn what_a_field_draws_is_drawn_alike_on_the_way_back() {
    let noisy = field_fn((), |(): &(), _, y: Var<'_, f64>, _| y.dropout(0.5).tanh());
    let problem = problem(&DOPRI5, 0.2);
    let value = |start: ArrayD<f64>, back: bool| {
        let tape = Tape::<f64>::train(5);
        let y = tape.leaf(start);
        let end = Adjoint::Checkpointed.integrate(&noisy, y, &[], &problem).unwrap().end;
        let gradient = back.then(|| end.sum().backward().wrt(y).unwrap().to_owned());
        (end.value().sum(), gradient)
    };
    let start = array(&[40], 3);
    let gradient = value(start.clone(), true).1.unwrap();
    let (mut above, mut below) = (start.clone(), start);
    above.map_inplace(|y| *y += 1e-5);
    below.map_inplace(|y| *y -= 1e-5);
    let differences = (value(above, false).0 - value(below, false).0) / 2e-5;
    assert!((gradient.sum() - differences).abs() < 1e-6, "{} {differences}", gradient.sum());
}

#[test]
fn a_tape_is_walked_twice_and_reset() {
    let (mut tape, field) = (Tape::<f64>::train(0), field());
    let mut seen = Vec::new();
    for _ in 0..3 {
        let (start, input) = (tape.leaf(array(&[4, 3], 0)), tape.leaf(array(&[4, 2], 50)));
        let end = Adjoint::Checkpointed
            .integrate(&field, start, &[input], &problem(&HEUN, 0.1))
            .unwrap()
            .end;
        let loss = end.square().sum();
        for _ in 0..2 {
            seen.push(loss.backward().wrt(start).unwrap().to_owned());
        }
        tape.reset();
    }
    assert!(seen.iter().all(|gradient| *gradient == seen[0]));
}

#[test]
#[should_panic(expected = "a field gave a derivative [4] for a state [4, 3]")]
fn derivatives_have_the_shape_of_the_state() {
    let tape = Tape::<f64>::eval();
    let wrong = field_fn((), |(): &(), _, y: Var<'_, f64>, _| y.sum_axis(1));
    let _ = Adjoint::Checkpointed.integrate(
        &wrong,
        tape.constant(array(&[4, 3], 0)),
        &[],
        &problem(&HEUN, 0.1),
    );
}

/// A pendulum pushed with time: the gradient by the times themselves, beside all others.
fn between<'t>(
    adjoint: Adjoint,
    [t0, t1, y, push]: [Var<'t, f64>; 4],
    control: StepController,
    tableau: &'static Tableau,
) -> Var<'t, f64> {
    let mlp = Mlp::<f64>::new(&Init::new(3), &[2, 2], Activation::Tanh);
    let field = timed_field_fn(
        mlp,
        |mlp: &Mlp<f64>, t: Var<'_, f64>, y: Var<'_, f64>, inputs: &[Var<'_, f64>]| {
            mlp.forward(y).add(inputs[0].mul(t.scale(2.0).sin()))
        },
    );
    let problem = Problem::new([0.0, 1.0], tableau, control);
    adjoint.integrate_between(&field, [t0, t1], y, &[push], &problem).unwrap().end
}

const FIFTHS: StepController = StepController::Fixed { step: 0.2 };

gradcheck!(times_when_recorded: |a, b, y, p| between(Adjoint::Direct, [a, b.add_scalar(2.5), y, p], FIFTHS, &RK4),
    shapes [[[], [], [3, 2], [2]]], options Options::default().range(-0.4, 0.4));
gradcheck!(times_when_replayed: |a, b, y, p| between(Adjoint::Checkpointed, [a, b.add_scalar(-2.5), y, p], FIFTHS, &THREE_EIGHTHS),
    shapes [[[1], [1], [3, 2], [2]]], options Options::default().range(-0.4, 0.4));

/// `d y(t1) / d t1` is the field at the end, and `d y(t1) / d t0` minus the field at the beginning, carried along.
#[test]
fn the_gradient_by_the_last_time_is_the_field_there() {
    for adjoint in Adjoint::ALL {
        let tape = Tape::<f64>::train(0);
        let (t0, t1) = (tape.leaf(ndarray::arr0(0.3)), tape.leaf(ndarray::arr0(1.7)));
        let y = tape.leaf(arr1(&[0.8]));
        // y' = y cos t, so y = y0 exp(sin t - sin t0).
        let empty = Mlp::<f64>::new(&Init::new(0), &[1, 1], Activation::Tanh);
        let field = timed_field_fn(empty, |_: &Mlp<f64>, t: Var<'_, f64>, y: Var<'_, f64>, _| {
            y.mul(t.cos())
        });
        let control = StepController::adaptive(1e-10, 1e-10);
        let problem = Problem::new([0.0, 1.0], &DOPRI5, control).save_at([0.5]);
        // Times of the problem are those of its span: the middle is between the two variables' middle.
        let flow = adjoint.integrate_between(&field, [t0, t1], y, &[], &problem).unwrap();
        let truth = |t: f64| 0.8 * (t.sin() - 0.3_f64.sin()).exp();
        assert!((flow.end.item() - truth(1.7)).abs() < 1e-8);
        assert!((flow.states[0].item() - truth(1.0)).abs() < 1e-8);
        assert_eq!((flow.times[0], flow.times[flow.times.len() - 1]), (0.3, 1.7));
        let gradients = flow.end.sum().backward();
        let found = [t0, t1, y].map(|var| gradients.wrt(var).unwrap().as_slice()[0]);
        let end = truth(1.7);
        let expected = [-end * 0.3_f64.cos(), end * 1.7_f64.cos(), end / 0.8];
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{adjoint:?}: {found} {expected}");
        }
    }
}

#[test]
fn times_that_are_one_are_refused() {
    let tape = Tape::<f64>::train(0);
    let (t, y) = (tape.leaf(ndarray::arr0(0.3)), tape.leaf(arr1(&[0.8])));
    let mlp = Mlp::<f64>::new(&Init::new(0), &[1, 1], Activation::Tanh);
    let field = timed_field_fn(mlp, |_: &Mlp<f64>, _: Var<'_, f64>, y: Var<'_, f64>, _| y);
    let problem = Problem::new([0.0, 1.0], &RK4, FIFTHS);
    let error = Adjoint::Direct.integrate_between(&field, [t, t], y, &[], &problem).unwrap_err();
    assert!(error.to_string().contains("the last time"), "{error}");
}
