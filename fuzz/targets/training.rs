//! Configurations and checkpoints of trainings.

use std::path::Path;

use autodiff_lite::state::State;
use models::depth::{Refined, Sphere, Voxels};
use models::img2mesh::Img2Mesh;
use models::mcmr::Mcmr;
use models::pixel2mesh::{Continuous, SingleView, Staged};
use recon::fit::FitConfig;
use train::settings::read_text;
use train::{Checkpoint, Configuration, System};

use super::scratch::with_files;

/// Reads the configuration of a system, and examines it as each command does first.
fn examined<S: System>(text: &str) {
    let read = read_text::<Configuration<S::Config>>(Path::new("a.toml"), text, &[]);
    if let Ok(config) = read {
        let _ = S::check(&config.system);
    }
}

pub(crate) fn toml(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let _ = read_text::<FitConfig>(Path::new("a.toml"), &text, &[]);
    examined::<Img2Mesh>(&text);
    examined::<Mcmr>(&text);
    examined::<SingleView<Staged>>(&text);
    examined::<SingleView<Continuous>>(&text);
    examined::<Refined<Sphere>>(&text);
    examined::<Refined<Voxels>>(&text);
}

fn preset<S: System>(name: &str) -> Option<&'static str> {
    S::PRESETS.iter().find(|(found, _)| *found == name).map(|(_, text)| *text)
}

pub(crate) fn toml_seeds() -> Vec<Vec<u8>> {
    let tiny = [
        preset::<Img2Mesh>("tiny"),
        preset::<Mcmr>("tiny"),
        preset::<SingleView<Staged>>("tiny"),
        preset::<SingleView<Continuous>>("tiny"),
        preset::<Refined<Sphere>>("tiny"),
        preset::<Refined<Voxels>>("tiny"),
    ];
    tiny.into_iter().flatten().map(|text| text.as_bytes().to_vec()).collect()
}

pub(crate) fn checkpoint(bytes: &[u8]) {
    with_files(&[("a.safetensors", bytes)], |root| {
        let path = root.join("a.safetensors");
        if let Ok(checkpoint) = Checkpoint::read(&path) {
            let _ = (checkpoint.system(), checkpoint.step());
            let _ = checkpoint.config::<Img2Mesh>();
            let _ = checkpoint.config::<Refined<Sphere>>();
        }
    });
}

pub(crate) fn checkpoint_seeds() -> Vec<Vec<u8>> {
    let of = |system: &str, config: &str| {
        let mut state = State::new();
        state.insert("a.weight", &[2], &[1.0_f32; 2]);
        for (key, value) in [
            ("format", "1"),
            ("system", system),
            ("step", "3"),
            ("epochs-begun", "1"),
            ("pending", "false"),
            ("best", "0.5 2"),
            ("average", "0.25"),
            ("config", config),
        ] {
            state.metadata.insert(key.to_owned(), value.to_owned());
        }
        state.to_bytes()
    };
    vec![
        of(Img2Mesh::NAME, preset::<Img2Mesh>("tiny").unwrap_or_default()),
        of("depth-pixel2mesh", "stages = 2\n"),
    ]
}
