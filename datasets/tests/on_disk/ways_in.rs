//! What people's folders are like: masks elsewhere and under other names, splits, poses of other tools, whole numbers as depth.

use std::path::Path;

use crate::common::{ball, edit_json, orient, read, transforms_folder};
use datasets::{
    CameraAxes, ColmapForm, MaskSource, PoseDirection, ReadOptions, View, ViewsProblem, read_views,
    write_colmap,
};
use mesh_core::{Camera, write_png};
use serde_json::json;

fn read_with(
    path: &Path,
    options: &ReadOptions,
) -> Result<datasets::Views, datasets::ReadViewsError> {
    read_views(path, options, &|_, _| ())
}

/// A folder of transforms whose masks lie in another one, under the names that `name` gives them.
fn with_masks_apart(count: usize, name: impl Fn(usize) -> String) -> [tempfile::TempDir; 2] {
    let folder = transforms_folder(count);
    let masks = tempfile::tempdir().unwrap();
    for i in 0..count {
        let from = folder.path().join(format!("masks/{i:04}.png"));
        std::fs::copy(&from, masks.path().join(name(i))).unwrap();
        std::fs::remove_file(from).unwrap();
    }
    edit_json(&folder.path().join("transforms.json"), |value| {
        for frame in value["frames"].as_array_mut().unwrap() {
            frame.as_object_mut().unwrap().remove("mask_path");
        }
    });
    [folder, masks]
}

#[test]
fn masks_of_another_folder_are_found_under_the_names_that_people_use() {
    let written = ball(3);
    let names: [fn(usize) -> String; 5] = [
        |i| format!("{i:04}.png"),
        |i| format!("{i:04}.png.png"),
        |i| format!("{i:04}_mask.png"),
        |i| format!("{i:04}_seg.png"),
        |i| format!("mask_{i:04}.png"),
    ];
    for name in names {
        let [folder, masks] = with_masks_apart(3, name);
        let options = ReadOptions { masks: Some(masks.path().into()), ..ReadOptions::default() };
        let views = read_with(folder.path(), &options).unwrap();
        for (a, b) in views.views.iter().zip(&written) {
            assert_eq!(a.mask, b.mask, "{}", name(0));
        }
        // Under the same names beside the images they need no option.
        std::fs::create_dir_all(folder.path().join("masks")).unwrap();
        for i in 0..3 {
            let to = folder.path().join("masks").join(name(i));
            std::fs::copy(masks.path().join(name(i)), to).unwrap();
        }
        assert_eq!(read(folder.path()).unwrap().views[2].mask, written[2].mask, "{}", name(0));
    }
}

#[test]
fn a_missing_mask_says_where_it_was_looked_for_and_may_be_left_out() {
    let [folder, masks] = with_masks_apart(4, |i| format!("{i:04}.png"));
    std::fs::remove_file(masks.path().join("0002.png")).unwrap();
    let options = ReadOptions { masks: Some(masks.path().into()), ..ReadOptions::default() };
    let error = read_with(folder.path(), &options).unwrap_err();
    assert_eq!(error.field_name(), Some("mask"));
    let text = error.to_string();
    let place = masks.path().display().to_string();
    for word in [place.as_str(), "0002.png", "0002_mask.png", "allow missing"] {
        assert!(text.contains(word), "{word}: {text}");
    }
    let lenient = ReadOptions { allow_missing: true, ..options };
    let views = read_with(folder.path(), &lenient).unwrap();
    assert_eq!(views.len(), 3);
    let warning = views.warnings.iter().find(|w| w.contains("0002.png")).unwrap();
    assert!(!warning.contains("--allow-missing"), "{warning}");
    // The same beside the images, and none at all is an error however lenient.
    let text = read(folder.path()).unwrap_err().to_string();
    assert!(text.contains("masks") && text.contains("0000_seg.png"), "{text}");
    let none = ReadOptions { allow_missing: true, ..ReadOptions::default() };
    assert_eq!(read_with(folder.path(), &none).unwrap_err().field_name(), Some("masks"));
}

