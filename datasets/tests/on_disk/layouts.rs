//! Every layout: what is written is read, and the variants that people have.

use std::sync::atomic::{AtomicUsize, Ordering};

use crate::common::{ball, edit_json, kaolin_folder, read, transforms_folder, zipped};
use datasets::{Layout, MaskSource, ReadOptions, View, read_views};
use mesh_core::{ByteImage, write_png};
use serde_json::{Value, json};

fn assert_same(read: &[View], written: &[View], depth: bool) {
    assert_eq!(read.len(), written.len());
    for (a, b) in read.iter().zip(written) {
        assert_eq!((&a.color, &a.mask), (&b.color, &b.mask));
        assert!((a.camera.rotation - b.camera.rotation).abs().max() < 1e-12);
        assert!((a.camera.translation - b.camera.translation).abs().max() < 1e-12);
        for p in [[0.3, 0.2, -0.5], [1.0, -1.0, 0.4]] {
            let (p, q) = (a.camera.project(p), b.camera.project(p));
            assert!((p.column - q.column).abs() + (p.row - q.row).abs() < 1e-9);
        }
        assert_eq!(a.depth, if depth { b.depth.clone() } else { None });
    }
}

fn with_depth() -> ReadOptions {
    ReadOptions { depth: true, ..ReadOptions::default() }
}

#[test]
fn kaolin_folders_and_zips_round_trip() {
    let (folder, written) = (kaolin_folder(12), ball(12));
    let views = read(folder.path()).unwrap();
    assert_eq!(views.layout, Layout::KaolinFolder);
    assert!(views.warnings.is_empty(), "{:?}", views.warnings);
    // In the order of the numbers: 10 after 9.
    assert_eq!(views.views[10].name, "10");
    assert_same(&views.views, &written, false);
    let (_keep, zip) = zipped(folder.path());
    let done = AtomicUsize::new(0);
    let views = read_views(&zip, &with_depth(), &|_, total| {
        assert_eq!(total, 12);
        done.fetch_add(1, Ordering::Relaxed);
    })
    .unwrap();
    assert_eq!((views.layout, done.into_inner()), (Layout::KaolinZip, 12));
    assert_same(&views.views, &written, true);
}

#[test]
fn transforms_round_trip_off_center_and_with_unequal_focal_lengths() {
    let mut written = ball(4);
    for view in &mut written {
        view.camera.lens = mesh_core::Lens::Perspective { fx: 38.0, fy: 35.0, cx: 21.5, cy: 14.25 };
    }
    let folder = tempfile::tempdir().unwrap();
    datasets::write_transforms(&written, folder.path()).unwrap();
    for path in [folder.path().to_owned(), folder.path().join("transforms.json")] {
        let views = read_views(&path, &with_depth(), &|_, _| {}).unwrap();
        assert_eq!(views.layout, Layout::Transforms);
        assert_same(&views.views, &written, true);
    }
    // kaolin's metadata cannot say such a lens, and says so.
    let error = datasets::write_kaolin(&written, folder.path()).unwrap_err().to_string();
    assert!(error.contains("0_metadata.json") && error.contains("kaolin"), "{error}");
}

#[test]
fn views_that_are_kept_for_tests_stay_so_when_they_are_written() {
    let folder = tempfile::tempdir().unwrap();
    datasets::write_transforms_split(&ball(5), &[1, 4], folder.path()).unwrap();
    let views = read(folder.path()).unwrap();
    assert_eq!((views.len(), &views.test[..]), (5, &[1, 4][..]));
    // nerfstudio refuses a file that has some of its three lists and not all.
    let text = std::fs::read(folder.path().join("transforms.json")).unwrap();
    let value: Value = serde_json::from_slice(&text).unwrap();
    assert_eq!(value["val_filenames"], json!(["images/0001.png", "images/0004.png"]));
    assert_eq!(value["train_filenames"].as_array().unwrap().len(), 3);
    datasets::write_transforms(&ball(5), folder.path()).unwrap();
    assert!(read(folder.path()).unwrap().test.is_empty());
}

