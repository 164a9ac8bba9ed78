//! COLMAP, BOP, photographs and turntables: what is written is read, and what others write.

use std::path::{Path, PathBuf};

use crate::common::{ball, edit_json, read};
use datasets::{
    Bop, Colmap, ColmapForm, Dataset, Layout, MaskSource, ReadOptions, Subset, Turntable, View,
    open, open_with, read_views, write_colmap, write_photos,
};
use mesh_core::{ByteImage, Camera, Lens, primitives, write_mesh, write_png};
use serde_json::json;

const OFF_CENTER: Lens = Lens::Perspective { fx: 38.0, fy: 35.5, cx: 21.5, cy: 14.25 };

/// The ball through a lens that is nothing special: W != H, fx != fy, off the centre.
fn off_center(count: usize) -> Vec<View> {
    let mut views = ball(count);
    for view in &mut views {
        view.camera.lens = OFF_CENTER;
    }
    views
}

fn assert_same(read: &[View], written: &[View]) {
    assert_eq!(read.len(), written.len());
    for (a, b) in read.iter().zip(written) {
        assert_eq!((&a.color, &a.mask, &a.depth), (&b.color, &b.mask, &b.depth));
        assert_eq!((a.camera.width, a.camera.height), (b.camera.width, b.camera.height));
        assert!((a.camera.rotation - b.camera.rotation).abs().max() < 1e-12);
        assert!((a.camera.translation - b.camera.translation).abs().max() < 1e-12);
        let (p, q) = (a.camera.project([0.3, 0.2, -0.5]), b.camera.project([0.3, 0.2, -0.5]));
        assert!((p.column - q.column).abs() + (p.row - q.row).abs() < 1e-9);
    }
}

fn with_depth() -> ReadOptions {
    ReadOptions { depth: true, ..ReadOptions::default() }
}

#[test]
fn colmap_projects_round_trip_in_both_forms() {
    let written = off_center(12);
    for form in [ColmapForm::Text, ColmapForm::Binary] {
        let folder = tempfile::tempdir().unwrap();
        write_colmap(&written, folder.path(), form).unwrap();
        // The project, and the model's own folder with the images above it.
        for path in ["", "sparse/0"] {
            let views = read_views(&folder.path().join(path), &with_depth(), &|_, _| {}).unwrap();
            assert_eq!(views.layout, Layout::Colmap);
            assert_eq!(views.views[10].name, "0010");
            assert_same(&views.views, &written);
        }
        let dataset = open(folder.path()).unwrap();
        assert_eq!(dataset.entries()[0].views, 12);
        let some = dataset.views(0, Some(&[7, 2]), &with_depth(), &|_, _| {}).unwrap();
        assert_same(&some.views, &[written[7].clone(), written[2].clone()]);
    }
    // The other form of an earlier model would be preferred, and is gone.
    let folder = tempfile::tempdir().unwrap();
    write_colmap(&written, folder.path(), ColmapForm::Binary).unwrap();
    write_colmap(&written[..3], folder.path(), ColmapForm::Text).unwrap();
    assert_eq!(read(folder.path()).unwrap().len(), 3);
}

#[test]
fn photographs_round_trip_with_either_lens() {
    let mut written = off_center(11);
    written[3].camera.lens = Lens::Orthographic { sx: 11.0, sy: 12.0, cx: 19.5, cy: 16.0 };
    let folder = tempfile::tempdir().unwrap();
    write_photos(&written, folder.path()).unwrap();
    for path in [folder.path().to_owned(), folder.path().join("cameras.json")] {
        let views = read_views(&path, &with_depth(), &|_, _| {}).unwrap();
        assert_eq!(views.layout, Layout::Photos);
        assert_same(&views.views, &written);
    }
    // Without the name of a mask the one of the same stem is found, and without that it is said.
    edit_json(&folder.path().join("cameras.json"), |v| {
        v["views"].as_array_mut().unwrap().iter_mut().for_each(|view| {
            view.as_object_mut().unwrap().remove("mask");
        });
    });
    assert_eq!(read(folder.path()).unwrap().views[4].mask, written[4].mask);
    std::fs::remove_file(folder.path().join("masks/0004.png")).unwrap();
    let error = read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("0004.png") && error.contains("mask"), "{error}");
    edit_json(&folder.path().join("cameras.json"), |v| v["version"] = json!(2));
    assert_eq!(read(folder.path()).unwrap_err().field_name(), Some("version"));
}

