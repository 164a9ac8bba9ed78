//! One step of `fit`: 4 views of 256x256, icosphere 4, all losses, preconditioning and optimiser.

use std::hint::black_box;

use benches::{criterion, pool};
use criterion::BenchmarkId;
use datasets::View;
use datasets::shapes::AlarmClock;
use recon::fit::{FitConfig, Stepper};
use recon::synthetic::{Orbit, RenderOptions, render_views};

fn views() -> Vec<View> {
    let mesh = AlarmClock::default().build();
    let cameras = Orbit { count: 4, ..Orbit::default() }.cameras();
    render_views(&mesh, &cameras, &RenderOptions::default(), &|_, _| ())
        .expect("the clock is sound")
}

fn main() {
    let views = views();
    let config = FitConfig { start_level: 4, ..FitConfig::default() };
    let mut criterion = criterion();
    for threads in [1, 2] {
        pool(threads).install(|| {
            let mut stepper = Stepper::new(&views, &config).expect("the clock is in view");
            // The first steps are far from the masks: measure the middle of a fit.
            for _ in 0..30 {
                stepper.step().expect("finite");
            }
            let id =
                BenchmarkId::new("fit step, 4 views 256x256, icosphere 4", format!("{threads}t"));
            criterion.bench_with_input(id, &(), |bench, ()| {
                bench.iter(|| black_box(stepper.step().expect("finite")));
            });
        });
    }
    criterion.final_summary();
}