#[test]
fn a_busy_background_is_refused_by_name() {
    let [folder, _masks] = with_masks_apart(2, |i| format!("{i:04}.png"));
    for i in 0..2 {
        let path = folder.path().join(format!("images/{i:04}.png"));
        let mut image = mesh_core::read_image(&path).unwrap();
        for (k, value) in image.data.iter_mut().enumerate() {
            *value = ((k * 7919) % 251) as u8;
        }
        write_png(&path, &image).unwrap();
    }
    let mask = MaskSource::Backdrop { color: None, tolerance: 24 };
    let options = ReadOptions { mask, ..ReadOptions::default() };
    let error = read_with(folder.path(), &options).unwrap_err();
    assert!(matches!(error.problem, ViewsProblem::BusyBackdrop { .. }), "{error}");
    assert!(error.to_string().contains("% of the border"), "{error}");
}

#[test]
fn bars_are_found_in_the_pixels_of_the_files() {
    let [folder, _masks] = with_masks_apart(10, |i| format!("{i:04}.png"));
    let written = ball(10);
    for (i, view) in written.iter().enumerate() {
        let mut image = view.color.clone();
        let (width, height) = (image.width, image.height);
        let bar = height / 8;
        for (k, pixel) in image.data.chunks_exact_mut(3).enumerate() {
            let row = k / width;
            let is_bar = row < bar || row + bar >= height;
            if is_bar || view.mask.data[k] == 0 {
                pixel.fill(if is_bar { 0 } else { 128 });
            }
        }
        write_png(folder.path().join(format!("images/{i:04}.png")), &image).unwrap();
    }
    let mask = MaskSource::Backdrop { color: None, tolerance: 24 };
    let share = |view: &View| {
        view.mask.data.iter().filter(|m| **m != 0).count() as f64 / view.mask.data.len() as f64
    };
    let whole = read_with(folder.path(), &ReadOptions { mask, ..ReadOptions::default() }).unwrap();
    let options = ReadOptions { mask, max_size: Some(20), ..ReadOptions::default() };
    let small = read_with(folder.path(), &options).unwrap();
    for ((whole, small), view) in whole.views.iter().zip(&small.views).zip(&written) {
        assert!((share(whole) - share(view)).abs() < 0.03, "{}", share(whole));
        assert!((share(small) - share(view)).abs() < 0.05, "{}", share(small));
    }
    // Not one of those that are looked at for bars.
    let only = Some(vec!["0003".to_owned()]);
    let one = read_with(folder.path(), &ReadOptions { mask, only, ..ReadOptions::default() });
    assert!(one.unwrap().views[0].mask == whole.views[3].mask);
}

#[test]
fn specks_go_and_holes_are_filled_where_it_is_asked() {
    let [folder, masks] = with_masks_apart(2, |i| format!("{i:04}.png"));
    let path = masks.path().join("0001.png");
    let clean = ball(2)[1].mask.clone();
    let mut dirty = clean.clone();
    dirty.data[0] = 255;
    let middle = (clean.height / 2) * clean.width + clean.width / 2;
    assert_eq!(dirty.data[middle], 255);
    dirty.data[middle] = 0;
    write_png(&path, &dirty).unwrap();
    let options = ReadOptions { masks: Some(masks.path().into()), ..ReadOptions::default() };
    assert_eq!(read_with(folder.path(), &options).unwrap().views[1].mask, dirty);
    let cleaning = ReadOptions { largest_part: true, fill_holes: true, ..options };
    assert_eq!(read_with(folder.path(), &cleaning).unwrap().views[1].mask, clean);
}