#[test]
fn photographs_need_no_masks_where_none_of_their_files_are_wanted() {
    let folder = tempfile::tempdir().unwrap();
    write_photos(&off_center(3), folder.path()).unwrap();
    std::fs::remove_dir_all(folder.path().join("masks")).unwrap();
    let with = |mask: MaskSource| {
        let options = ReadOptions { mask, ..ReadOptions::default() };
        read_views(folder.path(), &options, &|_, _| {})
    };
    assert_eq!(with(MaskSource::Whole).unwrap().len(), 3);
    let backdrop = MaskSource::Backdrop { color: Some([0; 3]), tolerance: 12 };
    assert_eq!(with(backdrop).unwrap().views[1].mask, ball(3)[1].mask);
    let error = with(MaskSource::Files).unwrap_err().to_string();
    assert!(error.contains("masks/0000.png") && error.contains("`views[0].mask`"), "{error}");
}

#[test]
fn a_field_that_photographs_cameras_have_not_is_named() {
    let folder = tempfile::tempdir().unwrap();
    write_photos(&off_center(3), folder.path()).unwrap();
    assert_eq!(read(folder.path()).unwrap().warnings, [""; 0]);
    edit_json(&folder.path().join("cameras.json"), |v| {
        v["unit"] = json!("m");
        v["views"][1]["maks"] = json!("masks/x.png");
        v["views"][2]["maks"] = json!(null);
        v["views"][2]["lens"]["perspective"]["focal_lenght"] = json!(700);
    });
    let views = read(folder.path()).unwrap();
    assert_eq!(views.len(), 3);
    let expected = [
        ["`views[2].lens.perspective.focal_lenght` is", "fx, fy, cx, cy"],
        ["`unit` is", "format, version, views"],
        ["`views[1].maks` (and 1 more) is", "image, mask, depth"],
    ];
    assert_eq!(views.warnings.len(), expected.len(), "{:?}", views.warnings);
    for words in expected {
        let says = |warning: &&String| words.iter().all(|word| warning.contains(word));
        let found: Vec<_> = views.warnings.iter().filter(says).collect();
        assert_eq!(found.len(), 1, "{words:?}: {:?}", views.warnings);
        assert!(found[0].contains("cameras.json: field"), "{found:?}");
    }
    edit_json(&folder.path().join("cameras.json"), |v| {
        v["views"][1]["lens"]["orthographic"] = json!({ "sx": 1, "sy": 1, "cx": 1, "cy": 1 });
    });
    let error = read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("one of `perspective` and `orthographic`"), "{error}");
}

#[test]
fn a_smaller_copy_of_a_picture_keeps_its_camera() {
    let folder = tempfile::tempdir().unwrap();
    let written = off_center(3);
    write_photos(&written, folder.path()).unwrap();
    edit_json(&folder.path().join("cameras.json"), |v| {
        for view in v["views"].as_array_mut().unwrap() {
            view["width"] = json!(80);
            view["height"] = json!(60);
            view["lens"] = json!({ "perspective": { "fx": 76, "fy": 71, "cx": 43, "cy": 28.5 } });
        }
    });
    assert_same(&read_views(folder.path(), &with_depth(), &|_, _| {}).unwrap().views, &written);
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/colmap").join(name)
}

