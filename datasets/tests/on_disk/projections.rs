//! Photographs with projection matrices, in each form that they come in.

use std::io::Write;
use std::path::Path;

use datasets::{Layout, OnInconsistent, ReadOptions, ReadViewsError, Views, read_views};
use mesh_core::{ByteImage, Camera, write_png};

type Matrix = [[f64; 4]; 3];

const SIZE: [usize; 2] = [48, 36];

/// Three cameras around a ball.
fn cameras() -> Vec<Camera> {
    let eye = |k: usize| {
        let (sin, cos) = (k as f64 * 0.7 + 0.2).sin_cos();
        [4.0 * sin, 1.0, 4.0 * cos]
    };
    (0..3)
        .map(|k| Camera::look_at(eye(k), [0.1, 0.0, 0.0], [0.0, 1.0, 0.0], 0.7, SIZE[0], SIZE[1]))
        .collect()
}

/// `K [R | t]` with the middle of the first pixel at `first`, times a scale.
fn matrix(camera: &Camera, first: f64, skew: f64, scale: f64) -> Matrix {
    let cv = camera.to_opencv().unwrap();
    let mut k = cv.intrinsics;
    (k[0][1], k[0][2], k[1][2]) = (skew, k[0][2] + first - 0.5, k[1][2] + first - 0.5);
    let pose = |j: usize, c: usize| if c < 3 { cv.rotation[j][c] } else { cv.translation[j] };
    std::array::from_fn(|i| {
        std::array::from_fn(|c| scale * (0..3).map(|j| k[i][j] * pose(j, c)).sum::<f64>())
    })
}

/// Images in `images` and masks in `masks`, under these names.
fn pictures(folder: &Path, images: &str, masks: &str, name: impl Fn(usize) -> [String; 2]) {
    for place in [images, masks] {
        std::fs::create_dir_all(folder.join(place)).unwrap();
    }
    for k in 0..3 {
        let mut mask = ByteImage::new(SIZE[1], SIZE[0], 1);
        for (i, value) in mask.data.iter_mut().enumerate() {
            let [x, y] = [(i % SIZE[0]) as f64 - 24.0, (i / SIZE[0]) as f64 - 18.0];
            *value = if x.hypot(y) < 9.0 { 255 } else { 0 };
        }
        let [image, file] = name(k);
        write_png(folder.join(images).join(image), &ByteImage::new(SIZE[1], SIZE[0], 3)).unwrap();
        write_png(folder.join(masks).join(file), &mask).unwrap();
    }
}

fn read(folder: &Path) -> Result<Views, ReadViewsError> {
    let options = ReadOptions { on_inconsistent: OnInconsistent::Accept, ..ReadOptions::default() };
    read_views(folder, &options, &|_, _| {})
}

fn assert_cameras(views: &Views, tolerance: f64) {
    assert_eq!((views.layout, views.len()), (Layout::Projections, 3));
    for (view, camera) in views.views.iter().zip(cameras()) {
        assert!(view.mask_pixels() > 200, "the mask of {}", view.name);
        for point in [[0.3, -0.2, 0.1], [-0.4, 0.5, 0.2], [0.0, 0.1, -0.6]] {
            let (a, b) = (view.camera.project(point), camera.project(point));
            let error = (a.column - b.column).hypot(a.row - b.row) + (a.depth - b.depth).abs();
            assert!(error < tolerance, "{}: {error}", view.name);
        }
    }
}

fn npy(shape: &str, kind: &str, bytes: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend_from_slice(&(header.len() as u16).to_le_bytes());
    out.extend_from_slice(header.as_bytes());
    out.extend_from_slice(bytes);
    out
}

fn npz(path: &Path, matrices: &[Matrix], single: bool) {
    let mut archive = zip::ZipWriter::new(std::fs::File::create(path).unwrap());
    for (k, p) in matrices.iter().enumerate() {
        let numbers = p.iter().flatten().copied().chain([0.0, 0.0, 0.0, 1.0]);
        let bytes: Vec<u8> = if single {
            numbers.flat_map(|x| (x as f32).to_le_bytes()).collect()
        } else {
            numbers.flat_map(f64::to_le_bytes).collect()
        };
        let kind = if single { "<f4" } else { "<f8" };
        for (name, bytes) in [("world", &bytes), ("scale", &vec![0; bytes.len()])] {
            let options = zip::write::SimpleFileOptions::default();
            archive.start_file(format!("{name}_mat_{k}.npy"), options).unwrap();
            archive.write_all(&npy("(4, 4)", kind, bytes)).unwrap();
        }
    }
    archive.finish().unwrap();
}

#[test]
fn idr_and_neus() {
    let matrices: Vec<Matrix> = cameras().iter().map(|c| matrix(c, 0.0, 0.0, -250.0)).collect();
    for (file, single, tolerance) in
        [("cameras_sphere.npz", false, 1e-9), ("cameras.npz", true, 1e-3)]
    {
        let folder = tempfile::tempdir().unwrap();
        // IDR's masks have fewer digits than its images.
        pictures(folder.path(), "image", "mask", |k| {
            [format!("{k:06}.png"), format!("{k:03}.png")]
        });
        npz(&folder.path().join(file), &matrices, single);
        assert_cameras(&read(folder.path()).unwrap(), tolerance);
        npz(&folder.path().join(file), &matrices[..2], single);
        let error = read(folder.path()).unwrap_err().to_string();
        assert!(error.contains("2 matrices") && error.contains("3, as many"), "{error}");
    }
}