#[test]
fn one_angle_of_view_is_enough() {
    let folder = transforms_folder(2);
    let json = folder.path().join("transforms.json");
    let known = read(&json).unwrap();
    let angles = known.views[0].camera.fov().unwrap();
    for (k, key) in ["camera_angle_x", "camera_angle_y"].into_iter().enumerate() {
        edit_json(&json, |value| {
            let other = ["camera_angle_y", "camera_angle_x"][k];
            value.as_object_mut().unwrap().remove(other);
            value[key] = json!(angles[k]);
            for frame in value["frames"].as_array_mut().unwrap() {
                frame.as_object_mut().unwrap().remove("fl_x");
                frame.as_object_mut().unwrap().remove("fl_y");
            }
        });
        for (view, known) in read(&json).unwrap().views.iter().zip(&known.views) {
            let [a, b] = [view, known].map(|view| view.camera.fov().unwrap());
            assert!((a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-9, "{key}: {a:?} {b:?}");
        }
    }
}

#[test]
fn a_world_that_nerfstudio_turned_is_said_to_be_another() {
    let folder = transforms_folder(2);
    let json = folder.path().join("transforms.json");
    let known = read(&json).unwrap();
    edit_json(&json, |value| {
        value["applied_transform"] = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]);
        value["applied_scale"] = json!(1.0);
    });
    assert!(read(&json).unwrap().warnings.is_empty());
    edit_json(&json, |value| {
        value["applied_transform"] = json!([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]]);
    });
    let views = read(&json).unwrap();
    assert!(views.views == known.views);
    let said = &views.warnings[0];
    assert!(said.contains("applied_transform: a mesh") && said.contains("COLMAP"), "{said}");
}

/// NeRF-synthetic: RGBA without extensions, one angle, three files of a split.
#[test]
fn the_layout_of_nerf_is_read_with_whatever_splits_there_are() {
    let views = ball(4);
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("train")).unwrap();
    std::fs::create_dir(folder.path().join("test")).unwrap();
    let angle = views[0].camera.fov().unwrap()[0];
    let frame = |i: usize, split: &str| {
        let view = &views[i];
        let rgba = ByteImage {
            channels: 4,
            data: (0..view.mask.data.len())
                .flat_map(|k| {
                    let c = &view.color.data[3 * k..3 * k + 3];
                    [c[0], c[1], c[2], view.mask.data[k]]
                })
                .collect(),
            ..view.color
        };
        write_png(folder.path().join(format!("{split}/r_{i}.png")), &rgba).unwrap();
        json!({ "file_path": format!("./{split}/r_{i}"), "transform_matrix": view.camera.to_opengl() })
    };
    let put = |split: &str, frames: Vec<Value>| {
        let text = json!({ "camera_angle_x": angle, "frames": frames }).to_string();
        std::fs::write(folder.path().join(format!("transforms_{split}.json")), text).unwrap();
    };
    put("train", vec![frame(0, "train"), frame(1, "train")]);
    put("test", vec![frame(2, "test"), frame(3, "test")]);
    let read_back = read(folder.path()).unwrap();
    assert_same(&read_back.views, &views, false);
    assert_eq!(read_back.views[2].name, "test/r_2");
    // One file alone is its own set of views.
    assert_eq!(read(&folder.path().join("transforms_test.json")).unwrap().len(), 2);
    // Alpha of a background: the other polarity.
    let inverted = ReadOptions { invert: true, ..ReadOptions::default() };
    let inverted = read_views(folder.path(), &inverted, &|_, _| {}).unwrap();
    assert!(inverted.views[0].mask.data.iter().zip(&views[0].mask.data).all(|(a, b)| a + b == 255));
    // A plain backdrop says the same as alpha.
    let backdrop = MaskSource::Backdrop { color: None, tolerance: 12 };
    let options = ReadOptions { mask: backdrop, ..ReadOptions::default() };
    assert_same(&read_views(folder.path(), &options, &|_, _| {}).unwrap().views, &views, false);
}

#[test]
fn a_frame_wins_over_the_whole_file() {
    let folder = transforms_folder(2);
    let json = folder.path().join("transforms.json");
    edit_json(&json, |value| {
        value["fl_x"] = json!(11.0);
        value["cx"] = json!(3.0);
        let first = value["frames"][0].as_object_mut().unwrap();
        first.remove("fl_x");
        first.remove("cx");
    });
    let views = read(&json).unwrap();
    let lens = |i: usize| match views.views[i].camera.lens {
        mesh_core::Lens::Perspective { fx, cx, .. } => (fx, cx),
        mesh_core::Lens::Orthographic { .. } => unreachable!("transforms.json has no such lens"),
    };
    assert_eq!(lens(0), (11.0, 3.0));
    assert_eq!(lens(1).1, 20.0);
}

#[test]
fn intrinsics_of_larger_pictures_are_scaled() {
    let folder = transforms_folder(1);
    let json = folder.path().join("transforms.json");
    let before = read(&json).unwrap();
    edit_json(&json, |value| {
        for key in ["w", "h", "fl_x", "fl_y", "cx", "cy"] {
            let number = value["frames"][0][key].as_f64().unwrap();
            value["frames"][0][key] = json!(number * 4.0);
        }
    });
    assert_same(&read(&json).unwrap().views, &before.views, false);
}

#[test]
fn masks_beside_the_images_are_found() {
    let folder = transforms_folder(2);
    let json = folder.path().join("transforms.json");
    edit_json(&json, |value| {
        for frame in value["frames"].as_array_mut().unwrap() {
            frame.as_object_mut().unwrap().remove("mask_path");
        }
    });
    assert_same(&read(&json).unwrap().views, &ball(2), false);
}

