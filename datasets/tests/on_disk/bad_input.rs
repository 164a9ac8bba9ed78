//! Spoilt inputs: each gives an error that names the file and the field, and none a panic.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::common::{ball, edit, edit_json, kaolin_folder, read, transforms_folder, zipped};
use datasets::{MaskSource, ReadOptions, ReadViewsError, View, ViewsProblem, read_views};
use mesh_core::{ByteImage, write_png};
use proptest::prelude::*;
use serde_json::json;

/// The error of reading a set of kaolin views after `spoil`, from the folder and from a zip.
fn spoilt(spoil: impl FnOnce(&Path)) -> ReadViewsError {
    let folder = kaolin_folder(6);
    spoil(folder.path());
    let (_keep, zip) = zipped(folder.path());
    let (of_folder, of_zip) = (read(folder.path()).unwrap_err(), read(&zip).unwrap_err());
    assert_eq!(of_folder.field_name(), of_zip.field_name());
    assert_eq!(of_folder.path.file_name().is_some(), of_zip.path.file_name().is_some());
    of_folder
}

fn assert_names(error: &ReadViewsError, words: &[&str]) {
    let text = error.to_string();
    for word in words {
        assert!(text.contains(word), "{word:?} is not in {text:?}");
    }
}

fn metadata(folder: &Path, change: impl FnOnce(&mut serde_json::Value)) {
    edit_json(&folder.join("3_metadata.json"), |v| change(&mut v["camera_properties"]));
}

#[test]
fn a_missing_view_is_named() {
    let whole = spoilt(|f| {
        for end in ["rgb.png", "semantic.npy", "metadata.json"] {
            std::fs::remove_file(f.join(format!("3_{end}"))).unwrap();
        }
    });
    assert_names(&whole, &["3_rgb.png", "missing"]);
    // A mask too: the others have one, so this view has lost its own.
    for name in ["3_rgb.png", "3_semantic.npy", "3_metadata.json"] {
        let part = spoilt(|f| std::fs::remove_file(f.join(name)).unwrap());
        assert_names(&part, &[name, "missing"]);
    }
    // Without any the alpha would have to say it, and says nothing.
    let masks = spoilt(|f| {
        (0..6).for_each(|i| std::fs::remove_file(f.join(format!("{i}_semantic.npy"))).unwrap());
    });
    assert_names(&masks, &["0_rgb.png", "`mask`"]);
}

#[test]
fn a_mask_of_another_size_is_named() {
    let other = kaolin_folder(1);
    let error = spoilt(|f| {
        let small = ReadOptions { max_size: Some(20), ..ReadOptions::default() };
        let views = read_views(other.path(), &small, &|_, _| {}).unwrap();
        let half = tempfile::tempdir().unwrap();
        datasets::write_kaolin(&views.views, half.path()).unwrap();
        std::fs::copy(half.path().join("0_semantic.npy"), f.join("3_semantic.npy")).unwrap();
    });
    assert_names(&error, &["3_semantic.npy", "mask shape", "15, 20", "30, 40"]);
    let folder = transforms_folder(2);
    write_png(folder.path().join("masks/0001.png"), &ByteImage::new(9, 7, 1)).unwrap();
    let error = read(folder.path()).unwrap_err();
    assert_names(&error, &["masks/0001.png", "mask size", "7x9", "40x30"]);
}

#[test]
fn a_truncated_picture_is_named() {
    let error = spoilt(|f| {
        let path = f.join("3_rgb.png");
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
    });
    assert_names(&error, &["3_rgb.png"]);
    assert!(matches!(error.problem, ViewsProblem::Image(_)));
    let empty = spoilt(|f| std::fs::write(f.join("3_rgb.png"), b"").unwrap());
    assert_names(&empty, &["3_rgb.png"]);
}

#[test]
fn an_array_of_a_wrong_type_is_named() {
    let error = spoilt(|f| {
        let path = f.join("3_semantic.npy");
        let mut bytes = std::fs::read(&path).unwrap();
        let at = bytes.windows(3).position(|w| w == b"<i4").unwrap();
        bytes[at..at + 3].copy_from_slice(b"<c8");
        std::fs::write(path, bytes).unwrap();
    });
    assert_names(&error, &["3_semantic.npy", "mask descr", "<c8", "<i4"]);
}