#[test]
fn plain_text() {
    let folder = tempfile::tempdir().unwrap();
    pictures(folder.path(), "images", "masks", |k| [format!("{k}.png"), format!("{k}.png")]);
    let line = |row: &[f64; 4]| row.map(|x| x.to_string()).join(" ");
    let write = |skew: f64| {
        let rows: Vec<String> = cameras()
            .iter()
            .flat_map(|c| matrix(c, 0.0, skew, 3.0))
            .map(|row| line(&row))
            .collect();
        let text = format!("# three cameras\n{}\n", rows.join("\n"));
        std::fs::write(folder.path().join("projections.txt"), &text).unwrap();
        text
    };
    let text = write(0.0);
    let views = read(folder.path()).unwrap();
    assert_cameras(&views, 1e-9);
    assert!(views.warnings.is_empty(), "{:?}", views.warnings);
    // A small skew is resampled away; a large one is no camera's.
    write(0.5);
    let views = read(folder.path()).unwrap();
    assert!(views.warnings[0].contains("skew") && views.warnings[0].contains("3 views"));
    let camera = &cameras()[0];
    let point = [0.3, -0.2, 0.1];
    let (a, b) = (views.views[0].camera.project(point), camera.project(point));
    // The frame may have grown to hold what was sheared out of it.
    let (dx, dy) = (a.column - b.column, a.row - b.row);
    assert!((dx - dx.round()).abs() < 1e-9 && (dy - dy.round()).abs() < 1e-9, "{dx} {dy}");
    write(30.0);
    let error = read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("projective frame") && error.contains("line 2"), "{error}");
    for (damaged, words) in [
        (text.replacen("# three", "three", 1), "line 1"),
        (text.trim_end().rsplit_once(' ').unwrap().0.to_owned(), "11 numbers"),
        (String::new(), "at least one matrix"),
    ] {
        std::fs::write(folder.path().join("projections.txt"), damaged).unwrap();
        let error = read(folder.path()).unwrap_err().to_string();
        assert!(error.contains(words), "{words}: {error}");
    }
}

#[test]
fn pmvs() {
    let folder = tempfile::tempdir().unwrap();
    pictures(folder.path(), "visualize", "masks", |k| {
        [format!("{k:08}.png"), format!("{k:08}.png")]
    });
    std::fs::create_dir_all(folder.path().join("txt")).unwrap();
    for (k, camera) in cameras().iter().enumerate() {
        let rows = matrix(camera, 0.0, 0.0, 1.0).map(|row| row.map(|x| x.to_string()).join(" "));
        let text = format!("CONTOUR\n{}\n", rows.join("\n"));
        std::fs::write(folder.path().join(format!("txt/{k:08}.txt")), text).unwrap();
    }
    assert_cameras(&read(folder.path()).unwrap(), 1e-9);
    std::fs::remove_file(folder.path().join("txt/00000002.txt")).unwrap();
    assert!(read(folder.path()).unwrap_err().to_string().contains("00000002.txt"));
}

/// A MATLAB 5 element: its type, its bytes, padding to eight.
fn element(kind: u32, bytes: &[u8]) -> Vec<u8> {
    let mut out = [kind.to_le_bytes(), (bytes.len() as u32).to_le_bytes()].concat();
    out.extend_from_slice(bytes);
    out.resize(out.len().next_multiple_of(8), 0);
    out
}

/// An array of a class, its size, its name, and what follows.
fn array(class: u8, size: [i32; 2], name: &str, rest: &[u8]) -> Vec<u8> {
    let flags = element(6, &[class, 0, 0, 0, 0, 0, 0, 0]);
    let size = element(5, &size.map(i32::to_le_bytes).concat());
    element(14, &[flags, size, element(1, name.as_bytes()), rest.to_vec()].concat())
}

#[test]
fn cells_of_matlab() {
    let folder = tempfile::tempdir().unwrap();
    pictures(folder.path(), "images", "masks", |k| {
        [format!("viff.{k:03}.png"), format!("viff.{k:03}.png")]
    });
    let cell = |camera: &Camera| {
        let p = matrix(camera, 1.0, 0.0, 0.01);
        let columns: Vec<u8> = (0..12).flat_map(|k| p[k % 3][k / 3].to_le_bytes()).collect();
        array(6, [3, 4], "", &element(9, &columns))
    };
    let cells: Vec<u8> = cameras().iter().flat_map(cell).collect();
    let mut file = vec![b' '; 124];
    file.extend_from_slice(&[0, 1, b'I', b'M']);
    file.extend_from_slice(&array(1, [1, 3], "P", &cells));
    std::fs::write(folder.path().join("dino_Ps.mat"), &file).unwrap();
    assert_cameras(&read(folder.path()).unwrap(), 1e-9);
}
