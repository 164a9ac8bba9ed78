//! Damaged models and JSON of every kind: an error or views, quickly and in little memory.
#![allow(clippy::unwrap_used, reason = "tests")]

mod common;
#[path = "../../mesh-core/tests/counting/mod.rs"]
mod counting;

use std::path::{Path, PathBuf};

use common::ball;
use counting::{LIMIT, alone, peak};
use datasets::{Colmap, ColmapForm, ReadOptions, open, read_views, write_colmap, write_photos};
use proptest::prelude::*;
use serde_json::json;

/// Opens and reads whatever is at the path, every object, with truth and points.
fn read_everything(path: &Path) {
    let (most, ()) = peak(|| {
        let options = ReadOptions { depth: true, ..ReadOptions::default() };
        let _ = read_views(path, &options, &|_, _| {});
        if let Ok(dataset) = open(path) {
            for object in 0..dataset.entries().len() {
                let _ = dataset.truth(object);
            }
        }
        if let Ok(colmap) = Colmap::open(path) {
            let _ = colmap.points();
        }
    });
    assert!(most < LIMIT, "{} bytes for {}", most, path.display());
}

/// A project of each kind, with the files of each that can be damaged.
fn projects() -> Vec<(tempfile::TempDir, Vec<PathBuf>)> {
    let views = ball(2);
    let mut made = Vec::new();
    for form in [ColmapForm::Text, ColmapForm::Binary] {
        let folder = tempfile::tempdir().unwrap();
        write_colmap(&views, folder.path(), form).unwrap();
        // COLMAP's own points, of which ours have none.
        let end = if form == ColmapForm::Text { ("text", "txt") } else { ("binary", "bin") };
        let points = format!("points3D.{}", end.1);
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/colmap");
        let target = folder.path().join("sparse/0").join(&points);
        std::fs::copy(fixtures.join(end.0).join(&points), target).unwrap();
        let files = ["cameras", "images", "points3D"];
        let files = files.map(|f| folder.path().join(format!("sparse/0/{f}.{}", end.1)));
        let depth = folder.path().join("stereo/depth_maps/0000.png.geometric.bin");
        made.push((folder, [&files[..], &[depth]].concat()));
    }
    let folder = tempfile::tempdir().unwrap();
    write_photos(&views, folder.path()).unwrap();
    let files = ["cameras.json", "depth/0001.exr", "masks/0000.png"];
    let files = files.map(|f| folder.path().join(f)).to_vec();
    made.push((folder, files));
    let folder = tempfile::tempdir().unwrap();
    let files = bop_scene(folder.path());
    made.push((folder, files));
    made
}

/// A scene of one object in two images.
fn bop_scene(folder: &Path) -> Vec<PathBuf> {
    for noun in ["rgb", "mask_visib"] {
        std::fs::create_dir_all(folder.join(noun)).unwrap();
    }
    let (mut cameras, mut poses, mut info) = (json!({}), json!({}), json!({}));
    for (i, view) in ball(2).iter().enumerate() {
        let cv = view.camera.to_opencv().unwrap();
        let k: Vec<f64> = cv.intrinsics.iter().flatten().copied().collect();
        let r: Vec<f64> = cv.rotation.iter().flatten().copied().collect();
        let key = i.to_string();
        cameras[&key] = json!({ "cam_K": k, "depth_scale": 1.0 });
        let pose = json!({ "obj_id": 1, "cam_R_m2c": r, "cam_t_m2c": cv.translation });
        poses[&key] = json!([pose]);
        info[&key] = json!([{ "visib_fract": 1.0 }]);
        mesh_core::write_png(folder.join(format!("rgb/{i:06}.png")), &view.color).unwrap();
        let mask = folder.join(format!("mask_visib/{i:06}_000000.png"));
        mesh_core::write_png(mask, &view.mask).unwrap();
    }
    [("scene_camera.json", cameras), ("scene_gt.json", poses), ("scene_gt_info.json", info)]
        .into_iter()
        .map(|(name, value)| {
            let path = folder.join(name);
            std::fs::write(&path, value.to_string()).unwrap();
            path
        })
        .collect()
}

#[test]
fn files_cut_anywhere_are_errors_or_views() {
    let _turn = alone();
    for (folder, files) in projects() {
        read_views(folder.path(), &ReadOptions::default(), &|_, _| {}).unwrap();
        for file in files {
            let whole = std::fs::read(&file).unwrap();
            for length in 0..whole.len() {
                std::fs::write(&file, &whole[..length]).unwrap();
                read_everything(folder.path());
            }
            std::fs::write(&file, &whole).unwrap();
        }
    }
}

#[test]
fn counts_that_claim_the_world_cost_nothing() {
    let _turn = alone();
    for (folder, files) in projects() {
        for file in files {
            let whole = std::fs::read(&file).unwrap();
            for at in 0..whole.len().saturating_sub(8).min(96) {
                for claim in [u64::MAX, 1 << 40, 1 << 31] {
                    let mut bytes = whole.clone();
                    bytes[at..at + 8].copy_from_slice(&claim.to_le_bytes());
                    std::fs::write(&file, bytes).unwrap();
                    // Most are the same story as their neighbours.
                    if (at + claim.count_ones() as usize).is_multiple_of(5) || at < 16 {
                        read_everything(folder.path());
                    }
                }
            }
            std::fs::write(&file, &whole).unwrap();
        }
    }
}

#[test]
fn numbers_that_cannot_be_meant_are_named() {
    let _turn = alone();
    for (folder, files) in projects() {
        for file in files {
            let Ok(text) = String::from_utf8(std::fs::read(&file).unwrap()) else { continue };
            for absurd in ["1e999", "-1", "0", "NaN", "99999999999999999999", "\"x\"", ""] {
                let digits: Vec<usize> =
                    text.match_indices(|c: char| c.is_ascii_digit()).map(|(at, _)| at).collect();
                for &at in digits.iter().step_by((digits.len() / 12).max(1)) {
                    let spoilt = format!("{}{absurd}{}", &text[..at], &text[at + 1..]);
                    std::fs::write(&file, spoilt).unwrap();
                    read_everything(folder.path());
                }
            }
            std::fs::write(&file, &text).unwrap();
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn changed_bytes_are_errors_or_views(
        project in 0usize..4,
        file in 0usize..4,
        changes in prop::collection::vec((0usize..100_000, any::<u8>()), 1..6),
    ) {
        let _turn = alone();
        let (folder, files) = projects().swap_remove(project);
        let file = &files[file % files.len()];
        let mut bytes = std::fs::read(file).unwrap();
        for (at, byte) in changes {
            let at = at % bytes.len();
            bytes[at] = byte;
        }
        std::fs::write(file, bytes).unwrap();
        read_everything(folder.path());
    }
}