#[test]
fn a_header_that_claims_terabytes_costs_nothing() {
    let error = spoilt(|f| {
        let path = f.join("3_semantic.npy");
        let text = "{'descr': '<i4', 'fortran_order': False, 'shape': (1048576, 1048576, 1), }\n";
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend_from_slice(&(text.len() as u16).to_le_bytes());
        bytes.extend_from_slice(text.as_bytes());
        std::fs::write(path, bytes).unwrap();
    });
    assert_names(&error, &["3_semantic.npy", "mask shape", "1048576"]);
    let error = spoilt(|f| {
        let path = f.join("3_rgb.png");
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[16..24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
        std::fs::write(path, bytes).unwrap();
    });
    assert_names(&error, &["3_rgb.png"]);
}

#[test]
fn a_zip_bomb_is_refused() {
    let folder = kaolin_folder(1);
    // 64 MiB of zeros pack to 64 KiB; the mask of 40x30 pixels may not unpack to that.
    let mut bytes = std::fs::read(folder.path().join("0_semantic.npy")).unwrap();
    bytes.resize(64 << 20, 0);
    std::fs::write(folder.path().join("0_semantic.npy"), bytes).unwrap();
    let (_keep, zip) = zipped(folder.path());
    assert!(std::fs::metadata(&zip).unwrap().len() < 1 << 18);
    for path in [folder.path(), &zip] {
        let error = read(path).unwrap_err();
        assert_names(&error, &["0_semantic.npy", "67108864"]);
        assert_eq!(error.field_name(), Some("mask"));
    }
}

#[test]
fn a_number_is_written_in_one_way_and_may_begin_anywhere() {
    let twice = spoilt(|f| {
        for end in ["rgb.png", "semantic.npy", "metadata.json"] {
            std::fs::copy(f.join(format!("3_{end}")), f.join(format!("03_{end}"))).unwrap();
        }
    });
    assert_names(&twice, &["`view`", "03", "both number 3", "rename or remove"]);
    let folder = kaolin_folder(6);
    for i in 0..2 {
        for end in ["rgb.png", "semantic.npy", "metadata.json"] {
            std::fs::remove_file(folder.path().join(format!("{i}_{end}"))).unwrap();
        }
    }
    let names: Vec<String> =
        read(folder.path()).unwrap().views.into_iter().map(|view| view.name).collect();
    assert_eq!(names, ["2", "3", "4", "5"]);
}

#[test]
fn views_that_would_not_fit_in_memory_are_refused() {
    let folder = kaolin_folder(4);
    let options = ReadOptions { memory_limit: 10_000, ..ReadOptions::default() };
    let error = read_views(folder.path(), &options, &|_, _| {}).unwrap_err();
    assert_names(&error, &["10000", "all views"]);
}

#[test]
fn many_views_are_judged_by_the_first_and_shrunk_where_that_is_wanted() {
    let folder = kaolin_folder(20);
    let whole = read(folder.path()).unwrap();
    let bytes: usize = whole.views.iter().map(View::bytes).sum();
    let options = ReadOptions { memory_limit: bytes as u64 / 3, ..ReadOptions::default() };
    let seen = AtomicUsize::new(0);
    let count = |_: usize, _: usize| {
        seen.fetch_add(1, Ordering::Relaxed);
    };
    let error = read_views(folder.path(), &options, &count).unwrap_err();
    // What all would take, though none but the first was read.
    assert_names(&error, &[&bytes.to_string(), "all views"]);
    assert_eq!(seen.into_inner(), 0);

    let options = ReadOptions { shrink_to_limit: true, ..options };
    let small = read_views(folder.path(), &options, &|_, _| {}).unwrap();
    let held: usize = small.views.iter().map(View::bytes).sum();
    assert!(held <= bytes / 3 && 4 * held > bytes, "{held} of {bytes}");
    assert!(small.warnings.iter().any(|w| w.contains("averaged down to")), "{:?}", small.warnings);
    let options = ReadOptions { memory_limit: bytes as u64, ..options };
    let same = read_views(folder.path(), &options, &|_, _| {}).unwrap();
    assert!(same.warnings.is_empty() && same.views[7].color == whole.views[7].color);
}

#[test]
fn cameras_that_are_none_are_named() {
    let not_a_number = spoilt(|f| {
        // As Python writes it.
        edit(&f.join("3_metadata.json"), |text| {
            text.replace("\"focal_length\":", "\"focal_length\":NaN,\"x\":")
        });
    });
    assert_names(&not_a_number, &["3_metadata.json", "camera_properties.focal_length", "NaN"]);
    let infinite = spoilt(|f| {
        edit(&f.join("3_metadata.json"), |text| {
            text.replacen("\"tf_mat\":[[", "\"tf_mat\":[[Infinity,0,0,0],[", 1)
        });
    });
    assert_names(&infinite, &["3_metadata.json", "tf_mat"]);
    let singular = spoilt(|f| {
        metadata(f, |c| c["tf_mat"][1] = c["tf_mat"][0].clone());
    });
    assert_names(&singular, &["3_metadata.json", "tf_mat", "singular"]);
    let zero = spoilt(|f| metadata(f, |c| c["focal_length"] = json!(0.0)));
    assert_names(&zero, &["camera_properties.focal_length", "above 0"]);
    let short = spoilt(|f| metadata(f, |c| c["tf_mat"] = json!([[1, 0, 0, 0]])));
    assert_names(&short, &["tf_mat", "4 rows"]);
    let three = spoilt(|f| metadata(f, |c| c["tf_mat"].as_array_mut().unwrap().truncate(3)));
    assert_names(&three, &["tf_mat", "4 rows"]);
    let transposed = spoilt(|f| {
        metadata(f, |c| {
            let rows = c["tf_mat"].clone();
            let transposed = |i: usize| (0..4).map(|j| rows[j][i].clone()).collect::<Vec<_>>();
            c["tf_mat"] = (0..4).map(transposed).collect();
        });
    });
    assert_names(&transposed, &["3_metadata.json", "tf_mat", "translation in the last"]);
    let none = spoilt(|f| edit_json(&f.join("3_metadata.json"), |v| *v = json!({})));
    assert_names(&none, &["3_metadata.json", "camera_properties"]);
    let broken = spoilt(|f| std::fs::write(f.join("3_metadata.json"), "{\"a\": [").unwrap());
    assert_names(&broken, &["3_metadata.json", "JSON"]);
    let shape = spoilt(|f| metadata(f, |c| c["resolution"]["width"] = json!(4000)));
    assert_names(&shape, &["camera_properties.resolution", "4000x30", "40x30"]);
}

#[test]
fn masks_that_are_empty_everywhere_are_refused() {
    let error = spoilt(|f| {
        let views: Vec<_> = ball(6)
            .into_iter()
            .map(|mut v| {
                v.mask.data.fill(0);
                v
            })
            .collect();
        datasets::write_kaolin(&views, f).unwrap();
    });
    assert_names(&error, &["masks of all 6 views are empty"]);
}

#[test]
fn cameras_that_see_nothing_are_refused() {
    // Turned by half a turn about their own up: OpenCV's axes taken for OpenGL's do the same.
    let error = spoilt(|f| {
        for i in 0..6 {
            edit_json(&f.join(format!("{i}_metadata.json")), |v| {
                for row in v["camera_properties"]["tf_mat"].as_array_mut().unwrap() {
                    for k in [0, 2] {
                        row[k] = json!(-row[k].as_f64().unwrap());
                    }
                }
            });
        }
    });
    assert_names(&error, &["tf_mat", "6 of 6 cameras"]);
    let folder = transforms_folder(6);
    edit_json(&folder.path().join("transforms.json"), |v| {
        for frame in v["frames"].as_array_mut().unwrap() {
            for row in frame["transform_matrix"].as_array_mut().unwrap() {
                for k in [1, 2] {
                    row[k] = json!(-row[k].as_f64().unwrap());
                }
            }
        }
    });
    let error = read(folder.path()).unwrap_err();
    assert_names(&error, &["transform_matrix", "6 of 6 cameras", "y up", "--axes", "opencv"]);
    let folder = tempfile::tempdir().unwrap();
    let mut views = crate::common::ball(6);
    for view in &mut views {
        for row in [0, 2] {
            view.camera.rotation.row_mut(row).neg_mut();
            view.camera.translation[row] *= -1.0;
        }
    }
    datasets::write_colmap(&views, folder.path(), datasets::ColmapForm::Text).unwrap();
    let error = read(folder.path()).unwrap_err();
    assert_names(&error, &["6 of 6 cameras", "y down, looking along +z", "--poses"]);
    // One stray among many is a warning.
    let folder = kaolin_folder(6);
    edit_json(&folder.path().join("2_metadata.json"), |v| {
        for row in v["camera_properties"]["tf_mat"].as_array_mut().unwrap() {
            for k in [0, 2] {
                row[k] = json!(-row[k].as_f64().unwrap());
            }
        }
    });
    let warnings = read(folder.path()).unwrap().warnings;
    assert!(warnings[0].contains("views 2 do not see"), "{warnings:?}");
}

#[test]
fn lenses_and_files_that_are_none_are_named() {
    let spoil = |change: &dyn Fn(&mut serde_json::Value)| {
        let folder = transforms_folder(2);
        edit_json(&folder.path().join("transforms.json"), |v| change(v));
        read(folder.path()).unwrap_err()
    };
    // It turns back before it has shown the whole object.
    let error = spoil(&|v| v["k1"] = json!(-300.0));
    assert_names(&error, &["transforms.json", "frames[0]: k1, k2", "off the axis"]);
    let error = spoil(&|v| v["frames"][1]["p2"] = json!("little"));
    assert_names(&error, &["`frames[1].p2`"]);
    let error = spoil(&|v| v["camera_model"] = json!("EQUIRECTANGULAR"));
    assert_names(&error, &["camera_model", "EQUIRECTANGULAR", "OPENCV_FISHEYE"]);
    let error = spoil(&|v| v["frames"][1]["transform_matrix"][2][1] = json!("x"));
    assert_names(&error, &["frames[1].transform_matrix[2][1]"]);
    let error = spoil(&|v| {
        v["frames"][1]["transform_matrix"] = json!([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]);
    });
    assert_names(&error, &["frames[1].transform_matrix", "singular"]);
    let error = spoil(&|v| v["frames"][1]["transform_matrix"][3] = json!([1, 2, 3, 4]));
    assert_names(&error, &["frames[1].transform_matrix", "last row"]);
    let error = spoil(&|v| v["frames"][1]["file_path"] = json!("images/nowhere.png"));
    assert_names(&error, &["images/nowhere.png", "missing", "frames[1].file_path"]);
    let error = spoil(&|v| v["frames"][1]["mask_path"] = json!("masks/nowhere.png"));
    assert_names(&error, &["masks/nowhere.png", "missing", "frames[1].mask_path"]);
    let error = spoil(&|v| {
        v["frames"][1].as_object_mut().unwrap().remove("fl_x");
    });
    assert_names(&error, &["frames[1].fl_x", "camera_angle_x"]);
    let error = spoil(&|v| v["frames"] = json!([]));
    assert_names(&error, &["views"]);
}

#[test]
fn what_is_no_set_of_views_is_said() {
    let folder = tempfile::tempdir().unwrap();
    assert_names(&read(folder.path()).unwrap_err(), &["no known layout", "nothing"]);
    std::fs::write(folder.path().join("notes.txt"), "x").unwrap();
    assert_names(&read(folder.path()).unwrap_err(), &["no known layout", "notes.txt", "_par.txt"]);
    assert_names(&read(&folder.path().join("notes.txt")).unwrap_err(), &["notes.txt"]);
    assert_names(&read(&folder.path().join("nowhere")).unwrap_err(), &["nowhere"]);
    std::fs::write(folder.path().join("bad.zip"), "PK\x03\x04 and then nothing").unwrap();
    assert_names(&read(&folder.path().join("bad.zip")).unwrap_err(), &["bad.zip", "zip"]);
    let files = ReadOptions { mask: MaskSource::Files, ..ReadOptions::default() };
    let kaolin = kaolin_folder(2);
    std::fs::remove_file(kaolin.path().join("1_semantic.npy")).unwrap();
    let error = read_views(kaolin.path(), &files, &|_, _| {}).unwrap_err();
    assert_names(&error, &["1_semantic.npy", "missing"]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Any byte of any file changed, any file cut: an error or views, never a panic.
    #[test]
    fn no_damage_makes_the_readers_panic(
        file in 0usize..6, at in 0usize..100_000, byte: u8, cut: bool, zip: bool,
    ) {
        let (kaolin, transforms) = (kaolin_folder(2), transforms_folder(2));
        let path = match file {
            0 => kaolin.path().join("1_rgb.png"),
            1 => kaolin.path().join("1_semantic.npy"),
            2 => kaolin.path().join("1_metadata.json"),
            3 => transforms.path().join("transforms.json"),
            4 => transforms.path().join("masks/0001.png"),
            _ => kaolin.path().join("1_depth.exr"),
        };
        let mut bytes = std::fs::read(&path).unwrap();
        let at = at % bytes.len();
        if cut { bytes.truncate(at) } else { bytes[at] = byte }
        std::fs::write(&path, bytes).unwrap();
        let options = ReadOptions { depth: true, ..ReadOptions::default() };
        let _ = read_views(transforms.path(), &options, &|_, _| {});
        if zip {
            let (_keep, zip) = zipped(kaolin.path());
            let mut bytes = std::fs::read(&zip).unwrap();
            let _ = read_views(&zip, &options, &|_, _| {});
            let place = at % bytes.len();
            bytes[place] = byte;
            std::fs::write(&zip, bytes).unwrap();
            let _ = read_views(&zip, &options, &|_, _| {});
        } else {
            let _ = read_views(kaolin.path(), &options, &|_, _| {});
        }
    }
}

/// 40 by 30 pixels where at most 1,000 are allowed.
#[test]
fn images_are_held_to_the_limits_of_the_caller() {
    let folder = kaolin_folder(2);
    let limits = mesh_core::Limits { max_pixels: 1000, ..mesh_core::Limits::default() };
    let options = ReadOptions { limits, ..ReadOptions::default() };
    let error = read_views(folder.path(), &options, &|_, _| {}).unwrap_err().to_string();
    assert!(error.contains("_rgb.png") && error.contains("1000"), "{error}");
}
