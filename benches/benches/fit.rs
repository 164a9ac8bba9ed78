//! One step of `fit`: 4 views of 256x256, icosphere 4, all losses, preconditioning and optimiser.

use std::hint::black_box;

use benches::{criterion, pool};
use criterion::BenchmarkId;
use datasets::View;
use recon::fit::{FitConfig, Stepper};
use synth::shapes::AlarmClock;
use synth::{Orbit, RenderOptions, render_views};

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
    let mut group = criterion.benchmark_group("fit");
    for threads in [1, 2] {
        let pool = pool(threads);
        let mut stepper = Stepper::new(&views, &config).expect("the clock is in view");
        group.bench_function(
            BenchmarkId::new("step-4x256-icosphere-4", format!("{threads}t")),
            |b| {
                pool.install(|| {
                    // The first steps are far from the masks: measure the middle of a fit.
                    for _ in 0..30 {
                        stepper.step().expect("finite");
                    }
                    b.iter(|| black_box(stepper.step().expect("finite")));
                });
            },
        );
    }
    group.finish();
    criterion.final_summary();
}
