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
            [&pair.model, &pair.truth].map(|picture| colored(&picture.resized(height, width)))
        })
        .collect();
    let width = columns.iter().map(|column| column[0].width).sum();
    let mut data = Vec::with_capacity(2 * height * width * 3);
    for row in 0..2 {
        for i in 0..height {
            for column in &columns {
                let line = column[row].width * 3;
                data.extend_from_slice(&column[row].data[i * line..(i + 1) * line]);
            }
        }
    }
    Some(ByteImage { height: 2 * height, width, channels: 3, data })
}

/// With three channels, whatever it had.
fn colored(picture: &ByteImage) -> ByteImage {
    let channels = picture.channels;
    let pixel = |p: &[u8]| if channels < 3 { [p[0]; 3] } else { [p[0], p[1], p[2]] };
    let data = picture.data.chunks_exact(channels).flat_map(pixel).collect();
    ByteImage { height: picture.height, width: picture.width, channels: 3, data }
}
