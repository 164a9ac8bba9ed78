//! Data sets: one file of a layout among sound ones, and whole folders.

use std::io::{Cursor, Write as _};
use std::path::Path;

use datasets::r2n2::{Rendering, write_object};
use datasets::{
    ColmapForm, MaskSource, ReadOptions, Truth, View, write_colmap, write_kaolin, write_photos,
    write_transforms,
};
use mesh_core::{ByteImage, Camera, DepthMap, R2n2View, encode_png};

use super::scratch::{packed, unpacked, with_files};

/// Opens whatever is there and asks for all of it.
fn walked(path: &Path) {
    let options = ReadOptions {
        mask: MaskSource::Whole,
        depth: true,
        allow_missing: true,
        memory_limit: 1 << 26,
        ..ReadOptions::default()
    };
    let Ok(dataset) = datasets::open_with(path, &options) else { return };
    for object in 0..dataset.entries().len().min(4) {
        let _ = dataset.views(object, None, &options, &|_, _| {});
        let _ = dataset.truth(object);
    }
}

/// Two views of nothing much.
fn views() -> Vec<View> {
    (0..2)
        .map(|k| {
            let mut mask = ByteImage::new(6, 8, 1);
            mask.data[20..28].fill(255);
            let eye = [f64::from(k), 0.5, 3.0];
            View {
                crop: None,
                name: k.to_string(),
                color: ByteImage::new(6, 8, 3),
                mask,
                camera: Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.7, 8, 6),
                depth: Some(DepthMap { height: 6, width: 8, data: vec![2.0; 48] }),
            }
        })
        .collect()
}

/// What a writer leaves in a folder, by name.
fn written(write: impl FnOnce(&Path)) -> Vec<(String, Vec<u8>)> {
    let place = tempfile::tempdir().expect("a place for seeds");
    write(place.path());
    let (mut files, mut folders) = (Vec::new(), vec![place.path().to_owned()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("our own folder").flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if let Ok(name) = path.strip_prefix(place.path()) {
                let name = name.to_string_lossy().into_owned();
                files.push((name, std::fs::read(&path).expect("our own file")));
            }
        }
    }
    files.sort();
    files
}

fn one_archive(files: &[(String, Vec<u8>)]) -> Vec<u8> {
    let files: Vec<(&str, &[u8])> =
        files.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
    packed(&files)
}

fn file_of(files: &[(String, Vec<u8>)], name: &str) -> Vec<u8> {
    files
        .iter()
        .find(|(found, _)| found == name)
        .map(|(_, bytes)| bytes.clone())
        .unwrap_or_default()
}

/// Opens the bytes as this file, beside an image that is one.
fn beside_picture(name: &str, bytes: &[u8]) {
    let png = encode_png(&ByteImage::new(6, 8, 3));
    let files = [(name, bytes), ("images/0000.png", &png), ("images/0001.png", &png)];
    with_files(&files, walked);
}

pub(crate) fn transforms(bytes: &[u8]) {
    beside_picture("transforms.json", bytes);
}

pub(crate) fn transforms_seeds() -> Vec<Vec<u8>> {
    let files = written(|folder| drop(write_transforms(&views(), folder)));
    let angle = br#"{"camera_angle_x": 0.7, "k1": 0, "frames": [{"file_path": "./images/0000",
        "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4.0],[0,0,0,1]]}]}"#;
    vec![file_of(&files, "transforms.json"), angle.to_vec()]
}

pub(crate) fn cameras(bytes: &[u8]) {
    beside_picture("cameras.json", bytes);
}

pub(crate) fn cameras_seeds() -> Vec<Vec<u8>> {
    let files = written(|folder| drop(write_photos(&views(), folder)));
    vec![file_of(&files, "cameras.json")]
}

pub(crate) fn pix3d(bytes: &[u8]) {
    for name in ["pix3d.json", "pix3d_s1_train.json"] {
        beside_picture(name, bytes);
    }
}

