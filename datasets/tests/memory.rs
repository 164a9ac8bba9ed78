//! What a file makes its reader take is in proportion to the file: 256 MB, and 20 bytes for each of its
//! own. The densest contents of each format are tried at a size where more would show.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "../../mesh-core/tests/counting/mod.rs"]
mod counting;

use std::io::Write;
use std::path::Path;

use counting::{alone, limit, peak};
use datasets::pixel2mesh::{Ellipsoid, Pixel2Mesh, read_sample};
use datasets::r2n2::R2n2;
use datasets::{Bop, Colmap, Cub, Dataset, Mcmr, Pix3d, ReadOptions, open, read_depth_file};
use mesh_core::{ByteImage, write_png};

/// As long as the nested pickles that once took 396 MB.
const SIZE: usize = 6_000_000;

/// Writes a file, reads something with it, and holds that to the limit for `stored` bytes.
fn held<T>(path: &Path, bytes: &[u8], what: &str, read: impl FnOnce() -> T) -> T {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
    let (taken, result) = peak(read);
    let most = limit(bytes.len());
    assert!(taken <= most, "{what}: {taken} bytes for {}, at most {most}", bytes.len());
    result
}

/// As much of the unit as fits, between two ends.
fn filled(start: &str, unit: &str, end: &str) -> Vec<u8> {
    let count = (SIZE - start.len() - end.len()) / unit.len();
    [start.as_bytes(), &unit.as_bytes().repeat(count), end.as_bytes()].concat()
}

#[test]
fn pickles() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("info_ellipsoid.dat");
    let arrays = || {
        // One array of bytes, remembered, and asked for again and again.
        let mut bytes =
            b"\x80\x02(cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\n".to_vec();
        bytes.extend(b"K\0\x85U\x01b\x87R(K\x01(J");
        let data = SIZE as u32;
        bytes.extend(data.to_le_bytes());
        bytes.extend(b"tcnumpy\ndtype\nU\x02u1K\0K\x01\x87R(K\x03U\x01|NNNK\xffK\xffK\0tb\x89T");
        bytes.extend(data.to_le_bytes());
        bytes.resize(bytes.len() + SIZE, 7);
        bytes.extend(b"tbq\0h\0h\0h\0h\0h\0h\0h\0t.");
        bytes
    };
    for (what, bytes) in [
        ("empty lists", filled("\u{1}", "]", ".")),
        ("lists in lists", filled("", "(l", ".")),
        ("lists of one", filled("(", "]N\u{61}", "t.")),
        ("numbers", filled("(", "K\u{1}", "l.")),
        ("copies of the top", filled("N", "2", ".")),
        ("remembered", filled("N", "q\u{1}", ".")),
        ("names", filled("", "c\n\n", ".")),
        ("texts", filled("", "V\n", ".")),
        ("a long text", [b"V".to_vec(), vec![0xff; SIZE], b"\n.".to_vec()].concat()),
        ("a list that grows", filled("](", "(K\u{1}e", ".")),
        ("tuples of one", filled("N", "\u{85}", ".").into_iter().filter(|&b| b != 0xc2).collect()),
        ("arrays that share bytes", arrays()),
    ] {
        let _ = held(&path, &bytes, what, || read_sample(&path));
        let _ = held(&path, &bytes, what, || Ellipsoid::open(&path));
    }
}

