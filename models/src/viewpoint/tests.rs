//! A camera head finds where images were taken from.

use autodiff_lite::optim::Adam;
use autodiff_lite::{Tape, Var};
use ndarray::Array4;
use nets::{Init, ViewpointHead};

use super::*;

/// An object seen from above, turned by its azimuth: a long body, and at its front a dot of its own colour, larger from near.
fn drawn(views: &[Viewpoint]) -> Array4<f32> {
    const SIDE: f64 = 32.0;
    Array4::from_shape_fn((views.len(), 32, 32, 3), |(n, i, j, c)| {
        let view = &views[n];
        let at = |k: usize| (2.0 * k as f64 + 1.0 - SIDE) / SIDE * view.distance;
        let (sin, cos) = view.azimuth.sin_cos();
        let along = cos * at(j) + sin * at(i);
        let across = (cos * at(i) - sin * at(j)) / view.elevation.sin();
        let body = along.abs() < 0.5 && across.abs() < 0.15;
        let front = (along - 0.4).hypot(across) < 0.15;
        if front { [1.0, 0.0, 0.0][c] } else { f32::from(u8::from(!body)) }
    })
}

/// Spread over all directions; elevation and distance go their own ways.
fn planted(count: usize, first: f64) -> Vec<Viewpoint> {
    let view = |k: usize| Viewpoint {
        azimuth: first + std::f64::consts::TAU * k as f64 / count as f64,
        elevation: 0.6 + 0.3 * (k as f64 * 2.4).sin(),
        distance: 0.8 + 0.2 * (k as f64 * 1.7).cos(),
    };
    (0..count).map(view).collect()
}

fn guess<'t>(
    head: &ViewpointHead,
    tape: &'t Tape,
    views: &[Viewpoint],
) -> nets::ViewpointGuess<'t> {
    let images: Var<'t> = tape.constant(drawn(views));
    head.forward(images)
}

#[test]
fn planted_azimuths_are_found() {
    let mut head = ViewpointHead::<f32>::new(&Init::new(0), 3, 8);
    head.begin_at(0.6, -0.2);
    let (mut tape, mut adam) = (Tape::train(0), Adam::new(2e-3));
    for step in 0..240 {
        let views = planted(16, 0.37 * f64::from(step));
        let loss = viewpoint_loss(&guess(&head, &tape, &views), &views);
        let gradients = loss.backward();
        tape.reset();
        adam.step(&mut head, &gradients);
    }
    let (tape, views) = (Tape::eval(), planted(24, 0.11));
    let found = hypotheses(&guess(&head, &tape, &views), 3);
    let first = found.iter().map(|likely| likely[0].viewpoint);
    let mut errors: Vec<f64> = first.clone().zip(&views).map(|(a, b)| a.azimuth_error(b)).collect();
    errors.sort_by(f64::total_cmp);
    // The line is found in every image, its front in three of four at least: half of them would be chance.
    assert!(errors[12] < 3.0 && errors[17] < 8.0, "{errors:?}");
    let to_line = |error: &f64| error.min(180.0 - error);
    assert!(errors.iter().all(|error| to_line(error) < 8.0), "{errors:?}");
    let wrong = |of: fn(&Viewpoint) -> f64| {
        let errors = first.clone().zip(&views).map(|(a, b)| (of(&a) - of(b)).abs());
        errors.sum::<f64>() / views.len() as f64
    };
    let (raised, far) = (wrong(|v| v.elevation), wrong(|v| v.distance.ln()));
    assert!(raised < 0.12 && far < 0.1, "{raised} {far}");
}
