#![allow(clippy::unwrap_used, reason = "tests")]
#![allow(clippy::excessive_precision, reason = "digits as the references print them")]

use autodiff_lite::Tape;
use ndarray::{Array2, arr1};
use proptest::prelude::*;

use super::*;

fn fixed(step: f64) -> StepController {
    StepController::Fixed { step }
}

/// All trees up to order five: the sum that each asks for, over weights `b`, and its value.
fn order_conditions(t: &Tableau, b: &[f64]) -> Vec<(u32, f64, f64)> {
    let stages = t.stages();
    let a = |i: usize, j: usize| t.a[i].get(j).copied().unwrap_or(0.0);
    let dot = |x: &dyn Fn(usize) -> f64| (0..stages).map(|i| b[i] * x(i)).sum::<f64>();
    let through = |x: Vec<f64>| -> Vec<f64> {
        (0..stages).map(|i| (0..stages).map(|j| a(i, j) * x[j]).sum()).collect()
    };
    let power = |n: i32| (0..stages).map(|i| t.c[i].powi(n)).collect::<Vec<f64>>();
    let times =
        |x: &[f64], n: i32| (0..stages).map(|i| x[i] * t.c[i].powi(n)).collect::<Vec<f64>>();
    let (ac, ac2, ac3) = (through(power(1)), through(power(2)), through(power(3)));
    let aac = through(ac.clone());
    let (aac2, acac, aaac) = (through(ac2.clone()), through(times(&ac, 1)), through(aac.clone()));
    vec![
        (1, dot(&|_| 1.0), 1.0),
        (2, dot(&|i| t.c[i]), 1.0 / 2.0),
        (3, dot(&|i| t.c[i].powi(2)), 1.0 / 3.0),
        (3, dot(&|i| ac[i]), 1.0 / 6.0),
        (4, dot(&|i| t.c[i].powi(3)), 1.0 / 4.0),
        (4, dot(&|i| t.c[i] * ac[i]), 1.0 / 8.0),
        (4, dot(&|i| ac2[i]), 1.0 / 12.0),
        (4, dot(&|i| aac[i]), 1.0 / 24.0),
        (5, dot(&|i| t.c[i].powi(4)), 1.0 / 5.0),
        (5, dot(&|i| t.c[i].powi(2) * ac[i]), 1.0 / 10.0),
        (5, dot(&|i| ac[i].powi(2)), 1.0 / 20.0),
        (5, dot(&|i| t.c[i] * ac2[i]), 1.0 / 15.0),
        (5, dot(&|i| ac3[i]), 1.0 / 20.0),
        (5, dot(&|i| t.c[i] * aac[i]), 1.0 / 30.0),
        (5, dot(&|i| acac[i]), 1.0 / 40.0),
        (5, dot(&|i| aac2[i]), 1.0 / 60.0),
        (5, dot(&|i| aaac[i]), 1.0 / 120.0),
    ]
}

#[test]
fn tableaux_satisfy_the_conditions_of_their_order_and_of_no_higher() {
    for t in Tableau::ALL {
        let stages = t.stages();
        assert!(t.a.len() == stages && t.c.len() == stages, "{}", t.name);
        for i in 0..stages {
            assert!(t.a[i].len() <= i, "{}: an explicit method", t.name);
            assert!((t.a[i].iter().sum::<f64>() - t.c[i]).abs() < 1e-14, "{} row {i}", t.name);
        }
        let check = |b: &[f64], order: u32, what: &str| {
            let all = order_conditions(t, b);
            for &(n, sum, value) in all.iter().filter(|(n, ..)| *n <= order) {
                assert!((sum - value).abs() < 1e-14, "{} {what}, order {n}: {sum}", t.name);
            }
            let next = all.iter().filter(|(n, ..)| *n == order + 1);
            let missed = next.clone().any(|(_, sum, value)| (sum - value).abs() > 1e-6);
            assert!(missed || next.count() == 0, "{} {what} is better than {order}", t.name);
        };
        check(t.b, t.order, "weights");
        if let Some(error) = t.error {
            let embedded: Vec<f64> = t.b.iter().zip(error).map(|(b, e)| b - e).collect();
            check(&embedded, t.order - 1, "embedded weights");
        }
        if let Some(dense) = t.dense {
            assert!(dense.iter().sum::<f64>().abs() < 1e-13, "a constant derivative stays one");
        }
        assert_eq!(t.is_fsal(), ["bosh3", "dopri5", "tsit5"].contains(&t.name));
        assert_eq!(t.check(), Ok(()));
        assert_eq!(Tableau::named(t.name), Some(t));
    }
    assert_eq!(Tableau::ALL.map(Tableau::evaluations_per_step), [1, 2, 2, 4, 3, 6, 3, 4, 1, 6]);
}

