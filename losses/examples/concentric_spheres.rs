//! What the presets say about a sphere that is a little too large, as a chart.
//!
//! `cargo run --release -p unsphere-losses --example concentric_spheres` writes `concentric_spheres.svg` to the
//! folder for temporary files: one line per preset, the error of the radius along x, the figure of merit along y.

#![allow(clippy::print_stdout, reason = "an example shows what it did")]

use std::fmt::Write as _;

use losses::metrics::{Points, Preset, evaluate};
use mesh_core::{TriMesh, primitives::icosphere};

const COLORS: [&str; 4] = ["#c0392b", "#2471a3", "#1e8449", "#9a7d0a"];
const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 50.0;
const BOTTOM: f64 = 40.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let truth = icosphere(4);
    let mut svg = String::new();
    for (preset, color) in Preset::ALL.into_iter().zip(COLORS) {
        let mut protocol = preset.protocol(0);
        if let Some(Points::Surface { samples }) = &mut protocol.points {
            *samples = 5_000; // fewer than published, so that the chart is quick
        }
        println!("{}: {}", preset.name(), protocol.formula);
        let mut line = String::new();
        for percent in 0..=20 {
            let factor = 1.0 + percent as f32 / 100.0;
            let place = |p: &[f32; 3]| p.map(|v| factor * v);
            let prediction =
                TriMesh::new(truth.positions.iter().map(place).collect(), truth.faces.clone());
            let report = evaluate(&prediction, &truth, &protocol)?;
            // The F-score at the widest threshold, or the IoU where there is no F-score.
            let merit = report.f_scores.last().map(|f| f.f_score).or(report.iou).unwrap_or(0.0);
            let x = LEFT + percent as f64 / 20.0 * (WIDTH - LEFT - 90.0);
            write!(line, "{x:.1},{:.1} ", 20.0 + (1.0 - merit) * (HEIGHT - BOTTOM - 20.0))?;
            if percent % 10 == 0 {
                let chamfer = report.chamfer.map_or_else(|| "-".into(), |d| format!("{d:.6}"));
                println!("  radius +{percent:2} %   merit {merit:.3}   chamfer {chamfer}");
            }
        }
        writeln!(svg, "<polyline points='{line}' fill='none' stroke='{color}' stroke-width='2'/>")?;
    }
    let mut page = format!(
        "<svg xmlns='http://www.w3.org/2000/svg' width='{WIDTH}' height='{HEIGHT}' font-family='sans-serif' \
         font-size='12'><rect width='100%' height='100%' fill='white'/>"
    );
    for (i, (preset, color)) in Preset::ALL.into_iter().zip(COLORS).enumerate() {
        let (x, y) = (WIDTH - 80.0, 30.0 + 18.0 * i as f64);
        writeln!(page, "<text x='{x}' y='{y}' fill='{color}'>{}</text>", preset.name())?;
    }
    for (merit, y) in [(1.0, 24.0), (0.0, HEIGHT - BOTTOM)] {
        writeln!(page, "<text x='20' y='{y}'>{merit}</text>")?;
    }
    let y = HEIGHT - 14.0;
    writeln!(
        page,
        "<text x='{LEFT}' y='{y}'>F-score (mcmr: IoU) against radius, 0 to 20 % too large</text>"
    )?;
    writeln!(page, "{svg}</svg>")?;
    let path = std::env::temp_dir().join("concentric_spheres.svg");
    std::fs::write(&path, page)?;
    println!("wrote {}", path.display());
    Ok(())
}
