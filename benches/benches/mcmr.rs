//! Whole training steps of MCMR: encoder, selection, deformation, texture, rendering, losses, backward, Adam.
//!
//! `small` is the preset of that name before the subdivision; `published` has the published sizes and batch with pictures
//! and textures of 128 pixels, 162 vertices and every loss but the perceptual one.

use autodiff_lite::Tape;
use autodiff_lite::optim::Adam;
use benches::{criterion, pool};
use datasets::ReadOptions;
use recon::mcmr::{Data, Mcmr, McmrConfig};
use recon::train::{Draw, Moment, Source, System};

/// Objects that the pictures are of; no more than the larger batch needs.
const OBJECTS: usize = 16;

fn preset(name: &str) -> McmrConfig {
    let (_, text) = Mcmr::PRESETS.iter().find(|(other, _)| *other == name).expect("a preset");
    let config: recon::train::Configuration<McmrConfig> =
        toml::from_str(text).expect("presets are tested");
    let families = vec!["airplane".to_owned(), "car".to_owned()];
    McmrConfig { families, objects: OBJECTS, test_objects: 1, ..config.system }
}

fn step(
    system: &mut Mcmr,
    tape: &mut Tape,
    adam: &mut Adam,
    batch: &[<Mcmr as System>::Sample],
    at: u64,
) {
    tape.reseed(at);
    let terms = system.loss(tape, batch, Moment { step: at, epoch: 0 });
    let counted = terms.0.iter().filter(|term| term.weight != 0.0);
    let weighted = counted.map(|term| term.value.reshape(&[]).scale(term.weight as f32));
    let gradients = weighted.reduce(|a, b| a + b).expect("losses").backward();
    drop(terms);
    tape.reset();
    adam.step(system, &gradients);
}

fn main() {
    let mut criterion = criterion();
    let mut group = criterion.benchmark_group("mcmr");
    let published = McmrConfig { image_size: 128, percept_weight: 0.0, ..preset("paper") };
    for (name, batch, config) in [("small", 8, preset("small")), ("published", 16, published)] {
        let source =
            Source { path: None, options: &ReadOptions::default(), seed: 0, progress: &|_, _| {} };
        let data: Data = Mcmr::open(&config, &source).expect("it makes its own pictures");
        let mut system = Mcmr::new(&config, 0);
        system.adopt(&data).expect("pictures to learn from");
        let draw = |item| {
            let draw = Draw { seed: 0, epoch: 0, index: item as u64, item };
            system.draw(&data, &draw).expect("the pictures are in memory")
        };
        let samples: Vec<_> = (0..batch).map(draw).collect();
        let (mut tape, mut adam, mut at) = (Tape::train(0), Adam::new(1e-4), 0);
        group.bench_function(format!("training-step/{name}/batch-{batch}/2t"), |bencher| {
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