/// Slope of log error over log step by least squares.
fn regress(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let logs: Vec<_> = points.iter().map(|&(h, e)| (h.ln(), e.ln())).collect();
    let (mx, my) =
        (logs.iter().map(|p| p.0).sum::<f64>() / n, logs.iter().map(|p| p.1).sum::<f64>() / n);
    let top: f64 = logs.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    top / logs.iter().map(|p| (p.0 - mx).powi(2)).sum::<f64>()
}

/// `y' = y cos t` beside a turning point on the circle that is driven by time: nothing vanishes by accident.
fn driven(t: f64, &[y, p, q]: &[f64; 3]) -> [f64; 3] {
    [y * t.cos(), -q * (1.0 + t), p * (1.0 + t)]
}

fn driven_truth(t: f64) -> [f64; 3] {
    let angle = t + t * t / 2.0;
    [t.sin().exp(), angle.cos(), angle.sin()]
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn observed_orders_are_those_of_the_tableaux() {
    for t in Tableau::ALL {
        let save_at: Vec<f64> = (1..40).map(|i| 0.05 * i as f64 + 0.0123).collect();
        let (mut ends, mut between) = (Vec::new(), Vec::new());
        for steps in [24, 32, 48, 64, 96] {
            let h = 2.1 / steps as f64;
            let problem = Problem::new([0.0, 2.1], t, fixed(h)).save_at(save_at.clone());
            let solution = solve(driven, driven_truth(0.0), &problem).unwrap();
            assert_eq!(solution.stats.accepted, steps);
            ends.push((h, distance(&solution.end, &driven_truth(2.1))));
            let errors = save_at.iter().zip(&solution.states);
            let worst = errors.map(|(&at, y)| distance(y, &driven_truth(at))).fold(0.0, f64::max);
            between.push((h, worst));
        }
        let (order, dense) = (regress(&ends), regress(&between));
        // The leading error of Tsitouras' method is so small that the next one still shows at these steps.
        let within = |excess: f64| excess > -0.3 && excess < 0.45;
        assert!(within(order - t.order as f64), "{}: observed order {order}", t.name);
        // The cubic has order 3 in itself, which means an error of fourth order at the step's scale.
        let expected = if t.dense.is_some() { t.order as f64 } else { t.order.min(4) as f64 };
        assert!(within(dense - expected), "{} between: observed order {dense}", t.name);
    }
}

#[test]
fn an_oscillator_comes_back() {
    let turn = 2.0 * std::f64::consts::PI;
    let problem = Problem::new([0.0, 10.0 * turn], &DOPRI5, StepController::adaptive(1e-10, 1e-10));
    let solution = solve(|_, &[x, v]: &[f64; 2]| [v, -x], [1.0, 0.0], &problem).unwrap();
    assert!((solution.end[0] - 1.0).abs() < 1e-7 && solution.end[1].abs() < 1e-7);
}

#[test]
fn logistic_growth() {
    let truth = |t: f64| 1.0 / (1.0 + 9.0 * (-t).exp());
    let save_at: Vec<f64> = (0..=20).map(|i| i as f64 * 0.5).collect();
    let problem = Problem::new([0.0, 10.0], &DOPRI5, StepController::adaptive(1e-9, 1e-9))
        .save_at(save_at.clone());
    let solution = solve(|_, &y: &f64| y * (1.0 - y), 0.1, &problem).unwrap();
    for (&t, y) in save_at.iter().zip(&solution.states) {
        assert!((y - truth(t)).abs() < 1e-7, "t = {t}: {y} against {}", truth(t));
    }
    assert_eq!(solution.states[20], solution.end);
    assert_eq!(solution.states[0], 0.1);
}

/// Against Taylor series with 25 digits (mpmath's `odefun`).
#[test]
fn lorenz_for_a_short_time_and_van_der_pol() {
    let lorenz =
        |_, &[x, y, z]: &[f64; 3]| [10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z];
    let problem = Problem::new([0.0, 2.0], &DOPRI5, StepController::adaptive(1e-10, 1e-10));
    let solution = solve(lorenz, [1.0; 3], &problem).unwrap();
    let truth = [-8.173499932242249, -9.562023686798799, 24.620702049679656];
    assert!(distance(&solution.end, &truth) < 1e-5, "{:?}", solution.end);

    let circuit = |_, &[x, v]: &[f64; 2]| [v, (1.0 - x * x) * v - x];
    let problem = Problem::new([0.0, 10.0], &DOPRI5, StepController::adaptive(1e-9, 1e-9));
    let solution = solve(circuit, [2.0, 0.0], &problem).unwrap();
    assert!((solution.end[0] + 2.0083407825797123).abs() < 1e-6);
    assert!((solution.end[1] - 0.032907065863324064).abs() < 1e-6);
}

/// Arenstorf's orbit of three bodies: it closes after a period, and passes close by both.
fn arenstorf(_: f64, &[x, y, u, v]: &[f64; 4]) -> [f64; 4] {
    let (mu, nu) = (0.012277471, 1.0 - 0.012277471);
    let near = ((x + mu).powi(2) + y * y).powf(1.5);
    let far = ((x - nu).powi(2) + y * y).powf(1.5);
    let along = x + 2.0 * v - nu * (x + mu) / near - mu * (x - nu) / far;
    [u, v, along, y - 2.0 * u - nu * y / near - mu * y / far]
}

#[test]
fn an_orbit_of_three_bodies_closes() {
    let start = [0.994, 0.0, 0.0, -2.00158510637908252240537862224];
    let period = 17.0652165601579625588917206249;
    let problem = Problem::new([0.0, period], &DOPRI5, StepController::adaptive(1e-11, 1e-11));
    let solution = solve(arenstorf, start, &problem).unwrap();
    let away = (solution.end[0] - start[0]).hypot(solution.end[1]);
    assert!(away < 1e-4, "{away} from where it began");
    // Step sizes range over orders of magnitude: what an adaptive method is for.
    let sizes: Vec<f64> = solution.times.windows(2).map(|t| t[1] - t[0]).collect();
    let (least, most) =
        (sizes.iter().copied().fold(1.0, f64::min), sizes.iter().copied().fold(0.0, f64::max));
    assert!(most > 100.0 * least, "{least} to {most}");
}

#[test]
fn time_runs_back_to_where_it_began() {
    for t in [&HEUN, &MIDPOINT, &BOSH3, &DOPRI5, &TSIT5, &ADAPTIVE_HEUN] {
        let control = StepController::adaptive(1e-8, 1e-8);
        let there =
            solve(driven, driven_truth(0.0), &Problem::new([0.0, 2.0], t, control)).unwrap();
        let problem = Problem::new([2.0, 0.0], t, control).save_at([1.5, 1.0, 0.0]);
        let back = solve(driven, there.end, &problem).unwrap();
        assert!(distance(&back.end, &driven_truth(0.0)) < 1e-5, "{}", t.name);
        assert!(distance(&back.states[0], &driven_truth(1.5)) < 1e-5, "{}", t.name);
        assert!(back.times.is_sorted_by(|a, b| a > b) && back.times.last() == Some(&0.0));
        assert_eq!(back.states[2], back.end);
    }
    // Without error control the way back undoes the steps up to their order.
    for t in Tableau::ALL {
        let errors = [40, 80].map(|steps| {
            let control = fixed(2.0 / steps as f64);
            let there = solve(driven, driven_truth(0.0), &Problem::new([0.0, 2.0], t, control));
            let back = solve(driven, there.unwrap().end, &Problem::new([2.0, 0.0], t, control));
            distance(&back.unwrap().end, &driven_truth(0.0))
        });
        let order = (errors[0] / errors[1]).log2();
        assert!(order > t.order as f64 - 0.5, "{}: {order}", t.name);
    }
}

#[test]
fn the_last_time_is_met_exactly_or_passed_as_published() {
    for step in [0.1, 0.3, 1.0 / 3.0, 7.0] {
        let solution =
            solve(|_, _: &f64| 1.0, 0.0, &Problem::new([0.0, 1.0], &EULER, fixed(step))).unwrap();
        assert_eq!(solution.times.last(), Some(&1.0));
        assert!((solution.end - 1.0).abs() < 1e-15);
        assert_eq!(solution.stats.accepted, (1.0 / step - 1e-9).ceil() as usize, "{step}");
    }
    let problem = Problem::new([0.0, 1.0], &EULER, fixed(0.3)).overshooting();
    let solution = solve(|_, _: &f64| 1.0, 0.0, &problem).unwrap();
    assert_eq!(solution.stats.accepted, 4);
    assert!((solution.end - 1.2).abs() < 1e-15);
    // At t = 1 exactly the published loop goes on, for it stops once t > 1.
    let problem = Problem::new([0.0, 1.0], &EULER, fixed(0.25)).overshooting();
    assert_eq!(solve(|_, _: &f64| 1.0, 0.0, &problem).unwrap().stats.accepted, 5);
    let none =
        solve(|_, _: &f64| 1.0, 3.0, &Problem::new([0.5, 0.5], &EULER, fixed(0.25))).unwrap();
    assert_eq!((none.end, none.stats), (3.0, Stats::default()));
}

/// The figures of the paper: 7.55 steps from `U(0.05, 0.2)` and 4.01 from `U(0.2, 0.3)`, which begin at `U(0, 0.25)`.
#[test]
fn random_steps_are_as_many_as_published_and_follow_from_the_seed() {
    let mean = |low, high| {
        let count = 4000;
        let steps = (0..count).map(|sample| {
            let start = 0.25 * (sample as f64 + 0.5) / count as f64;
            let control = StepController::Random { low, high, seed: 7, sample };
            let problem = Problem::new([start, 1.0], &EULER, control).overshooting();
            solve(|_, y: &f64| -y, 1.0, &problem).unwrap().stats.evaluations
        });
        steps.sum::<usize>() as f64 / count as f64
    };
    let (deep, shallow) = (mean(0.05, 0.2), mean(0.2, 0.3));
    assert!((deep - 7.55).abs() < 0.1, "{deep}");
    assert!((shallow - 4.01).abs() < 0.05, "{shallow}");

    let times = |seed, sample| {
        let control = StepController::Random { low: 0.05, high: 0.2, seed, sample };
        solve(|_, y: &f64| -y, 1.0, &Problem::new([0.0, 1.0], &EULER, control)).unwrap().times
    };
    assert_eq!(times(1, 2), times(1, 2));
    assert_ne!(times(1, 2), times(1, 3));
    assert_ne!(times(1, 2), times(2, 2));
}

#[test]
fn every_error_says_the_remedy() {
    let blow_up = |_, &y: &f64| y * y;
    let adaptive = StepController::adaptive(1e-6, 1e-6);
    // 1 / (1 - t) has no value at t = 1.
    let error = solve(blow_up, 1.0, &Problem::new([0.0, 2.0], &DOPRI5, adaptive)).unwrap_err();
    assert!(
        matches!(error, SolveError::StepUnderflow { t, .. } | SolveError::NonFinite { t, .. } if (t - 1.0).abs() < 1e-3),
        "{error}"
    );
    let mut problem = Problem::new([0.0, 2.0], &DOPRI5, adaptive);
    problem.limits.least_step = 1e-3;
    let error = solve(blow_up, 1.0, &problem).unwrap_err();
    assert!(matches!(error, SolveError::StepUnderflow { least: 1e-3, .. }), "{error}");
    assert!(error.to_string().contains("loosen the tolerance"));
    problem.limits.steps = 5;
    let error = solve(blow_up, 1.0, &problem).unwrap_err();
    assert!(
        matches!(error, SolveError::StepLimit { limit: 5, .. })
            && error.to_string().contains("raise the limit")
    );

    let error = solve(
        |t, y: &f64| if t > 0.5 { f64::NAN } else { *y },
        1.0,
        &Problem::new([0.0, 1.0], &RK4, fixed(0.4)),
    )
    .unwrap_err();
    assert_eq!(error, SolveError::NonFinite { t: 0.4, stage: Some(2) });
    assert!(
        error.to_string().contains("derivative of stage 2 at t = 0.4")
            && error.to_string().contains("smaller steps")
    );
    let error =
        solve(|_, _: &f64| f64::INFINITY, 1.0, &Problem::new([0.0, 1.0], &DOPRI5, adaptive))
            .unwrap_err();
    assert_eq!(error, SolveError::NonFinite { t: 0.0, stage: Some(1) });
    let error = solve(|_, _: &f64| 1e300, f64::MAX, &Problem::new([0.0, 1e10], &EULER, fixed(1e9)))
        .unwrap_err();
    assert_eq!(error, SolveError::NonFinite { t: 0.0, stage: None });

    let error = solve(blow_up, 1.0, &Problem::new([0.0, 1.0], &RK4, adaptive)).unwrap_err();
    assert!(error.to_string().contains("rk4 estimates no error: choose"));
    for (problem, found) in [
        (Problem::new([0.0, 1.0], &EULER, fixed(0.0)), "the step size is 0:"),
        (Problem::new([0.0, f64::NAN], &EULER, fixed(0.1)), "a time of the span is NaN:"),
        (
            Problem::new([0.0, 1.0], &EULER, fixed(0.1)).save_at([0.5, 0.4]),
            "a time of save_at is 0.4:",
        ),
        (Problem::new([0.0, 1.0], &EULER, fixed(0.1)).save_at([1.5]), "a time of save_at is 1.5:"),
        (
            Problem::new([0.0, 1.0], &HEUN, StepController::adaptive(1e-3, 0.0)),
            "the absolute tolerance is 0:",
        ),
        (
            Problem::new(
                [0.0, 1.0],
                &HEUN,
                StepController::Random { low: 0.2, high: 0.1, seed: 0, sample: 0 },
            ),
            "the greatest step size is 0.1: it must exceed",
        ),
    ] {
        let error = solve(blow_up, 1.0, &problem).unwrap_err().to_string();
        assert!(error.starts_with(found), "{error}");
    }
}

#[test]
fn a_moment_without_a_number_is_stepped_around() {
    // The first guess leads where the field has no value; smaller steps do not.
    let field = |_, &y: &f64| if y > 2.0 { f64::NAN } else { 1.0 - y };
    let mut pid = Pid::new(Tolerance { relative: 1e-6, absolute: 1e-6 });
    pid.first = Some(50.0);
    let solution =
        solve(field, 0.0, &Problem::new([0.0, 5.0], &DOPRI5, StepController::Pid(pid))).unwrap();
    assert!((solution.end - (1.0 - (-5.0_f64).exp())).abs() < 1e-5 && solution.stats.rejected > 0);
}

#[test]
fn a_stiff_toy_costs_steps_and_a_damped_controller_rejects_fewer() {
    let field = |t: f64, &y: &f64| -500.0 * (y - t.cos());
    let tolerance = Tolerance { relative: 1e-4, absolute: 1e-4 };
    let run = |pid| {
        solve(field, 0.0, &Problem::new([0.0, 2.0], &DOPRI5, StepController::Pid(pid))).unwrap()
    };
    let plain = run(Pid::new(tolerance));
    let damped = run(Pid { proportional: 0.4, integral: 0.3, ..Pid::new(tolerance) });
    for solution in [&plain, &damped] {
        assert!((solution.end - 2.0_f64.cos() - 2.0_f64.sin() / 500.0).abs() < 1e-3);
    }
    assert!(damped.stats.rejected < plain.stats.rejected, "{:?} {:?}", damped.stats, plain.stats);
}

#[test]
fn evaluations_are_counted_as_they_are_made() {
    for t in Tableau::ALL {
        let mut calls = 0;
        let field = |t: f64, y: &[f64; 3]| {
            calls += 1;
            driven(t, y)
        };
        let problem = Problem::new([0.0, 1.0], t, fixed(0.1)).save_at([0.55, 1.0]);
        let solution = solve(field, driven_truth(0.0), &problem).unwrap();
        assert_eq!(solution.stats.evaluations, calls);
        // The derivative at the end of a step, for the asked time, is the first of the next.
        let first = usize::from(t.is_fsal() || t.carries_last);
        assert_eq!(calls, first + 10 * t.evaluations_per_step(), "{}", t.name);
    }
}

/// Arrays, vectors, pairs and variables on a tape: the same steps and the same bits.
#[test]
fn all_states_give_the_same() {
    let matrix = [[-0.3, 1.2], [-1.1, 0.1]];
    let apply = |y: &[f64]| {
        vec![matrix[0][0] * y[0] + matrix[0][1] * y[1], matrix[1][0] * y[0] + matrix[1][1] * y[1]]
    };
    let problem =
        Problem::new([0.0, 3.0], &DOPRI5, StepController::adaptive(1e-6, 1e-7)).save_at([1.3]);
    let plain = solve(|_, y: &Vec<f64>| apply(y), vec![1.0, 0.5], &problem).unwrap();
    let array = solve(
        |_, y: &ndarray::Array1<f64>| apply(y.as_slice().unwrap()).into(),
        arr1(&[1.0, 0.5]),
        &problem,
    )
    .unwrap();
    let shared = solve(
        |_, y: &ndarray::ArcArray1<f64>| {
            ndarray::Array1::from(apply(y.as_slice().unwrap())).into_shared()
        },
        arr1(&[1.0, 0.5]).into_shared(),
        &problem,
    )
    .unwrap();
    let pair = solve(
        |_, y: &(f64, [f64; 1])| {
            let d = apply(&[y.0, y.1[0]]);
            (d[0], [d[1]])
        },
        (1.0, [0.5]),
        &problem,
    )
    .unwrap();
    let tape = Tape::<f64>::train(0);
    let weight = tape.constant(ndarray::arr2(&matrix));
    let var = solve(
        |_, y: &autodiff_lite::Var<'_, f64>| (weight * *y).sum_axis(1),
        tape.leaf(arr1(&[1.0, 0.5])),
        &problem,
    )
    .unwrap();
    assert_eq!(plain.stats, array.stats);
    assert_eq!(plain.times, shared.times);
    assert_eq!(plain.times, pair.times);
    assert_eq!(plain.times, var.times);
    for (states, of) in [(&plain.end, 0), (&plain.states[0], 1)] {
        let pick = |end: [f64; 2], save_at: [f64; 2]| if of == 0 { end } else { save_at };
        let expected = [states[0], states[1]];
        let a = |y: &ndarray::Array1<f64>| [y[0], y[1]];
        assert_eq!(pick(a(&array.end), a(&array.states[0])), expected);
        assert_eq!(
            pick([pair.end.0, pair.end.1[0]], [pair.states[0].0, pair.states[0].1[0]]),
            expected
        );
        let v = |y: autodiff_lite::Var<'_, f64>| [y.value()[[0]], y.value()[[1]]];
        assert_eq!(pick(v(var.end), v(var.states[0])), expected);
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let start =
        Array2::from_shape_fn((120_000, 3), |(i, j)| 0.6 + 0.5 * ((i * 7 + j) as f32 * 0.01).sin());
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let problem = Problem::new([0.0, 1.0], &DOPRI5, StepController::adaptive(1e-3, 1e-3));
        let solution = pool.install(|| {
            solve(|_, y: &Array2<f32>| y.mapv(|y| y * (1.0 - y)), start.clone(), &problem)
        });
        let solution = solution.unwrap();
        (solution.times, solution.end)
    };
    let one = run(1);
    assert!(one == run(2) && one == run(3));
}

#[test]
fn arrays_that_are_not_row_major_are_read_right() {
    let turned = ndarray::arr2(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]).reversed_axes();
    let plain = turned.as_standard_layout().into_owned();
    let sum = Array2::lincomb(&[(1.0, &turned), (0.5, &plain)]);
    assert_eq!(sum, &plain * 1.5);
}