#[test]
fn splits_of_nerf_and_nerfstudio_are_kept() {
    let folder = transforms_folder(6);
    let json = folder.path().join("transforms.json");
    let value: serde_json::Value = serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    let name = |i: usize| value["frames"][i]["file_path"].clone();
    // nerfstudio: lists in the one file. Validation gives way to test ..
    edit_json(&json, |v| {
        v["train_filenames"] = json!([name(0), name(2), name(4)]);
        v["val_filenames"] = json!([name(3)]);
        v["test_filenames"] = json!([name(1), name(5)]);
    });
    let views = read(folder.path()).unwrap();
    let names: Vec<&str> = views.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!((names.len(), &views.test[..]), (5, &[1, 4][..]), "{names:?}");
    assert!(views.warnings.iter().any(|w| w.contains("validation")), "{:?}", views.warnings);
    let split = views.split(Some(5));
    assert_eq!((split.fit, split.held_out), (vec![0, 2, 3], vec![1, 4]));
    assert_eq!(views.split(None).fit.len(), 5);
    // .. and stands in for it where there is none.
    edit_json(&json, |v| {
        v.as_object_mut().unwrap().remove("test_filenames");
    });
    assert_eq!(read(folder.path()).unwrap().test, [3]);
    // NeRF: three files.
    for (split, frames) in [("train", 0..3), ("val", 3..4), ("test", 4..6)] {
        let mut part = value.clone();
        part["frames"] = value["frames"].as_array().unwrap()[frames].into();
        let text = part.to_string();
        std::fs::write(folder.path().join(format!("transforms_{split}.json")), text).unwrap();
    }
    std::fs::remove_file(&json).unwrap();
    let views = read(folder.path()).unwrap();
    assert_eq!((views.len(), &views.test[..]), (5, &[3, 4][..]));
    // A missing image moves the places of those behind it.
    std::fs::remove_file(folder.path().join(name(1).as_str().unwrap())).unwrap();
    let lenient = ReadOptions { allow_missing: true, ..ReadOptions::default() };
    assert_eq!(read_with(folder.path(), &lenient).unwrap().test, [2, 3]);
    // One of the files by itself is all there is.
    let alone = read(&folder.path().join("transforms_test.json")).unwrap();
    assert_eq!((alone.len(), alone.test.len()), (2, 0));
    // One of a test's does not make a test of the next.
    std::fs::remove_file(folder.path().join(name(4).as_str().unwrap())).unwrap();
    let views = read_with(folder.path(), &lenient).unwrap();
    assert_eq!((views.len(), &views.test[..]), (3, &[2][..]));
    edit_json(&folder.path().join("transforms_train.json"), |part| {
        let frames = part["frames"].as_array_mut().unwrap();
        frames.push(value["frames"][4].clone());
        frames.push(value["frames"][3].clone());
        part["test_filenames"] = json!([name(4)]);
    });
    assert_eq!(read_with(folder.path(), &lenient).unwrap().test, [3]);
}

/// 4x4 rows of a pose.
fn rows(camera: &Camera, axes: CameraAxes, poses: PoseDirection) -> serde_json::Value {
    let to_world = camera.to_opengl();
    let sign = if axes == CameraAxes::OpenCv { -1.0 } else { 1.0 };
    // Columns are the camera's axes.
    let to_world = to_world.map(|[x, y, z, t]| [x, sign * y, sign * z, t]);
    let to_world = [to_world[0], to_world[1], to_world[2], [0.0, 0.0, 0.0, 1.0]];
    if poses == PoseDirection::CameraToWorld {
        return json!(to_world);
    }
    let r = |i: usize, k: usize| to_world[k][i];
    let t = |i: usize| -(0..3).map(|k| r(i, k) * to_world[k][3]).sum::<f64>();
    let mut out = [[0.0, 0.0, 0.0, 1.0]; 4];
    for i in 0..3 {
        out[i] = [r(i, 0), r(i, 1), r(i, 2), t(i)];
    }
    json!(out)
}

