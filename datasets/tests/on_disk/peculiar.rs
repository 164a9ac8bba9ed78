//! What other programs and systems want of files, and what they leave in folders.

use std::io::Write as _;

use crate::common::{ball, edit_json, kaolin_folder, read, transforms_folder};
use datasets::{ColmapForm, ReadOptions, read_views, write_colmap};
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

/// What an unpacked zip of macOS leaves: one folder, and clutter beside it and within.
#[test]
fn clutter_beside_the_views_does_not_count() {
    let inner = kaolin_folder(3);
    let outer = tempfile::tempdir().unwrap();
    let scene = outer.path().join("scene");
    std::fs::create_dir(&scene).unwrap();
    for entry in std::fs::read_dir(inner.path()).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), scene.join(entry.file_name())).unwrap();
    }
    std::fs::create_dir_all(outer.path().join("__MACOSX/scene")).unwrap();
    for name in [".DS_Store", "._scene", "scene/._0_rgb.png", "__MACOSX/scene/._0_rgb.png"] {
        std::fs::write(outer.path().join(name), b"clutter").unwrap();
    }
    assert_eq!(read(outer.path()).unwrap().len(), 3);
    // Images that are found by being there are not joined by what macOS has beside each.
    for view in 0..3 {
        let name = format!("{view}_rgb.png");
        let photos = outer.path().join("photos");
        std::fs::create_dir_all(&photos).unwrap();
        std::fs::copy(scene.join(&name), photos.join(&name)).unwrap();
        std::fs::write(photos.join(format!("._{name}")), b"clutter").unwrap();
    }
    let table =
        datasets::Turntable { count: 3, elevation: 0.0, distance: 3.0, fov: 40.0, reverse: false };
    let options = ReadOptions {
        turntable: Some(table),
        mask: datasets::MaskSource::Whole,
        ..ReadOptions::default()
    };
    assert_eq!(read_views(&outer.path().join("photos"), &options, &|_, _| {}).unwrap().len(), 3);
}

#[test]
fn names_that_windows_wrote_are_found() {
    let folder = transforms_folder(2);
    edit_json(&folder.path().join("transforms.json"), |value| {
        for frame in value["frames"].as_array_mut().unwrap() {
            for key in ["file_path", "mask_path", "depth_file_path"] {
                let name = frame[key].as_str().unwrap().replace('/', "\\");
                frame[key] = format!(".\\{name}").into();
            }
        }
    });
    let options = ReadOptions { depth: true, ..ReadOptions::default() };
    let expected = ball(2);
    let assert_read = |path: &std::path::Path| {
        let views = read_views(path, &options, &|_, _| {}).unwrap().views;
        assert_eq!((views.len(), views[1].name.as_str()), (2, "images/0001"));
        assert_eq!((&views[1].mask, &views[1].depth), (&expected[1].mask, &expected[1].depth));
    };
    assert_read(folder.path());
    // Entries of an archive that Windows made, all in one folder.
    let archive = folder.path().join("scene.zip");
    let mut zip = zip::ZipWriter::new(std::fs::File::create(&archive).unwrap());
    for name in ["transforms.json", "images/0000.png", "images/0001.png", "masks/0000.png"]
        .into_iter()
        .chain(["masks/0001.png", "depth/0000.exr", "depth/0001.exr"])
    {
        let entry = format!("scene\\{}", name.replace('/', "\\"));
        zip.start_file(entry, zip::write::SimpleFileOptions::default()).unwrap();
        zip.write_all(&std::fs::read(folder.path().join(name)).unwrap()).unwrap();
    }
    zip.finish().unwrap();
    assert_read(&archive);
    // No way out of the folder.
    edit_json(&folder.path().join("transforms.json"), |value| {
        value["frames"][0]["file_path"] = "..\\..\\..\\0.png".into();
    });
    assert!(read(folder.path()).unwrap_err().to_string().contains("lies outside"));
}

#[test]
fn masks_of_labels_say_what_they_hold() {
    let folder = transforms_folder(3);
    let masks = tempfile::tempdir().unwrap();
    for (i, view) in ball(3).iter().enumerate() {
        let mut labels = view.mask.clone();
        labels
            .data
            .iter_mut()
            .enumerate()
            .for_each(|(k, m)| *m = if *m > 0 { 7 } else { k as u8 % 3 });
        write_png(folder.path().join(format!("masks/{i:04}.png")), &labels).unwrap();
        write_png(masks.path().join(format!("{i:04}.png")), &labels).unwrap();
    }
    let apart = ReadOptions { masks: Some(masks.path().into()), ..ReadOptions::default() };
    for options in [ReadOptions::default(), apart] {
        let error = read_views(folder.path(), &options, &|_, _| {}).unwrap_err().to_string();
        assert!(error.contains("largest value in their files is 7"), "{error}");
    }
}

#[test]
fn larger_models_of_colmap_are_named() {
    let folder = tempfile::tempdir().unwrap();
    write_colmap(&ball(5), folder.path(), ColmapForm::Binary).unwrap();
    std::fs::rename(folder.path().join("sparse/0"), folder.path().join("sparse/2")).unwrap();
    write_colmap(&ball(2), folder.path(), ColmapForm::Text).unwrap();
    std::fs::create_dir(folder.path().join("sparse/1")).unwrap();
    std::fs::write(folder.path().join("sparse/1/images.bin"), b"damaged").unwrap();
    let views = read(folder.path()).unwrap();
    assert_eq!(views.len(), 2);
    let warning = views.warnings.join(" ");
    assert!(warning.contains("sparse/2 has a model of 5 images, sparse/0 of 2"), "{warning}");
    assert_eq!(read(&folder.path().join("sparse/2")).unwrap().len(), 5);
    // The first is the largest as a rule.
    write_colmap(&ball(5), folder.path(), ColmapForm::Binary).unwrap();
    assert!(read(folder.path()).unwrap().warnings.is_empty());
}

#[test]
fn what_is_written_over_does_not_shine_through() {
    let without_depth = |count: usize| {
        let mut views = ball(count);
        for view in &mut views {
            view.depth = None;
        }
        views
    };
    let options = ReadOptions { depth: true, ..ReadOptions::default() };
    let folder = kaolin_folder(5);
    let stranger = folder.path().join("12_notes.txt");
    std::fs::write(&stranger, b"not ours").unwrap();
    datasets::write_kaolin(&without_depth(3), folder.path()).unwrap();
    let views = read_views(folder.path(), &options, &|_, _| {}).unwrap().views;
    assert!(views.len() == 3 && views.iter().all(|view| view.depth.is_none()));
    assert!(stranger.exists() && !folder.path().join("4_depth.exr").exists());
    let folder = tempfile::tempdir().unwrap();
    write_colmap(&ball(3), folder.path(), ColmapForm::Binary).unwrap();
    write_colmap(&without_depth(3), folder.path(), ColmapForm::Binary).unwrap();
    let views = read_views(folder.path(), &options, &|_, _| {}).unwrap().views;
    assert!(views.iter().all(|view| view.depth.is_none()));
}
