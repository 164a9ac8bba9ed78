//! COLMAP's rigs and frames, as COLMAP 4 writes them (`fixtures/colmap/rig/make.py`).

use std::path::Path;

use datasets::{OnInconsistent, ReadOptions, Views, read_views, write_colmap};
use mesh_core::{ByteImage, write_png};

use crate::common::ball;

const FORMS: [(&str, &str); 2] = [("binary", "bin"), ("text", "txt")];

/// The model of COLMAP beside images of the sizes that it names.
fn project(form: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let sparse = folder.path().join("sparse/0");
    std::fs::create_dir_all(&sparse).unwrap();
    let fixture =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/colmap/rig").join(form);
    for entry in std::fs::read_dir(fixture).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), sparse.join(entry.file_name())).unwrap();
    }
    let mut image = ByteImage::new(48, 64, 4);
    (0..48 * 64).for_each(|k| image.data[4 * k + 3] = if k % 64 < 20 { 255 } else { 0 });
    for name in ["1/1", "2/1", "1/2", "2/2", "2/3", "3/4"] {
        let path = folder.path().join(format!("images/{name}.png"));
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        write_png(path, &image).unwrap();
    }
    folder
}

fn read(folder: &Path) -> Result<Views, String> {
    let options = ReadOptions { on_inconsistent: OnInconsistent::Accept, ..ReadOptions::default() };
    read_views(folder, &options, &|_, _| {}).map_err(|error| error.to_string())
}

/// Where the views see a few points of the world.
fn seen(views: &Views) -> Vec<[f64; 3]> {
    let points = [[0.1, 0.2, -0.3], [-0.4, 0.3, 0.2]];
    let of = |view: &datasets::View| {
        points.map(|point| view.camera.project(point)).map(|p| [p.column, p.row, p.depth])
    };
    views.views.iter().flat_map(of).collect()
}

fn is_near(a: &[[f64; 3]], b: &[[f64; 3]]) -> bool {
    a.len() == b.len()
        && a.iter().flatten().zip(b.iter().flatten()).all(|(x, y)| (x - y).abs() < 1e-9)
}

#[test]
fn poses_are_composed_of_frames_and_rigs() {
    for (form, extension) in FORMS {
        let folder = project(form);
        let sparse = folder.path().join("sparse/0");
        // COLMAP wrote the composed poses too: nothing to say.
        let composed = read(folder.path()).unwrap();
        assert_eq!((composed.len(), composed.warnings.len()), (6, 0), "{:?}", composed.warnings);
        for noun in ["rigs", "frames"] {
            std::fs::remove_file(sparse.join(format!("{noun}.{extension}"))).unwrap();
        }
        let own = read(folder.path()).unwrap();
        assert!(is_near(&seen(&composed), &seen(&own)), "{form}");

        // Images whose poses say nothing: those of frames and rigs count, as they do in COLMAP.
        let folder = project(form);
        let images = folder.path().join("sparse/0").join(format!("images.{extension}"));
        let bytes = std::fs::read(&images).unwrap();
        let identity = [1.0f64, 0.0, 0.0, 0.0, 0.0, 0.0, 9.0];
        let changed = if form == "text" {
            let text = String::from_utf8(bytes).unwrap();
            let line = |line: &str| match line.split(' ').collect::<Vec<_>>()[..] {
                [id, _, _, _, _, _, _, _, camera, name] => {
                    format!("{id} 1 0 0 0 0 0 9 {camera} {name}")
                }
                _ => line.to_owned(),
            };
            (text.lines().map(line).collect::<Vec<_>>().join("\n") + "\n").into_bytes()
        } else {
            // Eight bytes of count; each image has as many bytes as the next.
            let (head, rest) = bytes.split_at(8);
            let mut changed = head.to_vec();
            for image in rest.chunks_exact(rest.len() / 6) {
                changed.extend_from_slice(&image[..4]);
                changed.extend(identity.iter().flat_map(|x| x.to_le_bytes()));
                changed.extend_from_slice(&image[60..]);
            }
            changed
        };
        std::fs::write(&images, changed).unwrap();
        let moved = read(folder.path()).unwrap();
        assert!(is_near(&seen(&composed), &seen(&moved)), "{form}");
        let said = &moved.warnings[0];
        assert!(said.contains("place 6 of 6 images") && said.contains(extension), "{said}");
    }
}

#[test]
fn what_is_wrong_with_frames_is_named() {
    let folder = project("text");
    let sparse = folder.path().join("sparse/0");
    let frames = std::fs::read_to_string(sparse.join("frames.txt")).unwrap();
    let fails = |from: &str, to: &str| {
        assert!(frames.contains(from));
        std::fs::write(sparse.join("frames.txt"), frames.replacen(from, to, 1)).unwrap();
        read(folder.path()).unwrap_err()
    };
    let error = fails("2 CAMERA 1 1 CAMERA 2 2", "2 CAMERA 1 1 CAMERA 7 2");
    assert!(error.contains("frames.txt") && error.contains("camera 7 of rig 1"), "{error}");
    let error = fails("2 CAMERA 1 1 CAMERA 2 2", "2 CAMERA 2 1 CAMERA 2 2");
    assert!(error.contains("expected camera 1, which the image names"), "{error}");
    let error = fails("2 CAMERA 1 1 CAMERA 2 2", "9 CAMERA 1 1 CAMERA 2 2");
    assert!(error.contains("line 4, SENSOR_TYPE"), "{error}");
    // A sensor that is no camera, and a camera whose place in the rig is not known.
    let rigs = std::fs::read_to_string(sparse.join("rigs.txt")).unwrap();
    std::fs::write(sparse.join("frames.txt"), &frames).unwrap();
    let end = rigs.find("\n2 1 CAMERA 3").unwrap();
    let start = rigs.find("1 2 CAMERA 1").unwrap();
    let rest = &rigs[end..];
    let text = format!("{}1 3 CAMERA 1 CAMERA 2 0 IMU 2 0{rest}", &rigs[..start]);
    std::fs::write(sparse.join("rigs.txt"), text).unwrap();
    assert_eq!(read(folder.path()).unwrap().warnings, Vec::<String>::new());
}

#[test]
fn damaged_rigs_are_errors() {
    for noun in ["rigs", "frames"] {
        let folder = project("binary");
        let file = folder.path().join(format!("sparse/0/{noun}.bin"));
        let bytes = std::fs::read(&file).unwrap();
        for end in 0..bytes.len() {
            std::fs::write(&file, &bytes[..end]).unwrap();
            assert!(read(folder.path()).unwrap_err().contains(noun), "{noun} cut at {end}");
        }
        for at in 0..bytes.len() {
            let mut bytes = bytes.clone();
            bytes[at] = 0xff;
            std::fs::write(&file, &bytes).unwrap();
            // Whatever it is now: no panic, no hang.
            let _ = read(folder.path());
        }
    }
}

#[test]
fn rigs_of_an_earlier_model_do_not_survive_writing() {
    for (form, _) in FORMS {
        let folder = project(form);
        let views = ball(2);
        write_colmap(&views, folder.path(), datasets::ColmapForm::Binary).unwrap();
        let back = read(folder.path()).unwrap();
        assert_eq!(back.warnings, Vec::<String>::new());
        let written = Views::in_memory(views);
        assert!(is_near(&seen(&back), &seen(&written)));
    }
}