#[test]
fn poses_of_other_tools_are_read_as_they_are_meant() {
    let written = ball(5);
    for axes in [CameraAxes::OpenCv, CameraAxes::OpenGl] {
        for poses in [PoseDirection::WorldToCamera, PoseDirection::CameraToWorld] {
            let folder = transforms_folder(5);
            edit_json(&folder.path().join("transforms.json"), |value| {
                for (i, view) in written.iter().enumerate() {
                    value["frames"][i]["transform_matrix"] = rows(&view.camera, axes, poses);
                    value["frames"][i]["fl_x"] = json!(2.0 * focal(view));
                    value["frames"][i]["fl_y"] = json!(2.0 * focal(view));
                }
            });
            let options = ReadOptions {
                axes: Some(axes),
                poses: Some(poses),
                focal_scale: Some(0.5),
                ..ReadOptions::default()
            };
            let views = read_with(folder.path(), &options).unwrap();
            for (a, b) in views.views.iter().zip(&written) {
                let p = [0.2, -0.1, 0.3];
                let (p, q) = (a.camera.project(p), b.camera.project(p));
                assert!((p.column - q.column).abs() + (p.row - q.row).abs() < 1e-9);
                assert!((p.depth - q.depth).abs() < 1e-9);
            }
        }
    }
    // What is so already stays, and what has no poses cannot have others.
    let folder = tempfile::tempdir().unwrap();
    write_colmap(&written, folder.path(), ColmapForm::Text).unwrap();
    let said = ReadOptions { axes: Some(CameraAxes::OpenCv), ..ReadOptions::default() };
    let (told, plain) = (read_with(folder.path(), &said).unwrap(), read(folder.path()).unwrap());
    assert_eq!(told.views[3].camera, plain.views[3].camera);
    let table =
        datasets::Turntable { count: 5, elevation: 0.0, distance: 3.0, fov: 40.0, reverse: false };
    let images = folder.path().join("images");
    let said = ReadOptions { turntable: Some(table), mask: MaskSource::Whole, ..said };
    assert_eq!(read_with(&images, &said).unwrap_err().field_name(), Some("axes"));
}

fn focal(view: &View) -> f64 {
    match view.camera.lens {
        mesh_core::Lens::Perspective { fx, .. } => fx,
        mesh_core::Lens::Orthographic { .. } => panic!("a perspective"),
    }
}

#[test]
fn depth_in_whole_millimetres_is_read() {
    let folder = transforms_folder(2);
    let size = ball(2)[0].mask.clone();
    let depth = |x: usize| if x == 0 { 0 } else { 1500 + x as u16 };
    let depth = (0..size.height).flat_map(|_| (0..size.width).flat_map(|x| depth(x).to_be_bytes()));
    let file = std::fs::File::create(folder.path().join("d.png")).unwrap();
    let mut encoder = png::Encoder::new(file, size.width as u32, size.height as u32);
    encoder.set_depth(png::BitDepth::Sixteen);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&depth.collect::<Vec<u8>>()).unwrap();
    writer.finish().unwrap();
    edit_json(&folder.path().join("transforms.json"), |value| {
        value["frames"][0]["depth_file_path"] = json!("d.png");
    });
    let options = ReadOptions { depth: true, ..ReadOptions::default() };
    let read_depth = || read_with(folder.path(), &options).unwrap().views[0].depth.clone().unwrap();
    let found = read_depth();
    assert_eq!(found.data[0], f32::INFINITY);
    assert!((found.data[2] - 1.502).abs() < 1e-6, "{}", found.data[2]);
    edit_json(&folder.path().join("transforms.json"), |value| {
        value["depth_unit_scale_factor"] = json!(0.01);
    });
    assert!((read_depth().data[2] - 15.02).abs() < 1e-5);
    // What is said of the unit holds for an array as well; without it the numbers are lengths.
    let header = format!(
        "{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, {}), }}",
        size.height, size.width
    );
    let mut bytes = b"\x93NUMPY\x01\0".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend((0..size.data.len()).flat_map(|k| (1500.0 + k as f32).to_le_bytes()));
    std::fs::write(folder.path().join("d.npy"), bytes).unwrap();
    edit_json(&folder.path().join("transforms.json"), |value| {
        value["frames"][0]["depth_file_path"] = json!("d.npy");
    });
    assert!((read_depth().data[2] - 15.02).abs() < 1e-5);
    edit_json(&folder.path().join("transforms.json"), |value| {
        value.as_object_mut().unwrap().remove("depth_unit_scale_factor");
    });
    assert_eq!(read_depth().data[2], 1502.0);
    // Whole numbers are millimetres in an array too.
    let write = |kind: &str, [height, width]: [usize; 2]| {
        let header = format!(
            "{{'descr': '{kind}', 'fortran_order': False, 'shape': ({height}, {width}), }}"
        );
        let mut bytes = b"\x93NUMPY\x01\0".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.bytes());
        bytes.extend((0..height * width).flat_map(|k| (1500 + k as u16).to_le_bytes()));
        std::fs::write(folder.path().join("d.npy"), bytes).unwrap();
    };
    write("<u2", [size.height, size.width]);
    assert!((read_depth().data[2] - 1.502).abs() < 1e-6);
    // Half the size is brought to that of the image, another shape is not.
    write("<u2", [size.height / 2, size.width / 2]);
    let depth = read_depth();
    assert_eq!((depth.height, depth.width), (size.height, size.width));
    assert!((depth.data[2] - 1.501).abs() < 1e-6, "{}", depth.data[2]);
    write("<u2", [size.height, size.height]);
    let error = read_with(folder.path(), &options).unwrap_err();
    assert!(error.to_string().contains("d.npy"), "{error}");
}

