//! The contact sheet: what was made, at a glance.

use diff_raster::FacesError;
use mesh_core::vector::widen;
use mesh_core::{ByteImage, Camera, bounds};
use rayon::prelude::*;

use super::config::GenerateConfig;
use super::object::Job;
use crate::{Lighting, RenderOptions, render_view};

/// Objects of a category that are shown.
const COLUMNS: usize = 8;
/// Width and height of each image.
const SIDE: usize = 160;
/// Pixels between images.
const GAP: usize = 4;
const BACKDROP: [f32; 3] = [0.92; 3];

/// A row for each category, its first objects from the same side, in front of a light backdrop.
pub(super) fn draw(config: &GenerateConfig, jobs: &[Job<'_>]) -> Result<ByteImage, FacesError> {
    let mut rows: Vec<Vec<&Job<'_>>> = Vec::new();
    for job in jobs {
        let row = |row: &&mut Vec<&Job<'_>>| row[0].of.category() == job.of.category();
        match rows.last_mut().filter(row) {
            Some(row) if row.len() < COLUMNS => row.push(job),
            Some(_) => {}
            None => rows.push(vec![job]),
        }
    }
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let shown: Vec<(usize, usize, &Job<'_>)> = rows
        .iter()
        .enumerate()
        .flat_map(|(i, row)| row.iter().enumerate().map(move |(j, &job)| (i, j, job)))
        .collect();
    let tiles: Vec<ByteImage> =
        shown.par_iter().map(|(_, _, job)| tile(config, job)).collect::<Result<_, _>>()?;
    let extent = |count: usize| count * SIDE + (count + 1) * GAP;
    let mut sheet = ByteImage::new(extent(rows.len()), extent(columns), 3);
    sheet.data.fill((BACKDROP[0] * 255.0 + 0.5) as u8);
    for ((i, j, _), tile) in shown.iter().zip(&tiles) {
        sheet.paste(tile, [extent(*i), extent(*j)]);
    }
    Ok(sheet)
}

fn tile(config: &GenerateConfig, job: &Job<'_>) -> Result<ByteImage, FacesError> {
    const FOV: f64 = 0.5;
    let (mesh, _) = job.mesh();
    let around = mesh.bounds().unwrap_or_default();
    let (middle, diagonal) = (widen(bounds::center(around)), bounds::diagonal::<f64>(around));
    let distance = 0.5 * diagonal.max(1e-9) / (0.5 * FOV).sin();
    // From the front, its left, and above: what tells most things apart.
    let (azimuth, elevation) = (0.7_f64, 0.4_f64);
    let toward =
        [elevation.cos() * azimuth.sin(), elevation.sin(), elevation.cos() * azimuth.cos()];
    let eye = std::array::from_fn(|k| middle[k] + distance * toward[k]);
    let camera = Camera::look_at(eye, middle, [0.0, 1.0, 0.0], FOV, SIDE, SIDE);
    let options = RenderOptions {
        lighting: if config.lighting.lamps.is_empty() {
            Lighting::studio()
        } else {
            config.lighting.clone()
        },
        background: BACKDROP,
        ..RenderOptions::default()
    };
    Ok(render_view(&mesh, &camera, &options)?.color)
}
