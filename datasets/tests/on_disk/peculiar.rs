//! What other programs and systems want of files, and what they leave in folders.

use crate::common::{ball, kaolin_folder, read};
use datasets::{ReadOptions, read_views};
use mesh_core::write_png;

/// kaolin's `import_synthetic_view` takes `asset_transforms[0][1]`.
#[test]
fn kaolin_finds_the_transform_that_it_asks_for() {
    let folder = kaolin_folder(2);
    let text = std::fs::read_to_string(folder.path().join("1_metadata.json")).unwrap();
    let metadata: serde_json::Value = serde_json::from_str(&text).unwrap();
    let rows: Vec<Vec<f64>> =
        serde_json::from_value(metadata["asset_transforms"][0][1].clone()).unwrap();
    let identity = |i: usize| (0..4).map(|j| f64::from(u8::from(i == j))).collect();
    assert_eq!(rows, (0..4).map(identity).collect::<Vec<Vec<f64>>>());
}

#[test]
fn kaolins_own_masks_need_not_be_there_where_others_are_named() {
    let folder = kaolin_folder(3);
    std::fs::remove_file(folder.path().join("1_semantic.npy")).unwrap();
    assert!(read(folder.path()).unwrap_err().to_string().contains("1_semantic.npy"));
    let masks = tempfile::tempdir().unwrap();
    for (i, view) in ball(3).iter().enumerate() {
        write_png(masks.path().join(format!("{i}_rgb.png")), &view.mask).unwrap();
    }
    let options = ReadOptions { masks: Some(masks.path().into()), ..ReadOptions::default() };
    let views = read_views(folder.path(), &options, &|_, _| {}).unwrap().views;
    assert_eq!(views[1].mask, ball(3)[1].mask);
}