#[test]
fn only_the_views_that_are_named_are_read() {
    let folder = transforms_folder(4);
    let broken = folder.path().join("images/0001.png");
    std::fs::write(broken, b"no image").unwrap();
    let only = |names: &[&str]| ReadOptions {
        only: Some(names.iter().map(|&name| name.to_owned()).collect()),
        ..ReadOptions::default()
    };
    let all = read_with(folder.path(), &ReadOptions::default()).unwrap_err();
    assert!(all.to_string().contains("0001"), "{all}");
    let views = read_with(folder.path(), &only(&["0003.png", "0000"])).unwrap();
    assert_eq!((&views.views[0].mask, &views.views[1].mask), (&ball(4)[0].mask, &ball(4)[3].mask));
    assert_eq!(views.len(), 2);
    let unknown = read_with(folder.path(), &only(&["0000", "9.png"])).unwrap_err();
    assert!(unknown.to_string().contains("none called 9.png"), "{unknown}");
    assert!(read_with(folder.path(), &only(&["0001.png"])).is_err());
}

#[test]
fn of_two_folders_with_the_same_names_one_can_be_named() {
    let folder = transforms_folder(4);
    edit_json(&folder.path().join("transforms.json"), |value| {
        for (i, side) in ["left", "left", "right", "right"].into_iter().enumerate() {
            let new = format!("{side}/{:04}.png", i % 2);
            std::fs::create_dir_all(folder.path().join(side)).unwrap();
            std::fs::rename(
                folder.path().join(format!("images/{i:04}.png")),
                folder.path().join(&new),
            )
            .unwrap();
            value["frames"][i]["file_path"] = json!(new);
        }
    });
    let named = |names: &[&str]| {
        let only = Some(names.iter().map(|&name| name.to_owned()).collect());
        let views = read_with(folder.path(), &ReadOptions { only, ..ReadOptions::default() });
        views.map(|views| views.views.into_iter().map(|view| view.name).collect::<Vec<_>>())
    };
    assert_eq!(named(&["left/0001"]).unwrap(), ["left/0001"]);
    assert_eq!(named(&["0001.png"]).unwrap(), ["left/0001", "right/0001"]);
    let unknown = named(&["left/0001", "up/0001"]).unwrap_err().to_string();
    assert!(unknown.contains("none called up/0001"), "{unknown}");
}

#[test]
fn masks_of_smaller_and_of_larger_copies_are_brought_to_the_image() {
    let [folder, masks] = with_masks_apart(3, |i| format!("{i:04}.png"));
    let options = ReadOptions { masks: Some(masks.path().into()), ..ReadOptions::default() };
    for (size, most) in [([15, 20], 60), ([60, 80], 0)] {
        for (i, view) in ball(3).iter().enumerate() {
            let mask = view.mask.resized(size[0], size[1]);
            write_png(masks.path().join(format!("{i:04}.png")), &mask).unwrap();
        }
        for (read, made) in read_with(folder.path(), &options).unwrap().views.iter().zip(ball(3)) {
            let off = read.mask.data.iter().zip(&made.mask.data).filter(|(a, b)| a != b).count();
            assert!(off <= most && read.mask_pixels() > 200, "{off}");
            assert!(read.mask.data.iter().all(|&m| m == 0 || m == 255));
        }
    }
}