pub(crate) fn pix3d_seeds() -> Vec<Vec<u8>> {
    let files: [&[u8]; 2] = [
        include_bytes!("../../datasets/tests/fixtures/photos/pix3d/pix3d.json"),
        include_bytes!("../../datasets/tests/fixtures/photos/pix3d/pix3d_s1_train.json"),
    ];
    files.map(<[u8]>::to_vec).to_vec()
}

pub(crate) fn mat(bytes: &[u8]) {
    // Two layouts, since each asks for other variables.
    with_files(
        &[
            ("data/val_cub_cleaned.mat", bytes),
            (
                "sfm/anno_val.mat",
                include_bytes!(
                    "../../datasets/tests/fixtures/photos/cub/cachedir/cub/sfm/anno_val.mat"
                ),
            ),
        ],
        |root| drop(datasets::Cub::open(root)),
    );
    with_files(&[("Annotations/aeroplane_pascal/a.mat", bytes)], |root| {
        drop(datasets::Pascal3d::open(root));
    });
}

pub(crate) fn mat_seeds() -> Vec<Vec<u8>> {
    let files: [&[u8]; 5] = [
        include_bytes!("../../datasets/tests/fixtures/mat/plain.mat"),
        include_bytes!("../../datasets/tests/fixtures/mat/compressed.mat"),
        include_bytes!("../../datasets/tests/fixtures/mat/big_endian.mat"),
        include_bytes!(
            "../../datasets/tests/fixtures/photos/cub/cachedir/cub/data/val_cub_cleaned.mat"
        ),
        include_bytes!(
            "../../datasets/tests/fixtures/photos/pascal3d/Annotations/aeroplane_pascal/2008_000021.mat"
        ),
    ];
    files.map(<[u8]>::to_vec).to_vec()
}

pub(crate) fn yaml(bytes: &[u8]) {
    let png = encode_png(&ByteImage::new(6, 8, 3));
    let files = [
        ("bird/bird_train.txt", &b"a.yaml\n"[..]),
        ("bird/annotations/a.yaml", bytes),
        ("bird/images/a.jpg", &png),
        ("bird/masks/a.png", &png),
    ];
    with_files(&files, walked);
}

pub(crate) fn yaml_seeds() -> Vec<Vec<u8>> {
    let files: [&[u8]; 2] = [
        include_bytes!(
            "../../datasets/tests/fixtures/photos/mcmr/aeroplane/annotations/00000.yaml"
        ),
        include_bytes!(
            "../../datasets/tests/fixtures/photos/mcmr/aeroplane/annotations/00001.yaml"
        ),
    ];
    files.map(<[u8]>::to_vec).to_vec()
}

/// A model of COLMAP's: its files among packed ones, beside images.
fn colmap(bytes: &[u8]) {
    let png = encode_png(&ByteImage::new(6, 8, 3));
    let mut files = unpacked(bytes);
    files.push(("images/0000.png".to_owned(), &png));
    with_files(&files, |root| {
        walked(root);
        if let Ok(model) = datasets::Colmap::open(root) {
            let _ = model.bounds();
        }
    });
}

fn colmap_seed(form: ColmapForm) -> Vec<Vec<u8>> {
    let mut files = written(|folder| drop(write_colmap(&views(), folder, form)));
    files.retain(|(name, _)| name.contains("sparse"));
    vec![one_archive(&files)]
}

pub(crate) fn colmap_text(bytes: &[u8]) {
    colmap(bytes);
}

pub(crate) fn colmap_text_seeds() -> Vec<Vec<u8>> {
    colmap_seed(ColmapForm::Text)
}

pub(crate) fn colmap_binary(bytes: &[u8]) {
    colmap(bytes);
}

pub(crate) fn colmap_binary_seeds() -> Vec<Vec<u8>> {
    colmap_seed(ColmapForm::Binary)
}

/// A scene of BOP's: its files among packed ones, beside an image.
pub(crate) fn bop(bytes: &[u8]) {
    let png = encode_png(&ByteImage::new(6, 8, 3));
    let mut files = unpacked(bytes);
    files.push(("rgb/000000.png".to_owned(), &png));
    with_files(&files, walked);
}

