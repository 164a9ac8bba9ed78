//! `unsphere data mask` and `unsphere capture`, from the command line.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{unsphere, unsphere_with};
use datasets::{MaskSource, ReadOptions, View, read_views, write_photos};
use jpeg_encoder::{ColorType, Encoder};
use mesh_core::{ByteImage, Camera, Distortion, Lens, TriMesh, primitives, read_mesh};
use synth::{Cloth, Lighting, Orbit, RenderOptions, Room, Wall, marbled};

/// A pebble with a waist, painted in small details.
fn pebble() -> TriMesh {
    let mut mesh = primitives::icosphere(6);
    for p in &mut mesh.positions {
        let [x, y, z] = *p;
        let bump = 1.0 + 0.12 * (5.0 * x + 1.0).sin() * (4.0 * z).cos() + 0.18 * (3.0 * y).cos();
        *p = [0.8 * bump * x, 0.9 * bump * y, 0.65 * bump * z];
    }
    marbled(&mesh, [[0.75, 0.16, 0.12], [0.95, 0.72, 0.30]], 3.5, 9)
}

/// Photographs of the pebble on a table, their masks true.
fn photographed(count: usize, [width, height]: [usize; 2]) -> Vec<View> {
    let orbit = Orbit {
        count,
        target: [0.0; 3],
        distance: [4.2, 4.8],
        elevation: [15.0, 50.0],
        fov_y: 42.0,
        width,
        height,
        ..Orbit::default()
    };
    let room = Room { cloth: Cloth::Print, wall: Wall::Landscape, shadow: 0.3, seed: 3 };
    let options = RenderOptions { lighting: Lighting::studio(), ..RenderOptions::default() };
    room.photograph(&pebble(), &orbit.cameras(), &options).unwrap()
}

fn iou(a: &ByteImage, b: &ByteImage) -> f64 {
    let pairs = || a.data.iter().zip(&b.data);
    let both = pairs().filter(|(a, b)| **a != 0 && **b != 0).count();
    both as f64 / pairs().filter(|(a, b)| **a != 0 || **b != 0).count().max(1) as f64
}

#[test]
fn masks_are_found_beside_the_views_and_fit_takes_them() {
    let place = tempfile::tempdir().unwrap();
    let views = photographed(12, [96, 72]);
    write_photos(&views, &place.path().join("views")).unwrap();
    let refused = unsphere(place.path(), ["data", "mask", "views"]);
    refused.fails(1, &["views/masks exists already"]);
    let run = ["data", "mask", "views", "-o", "found", "--json", "--threads", "2"];
    let found = unsphere(place.path(), run).ok().json();
    assert_eq!(found["views"].as_array().unwrap().len(), 12, "{found}");
    let again =
        unsphere(place.path(), ["data", "mask", "views", "-o", "again", "-q", "--threads", "1"]);
    again.ok();
    let mut sum = 0.0;
    for (k, view) in views.iter().enumerate() {
        let file = format!("{k:04}.png");
        let [mask, same] = ["found", "again"].map(|folder| {
            mesh_core::read_image(place.path().join(folder).join("images").join(&file))
        });
        let mask = mask.unwrap();
        assert_eq!(mask, same.unwrap());
        assert!(mask.data.iter().all(|&m| m == 0 || m == 255));
        sum += iou(&view.mask, &mask) / 12.0;
    }
    assert!(sum > 0.96, "mask IoU {sum:.4}");
    // What was written is what `--masks` reads, and `--mask color-model` finds the same.
    for with in [["--masks", "found"], ["--mask", "color-model"]] {
        let found = unsphere_with(
            place.path(),
            &[&["data", "inspect", "views", "--json"][..], &with].concat(),
        );
        let iou = found.ok().json()["looked_at"][0]["agreement"]["hull_iou"].as_f64().unwrap();
        assert!(iou > 0.97, "{with:?}: {iou}");
    }
}

#[test]
fn masks_of_smaller_images_are_taken_and_mended_as_asked() {
    let place = tempfile::tempdir().unwrap();
    write_photos(&photographed(8, [96, 72]), &place.path().join("views")).unwrap();
    let mask = |folder: &str, how: &[&str]| -> Vec<ByteImage> {
        let run = [&["data", "mask", "views", "-q", "-o", folder][..], how].concat();
        unsphere_with(place.path(), &run).ok();
        let file = |k: usize| place.path().join(format!("{folder}/images/{k:04}.png"));
        (0..8).map(|k| mesh_core::read_image(file(k)).unwrap()).collect()
    };
    let small = mask("small", &["--max-size", "48"]);
    assert_eq!((small[0].width, small[0].height), (48, 36));
    let inspect = ["data", "inspect", "views", "--json", "--masks", "small"];
    let found = unsphere(place.path(), inspect).ok().json();
    assert!(found["looked_at"][0]["agreement"]["hull_iou"].as_f64().unwrap() > 0.9, "{found}");
    let wider = mask("wider", &["--max-size", "48", "--dilate-masks", "3"]);
    let count = |masks: &[ByteImage]| -> usize {
        masks.iter().flat_map(|mask| &mask.data).map(|&m| usize::from(m == 255)).sum()
    };
    assert!(count(&wider) * 10 > count(&small) * 12, "{} {}", count(&wider), count(&small));
}