#[test]
fn masks_are_closed_before_holes_are_filled() {
    let [folder, masks] = with_masks_apart(2, |i| format!("{i:04}.png"));
    let clean = ball(2)[1].mask.clone();
    // A crack from the middle to the frame: no hole, until it is closed.
    let mut cracked = clean.clone();
    let middle = clean.width / 2;
    for row in cracked.data.chunks_mut(clean.width).take(clean.height / 2) {
        row[middle] = 0;
    }
    write_png(masks.path().join("0001.png"), &cracked).unwrap();
    let options = ReadOptions { masks: Some(masks.path().into()), ..ReadOptions::default() };
    let off = |options: &ReadOptions| {
        let views = read_with(folder.path(), options).unwrap();
        views.views[1].mask.data.iter().zip(&clean.data).filter(|(a, b)| a != b).count()
    };
    assert!(off(&ReadOptions { fill_holes: true, ..options.clone() }) > 8);
    // A disk's closing rounds what a disk does not fit into.
    assert!(off(&ReadOptions { dilate: 2, erode: 2, ..options.clone() }) <= 4);
    assert!(off(&ReadOptions { dilate: 2, ..options }) > 50);
}

#[test]
fn colmap_counts_pixels_as_they_are_stored() {
    let written = ball(3);
    let folder = tempfile::tempdir().unwrap();
    write_colmap(&written, folder.path(), ColmapForm::Text).unwrap();
    let masks = tempfile::tempdir().unwrap();
    for (name, orientation) in [("0000.png", 3), ("0001.png", 6)] {
        let mask = masks.path().join(name);
        write_png(&mask, &written[usize::from(orientation == 6)].mask).unwrap();
        orient(&mask, orientation);
        orient(&folder.path().join("images").join(name), orientation);
        let beside = folder.path().join("masks").join(name);
        if beside.exists() {
            orient(&beside, orientation);
        }
    }
    write_png(masks.path().join("0002.png"), &written[2].mask).unwrap();
    let apart = ReadOptions { masks: Some(masks.path().into()), ..ReadOptions::default() };
    for options in [ReadOptions::default(), apart] {
        let views = read_with(folder.path(), &options).unwrap().views;
        for (a, b) in views.iter().zip(&written) {
            assert_eq!((&a.color, &a.mask), (&b.color, &b.mask), "{}", a.name);
        }
    }
}

#[test]
fn an_orientation_that_makes_another_size_says_what_to_do() {
    let folder = transforms_folder(2);
    orient(&folder.path().join("images/0001.png"), 6);
    let text = read(folder.path()).unwrap_err().to_string();
    assert!(text.contains("frames[1].w, h") && text.contains("exiftool"), "{text}");
    let folder = tempfile::tempdir().unwrap();
    write_colmap(&ball(2), folder.path(), ColmapForm::Text).unwrap();
    let image = folder.path().join("images/0001.png");
    write_png(&image, &mesh_core::ByteImage::new(40, 30, 3)).unwrap();
    orient(&image, 6);
    let text = read(folder.path()).unwrap_err().to_string();
    assert!(text.contains("0001.png") && text.contains("auto-orient"), "{text}");
}

#[test]
fn masks_of_labels_in_sixteen_bits_are_read() {
    let folder = transforms_folder(2);
    let mask = ball(2)[0].mask.clone();
    let file = std::fs::File::create(folder.path().join("masks/0000.png")).unwrap();
    let mut encoder = png::Encoder::new(file, mask.width as u32, mask.height as u32);
    encoder.set_depth(png::BitDepth::Sixteen);
    let labels: Vec<u8> = mask.data.iter().flat_map(|&m| [0, u8::from(m != 0)]).collect();
    encoder.write_header().unwrap().write_image_data(&labels).unwrap();
    let red = mesh_core::ByteImage {
        channels: 3,
        data: ball(2)[1].mask.data.iter().flat_map(|&m| [m, 0, 0]).collect(),
        ..mask.clone()
    };
    write_png(folder.path().join("masks/0001.png"), &red).unwrap();
    let views = read(folder.path()).unwrap().views;
    assert_eq!((&views[0].mask, &views[1].mask), (&mask, &ball(2)[1].mask));
}