/// COLMAP's own files beside images of the sizes that they name.
fn colmap_project(model: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let sparse = folder.path().join("sparse");
    std::fs::create_dir_all(&sparse).unwrap();
    for entry in std::fs::read_dir(fixture(model)).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), sparse.join(entry.file_name())).unwrap();
    }
    std::fs::create_dir_all(folder.path().join("images/side")).unwrap();
    for (name, width, height) in
        [("img2.png", 64, 48), ("side/img9.png", 40, 30), ("side/img10.png", 40, 30)]
    {
        let mut image = ByteImage::new(height, width, 4);
        for k in 0..height * width {
            let inside = (k % width).abs_diff(width / 2) + (k / width).abs_diff(height / 2) < 12;
            image.data[4 * k + 3] = if inside { 255 } else { 0 };
        }
        write_png(folder.path().join("images").join(name), &image).unwrap();
    }
    folder
}

#[test]
fn what_colmap_wrote_is_read() {
    let options =
        ReadOptions { on_inconsistent: datasets::OnInconsistent::Accept, ..ReadOptions::default() };
    for model in ["binary", "text", "source"] {
        let folder = colmap_project(model);
        let views = read_views(folder.path(), &options, &|_, _| {}).unwrap().views;
        let names: Vec<_> = views.iter().map(|v| v.name.as_str()).collect();
        assert_eq!(names, ["img2", "side/img9", "side/img10"], "{model}");
        let lens = |i: usize| match views[i].camera.lens {
            Lens::Perspective { fx, fy, cx, cy } => [fx, fy, cx, cy],
            Lens::Orthographic { .. } => unreachable!("COLMAP has no such lens"),
        };
        assert_eq!(lens(0), [50.0, 50.0, 32.0, 24.0]);
        assert_eq!(lens(1), [38.0, 35.5, 21.5, 14.25]);
        // img2: no turn, 4 in front: x right, y down.
        let p = views[0].camera.project([1.0, 1.0, 0.0]);
        assert!((p.column - (32.0 + 12.5)).abs() + (p.row - (24.0 + 12.5)).abs() < 1e-12);
        assert!((p.depth - 4.0).abs() < 1e-12);
        // img9: q = (0.8, 0, 0.6, 0), so R = [[.28, 0, .96], [0, 1, 0], [-.96, 0, .28]].
        let p = views[1].camera.project([1.0, 0.5, 0.25]);
        let (x, y, z) = (0.28 + 0.24 - 1.0, 0.5 + 0.125, -0.96 + 0.07 + 3.5);
        assert!((p.column - (38.0 * x / z + 21.5)).abs() < 1e-9, "{model}");
        assert!((p.row - (35.5 * y / z + 14.25)).abs() < 1e-9);
        // The points, which the images' second lines and the tracks frame.
        let colmap = Colmap::open(folder.path()).unwrap();
        let points = colmap.points().unwrap();
        assert_eq!(points.len(), 2);
        let first = points.iter().find(|p| p.color == [200, 100, 50]).unwrap();
        assert_eq!(
            (first.position, first.error, first.observations),
            ([0.5, -0.25, 0.125], 0.75, 2)
        );
        assert_eq!(colmap.bounds().unwrap().unwrap()[0], [-1.0, -0.25, 0.125]);
    }
    let folder = colmap_project("distorted");
    let read = read_views(folder.path(), &options, &|_, _| {}).unwrap();
    assert!(
        read.warnings[0].contains("undone")
            && read.warnings[0].contains("camera 7, OPENCV (2 views)")
    );
    assert_eq!(
        read.views[0].camera,
        read_views(colmap_project("text").path(), &options, &|_, _| {}).unwrap().views[0].camera
    );
}

