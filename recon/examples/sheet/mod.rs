//! Views side by side, as one image.

use datasets::View;
use mesh_core::ByteImage;

/// Objects, so many in a line, each with `K` kinds of views, which lie below one another. All views have one size.
pub(crate) fn sheet<const K: usize>(objects: &[&[Vec<View>; K]], across: usize) -> ByteImage {
    let lines: Vec<Vec<&View>> = objects
        .chunks(across)
        .flat_map(|objects| {
            (0..K).map(|kind| objects.iter().flat_map(|object| &object[kind]).collect())
        })
        .collect();
    let size = lines.iter().flatten().next().map_or([0; 2], |v| [v.color.height, v.color.width]);
    let [height, width] = size;
    let longest = lines.iter().map(Vec::len).max().unwrap_or(0);
    let mut sheet = ByteImage::new(lines.len() * height, longest * width, 3);
    for (row, views) in lines.iter().enumerate() {
        for (column, view) in views.iter().enumerate() {
            sheet.paste(&view.color.to_rgb(), [row * height, column * width]);
        }
    }
    sheet
}