#[test]
fn json() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (frames, end) = (r#"{"camera_angle_x": 1, "frames": ["#, "0]}");
    let frame = r#"{"file_path":"","transform_matrix":[[0,0,0,0],[0,0,0,0],[0,0,0,0],[0,0,0,0]]},"#;
    let units =
        ["0,", "[],", "[0],", "{},", "{\"\":0},", "\"\",", "NaN,", "{\"a\":{\"\":[0]}},", frame];
    let options = ReadOptions { allow_missing: true, ..ReadOptions::default() };
    for unit in units {
        let bytes = filled(frames, unit, end);
        let path = folder.path().join("poses.json");
        let _ = held(&path, &bytes, unit, || datasets::open_with(&path, &options).map(drop));
    }
    let views = r#"{"format": "unsphere-cameras", "version": 1, "views": ["#;
    let path = folder.path().join("cameras.json");
    let _ = held(&path, &filled(views, "[[0]],", end), "cameras", || open(&path).map(drop));
    let path = folder.path().join("pix3d.json");
    let _ = held(&path, &filled("[", "{\"img\":\"\"},", "0]"), "pix3d", || Pix3d::open(&path));
    // Keys that stand in the names of all that is below them.
    let key = format!("{{\"{}1\": [", "0".repeat(SIZE / 2));
    let scene = folder.path().join("scene");
    std::fs::create_dir(&scene).unwrap();
    std::fs::write(scene.join("scene_camera.json"), "{}").unwrap();
    let path = scene.join("scene_gt.json");
    let _ = held(&path, &filled(&key, "{},", "0]}"), "a long key", || Bop::open(&scene));
    // Many objects of a split, each in a tree of its own.
    let root = folder.path().join("r2n2");
    let rendering = root.join("ShapeNetRendering/02958343/a/rendering");
    std::fs::create_dir_all(&rendering).unwrap();
    std::fs::write(rendering.join("rendering_metadata.txt"), "1 2 0 0.7 25\n").unwrap();
    let objects: Vec<u8> =
        (0..SIZE / 20).flat_map(|k| format!("\"{k:x}\":{{\"\":[]}},").into_bytes()).collect();
    let split = [b"{\"train\":{", &objects[..], b"\"a\":{}}}"].concat();
    let path = root.join("splits.json");
    let _ = held(&path, &split, "splits", || R2n2::open(&root));
}

fn write_png_at(path: &Path) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    write_png(path, &ByteImage::new(2, 2, 1)).unwrap();
}

#[test]
fn lists() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("list.txt");
    let _ =
        held(&path, &filled("", "a.dat\n", ""), "samples", || Pixel2Mesh::open(&path).map(drop));
    let class = folder.path().join("bird");
    std::fs::create_dir_all(class.join("annotations")).unwrap();
    std::fs::create_dir_all(class.join("images")).unwrap();
    let path = class.join("bird_train.txt");
    let _ = held(&path, &filled("", "a\n", ""), "MCMR's list", || Mcmr::open(&class));
    let path = class.join("annotations/a.yaml");
    write_png_at(&class.join("masks/a.png"));
    for unit in ["- ", "[", "- 1\n", "- [1,1]\n"] {
        std::fs::write(class.join("bird_train.txt"), "a.yaml\n").unwrap();
        let bytes = &filled("", unit, "")[..1 << 20];
        let _ = held(&path, bytes, "annotations", || Mcmr::open(&class));
    }
    let root = folder.path().join("r2n2");
    let object = root.join("ShapeNetRendering/02958343/a");
    let path = object.join("rendering/rendering_metadata.txt");
    let _ = held(&path, &filled("", "0 0 0 1 9\n", ""), "metadata", || R2n2::open(&root));
    std::fs::write(&path, "0 0 0 1 9\n").unwrap();
    let names = object.join("rendering/renderings.txt");
    let _ = held(&names, &filled("", "a\n", ""), "names", || R2n2::open(&root));
    std::fs::remove_file(&names).unwrap();
    let path = root.join("ShapeNetRendering/02958343/train.lst");
    let lines: Vec<u8> = (0..SIZE / 7).flat_map(|k| format!("{k:x}\n").into_bytes()).collect();
    let _ = held(&path, &lines, "a split", || R2n2::open(&root));
    std::fs::remove_file(&path).unwrap();
    let path = object.join("model_normal.xyz");
    let _ = held(&path, &filled("", "0 0 0 0 0 1\n", ""), "points", || {
        datasets::open(&root).unwrap().truth(0)
    });
}