#[test]
fn a_turntable_gives_photographs_their_cameras() {
    let table = Turntable { count: 12, elevation: 20.0, distance: 4.0, fov: 45.0, reverse: false };
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("images")).unwrap();
    std::fs::create_dir_all(folder.path().join("masks")).unwrap();
    let template = &ball(1)[0];
    for i in 0..12 {
        // Numbered as people do: 2 comes before 10.
        write_png(folder.path().join(format!("images/IMG_{i}.png")), &template.color).unwrap();
        write_png(folder.path().join(format!("masks/IMG_{i}.png")), &template.mask).unwrap();
    }
    let error = read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("--turntable"), "{error}");
    let options = |table| ReadOptions { turntable: Some(table), ..ReadOptions::default() };
    let views = read_views(folder.path(), &options(table), &|_, _| {}).unwrap();
    assert_eq!((views.layout, views.len()), (Layout::Turntable, 12));
    for (i, view) in views.views.iter().enumerate() {
        assert_eq!(view.name, format!("images/IMG_{i}"));
        assert_eq!(view.camera, table.camera(i, 40, 30));
    }
    assert_eq!(open_with(folder.path(), &options(table)).unwrap().layout(), Layout::Turntable);
    for (table, word) in [
        (Turntable { count: 13, ..table }, "count"),
        (Turntable { count: 11, ..table }, "count"),
        (Turntable { elevation: 91.0, ..table }, "elevation"),
        (Turntable { distance: f64::NAN, ..table }, "distance"),
        (Turntable { fov: 180.0, ..table }, "fov"),
    ] {
        let error = read_views(folder.path(), &options(table), &|_, _| {}).unwrap_err();
        assert!(error.field_name().unwrap().contains(word), "{error}");
    }
}

/// A BOP dataset of one scene with the ball as object 5, in millimetres, and a stranger.
fn bop(views: &[View]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("train_pbr/000003");
    for noun in ["rgb", "mask_visib", "depth"] {
        std::fs::create_dir_all(scene.join(noun)).unwrap();
    }
    std::fs::create_dir_all(folder.path().join("models")).unwrap();
    let ball = primitives::icosphere(2).scaled([1000.0; 3]);
    write_mesh(folder.path().join("models/obj_000005.ply"), &ball).unwrap();
    let (mut cameras, mut poses, mut info) = (json!({}), json!({}), json!({}));
    for (i, view) in views.iter().enumerate() {
        let cv = view.camera.to_opencv().unwrap();
        let k = cv.intrinsics;
        // Their principal point counts from the first pixel's centre.
        let k = [k[0][0], 0.0, k[0][2] - 0.5, 0.0, k[1][1], k[1][2] - 0.5, 0.0, 0.0, 1.0];
        let flat: Vec<f64> = cv.rotation.iter().flatten().copied().collect();
        let millimetres = cv.translation.map(|t| 1000.0 * t);
        let key = i.to_string();
        cameras[&key] = json!({ "cam_K": k, "depth_scale": 0.5 });
        let pose = |id| json!({ "obj_id": id, "cam_R_m2c": flat, "cam_t_m2c": millimetres });
        poses[&key] = json!([pose(2), pose(5)]);
        info[&key] = json!([{ "visib_fract": 0.01 }, { "visib_fract": 0.9 }]);
        write_png(scene.join(format!("rgb/{i:06}.png")), &view.color).unwrap();
        write_png(scene.join(format!("mask_visib/{i:06}_000001.png")), &view.mask).unwrap();
    }
    let put = |name: &str, value: &serde_json::Value| {
        std::fs::write(scene.join(name), value.to_string()).unwrap();
    };
    put("scene_camera.json", &cameras);
    put("scene_gt.json", &poses);
    put("scene_gt_info.json", &info);
    folder
}

#[test]
fn bop_scenes_are_views_in_the_frame_of_the_model() {
    let written = off_center(11);
    let folder = bop(&written);
    for path in ["", "train_pbr", "train_pbr/000003"] {
        let path = folder.path().join(path);
        let dataset = Bop::open(&path).unwrap();
        assert_eq!(dataset.entries().len(), 1, "{:?}", dataset.entries());
        assert_eq!(dataset.entries()[0].name, "5");
        assert!(dataset.warnings()[0].contains("11 instances"), "{:?}", dataset.warnings());
        let views = read(&path).unwrap();
        assert_eq!((views.layout, views.len()), (Layout::Bop, 11));
        assert_eq!(views.views[10].name, "000010");
        for (a, b) in views.views.iter().zip(&written) {
            assert_eq!((&a.color, &a.mask), (&b.color, &b.mask));
            let (p, q) =
                (a.camera.project([300.0, 200.0, -500.0]), b.camera.project([0.3, 0.2, -0.5]));
            assert!((p.column - q.column).abs() + (p.row - q.row).abs() < 1e-9);
            assert!((p.depth - 1000.0 * q.depth).abs() < 1e-6);
        }
        let truth = dataset.truth(0).unwrap().mesh.unwrap();
        assert_eq!(truth.faces.len(), 320);
    }
    assert_eq!(Bop::open(folder.path()).unwrap().entries()[0].subset, Some(Subset::Train));
    assert_eq!(Bop::open(folder.path()).unwrap().entries()[0].category, "train_pbr");
}