#[test]
fn views_are_read_smaller_when_asked() {
    let folder = kaolin_folder(3);
    let options = ReadOptions { max_size: Some(20), depth: true, ..ReadOptions::default() };
    let views = read_views(folder.path(), &options, &|_, _| {}).unwrap();
    let (small, large) = (&views.views[0], &ball(3)[0]);
    assert_eq!((small.camera.width, small.camera.height), (20, 15));
    assert_eq!((small.color.width, small.color.height), (20, 15));
    assert!((4 * small.mask_pixels()).abs_diff(large.mask_pixels()) < large.mask_pixels() / 8);
    let (p, q) = (small.camera.project([0.5; 3]), large.camera.project([0.5; 3]));
    assert!((2.0 * p.column - q.column).abs() < 1e-9);
    assert_eq!(small.depth.as_ref().unwrap().data.len(), 300);
    assert_eq!(views.bytes(), 3 * 300 * 8);
}

#[test]
fn kaolin_labels_of_any_number_type_are_masks() {
    let folder = kaolin_folder(1);
    let mask = &ball(1)[0].mask;
    for (descr, size) in [("|u1", 1), ("|b1", 1), ("<i8", 8), ("<f4", 4), ("<f8", 8)] {
        let header =
            format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (30, 40), }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend_from_slice(&(header.len() as u16).to_le_bytes());
        bytes.extend_from_slice(header.as_bytes());
        for &m in &mask.data {
            let one: Vec<u8> = match (descr, m != 0) {
                ("<f4", on) => f32::from(on).to_le_bytes().to_vec(),
                ("<f8", on) => f64::from(on).to_le_bytes().to_vec(),
                (_, on) => u64::from(on).to_le_bytes()[..size].to_vec(),
            };
            bytes.extend_from_slice(&one);
        }
        std::fs::write(folder.path().join("0_semantic.npy"), bytes).unwrap();
        assert_eq!(&read(folder.path()).unwrap().views[0].mask, mask, "{descr}");
    }
}

#[test]
fn pictures_without_masks_are_read_when_masks_do_not_matter() {
    let folder = kaolin_folder(3);
    for i in 0..3 {
        std::fs::remove_file(folder.path().join(format!("{i}_semantic.npy"))).unwrap();
    }
    let options = ReadOptions { mask: MaskSource::Whole, ..ReadOptions::default() };
    let views = read_views(folder.path(), &options, &|_, _| {}).unwrap();
    assert!(views.views.iter().all(|v| v.mask_pixels() == 1200) && views.warnings.is_empty());
}

#[test]
fn views_without_their_files_are_left_out_when_allowed() {
    let folder = kaolin_folder(6);
    for name in ["2_rgb.png", "3_rgb.png", "3_semantic.npy", "3_metadata.json"] {
        std::fs::remove_file(folder.path().join(name)).unwrap();
    }
    let options = ReadOptions { allow_missing: true, ..ReadOptions::default() };
    let views = read_views(folder.path(), &options, &|_, _| {}).unwrap();
    let names: Vec<_> = views.views.iter().map(|v| v.name.as_str()).collect();
    assert_eq!(names, ["0", "1", "4", "5"]);
    assert_eq!(views.warnings.len(), 2, "{:?}", views.warnings);
}

#[test]
fn a_view_whose_mask_is_named_and_missing_is_left_out_when_allowed() {
    let folder = transforms_folder(4);
    std::fs::remove_file(folder.path().join("masks/0002.png")).unwrap();
    let error = read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("0002.png: is missing") && error.contains("--allow-missing"), "{error}");
    let options = ReadOptions { allow_missing: true, ..ReadOptions::default() };
    let views = read_views(folder.path(), &options, &|_, _| {}).unwrap();
    assert_eq!(views.len(), 3);
    let warning = &views.warnings[0];
    // Who has left it out is not told to.
    assert!(warning.contains("0002.png") && !warning.contains("--allow-missing"), "{warning}");
}

#[test]
#[ignore = "needs UNSPHERE_DATA"]
fn the_real_clock_is_read_from_folder_and_zip() {
    let data = std::path::PathBuf::from(std::env::var("UNSPHERE_DATA").unwrap());
    let folder = data.join("rendered_clock/views_256");
    let zip = data.join("rendered_clock/rendered_clock.zip");
    for (path, size, layout) in
        [(folder, 256, Layout::KaolinFolder), (zip, 1024, Layout::KaolinZip)]
    {
        let views = read(&path).unwrap();
        assert_eq!((views.len(), views.layout), (100, layout));
        assert!(views.warnings.is_empty(), "{:?}", views.warnings);
        for view in &views.views {
            assert_eq!((view.color.width, view.color.height), (size, size));
            let share = view.mask_pixels() as f64 / (size * size) as f64;
            assert!((0.005..0.3).contains(&share), "view {}: {share}", view.name);
        }
    }
}