proptest! {
    /// Linear equations have known solutions, in either direction and by any method.
    #[test]
    fn exponentials(rate in -2.0..1.0_f64, from in -3.0..3.0_f64, length in -2.0..2.0_f64, method in 0..6_usize) {
        let tableau = Tableau::ALL[method];
        let problem = Problem::new([from, from + length], tableau, fixed(0.01));
        let solution = solve(|_, &y: &f64| rate * y, 1.0, &problem).unwrap();
        let truth = (rate * (problem.span[1] - problem.span[0])).exp();
        let bound = if tableau.order == 1 { 0.05 } else { 1e-3 };
        prop_assert!((solution.end / truth - 1.0).abs() < bound);
        prop_assert_eq!(solution.times.last(), Some(&problem.span[1]));
    }

    /// What the state is scaled by, the steps are not, as long as the tolerance is scaled too.
    #[test]
    fn steps_do_not_depend_on_units(exponent in -6..6_i32) {
        let unit = 2.0_f64.powi(exponent * 3);
        let run = |unit: f64| {
            let control = StepController::adaptive(1e-6, 1e-6 * unit);
            solve(|t, &y: &f64| -y + unit * t.sin(), unit, &Problem::new([0.0, 4.0], &BOSH3, control)).unwrap().times
        };
        prop_assert_eq!(run(1.0), run(unit));
    }
}
