//! Whatever the bytes of a dataset's files: objects or an error, no panic, no hang, and at most
//! 64 MB for files of a few kB.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "../../mesh-core/tests/counting/mod.rs"]
mod counting;
#[path = "../../mesh-core/tests/damage/mod.rs"]
mod damage;

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use counting::{LIMIT, alone, peak};
use damage::{change, damaged};
use datasets::pixel2mesh::{Ellipsoid, Pixel2Mesh, Sample, read_sample, write_sample};
use datasets::r2n2::{self, R2n2, Rendering};
use datasets::{Dataset, ReadOptions, SurfacePoints, Truth};
use mesh_core::io::binvox;
use mesh_core::{ByteImage, DepthMap, R2n2View, TriMesh, VoxelGrid};
use proptest::prelude::*;

/// Runs a reader and holds what it takes on top of what is there below 64 MB.
fn sparing<T>(what: &str, read: impl FnOnce() -> T) -> T {
    let (taken, result) = peak(read);
    assert!(taken <= LIMIT, "{what}: {taken} bytes");
    result
}

/// What the formats trip over.
const WORDS: &[&str] = &[
    "\n",
    "-1",
    "99999999999999",
    "nan",
    "1e39",
    "../",
    "[[[[",
    "{\"a\":",
    "((((",
    "h\0R",
    "\u{94}2222",
];

/// The files of one small object, below a folder that lives as long as the process.
static OBJECT: LazyLock<(tempfile::TempDir, Vec<PathBuf>)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let mut rgba = ByteImage::new(9, 12, 4);
    rgba.data[40..200].fill(255);
    let depth = Some(DepthMap { height: 9, width: 12, data: vec![1.0; 108] });
    let normals = Some(ByteImage::new(9, 12, 3));
    let camera = R2n2View { azimuth: 30.0, elevation: 25.0, distance_ratio: 0.8 };
    let view = Rendering { rgba, camera, depth, normals };
    let mesh = TriMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
    let points = SurfacePoints { positions: vec![[0.5; 3]; 3], normals: vec![[0.0, 1.0, 0.0]; 3] };
    let voxels = VoxelGrid::new([4; 3], ([0.0; 3], [1.0; 3]));
    let truth = Truth { mesh: Some(mesh), points: Some(points), voxels: Some(voxels) };
    r2n2::write_object(folder.path(), "02958343", "a", &[view.clone(), view], &truth).unwrap();
    let split = r#"{"train": {"02958343": {"a": [0, 1]}}, "test": {}}"#;
    std::fs::write(folder.path().join("splits.json"), split).unwrap();
    let object = folder.path().join("ShapeNetRendering/02958343/a");
    let rendering = object.join("rendering");
    let files = vec![
        rendering.join("rendering_metadata.txt"),
        rendering.join("renderings.txt"),
        rendering.join("00.png"),
        rendering.join("00_depth.exr"),
        rendering.join("00_normal.png"),
        object.join("model_normal.xyz"),
        folder.path().join("ShapeNetVox32/02958343/a/model.binvox"),
        folder.path().join("ShapeNetCore.v1/02958343/a/model.obj"),
        folder.path().join("splits.json"),
    ];
    (folder, files)
});

fn read_object(root: &Path) {
    let Ok(dataset) = R2n2::open(root) else { return };
    let options = ReadOptions { depth: true, ..ReadOptions::default() };
    for object in 0..dataset.entries().len() {
        let _ = dataset.views(object, None, &options, &|_, _| {});
        let _ = dataset.truth(object);
        let _ = dataset.normals(object, 0);
    }
}

/// The object with one file damaged.
fn object_with(file: usize, damage: impl FnOnce(Vec<u8>) -> Vec<u8>) {
    let _turn = alone();
    let (root, files) = &*OBJECT;
    let whole = std::fs::read(&files[file]).unwrap();
    std::fs::write(&files[file], damage(whole.clone())).unwrap();
    let name = files[file].file_name().unwrap().to_string_lossy();
    sparing(&name, || read_object(root.path()));
    std::fs::write(&files[file], whole).unwrap();
}

/// Small pickles: samples in every style, and one shaped like the ellipsoid's.
fn pickles() -> Vec<Vec<u8>> {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let names = [
        "original",
        "port",
        "fortran",
        "protocol0",
        "protocol2",
        "protocol4",
        "protocol5",
        "tiny_ellipsoid",
    ];
    names.iter().map(|name| std::fs::read(fixtures.join(format!("{name}.dat"))).unwrap()).collect()
}

