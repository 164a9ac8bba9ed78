//! Renders the alarm clock from all around, into kaolin's layout, with depth and true mesh.
//!
//! `cargo run --release -p unsphere-synth --example alarm_clock_views -- [folder] [views] [size] [seed]`

use std::io::Write;
use std::path::Path;

use synth::shapes::AlarmClock;
use synth::{Lighting, Orbit, RenderOptions, render_views, write_dataset};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize, default| arguments.get(k).map_or(Ok(default), |text| text.parse());
    let folder = arguments.first().map_or("alarm_clock", String::as_str);
    let (count, size, seed) = (number(1, 100)?, number(2, 256)?, number(3, 0)?);

    // Seed 0 is the standard clock; others are drawn.
    let clock = if seed == 0 { AlarmClock::default() } else { AlarmClock::sample(seed as u64) };
    let mesh = clock.build();
    let orbit = Orbit { count, width: size, height: size, ..Orbit::default() };
    let options =
        RenderOptions { lighting: Lighting::studio(), depth: true, ..RenderOptions::default() };
    let start = std::time::Instant::now();
    let views = render_views(&mesh, &orbit.cameras(), &options, &|_, _| {})?;
    let rendered = start.elapsed();
    write_dataset(&views, &mesh, Path::new(folder))?;

    let mut out = std::io::stdout().lock();
    writeln!(out, "{count} views of {} faces: rendered in {rendered:.2?}", mesh.faces.len())?;
    writeln!(out, "written to {folder} after {:.2?}", start.elapsed())?;
    Ok(())
}
