//! `docs/views.md` says how `cameras.json` is read.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::path::Path;

use datasets::{ReadOptions, read_views};
use mesh_core::{ByteImage, Lens, encode_png};

/// A mask with a block of object in its middle, and as an image the same.
fn picture() -> Vec<u8> {
    let (width, height) = (64, 48);
    let inside = |at: usize| (16..48).contains(&(at % width)) && (12..36).contains(&(at / width));
    let data = (0..width * height).map(|at| if inside(at) { 255 } else { 0 }).collect();
    encode_png(&ByteImage { width, height, channels: 1, data })
}

#[test]
fn the_example_is_read_as_the_page_says() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/views.md");
    let page = std::fs::read_to_string(page).unwrap();
    let json = page.split("```json\n").nth(1).unwrap().split("```").next().unwrap();
    let place = tempfile::tempdir().unwrap();
    std::fs::create_dir(place.path().join("images")).unwrap();
    std::fs::create_dir(place.path().join("masks")).unwrap();
    std::fs::write(place.path().join("cameras.json"), json).unwrap();
    // The second view's mask is not named: a name of the table.
    for name in ["images/0000.png", "images/0001.png", "masks/0000.png", "masks/0001_mask.png"] {
        std::fs::write(place.path().join(name), picture()).unwrap();
    }
    let views = read_views(place.path(), &ReadOptions::default(), &|_, _| {}).unwrap();
    assert_eq!(views.len(), 2);
    for view in &views.views {
        assert!(view.mask.data[24 * 64 + 32] == 255 && view.mask.data[0] == 0, "{}", view.name);
    }
    let [first, second] = [0, 1].map(|k| &views.views[k].camera);
    assert_eq!(first.lens, Lens::Perspective { fx: 70.0, fy: 70.0, cx: 32.0, cy: 24.0 });
    assert_eq!(second.lens, Lens::Orthographic { sx: 20.0, sy: 20.0, cx: 32.0, cy: 24.0 });
    // The world's origin is four units before the first camera, and what is beside it to the right in the world is right in the image.
    let seen = first.project([1.0, 0.0, 0.0]);
    assert_eq!((seen.column, seen.row, seen.depth), (32.0 + 70.0 / 4.0, 24.0, 4.0));
    // The second camera's rows: the world's -z is to its right.
    assert_eq!((second.rotation[(0, 2)], second.rotation[(2, 0)]), (-1.0, 1.0));
    for name in ["0001_mask.png", "mask_0001.png", "0001_seg.png"] {
        std::fs::remove_dir_all(place.path().join("masks")).unwrap();
        std::fs::create_dir(place.path().join("masks")).unwrap();
        std::fs::write(place.path().join("masks/0000.png"), picture()).unwrap();
        std::fs::write(place.path().join("masks").join(name), picture()).unwrap();
        assert!(
            page.contains(name)
                && read_views(place.path(), &ReadOptions::default(), &|_, _| {}).is_ok()
        );
    }
}