#[test]
fn what_cannot_be_masked_is_refused() {
    let place = tempfile::tempdir().unwrap();
    write_photos(&photographed(2, [40, 30]), &place.path().join("two")).unwrap();
    let two = unsphere(place.path(), ["data", "mask", "two", "-o", "found"]);
    two.fails(3, &["2 views", "at least 3"]);
    assert!(!place.path().join("found").exists());
    let far = ["data", "mask", "two", "-o", "found", "--box", "0,0,0,1,1"];
    unsphere(place.path(), far).fails(2, &["six numbers"]);
    let other = ["data", "mask", "two", "-o", "found", "--mask", "backdrop"];
    unsphere(place.path(), other).fails(2, &["--mask"]);
    let both = ["data", "mask", "two", "--model", "m.onnx", "--box", "0,0,0,1,1,1"];
    unsphere(place.path(), both).fails(2, &["--model", "--box"]);
}

/// A program on the path that is called colmap.
#[cfg(unix)]
fn fake(folder: &Path, text: &str) -> PathBuf {
    use std::os::unix::fs::PermissionsExt;
    let path = folder.join("colmap");
    std::fs::write(&path, format!("#!/bin/sh\n[ \"$2\" = -h ] && exit 0\n{text}\n")).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    path
}

/// `capture` where only these programs are on the path.
#[cfg(unix)]
fn capture(place: &Path, path: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_unsphere"));
    command.args(["capture", "photos", "-o", "out"]).current_dir(place).env("PATH", path);
    command
}

#[cfg(unix)]
fn photos(place: &Path) {
    let folder = place.join("photos");
    std::fs::create_dir(&folder).unwrap();
    for (k, view) in photographed(4, [32, 24]).iter().enumerate() {
        mesh_core::write_png(folder.join(format!("{k}.png")), &view.color).unwrap();
    }
}

/// Nothing is left where the output was to be.
#[cfg(unix)]
fn nothing_else_than_photos(place: &Path) {
    let names: Vec<_> = std::fs::read_dir(place).unwrap().map(|e| e.unwrap().file_name()).collect();
    let known = ["photos", "bin", "started", "ended"];
    assert!(names.iter().all(|name| known.contains(&name.to_str().unwrap())), "{names:?}");
}

#[test]
#[cfg(unix)]
fn without_colmap_it_says_how_to_install_it() {
    let place = tempfile::tempdir().unwrap();
    photos(place.path());
    let run = capture(place.path(), "/nowhere").output().unwrap();
    let text = String::from_utf8(run.stderr).unwrap();
    assert_eq!(run.status.code(), Some(1), "{text}");
    assert!(text.contains("apt-get install colmap") && text.contains("--colmap"), "{text}");
    nothing_else_than_photos(place.path());
}

#[test]
#[cfg(unix)]
fn a_colmap_that_fails_is_quoted_and_leaves_nothing() {
    let place = tempfile::tempdir().unwrap();
    photos(place.path());
    let bin = place.path().join("bin");
    std::fs::create_dir(&bin).unwrap();
    fake(&bin, "[ $1 = exhaustive_matcher ] && { echo 'no such table'; exit 5; }; exit 0");
    let run = capture(place.path(), bin.to_str().unwrap()).output().unwrap();
    let text = String::from_utf8(run.stderr).unwrap();
    assert_eq!(run.status.code(), Some(1), "{text}");
    assert!(text.contains("exhaustive_matcher failed") && text.contains("no such table"), "{text}");
    nothing_else_than_photos(place.path());
    // One that does nothing at all finds no cameras.
    fake(&bin, "exit 0");
    let run = capture(place.path(), bin.to_str().unwrap()).output().unwrap();
    let text = String::from_utf8(run.stderr).unwrap();
    assert_eq!(run.status.code(), Some(3), "{text}");
    assert!(text.contains("found no cameras"), "{text}");
    nothing_else_than_photos(place.path());
}

