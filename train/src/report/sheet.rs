//! Model above truth, as one image.

use mesh_core::ByteImage;

use super::ViewPair;

/// Images in a sheet; more make it wide, not clearer.
const MOST_PICTURES: usize = 9;

/// The model above the truth, pair beside pair, all as high as the first.
pub fn sheet(pairs: &[ViewPair]) -> Option<ByteImage> {
    let height = pairs.first()?.model.height;
    let columns: Vec<[ByteImage; 2]> = pairs
        .iter()
        .take(MOST_PICTURES)
        .map(|pair| {
            let width = (pair.model.width * height / pair.model.height.max(1)).max(1);
            [&pair.model, &pair.truth].map(|picture| picture.resized(height, width).to_rgb())
        })
        .collect();
    let width = columns.iter().map(|column| column[0].width).sum();
    let mut sheet = ByteImage::new(2 * height, width, 3);
    let mut left = 0;
    for [model, truth] in &columns {
        sheet.paste(model, [0, left]);
        sheet.paste(truth, [height, left]);
        left += model.width;
    }
    Some(sheet)
}