#[test]
fn bop_depth_is_in_units_of_the_scene() {
    let folder = bop(&off_center(1));
    // A grey image of 16 bits: 40 x 30, every pixel 1500 units of half a millimetre but one hole.
    let mut values = vec![1500u16; 1200];
    values[0] = 0;
    let png = gray16(40, 30, &values);
    let path = folder.path().join("train_pbr/000003/depth/000000.png");
    std::fs::write(path, png).unwrap();
    let views = read_views(folder.path(), &with_depth(), &|_, _| {}).unwrap();
    let depth = views.views[0].depth.as_ref().unwrap();
    assert_eq!((depth.data[0], depth.data[1], depth.data[1199]), (f32::INFINITY, 750.0, 750.0));
}

#[test]
fn a_container_of_blenderproc_is_refused_with_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("0.hdf5"), b"\x89HDF\r\n").unwrap();
    for path in [folder.path().to_owned(), folder.path().join("0.hdf5")] {
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains("0.hdf5") && error.contains("write_bop"), "{error}");
    }
}

#[test]
fn of_several_objects_one_must_be_named() {
    let folder = bop(&off_center(2));
    let info = folder.path().join("train_pbr/000003/scene_gt_info.json");
    std::fs::remove_file(info).unwrap();
    let error = read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("train_pbr/2, train_pbr/5"), "{error}");
    let options = ReadOptions { object: Some("5".into()), ..ReadOptions::default() };
    assert_eq!(read_views(folder.path(), &options, &|_, _| {}).unwrap().len(), 2);
}

/// A PNG of 16 bits a pixel, stored without compression: no other writer of ours makes one.
fn gray16(width: u32, height: u32, values: &[u16]) -> Vec<u8> {
    let mut raw = Vec::new();
    for row in values.chunks(width as usize) {
        raw.push(0);
        raw.extend(row.iter().flat_map(|v| v.to_be_bytes()));
    }
    let adler = raw.iter().fold((1u32, 0u32), |(a, b), &byte| {
        let a = (a + u32::from(byte)) % 65521;
        (a, (b + a) % 65521)
    });
    let mut packed = vec![0x78, 0x01, 0x01];
    packed.extend_from_slice(&(raw.len() as u16).to_le_bytes());
    packed.extend_from_slice(&(!(raw.len() as u16)).to_le_bytes());
    packed.extend_from_slice(&raw);
    packed.extend_from_slice(&(adler.1 << 16 | adler.0).to_be_bytes());
    let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
    let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[16, 0, 0, 0, 0]].concat();
    for (kind, data) in [(b"IHDR", header), (b"IDAT", packed), (b"IEND", Vec::new())] {
        png.extend_from_slice(&(data.len() as u32).to_be_bytes());
        let body = [&kind[..], &data].concat();
        let crc = body.iter().fold(u32::MAX, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |c, _| {
                if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 }
            })
        });
        png.extend_from_slice(&body);
        png.extend_from_slice(&(!crc).to_be_bytes());
    }
    png
}

/// The ball from a turntable that stands as the cameras of [`Turntable::camera`] say.
#[test]
fn the_turntable_agrees_with_the_geometry() {
    let table = Turntable { count: 5, elevation: 10.0, distance: 3.0, fov: 50.0, reverse: true };
    let camera: Camera = table.camera(2, 64, 48);
    assert!((camera.center().norm() - 3.0).abs() < 1e-12);
    assert!((camera.fov().unwrap()[1].to_degrees() - 50.0).abs() < 1e-12);
}
