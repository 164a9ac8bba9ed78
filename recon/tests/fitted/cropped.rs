//! Views of which only what is around the object is kept.

use datasets::{View, Views};
use recon::evaluate::score_views;
use recon::fit::{FitConfig, Fitted, MARGIN, fit};
use recon::verdict::assess;
use synth::shapes::AlarmClock;
use synth::{Orbit, RenderOptions, render_views};
use train::progress::Watch;

/// A clock that fills a third of its images.
fn views() -> Vec<View> {
    let orbit = Orbit { count: 12, width: 192, height: 160, ..Orbit::default() };
    let cameras = orbit.cameras();
    let clock = AlarmClock::default().build();
    let small = clock.scaled([0.5; 3]);
    render_views(&small, &cameras, &RenderOptions::default(), &|_, _| ()).expect("a clock")
}

fn fitted(views: &Views) -> Fitted {
    let config = FitConfig { level: 4, steps: 40, ..FitConfig::default() };
    fit(views, &config, &mut Watch::default()).expect("a fit")
}

#[test]
fn a_fit_of_cropped_views_is_that_of_whole_ones() {
    let whole = Views::in_memory(views());
    let margin = 1.2 * f64::from(MARGIN);
    let parts = whole.views.iter().map(|view| view.clone().cropped_to_object(margin)).collect();
    let parts = Views::in_memory(parts);
    assert!(2 * parts.bytes() < whole.bytes(), "{} of {}", parts.bytes(), whole.bytes());
    let [a, b] = [&whole, &parts].map(fitted);
    assert_eq!(a.mesh.faces, b.mesh.faces);
    let apart =
        |(p, q): (&[f32; 3], &[f32; 3])| (0..3).map(|k| (p[k] - q[k]).abs()).fold(0.0, f32::max);
    let farthest = a.mesh.positions.iter().zip(&b.mesh.positions).map(apart).fold(0.0, f32::max);
    assert!(farthest < 1e-5, "{farthest}");
    // Of the same mesh the same is said, of all of the images.
    let scores = [&whole, &parts].map(|views| {
        let all: Vec<&View> = views.views.iter().collect();
        score_views(&a.mesh, &all, &|_, _| ()).expect("scores")
    });
    assert_eq!(scores[0], scores[1]);
    let evidence = [&whole, &parts].map(|views| assess(views, &a).expect("a verdict").evidence);
    assert_eq!(evidence[0], evidence[1]);
}