#[test]
fn colmap() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let options = ReadOptions { allow_missing: true, ..ReadOptions::default() };
    let open = || datasets::open_with(root, &options).map(drop);
    let (cameras, images) = (root.join("cameras.txt"), root.join("images.txt"));
    std::fs::write(&images, "1 1 0 0 0 0 0 0 1 a\n\n").unwrap();
    let lines: Vec<u8> =
        (0..SIZE / 20).flat_map(|k| format!("{k} M 1 1 1\n").into_bytes()).collect();
    let _ = held(&cameras, &lines, "cameras", open);
    let _ = held(&cameras, &filled("1 M 1 1 ", "1 ", ""), "parameters", open);
    std::fs::write(&cameras, "1 PINHOLE 4 4 3 3 2 2\n").unwrap();
    let _ = held(&images, &filled("", "1 1 0 0 0 0 0 0 1 a\n\n", ""), "images", open);
    let _ = held(
        &images,
        &filled("1 1 0 0 0 0 0 0 1 ", "a1", "\n\n1 1 0 0 0 0 0 0 1 b\n"),
        "names",
        open,
    );
    std::fs::write(&images, "1 1 0 0 0 0 0 0 1 a\n\n").unwrap();
    write_png(root.join("a"), &ByteImage::new(4, 4, 3)).unwrap();
    let points = root.join("points3D.txt");
    let _ = held(&points, &filled("", "1 0 0 0 0 0 0 0\n", ""), "points", || {
        Colmap::open(root).and_then(|colmap| colmap.bounds())
    });
    for (name, record) in [("cameras.bin", 48), ("images.bin", 75), ("points3D.bin", 51)] {
        let count = SIZE / record;
        let mut bytes = (count as u64).to_le_bytes().to_vec();
        for k in 0..count as u32 {
            let mut one = vec![0; record];
            one[..4].copy_from_slice(&k.to_le_bytes());
            if name == "cameras.bin" {
                (one[8], one[16]) = (1, 1);
            } else if name == "images.bin" {
                (one[4 + 7], one[64]) = (1, b'a');
            }
            bytes.extend(one);
        }
        if name == "images.bin" {
            std::fs::write(root.join("cameras.bin"), 0_u64.to_le_bytes()).unwrap();
        }
        let _ = held(&root.join(name), &bytes, name, || {
            let _ = open();
            Colmap::open(root).and_then(|colmap| colmap.points())
        });
    }
}

/// A MAT file of one compressed variable.
fn compressed(body: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(&14_u32.to_le_bytes()).unwrap();
    encoder.write_all(&(body.len() as u32).to_le_bytes()).unwrap();
    encoder.write_all(body).unwrap();
    let packed = encoder.finish().unwrap();
    let mut bytes = vec![b' '; 124];
    bytes.extend([0, 1, b'I', b'M', 15, 0, 0, 0]);
    bytes.extend((packed.len() as u32).to_le_bytes());
    bytes.extend(packed);
    bytes
}

/// The flags, the shape and the name with which a variable begins.
fn head(class: u8, dims: [u32; 2]) -> Vec<u8> {
    let mut out = vec![6, 0, 0, 0, 8, 0, 0, 0, class, 0, 0, 0, 0, 0, 0, 0, 5, 0, 0, 0, 8, 0, 0, 0];
    out.extend(dims.iter().flat_map(|d| d.to_le_bytes()));
    out.extend([1, 0, 0, 0, 8, 0, 0, 0]);
    out.extend(b"images\0\0");
    out
}

/// What a variable of little more than a hundredth of it inflates to.
const INFLATED: u32 = 100_000_000;

#[test]
fn matlab_variables_that_inflate() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("data/train_cub_cleaned.mat");
    let numbers = |class: u8, kind: u8, size: u32, value: u8| {
        let mut body = head(class, [INFLATED / size, 1]);
        body.extend([kind, 0, 0, 0]);
        body.extend(INFLATED.to_le_bytes());
        body.resize(body.len() + INFLATED as usize, value);
        body
    };
    let cells = |tag: &[u8]| {
        let count = INFLATED as usize / tag.len();
        [head(1, [count as u32, 1]), tag.repeat(count)].concat()
    };
    // A number in a cell: its tag, flags, shape, name and value.
    let mut number = head(6, [1, 1]);
    number.extend([2, 0, 1, 0, 7, 0, 0, 0]);
    let number = [&[14, 0, 0, 0, number.len() as u8, 0, 0, 0][..], &number].concat();
    for (what, body) in [
        ("bits", numbers(9, 2, 1, 1)),
        ("bytes", numbers(9, 2, 1, 7)),
        ("bytes below zero", numbers(8, 1, 1, 255)),
        ("doubles", numbers(6, 9, 8, 1)),
        ("text", numbers(4, 16, 1, b'a')),
        ("empty cells", cells(&[14, 0, 0, 0, 0, 0, 0, 0])),
        ("cells of numbers", cells(&number)),
    ] {
        let bytes = compressed(&body);
        assert!(bytes.len() < 3_000_000, "{what}: {}", bytes.len());
        let _ = held(&path, &bytes, what, || Cub::open(folder.path()));
    }
}

