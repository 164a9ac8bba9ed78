//! Integrations by torchdiffeq and diffrax; `fixtures/peers.py` made them.
#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::{Activation, Tape, Var};
use nets::{Init, Mlp};
use ode_deform::solve::{
    DOPRI5, Problem, RK4, StepController, THREE_EIGHTHS, TSIT5, Tableau, solve, solve_until,
};
use ode_deform::{Adjoint, timed_field_fn};

const START: [f64; 3] = [1.0, 1.0, 0.0];
const STEP: StepController = StepController::Fixed { step: 2.1 / 14.0 };

fn peer(name: &str) -> Vec<f64> {
    let all: serde_json::Value = serde_json::from_str(include_str!("fixtures/peers.json")).unwrap();
    all[name].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn near(found: &[f64], expected: &[f64], tolerance: f64, what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < tolerance, "{what}: {found} instead of {expected}");
    }
}

fn driven(t: f64, &[y, p, q]: &[f64; 3]) -> [f64; 3] {
    [y * t.cos(), -q * (1.0 + t), p * (1.0 + t)]
}

#[test]
fn steps_of_one_size_lead_to_the_same_place() {
    for name in ["three-eighths", "heun3", "adaptive-heun", "bosh3", "tsit5"] {
        let problem = Problem::new([0.0, 2.1], Tableau::named(name).unwrap(), STEP);
        let found = solve(driven, START, &problem).unwrap();
        assert_eq!(found.stats.accepted, 14);
        near(&found.end, &peer(name), 1e-9, name);
    }
    // What differs is seen: the classical rule is another one.
    let other = solve(driven, START, &Problem::new([0.0, 2.1], &RK4, STEP)).unwrap();
    assert!((other.end[1] - peer("three-eighths")[1]).abs() > 1e-7);
}

#[test]
fn between_the_ends_of_steps_tsitouras_curve_is_that_of_diffrax() {
    let asked = peer("tsit5.asked");
    let problem = Problem::new([0.0, 2.1], &TSIT5, STEP).save_at(asked.clone()).save_dense();
    let solution = solve(driven, START, &problem).unwrap();
    let curve = solution.dense.unwrap();
    near(solution.states.as_flattened(), &peer("tsit5.dense"), 1e-9, "asked for by name");
    let found: Vec<f64> = asked.iter().flat_map(|&t| curve.at(t).unwrap()).collect();
    near(&found, &peer("tsit5.dense"), 1e-9, "on the curve");
}

#[test]
fn an_event_ends_where_both_peers_end() {
    for tableau in [&TSIT5, &DOPRI5] {
        let control = StepController::adaptive(1e-12, 1e-12);
        let problem = Problem::new([0.0, 2.1], tableau, control);
        let event = |t: f64, &[_, _, q]: &[f64; 3]| q - 0.5 + t;
        let solution = solve_until(driven, event, START, &problem).unwrap();
        let found = [&[solution.event.unwrap()][..], &solution.end].concat();
        for name in ["event.torchdiffeq", "event.diffrax"] {
            near(&found, &peer(name), 1e-9, name);
        }
    }
}

#[test]
fn the_gradient_by_the_times_of_one_step() {
    for adjoint in [Adjoint::Direct, Adjoint::Checkpointed] {
        let tape = Tape::<f64>::train(0);
        let [first, last] = [0.3, 0.9].map(|t| tape.leaf(ndarray::arr0(t)));
        let y = tape.leaf(ndarray::arr1(&START));
        let none = Mlp::<f64>::new(&Init::new(0), &[1, 1], Activation::Tanh);
        let field = timed_field_fn(none, |_: &Mlp<f64>, t: Var<'_, f64>, s: Var<'_, f64>, _| {
            let [y, p, q] = [0, 1, 2].map(|i| s.slice_axis(0, i..i + 1));
            let later = t.add_scalar(1.0);
            s.tape().concat(&[y * t.cos(), (q * later).neg(), p * later], 0)
        });
        let step = StepController::Fixed { step: 0.6 };
        let problem = Problem::new([0.3, 0.9], &THREE_EIGHTHS, step);
        let flow = adjoint.integrate_between(&field, [first, last], y, &[], &problem).unwrap();
        assert_eq!(flow.stats.accepted, 1);
        near(flow.end.value().as_slice(), &peer("between.end"), 1e-9, "the end");
        let weights = tape.constant(ndarray::arr1(&[1.0, -2.0, 0.5]));
        let gradients = flow.end.mul(weights).sum().backward();
        let by = |var: Var<'_, f64>| gradients.wrt(var).unwrap().as_slice().to_vec();
        near(&[by(first), by(last)].concat(), &peer("between.grad.t"), 1e-9, "by the times");
        near(&by(y), &peer("between.grad.y"), 1e-9, "by the start");
    }
}