#[test]
#[cfg(unix)]
fn ctrl_c_stops_colmap_and_leaves_nothing() {
    let place = tempfile::tempdir().unwrap();
    photos(place.path());
    let bin = place.path().join("bin");
    std::fs::create_dir(&bin).unwrap();
    let sign = |name: &str| place.path().join(name);
    let text = format!(
        "/bin/touch {}; /bin/sleep 20; /bin/touch {}",
        sign("started").display(),
        sign("ended").display()
    );
    fake(&bin, &text);
    let mut run =
        capture(place.path(), bin.to_str().unwrap()).stderr(Stdio::piped()).spawn().unwrap();
    let start = Instant::now();
    while !sign("started").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "it did not start");
        std::thread::sleep(Duration::from_millis(20));
    }
    let pressed = Instant::now();
    let kill = Command::new("kill").args(["-INT", &run.id().to_string()]).status().unwrap();
    assert!(kill.success());
    assert_eq!(run.wait().unwrap().code(), Some(130));
    assert!(pressed.elapsed() < Duration::from_secs(15));
    assert!(!sign("ended").exists());
    nothing_else_than_photos(place.path());
}

#[test]
#[cfg(unix)]
fn ctrl_c_while_masks_are_made_leaves_nothing() {
    let place = tempfile::tempdir().unwrap();
    // Enough to be busy with.
    let views = photographed(12, [480, 360]);
    write_photos(&views, &place.path().join("photos")).unwrap();
    let names = || -> Vec<_> {
        std::fs::read_dir(place.path()).unwrap().map(|e| e.unwrap().file_name()).collect()
    };
    let mut run = Command::new(env!("CARGO_BIN_EXE_unsphere"))
        .args(["data", "mask", "photos", "-o", "found", "-q"])
        .current_dir(place.path())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while names().len() == 1 {
        assert!(start.elapsed() < Duration::from_secs(60), "it did not start");
        std::thread::sleep(Duration::from_millis(5));
    }
    // It listens as soon as the folder is there, or nearly so.
    std::thread::sleep(Duration::from_millis(50));
    let kill = Command::new("kill").args(["-INT", &run.id().to_string()]).status().unwrap();
    assert!(kill.success());
    assert_eq!(run.wait().unwrap().code(), Some(130));
    assert_eq!(names(), ["photos"]);
}

/// What a lens of this kind makes of a pinhole's image, of colours and of the mask.
fn bent(view: &View, lens: &Distortion, [width, height]: [usize; 2]) -> [ByteImage; 2] {
    let Lens::Perspective { fx, fy, cx, cy } = view.camera.lens else { panic!("a pinhole") };
    let undo = lens.undistorter();
    let (w, h) = (view.color.width, view.color.height);
    // The middle of a larger image.
    let middle = [(w - width) / 2, (h - height) / 2];
    let mut color = ByteImage::new(height, width, 3);
    let mut mask = ByteImage::new(height, width, 1);
    for k in 0..width * height {
        let at = [k % width + middle[0], k / width + middle[1]].map(|v| v as f64 + 0.5);
        let ray = undo([(at[0] - cx) / fx, (at[1] - cy) / fy]).unwrap();
        let place = [(fx * ray[0] + cx) - 0.5, (fy * ray[1] + cy) - 0.5];
        let near = |v: f64, size: usize| (v.max(0.0) as usize).min(size - 2);
        let (x, y) = (near(place[0], w), near(place[1], h));
        let (s, t) = (place[0] - x as f64, place[1] - y as f64);
        let taps =
            [(0, (1.0 - s) * (1.0 - t)), (1, s * (1.0 - t)), (w, (1.0 - s) * t), (w + 1, s * t)];
        let blend = |image: &ByteImage, c: usize| -> f64 {
            let at = |tap: usize| f64::from(image.data[(y * w + x + tap) * image.channels + c]);
            taps.iter().map(|&(tap, weight)| weight * at(tap)).sum()
        };
        (0..3).for_each(|c| color.data[3 * k + c] = (blend(&view.color, c) + 0.5) as u8);
        mask.data[k] = if blend(&view.mask, 0) >= 127.5 { 255 } else { 0 };
    }
    [color, mask]
}

/// A JPEG as a camera writes that was held upright: the image lies on its side, and EXIF says so.
fn jpeg(upright: &ByteImage) -> Vec<u8> {
    let (width, height) = (upright.height, upright.width);
    let mut lying = Vec::with_capacity(upright.data.len());
    for i in 0..height {
        for j in 0..width {
            // Turned by a quarter clockwise it is upright.
            let at = j * upright.width + (upright.width - 1 - i);
            lying.extend_from_slice(&upright.data[3 * at..3 * at + 3]);
        }
    }
    let mut bytes = Vec::new();
    Encoder::new(&mut bytes, 93)
        .encode(&lying, width as u16, height as u16, ColorType::Rgb)
        .unwrap();
    let mut exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    exif.extend([6, 0, 0, 0, 0, 0, 0, 0]);
    let length = (exif.len() as u16 + 2).to_be_bytes();
    bytes.splice(2..2, [&[0xff, 0xe1], &length[..], &exif].concat());
    bytes
}