/// Cells that are deflated bits in the file take a byte each in the grid.
#[test]
fn voxels_that_inflate() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let annotations = br#"[{"img": "img/a.png", "mask": "mask/a.png", "model": "model/a/m.obj", "voxel": "model/a/v.mat",
        "category": "chair", "rot_mat": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "trans_mat": [0, 0, 2], "focal_length": 35,
        "img_size": [4, 3], "cam_position": [0, 0, 2], "inplane_rotation": 0, "bbox": [0, 0, 4, 3], "truncated": false,
        "occluded": false, "slightly_occluded": false, "img_source": "x", "model_source": "x", "2d_keypoints": [], "3d_keypoints": ""}]"#;
    std::fs::write(folder.path().join("pix3d.json"), annotations).unwrap();
    write_png_at(&folder.path().join("img/a.png"));
    let dataset = Pix3d::open(folder.path()).unwrap();
    // More than 256 MB.
    let side = 700_u32;
    let mut body = vec![6, 0, 0, 0, 8, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0, 5, 0, 0, 0, 12, 0, 0, 0];
    body.extend([side; 3].iter().flat_map(|d| d.to_le_bytes()));
    body.extend([0, 0, 0, 0, 1, 0, 0, 0, 5, 0, 0, 0]);
    body.extend(b"voxel\0\0\0");
    body.extend([2, 0, 0, 0]);
    body.extend((side * side * side).to_le_bytes());
    body.resize(body.len() + (side * side * side) as usize, 0);
    let bytes = compressed(&body);
    drop(body);
    let path = folder.path().join("model/a/v.mat");
    let error = held(&path, &bytes, "voxels", || dataset.truth(0)).unwrap_err().to_string();
    assert!(error.contains("voxel"), "{error}");
}

#[test]
fn archives() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("views.zip");
    let packed = |files: &[(String, Vec<u8>)]| {
        let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        for (name, bytes) in files {
            zip.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
            zip.write_all(bytes).unwrap();
        }
        zip.finish().unwrap().into_inner()
    };
    let file = |name: &str, bytes: Vec<u8>| vec![(name.to_owned(), bytes)];
    let blank = |size: usize| vec![b' '; size];
    for (what, files) in [
        ("poses of blanks", file("transforms.json", blank(250_000_000))),
        (
            "poses that grow",
            file("transforms.json", filled("{\"frames\":[", "[],", "0]}").repeat(9)),
        ),
        ("cameras", file("cameras.json", blank(200_000_000))),
        ("many files", (0..40_000).map(|k| (format!("{k}"), Vec::new())).collect()),
    ] {
        let _ = held(&path, &packed(&files), what, || open(&path).map(drop));
    }
}

#[test]
fn arrays_of_depth() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("depth.npy");
    for fortran in ["False", "True"] {
        let header = format!(
            "{{'descr': '|u1', 'fortran_order': {fortran}, 'shape': (2000, {}), }}",
            SIZE / 2000
        );
        let mut bytes = b"\x93NUMPY\x01\0".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.bytes());
        bytes.resize(bytes.len() + SIZE, 1);
        held(&path, &bytes, fortran, || read_depth_file(&path, 1.0)).unwrap();
    }
    // A header of nothing but axes.
    let header = filled("{'descr': '|u1', 'fortran_order': False, 'shape': (", "1,", ")}");
    let mut bytes = b"\x93NUMPY\x02\0".to_vec();
    bytes.extend((header.len() as u32).to_le_bytes());
    bytes.extend(header);
    bytes.push(1);
    assert!(held(&path, &bytes, "axes", || read_depth_file(&path, 1.0)).is_err());
}
