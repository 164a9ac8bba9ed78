//! Draws a sheet of procedural objects, one row for each family, without a word on it.
//!
//! `cargo run --release -p unsphere-synth --example family_sheet -- [file.png] [families] [count] [seed] [size]`
//!
//! Families are names with commas between them, or `all`; the seed is that of the first column.

use std::io::Write;

use mesh_core::{ByteImage, Camera, write_png};
use synth::shapes::Family;
use synth::{Lighting, RenderOptions, render_view};

/// Azimuths in degrees, taken in turns: mostly three-quarter views of the front.
const AZIMUTHS: [f64; 6] = [38.0, -42.0, 140.0, 55.0, -35.0, -130.0];
const ELEVATION: f64 = 27.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize, default| arguments.get(k).map_or(Ok(default), |text| text.parse());
    let file = arguments.first().map_or("contact_sheet.png", String::as_str);
    let (count, seed, size) = (number(2, 8)?, number(3, 0)?, number(4, 137)?);
    let families: Vec<Family> = match arguments.get(1).map_or("all", String::as_str) {
        "all" => Family::ALL.to_vec(),
        names => names.split(',').map(str::parse::<Family>).collect::<Result<_, _>>()?,
    };

    let background = [0.94, 0.94, 0.93];
    let options = RenderOptions {
        lighting: Lighting::studio(),
        background,
        supersample: 3,
        ..RenderOptions::default()
    };
    let mut sheet = ByteImage::new(families.len() * size, count * size, 3);
    let mut out = std::io::stdout().lock();
    for (row, family) in families.iter().enumerate() {
        for column in 0..count {
            let shape = family.draw((seed + column) as u64);
            let mesh = shape.mesh();
            let camera = camera(AZIMUTHS[column % AZIMUTHS.len()], size);
            let view = render_view(&mesh, &camera, &options)?;
            sheet.paste(&view.color, [row * size, column * size]);
            let traits: Vec<String> =
                shape.traits.iter().map(|(name, value)| format!("{name} {value}")).collect();
            let seed = shape.seed;
            writeln!(out, "{family} {seed}: {} faces, {}", mesh.faces.len(), traits.join(", "))?;
        }
    }
    write_png(file, &sheet)?;
    Ok(())
}

/// Sees all of an object whose box has a diagonal of 1.
fn camera(azimuth: f64, size: usize) -> Camera {
    let (sin, cos) = ELEVATION.to_radians().sin_cos();
    let turn = azimuth.to_radians();
    let eye = [cos * turn.sin(), sin, cos * turn.cos()].map(|v| 1.6 * v);
    Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 32.0_f64.to_radians(), size, size)
}
