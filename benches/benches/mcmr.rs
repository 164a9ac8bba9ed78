//! Whole training steps of MCMR: encoder, selection, deformation, texture, rendering, losses, backward, Adam.
//!
//! `small` is the preset of that name before the subdivision; `published` has the published sizes and batch with images
//! and textures of 128 pixels, 162 vertices and every loss but the perceptual one, drawn by DIB-R.

use std::path::Path;

use benches::{TrainingStep, criterion, pool, yardsticks};
use models::mcmr::{CameraHead, Mcmr, McmrConfig, RendererKind};
use train::settings::read_text;
use train::{Configuration, System};

/// Objects of each family; two families have more images than the larger batch needs.
const OBJECTS: usize = 16;

fn preset(name: &str) -> McmrConfig {
    let (_, text) = Mcmr::PRESETS.iter().find(|(other, _)| *other == name).expect("a preset");
    let config: Configuration<McmrConfig> =
        read_text(Path::new(name), text, &[]).expect("presets are tested");
    let families = vec!["airplane".to_owned(), "car".to_owned()];
    McmrConfig { families, objects: OBJECTS, test_objects: 1, ..config.system }
}

fn main() {
    let mut criterion = criterion();
    yardsticks(&mut criterion, "mcmr");
    let mut group = criterion.benchmark_group("mcmr");
    // As earlier records of this bench: the preset itself draws by SoftRas.
    let published = McmrConfig {
        image_size: 128,
        percept_weight: 0.0,
        renderer: RendererKind::DibR,
        closed_texture: true,
        ..preset("paper")
    };
    // As earlier records too: the preset's cameras have a network of their own.
    let one_network =
        McmrConfig { camera_head: CameraHead::Quaternion, own_cameras_at: None, ..preset("small") };
    for (name, batch, config) in [
        ("small", 8, preset("small")),
        ("small-one-network", 8, one_network),
        ("published", 16, published),
    ] {
        let mut step = TrainingStep::<Mcmr>::new(&config, batch);
        group.bench_function(format!("training-step/{name}/batch-{batch}/2t"), |bencher| {
            pool(2).install(|| bencher.iter(|| step.run()));
        });
    }
    group.finish();
    criterion.final_summary();
}
