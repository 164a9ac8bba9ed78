//! What an untrained img2mesh makes of two views: the path from images to a mesh, without a training.
//!
//! `cargo run --release -p unsphere-models --example predict_untrained -- [mesh.ply]`

use std::io::Write;

use mesh_core::io::write_mesh;
use models::img2mesh::Img2Mesh;
use synth::shapes::AlarmClock;
use synth::{Orbit, RenderOptions, render_views};
use train::{Configuration, System, settings};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "untrained.ply".to_owned());
    let (name, preset) = Img2Mesh::PRESETS[0];
    let config: Configuration<<Img2Mesh as System>::Config> =
        settings::read_text(name.as_ref(), preset, &[])?;
    let summary = Img2Mesh::summary(&config.system);

    let cameras = Orbit { count: 2, width: 64, height: 64, ..Orbit::default() }.cameras();
    let clock = AlarmClock::default().build();
    let views = render_views(&clock, &cameras, &RenderOptions::default(), &|_, _| {})?;
    let system = Img2Mesh::new(&config.system, config.train.seed);
    let mesh = system.predict(&views)?;
    write_mesh(&path, &mesh)?;

    let mut out = std::io::stdout().lock();
    writeln!(out, "preset {name}: {} trainable parameters", summary.trainable)?;
    writeln!(out, "{path}: {} vertices, {} faces", mesh.positions.len(), mesh.faces.len())?;
    Ok(())
}