#[test]
fn the_photographs_of_the_trial_are_upright() {
    let mut image = ByteImage::new(16, 24, 3);
    image.data[..24 * 3 * 8].fill(250);
    let read = mesh_core::decode_image(&jpeg(&image), "upright.jpg").unwrap();
    assert_eq!((read.height, read.width), (16, 24));
    assert!(read.data[..24 * 3 * 7].iter().all(|&v| v > 200), "the upper half is white");
    assert!(read.data[24 * 3 * 9..].iter().all(|&v| v < 60), "the lower half is black");
}

/// From nothing but photographs, through a lens that bends and EXIF that turns, to a mesh: silhouettes of views that
/// were not fitted.
#[test]
#[ignore = "needs colmap on the path, and minutes"]
fn from_photographs_to_a_mesh() {
    let place = tempfile::tempdir().unwrap();
    let folder = match std::env::var_os("CAPTURE_TRIAL") {
        Some(folder) => PathBuf::from(folder),
        None => place.path().to_owned(),
    };
    let lens = Distortion::brown_conrady([-0.12, 0.03, 0.0], [0.0, 0.0]);
    let size = [480, 400];
    for name in ["photos", "truth/images"] {
        std::fs::create_dir_all(folder.join(name)).unwrap();
    }
    for (k, view) in photographed(36, [560, 470]).iter().enumerate() {
        let [color, mask] = bent(view, &lens, size);
        std::fs::write(folder.join(format!("photos/p{k:02}.jpg")), jpeg(&color)).unwrap();
        mesh_core::write_png(folder.join(format!("truth/images/p{k:02}.png")), &mask).unwrap();
    }
    let captured = unsphere(&folder, ["capture", "photos", "-o", "views", "--json", "--force"]);
    let captured = captured.ok().json();
    assert!(captured["views"].as_u64().unwrap() >= 34, "{captured}");
    assert_eq!(captured["problems"], serde_json::json!([]), "{captured}");
    unsphere(&folder, ["fit", "views", "-o", "mesh", "--json", "--force"]).ok();
    // The true masks through the lens that COLMAP found: its model, with masks in the place of images.
    let model = folder.join("truth/sparse/0");
    std::fs::create_dir_all(&model).unwrap();
    for file in std::fs::read_dir(folder.join("views/colmap")).unwrap() {
        let file = file.unwrap();
        std::fs::copy(file.path(), model.join(file.file_name())).unwrap();
    }
    let whole = ReadOptions { mask: MaskSource::Whole, ..ReadOptions::default() };
    let truth = read_views(&folder.join("truth"), &whole, &|_, _| ()).unwrap();
    let found = read_views(&folder.join("views"), &ReadOptions::default(), &|_, _| ()).unwrap();
    let mut true_views = Vec::new();
    let mut sum = 0.0;
    for (truth, found) in truth.views.iter().zip(&found.views) {
        let data = truth.color.data.chunks_exact(3).map(|p| if p[0] >= 128 { 255 } else { 0 });
        let mask = ByteImage { data: data.collect(), channels: 1, ..truth.color };
        sum += iou(&mask, &found.mask);
        true_views.push(View { mask, ..found.clone() });
    }
    let mean = sum / true_views.len() as f64;
    assert!(mean >= 0.95, "masks: {mean:.4}");
    let mesh = read_mesh(folder.join("mesh/mesh.ply")).unwrap();
    let held_out: Vec<&View> = true_views.iter().skip(4).step_by(5).collect();
    let scores = recon::evaluate::score_views(&mesh, &held_out, &|_, _| ()).unwrap();
    assert!(scores.mask_iou >= 0.95, "{:.4}", scores.mask_iou);
}

#[test]
fn a_lens_that_bends_nothing_leaves_the_middle_of_the_image() {
    let view = photographed(1, [48, 40]).remove(0);
    let none = Distortion::brown_conrady([0.0; 3], [0.0; 2]);
    let [color, mask] = bent(&view, &none, [40, 32]);
    let Camera { width, height, .. } = view.camera;
    assert_eq!((width, height), (48, 40));
    for k in 0..40 * 32 {
        let at = (k / 40 + 4) * 48 + k % 40 + 4;
        assert_eq!(mask.data[k], view.mask.data[at]);
        assert_eq!(color.data[3 * k], view.color.data[3 * at]);
    }
}