pub(crate) fn bop_seeds() -> Vec<Vec<u8>> {
    let cameras = br#"{"0": {"cam_K": [9, 0, 4, 0, 9, 3, 0, 0, 1], "depth_scale": 0.1}}"#;
    let poses = br#"{"0": [{"cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_m2c": [0, 0, 300], "obj_id": 5}]}"#;
    let info = br#"{"0": [{"visib_fract": 0.9}]}"#;
    vec![packed(&[
        ("scene_camera.json", cameras),
        ("scene_gt.json", poses),
        ("scene_gt_info.json", info),
    ])]
}

/// Objects of 3D-R2N2's.
pub(crate) fn r2n2(bytes: &[u8]) {
    with_files(&unpacked(bytes), |root| {
        if let Ok(dataset) = datasets::r2n2::R2n2::open(root) {
            use datasets::Dataset as _;
            for object in 0..dataset.entries().len().min(2) {
                let _ = dataset.views(object, None, &ReadOptions::default(), &|_, _| {});
                let _ = dataset.truth(object);
            }
        }
    });
}

pub(crate) fn r2n2_seeds() -> Vec<Vec<u8>> {
    let mut rgba = ByteImage::new(6, 8, 4);
    rgba.data[40..120].fill(255);
    let camera = R2n2View { azimuth: 30.0, elevation: 25.0, distance_ratio: 0.8 };
    let view = Rendering { rgba, camera, depth: None, normals: None };
    let files = written(|folder| {
        let _ = write_object(folder, "02958343", "a", &[view], &Truth::default());
        let _ = std::fs::write(
            folder.join("splits.json"),
            r#"{"train": {"02958343": {"a": [0]}}, "test": {}}"#,
        );
    });
    vec![one_archive(&files)]
}

/// Views of one object in an archive.
pub(crate) fn zip(bytes: &[u8]) {
    with_files(&[("views.zip", bytes)], |root| walked(&root.join("views.zip")));
}

/// An archive whose files are stored, so that a change of a byte is one of a file's.
pub(crate) fn zip_seeds() -> Vec<Vec<u8>> {
    use ::zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};
    let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in written(|folder| drop(write_kaolin(&views(), folder))) {
        archive.start_file(name, stored).expect("a name of ours");
        archive.write_all(&bytes).expect("memory");
    }
    vec![archive.finish().expect("memory").into_inner()]
}

/// Any files at all.
pub(crate) fn folder(bytes: &[u8]) {
    with_files(&unpacked(bytes), walked);
}

pub(crate) fn folder_seeds() -> Vec<Vec<u8>> {
    let point = datasets::pixel2mesh::Sample {
        picture: Some(ByteImage::new(2, 3, 3)),
        points: datasets::SurfacePoints {
            positions: vec![[0.5; 3]],
            normals: vec![[0.0, 1.0, 0.0]],
        },
    };
    let list = br#"[{"category": "a", "name": "b", "views": 2}]"#;
    let mut generated = written(|folder| drop(write_transforms(&views(), &folder.join("a/b"))));
    generated.extend([
        ("objects.json".to_owned(), list.to_vec()),
        ("dataset.toml".to_owned(), Vec::new()),
    ]);
    let camera = b"1\nimages/0000.png 9 0 3.5 0 9 2.5 0 0 1 1 0 0 0 1 0 0 0 1 0 0 3\n";
    let mut middlebury = written(|folder| drop(write_photos(&views(), folder)));
    middlebury.retain(|(name, _)| name != "cameras.json");
    middlebury.push(("a_par.txt".to_owned(), camera.to_vec()));
    [
        middlebury,
        written(|folder| drop(write_kaolin(&views(), folder))),
        written(|folder| drop(write_transforms(&views(), folder))),
        written(|folder| drop(write_photos(&views(), folder))),
        written(|folder| drop(write_colmap(&views(), folder, ColmapForm::Binary))),
        written(|folder| {
            drop(datasets::pixel2mesh::write_sample(&folder.join("a_b_00.dat"), &point));
        }),
        generated,
    ]
    .iter()
    .map(|files| one_archive(files))
    .collect()
}
