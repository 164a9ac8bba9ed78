//! Fits a mesh to the alarm clock's views, or to a folder, zip or transforms.json of your own.
//!
//! `cargo run --release -p unsphere-recon --example fit_views -- [views] [mesh.glb]`

use std::{io::Write, path::Path};

use datasets::{ReadOptions, Views, read_views};
use recon::evaluate::score_views;
use recon::fit::{FitConfig, fit};
use recon::progress::{Event, Watch};
use synth::shapes::AlarmClock;
use synth::{Lighting, Orbit, RenderOptions, render_views};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut out = std::io::stdout();
    let views = if let Some(path) = arguments.first() {
        read_views(Path::new(path), &ReadOptions::default(), &|_, _| {})?
    } else {
        let options = RenderOptions { lighting: Lighting::studio(), ..RenderOptions::default() };
        let cameras = Orbit { count: 40, ..Orbit::default() }.cameras();
        let views = render_views(&AlarmClock::default().build(), &cameras, &options, &|_, _| {})?;
        Views::in_memory(views)
    };
    let mut watch = Watch::new(|event: &Event| {
        let _ = match event {
            Event::Stage { name, facts } => {
                let vertices = facts.get("vertices").unwrap_or_default();
                writeln!(out, "{name}: {vertices} vertices")
            }
            Event::Evaluated { step, metrics, .. } => {
                let mask_iou = metrics[0].value;
                writeln!(out, "  step {step:4}: mask IoU {mask_iou:.4} on held-out views")
            }
            Event::Warned { text } => writeln!(out, "warning: {text}"),
            _ => Ok(()),
        };
    });
    let fitted = fit(&views, &FitConfig::default(), &mut watch)?;
    drop(watch);
    let held_out: Vec<_> = fitted.held_out_views.iter().map(|&i| &views.views[i]).collect();
    let scores = score_views(&fitted.mesh, &held_out, &|_, _| {})?;
    writeln!(out, "mask IoU {:.4}, PSNR {:.1?} dB", scores.mask_iou, scores.psnr)?;
    writeln!(out, "{}", fitted.health)?;
    let path = arguments.get(1).map_or("fitted.glb", String::as_str);
    mesh_core::io::write_mesh(Path::new(path), &fitted.mesh)?;
    writeln!(out, "written to {path}")?;
    Ok(())
}
