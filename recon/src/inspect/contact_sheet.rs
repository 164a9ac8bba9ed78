//! A set of views side by side.

use datasets::View;
use mesh_core::{ByteImage, Mask};

/// Longest side of an image on the sheet.
const TILE: usize = 144;
/// Images on the sheet; of more, evenly chosen ones.
const MOST_TILES: usize = 48;

/// The views in rows, each with the border of its mask in green.
pub(crate) fn contact_sheet(views: &[View]) -> ByteImage {
    let step = views.len().div_ceil(MOST_TILES).max(1);
    let shown: Vec<View> = views.iter().step_by(step).map(|v| v.clone().at_most(TILE)).collect();
    let columns = (shown.len() as f64).sqrt().ceil() as usize;
    let rows = shown.len().div_ceil(columns.max(1));
    let mut sheet = ByteImage::new((rows * TILE).max(1), (columns * TILE).max(1), 3);
    sheet.data.fill(40);
    for (k, view) in shown.iter().enumerate() {
        let top = k / columns * TILE + (TILE - view.color.height) / 2;
        let left = k % columns * TILE + (TILE - view.color.width) / 2;
        sheet.paste(&outlined(view), [top, left]);
    }
    sheet
}

/// The view with the outline of its mask.
fn outlined(view: &View) -> ByteImage {
    let mut color = view.color.to_rgb();
    let outline = Mask::at_least(&view.mask, 1).outline();
    for (pixel, _) in color.data.chunks_exact_mut(3).zip(outline.data).filter(|(_, on)| *on) {
        pixel.copy_from_slice(&[40, 220, 90]);
    }
    color
}
