//! Puts the views of a folder, zip or `transforms.json` on one sheet, masks outlined in green.
//!
//! `cargo run -p unsphere-datasets --example contact_sheet -- <views> [sheet.png]`; without arguments it
//! draws the views of a small scene of its own.

use std::io::Write;
use std::path::Path;

use datasets::{ReadOptions, View, read_views, write_transforms};
use mesh_core::{ByteImage, Camera, Mask, write_png};

const TILE: usize = 128;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let own = tempfile::tempdir()?;
    let source = if let Some(path) = arguments.next() {
        path.into()
    } else {
        write_transforms(&discs(), own.path())?;
        own.path().to_owned()
    };
    let sheet_path = arguments.next().unwrap_or_else(|| "contact_sheet.png".to_owned());

    let options = ReadOptions { max_size: Some(TILE), ..ReadOptions::default() };
    let views = read_views(&source, &options, &|_, _| {})?;
    let columns = (views.len() as f64).sqrt().ceil() as usize;
    let rows = views.len().div_ceil(columns);
    let mut sheet = ByteImage::new(rows * TILE, columns * TILE, 3);
    for (k, view) in views.views.iter().enumerate() {
        draw(view, &mut sheet, (k / columns) * TILE, (k % columns) * TILE);
    }
    write_png(Path::new(&sheet_path), &sheet)?;

    let mut out = std::io::stdout().lock();
    writeln!(out, "{} views, {}, {sheet_path}", views.len(), views.layout)?;
    for warning in &views.warnings {
        writeln!(out, "warning: {warning}")?;
    }
    Ok(())
}

fn draw(view: &View, sheet: &mut ByteImage, top: usize, left: usize) {
    let mut color = view.color.clone();
    let outline = Mask::at_least(&view.mask, 1).outline();
    for (pixel, _) in color.data.chunks_exact_mut(3).zip(outline.data).filter(|(_, on)| *on) {
        pixel.copy_from_slice(&[40, 220, 90]);
    }
    sheet.paste(&color, [top, left]);
}

/// A coloured disc on grey from nine sides.
fn discs() -> Vec<View> {
    (0..9)
        .map(|n| {
            let (sin, cos) = (f64::from(n) * 0.7).sin_cos();
            let camera = Camera::look_at(
                [4.0 * sin, 1.0, 4.0 * cos],
                [0.0; 3],
                [0.0, 1.0, 0.0],
                0.7,
                96,
                96,
            );
            let mut color = ByteImage::new(96, 96, 3);
            let mut mask = ByteImage::new(96, 96, 1);
            for k in 0..96 * 96 {
                let (x, y) = ((k % 96) as f64 - 47.5, (k / 96) as f64 - 47.5);
                let inside = x * x + y * y < 900.0;
                mask.data[k] = if inside { 255 } else { 0 };
                let shade = (2.5 * (x - y) + 120.0) as u8;
                let pixel = if inside { [200, shade, 25 * n as u8] } else { [90, 92, 96] };
                color.data[3 * k..3 * k + 3].copy_from_slice(&pixel);
            }
            View { name: n.to_string(), color, mask, camera, depth: None, crop: None }
        })
        .collect()
}
