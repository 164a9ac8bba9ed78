//! A whole training step of img2mesh: three views to one mesh, four losses, backward, Adam.
//!
//! The work of the peer's step: pictures and renderings of 128x128, a small CNN, two layers of
//! attention of width 256, an icosphere of 642 vertices, colours and soft silhouettes.

use autodiff_lite::Tape;
use autodiff_lite::optim::Adam;
use benches::{criterion, pool};
use datasets::ReadOptions;
use recon::img2mesh::{Img2Mesh, Img2MeshConfig, Sample, SilhouetteKind};
use recon::train::{Draw, Moment, Source, System};

fn config(batch: usize) -> Img2MeshConfig {
    Img2MeshConfig {
        features: 256,
        image_size: 128,
        render_size: 128,
        views: 3,
        layers: 2,
        heads: 4,
        feed_forward: 512,
        level: 3,
        silhouette: SilhouetteKind::Soft,
        synthetic_views: 8 * batch,
        ..Img2MeshConfig::default()
    }
}

fn step(system: &mut Img2Mesh, tape: &mut Tape, adam: &mut Adam, batch: &[Sample], at: u64) {
    tape.reseed(at);
    let terms = system.loss(tape, batch, Moment { step: at, epoch: 0 });
    let weighted = terms.0.iter().map(|term| term.value.reshape(&[]).scale(term.weight as f32));
    let gradients = weighted.reduce(|a, b| a + b).expect("four losses").backward();
    drop(terms);
    tape.reset();
    adam.step(system, &gradients);
}

fn main() {
    let mut criterion = criterion();
    let mut group = criterion.benchmark_group("img2mesh");
    for batch in [1, 4] {
        let config = config(batch);
        let source =
            Source { path: None, options: &ReadOptions::default(), seed: 0, progress: &|_, _| {} };
        let data = Img2Mesh::open(&config, &source).expect("the clock needs no file");
        let mut system = Img2Mesh::new(&config, 0);
        system.adopt(&data).expect("views of a clock can be learned from");
        let draw = |item| {
            let draw = Draw { seed: 0, epoch: 0, index: item as u64, item };
            system.draw(&data, &draw).expect("the views are in memory")
        };
        let samples: Vec<Sample> = (0..batch).map(draw).collect();
        let (mut tape, mut adam, mut at) = (Tape::train(0), Adam::new(1e-4), 0);
        group.bench_function(format!("training-step/batch-{batch}/2t"), |bencher| {
            pool(2).install(|| {
                bencher.iter(|| {
                    step(&mut system, &mut tape, &mut adam, &samples, at);
                    at += 1;
                });
            });
        });
    }
    group.finish();
    criterion.final_summary();
}