fn read_pickle(bytes: &[u8]) {
    let _turn = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("02691156_a_00.dat");
    std::fs::write(&path, bytes).unwrap();
    sparing("sample", || {
        let _ = read_sample(&path);
        let dataset = Pixel2Mesh::open(folder.path()).unwrap();
        let _ = dataset.views(0, None, &ReadOptions::default(), &|_, _| {});
    });
    if let Ok(ellipsoid) = sparing("ellipsoid", || Ellipsoid::open(&path)) {
        sparing("mesh", || (0..3).for_each(|level| drop(ellipsoid.mesh(level))));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn objects(file in 0_usize..9, changes in prop::collection::vec(change(WORDS), 1..4)) {
        object_with(file, |bytes| damaged(bytes, &changes));
    }

    #[test]
    fn samples(which in 0_usize..8, changes in prop::collection::vec(change(WORDS), 1..4)) {
        read_pickle(&damaged(pickles().swap_remove(which), &changes));
    }

    #[test]
    fn noise(bytes in prop::collection::vec(any::<u8>(), 0..300), start in 0..3_usize) {
        let mut pickle = [&b""[..], b"\x80\x02", b"\x80\x02cnumpy.core.multiarray\n_reconstruct\n"][start].to_vec();
        pickle.extend(bytes);
        read_pickle(&pickle);
    }
}

#[test]
fn every_length_of_every_file() {
    for file in 0..OBJECT.1.len() {
        let length = std::fs::metadata(&OBJECT.1[file]).unwrap().len() as usize;
        // Images are cut at every third byte: their readers have tests of their own.
        let step = if (2..5).contains(&file) { 3 } else { 1 };
        for cut in (0..length).step_by(step) {
            object_with(file, |mut bytes| {
                bytes.truncate(cut);
                bytes
            });
        }
    }
    for pickle in pickles() {
        for cut in 0..pickle.len() {
            read_pickle(&pickle[..cut]);
        }
    }
}

#[test]
fn claims_and_bombs_cost_nothing() {
    let grid = |text: &[u8]| {
        let _turn = alone();
        sparing("grid", || binvox::decode(text, "x").map(drop))
    };
    assert!(grid(b"#binvox 1\ndim 1600 1600 1600\ndata\n\0\xff\0\xff").is_err());
    let runs = [&b"#binvox 1\ndim 255 1 450\ndata\n"[..], &[1, 255].repeat(450)].concat();
    assert!(grid(&runs).is_ok());
    // 2 GB of text; a memo at the far end; lists in lists; a list in itself; many of the same.
    read_pickle(b"\x80\x02T\xff\xff\xff\x7fabc.");
    read_pickle(b"\x80\x05\x8e\xff\xff\xff\xff\xff\xff\xff\x7fabc.");
    read_pickle(b"\x80\x02K\x01r\xff\xff\xff\xff.");
    read_pickle(&[&[b']'; 1000][..], &[b'a'; 999], b"."].concat());
    read_pickle(&[&[b'('; 1000][..], &[b't'; 1000], b"."].concat());
    read_pickle(b"]q\0h\0a.");
    let doubling: Vec<u8> = (0..150).flat_map(|_| *b"2\x86").collect();
    read_pickle(&[&b"K\x01"[..], &doubling, b"."].concat());
    // One long text translated, and used as a name, again and again.
    let text = [&b"\x80\x02X\x20\x4e\0\0"[..], &b"x".repeat(20_000), b"q\0X\x06\0\0\0latin1q\x01"]
        .concat();
    let encode =
        [&b"c_codecs\nencode\nq\x02"[..], &b"h\x02h\0h\x01\x86R".repeat(9000), b"."].concat();
    read_pickle(&[text.clone(), encode].concat());
    read_pickle(&[&text[..], &b"h\0h\0\x93".repeat(9000), b"."].concat());
    // A sample whose image claims to be empty, and one with more than there is.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.dat");
    let points = SurfacePoints { positions: vec![[0.0; 3]], normals: vec![[0.0; 3]] };
    let picture = Some(ByteImage { height: 1, width: 1, channels: 3, data: vec![1, 2, 3] });
    write_sample(&path, &Sample { picture, points }).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let shape = whole.windows(10).position(|w| w == b"J\x01\0\0\0J\x01\0\0\0").unwrap();
    for claim in [0, i32::MAX, -1] {
        let mut bytes = whole.clone();
        bytes[shape + 1..shape + 5].copy_from_slice(&claim.to_le_bytes());
        read_pickle(&bytes);
    }
}
