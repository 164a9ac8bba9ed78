//! Any bytes may arrive: files of annotated photographs cut at every length, changed anywhere,
//! with absurd counts. What comes back is an error or a value, and little memory is taken for it.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "../../mesh-core/tests/counting/mod.rs"]
mod counting;

use std::io::Write;
use std::path::{Path, PathBuf};

use counting::{LIMIT, alone, peak};
use datasets::{Cub, Dataset, Mcmr, Pascal3d, Pix3d, ReadOptions, ReadViewsError};
use proptest::prelude::*;

/// Whether a file is of a kind.
fn is(name: &str, extension: &str) -> bool {
    Path::new(name).extension().is_some_and(|found| found == extension)
}

type Open = fn(&Path) -> Result<Box<dyn Dataset>, ReadViewsError>;

/// A reader, its fixture, and the files that are spoilt.
struct Door {
    open: Open,
    folder: &'static str,
    files: &'static [&'static str],
}

static DOORS: [Door; 5] = [
    Door {
        open: |path| Pix3d::open(path).map(|d| Box::new(d) as _),
        folder: "pix3d",
        files: &[
            "pix3d.json",
            "mask/chair/0001.png",
            "model/chair/LOPSIDED/model.obj",
            "model/chair/LOPSIDED/voxel.mat",
        ],
    },
    Door {
        open: |path| Pix3d::open(&path.join("pix3d_s1_train.json")).map(|d| Box::new(d) as _),
        folder: "pix3d",
        files: &["pix3d_s1_train.json"],
    },
    Door {
        open: |path| Pascal3d::open(path).map(|d| Box::new(d) as _),
        folder: "pascal3d",
        files: &[
            "Annotations/aeroplane_imagenet/n02690373_16.mat",
            "Annotations/aeroplane_pascal/2008_000021.mat",
            "CAD/aeroplane/01.off",
            "PASCAL/VOCdevkit/VOC2012/SegmentationObject/2008_000021.png",
        ],
    },
    Door {
        open: |path| Cub::open(path).map(|d| Box::new(d) as _),
        folder: "cub",
        files: &["cachedir/cub/data/val_cub_cleaned.mat", "cachedir/cub/sfm/anno_val.mat"],
    },
    Door {
        open: |path| Mcmr::open(path).map(|d| Box::new(d) as _),
        folder: "mcmr",
        files: &[
            "aeroplane/annotations/00000.yaml",
            "aeroplane/annotations/00001.yaml",
            "aeroplane/aeroplane_train.txt",
        ],
    },
];

impl Door {
    fn copied(&self) -> tempfile::TempDir {
        let out = tempfile::tempdir().unwrap();
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/photos");
        copy(&fixtures.join(self.folder), out.path());
        out
    }

    /// Opens it and asks for everything that one can ask for, for images where they are meant;
    /// how much memory that took.
    fn walk(&self, folder: &Path, pictures: bool) -> usize {
        peak(|| {
            let Ok(dataset) = (self.open)(folder) else { return };
            for object in 0..dataset.entries().len() {
                if pictures {
                    let _ = dataset.views(object, None, &ReadOptions::default(), &|_, _| {});
                }
                let _ = dataset.truth(object);
            }
        })
        .0
    }
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let (from, to) = (entry.path(), to.join(entry.file_name()));
        if from.is_dir() {
            copy(&from, &to);
        } else {
            std::fs::copy(&from, &to).unwrap();
        }
    }
}

#[test]
fn files_cut_at_every_length_are_survived() {
    let _alone = alone();
    for door in &DOORS {
        let folder = door.copied();
        for name in door.files {
            let path = folder.path().join(name);
            let bytes = std::fs::read(&path).unwrap();
            for end in 0..bytes.len() {
                std::fs::write(&path, &bytes[..end]).unwrap();
                let taken = door.walk(folder.path(), is(name, "png"));
                assert!(taken < LIMIT, "{name} cut to {end} bytes: {taken}");
            }
            std::fs::write(&path, &bytes).unwrap();
        }
        // What was put back reads as before.
        let dataset = (door.open)(folder.path()).unwrap();
        dataset.views(0, Some(&[0]), &whole(), &|_, _| {}).unwrap();
    }
}

fn whole() -> ReadOptions {
    ReadOptions { mask: datasets::MaskSource::Whole, ..ReadOptions::default() }
}

#[test]
fn absurd_counts_are_survived() {
    let _alone = alone();
    let words: [[u8; 4]; 6] =
        [[255; 4], [255, 255, 255, 127], [0, 0, 0, 128], [0, 0, 0, 64], [0; 4], [14, 0, 0, 0]];
    for door in &DOORS {
        let folder = door.copied();
        for name in door.files.iter().filter(|name| is(name, "mat")) {
            let path = folder.path().join(name);
            let packed = std::fs::read(&path).unwrap();
            let plain = unpacked(&packed);
            // The words before the numbers begin, and a sample of the numbers.
            let rest = (640..plain.len() - 4).step_by(512);
            for at in (128..plain.len().min(640) - 4).step_by(4).chain(rest) {
                for word in words {
                    let mut bytes = plain.clone();
                    bytes[at..at + 4].copy_from_slice(&word);
                    std::fs::write(&path, &bytes).unwrap();
                    let taken = door.walk(folder.path(), false);
                    assert!(taken < LIMIT, "{name}: {word:?} at {at}: {taken}");
                }
            }
            std::fs::write(&path, &packed).unwrap();
        }
    }
}

/// A MAT file with its variables inflated, so that single words of them can be changed.
fn unpacked(bytes: &[u8]) -> Vec<u8> {
    let mut out = bytes[..128].to_vec();
    let mut rest = &bytes[128..];
    while !rest.is_empty() {
        assert_eq!(rest[0], 15, "the fixtures are compressed");
        let size = u32::from_le_bytes(rest[4..8].try_into().unwrap()) as usize;
        let mut decoder = flate2::read::ZlibDecoder::new(&rest[8..8 + size]);
        std::io::Read::read_to_end(&mut decoder, &mut out).unwrap();
        rest = &rest[8 + size..];
    }
    out
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A MAT file of one compressed variable whose body is `head` and then as many zeros.
fn bomb(head: &[u8], zeros: usize) -> Vec<u8> {
    let mut element = 14u32.to_le_bytes().to_vec();
    element.extend_from_slice(&((head.len() + zeros) as u32).to_le_bytes());
    element.extend_from_slice(head);
    element.resize(element.len() + zeros, 0);
    let packed = zlib(&element);
    let mut bytes = vec![b' '; 124];
    bytes.extend_from_slice(&[0, 1, b'I', b'M', 15, 0, 0, 0]);
    bytes.extend_from_slice(&(packed.len() as u32).to_le_bytes());
    bytes.extend_from_slice(&packed);
    bytes
}

/// The flags, shape and name with which a variable begins.
fn head(class: u8, dims: [u32; 2], name: [u8; 8]) -> Vec<u8> {
    let mut out = vec![6, 0, 0, 0, 8, 0, 0, 0, class, 0, 0, 0, 0, 0, 0, 0, 5, 0, 0, 0, 8, 0, 0, 0];
    out.extend(dims.iter().flat_map(|d| d.to_le_bytes()));
    out.extend_from_slice(&[1, 0, 0, 0, 8, 0, 0, 0]);
    out.extend_from_slice(&name);
    out
}

#[test]
fn bombs_take_what_their_bytes_are_worth() {
    let _alone = alone();
    let zeros = 1 << 20;
    // A matrix of doubles, stored as such, and as bytes; cells without content; a struct with a
    // million names; a text.
    let mut doubles = head(6, [zeros as u32 / 8, 1], *b"images\0\0");
    doubles.extend_from_slice(&[9, 0, 0, 0]);
    doubles.extend_from_slice(&(zeros as u32).to_le_bytes());
    let mut narrow = head(6, [zeros as u32, 1], *b"images\0\0");
    narrow.extend_from_slice(&[1, 0, 0, 0]);
    narrow.extend_from_slice(&(zeros as u32).to_le_bytes());
    let cells = |class, names: &[u8]| {
        let mut body = head(class, [u32::MAX / 4, 1], *b"images\0\0");
        body.extend_from_slice(names);
        body
    };
    // Zeros are tags of type 0; a million of them must end the reading at the first.
    let names = [5, 0, 4, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 16, 0];
    let mut text = head(4, [1, zeros as u32], *b"images\0\0");
    text.extend_from_slice(&[16, 0, 0, 0]);
    text.extend_from_slice(&(zeros as u32).to_le_bytes());
    let door = &DOORS[3];
    let folder = door.copied();
    let path = folder.path().join(door.files[0]);
    for head in [doubles, narrow, cells(1, &[]), cells(2, &names), text] {
        let bytes = bomb(&head, zeros);
        assert!(bytes.len() < 2048, "{}", bytes.len());
        std::fs::write(&path, &bytes).unwrap();
        let taken = door.walk(folder.path(), true);
        assert!(taken < LIMIT, "{taken}");
    }
    // Empty cells, each with a tag of its own: the densest that the format allows.
    let mut body = cells(1, &[]);
    for _ in 0..zeros / 8 {
        body.extend_from_slice(&[14, 0, 0, 0, 0, 0, 0, 0]);
    }
    let bytes = bomb(&body, 0);
    assert!(bytes.len() < 4096, "{}", bytes.len());
    std::fs::write(&path, &bytes).unwrap();
    let taken = door.walk(folder.path(), true);
    assert!(taken < LIMIT, "{taken}");
}

#[test]
fn a_photograph_that_claims_to_be_huge_takes_little() {
    let _alone = alone();
    let door = &DOORS[3];
    let folder = door.copied();
    let path = folder.path().join("CUB_200_2011/images/001.Lopsided_Bird/Bird_val_0.jpg");
    let mut bytes = std::fs::read(&path).unwrap();
    // The frame's header: marker, length, precision, then height and width.
    let at = bytes.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
    for size in [[0xff; 4], [0x40, 0, 0x40, 0], [0; 4]] {
        bytes[at + 5..at + 9].copy_from_slice(&size);
        std::fs::write(&path, &bytes).unwrap();
        let taken = door.walk(folder.path(), true);
        assert!(taken < LIMIT, "{size:?}: {taken}");
    }
}

#[test]
fn deep_and_wide_yaml_takes_little() {
    let _alone = alone();
    let door = &DOORS[4];
    let folder = door.copied();
    let path: PathBuf = folder.path().join(door.files[0]);
    let laugh = |i| format!("a{i}: &a{i} [*a{0}, *a{0}, *a{0}, *a{0}, *a{0}]\n", i - 1);
    let laughs = (1..9).map(laugh).collect::<Vec<_>>().concat();
    for text in ["[".repeat(1000), "- ".repeat(500), "a:\n".repeat(300), laughs, "[0,".repeat(300)]
    {
        std::fs::write(&path, text).unwrap();
        let taken = door.walk(folder.path(), true);
        assert!(taken < LIMIT, "{taken}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn files_changed_anywhere_are_survived(
        which in any::<prop::sample::Index>(),
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..5),
        inflate: bool,
    ) {
        let _alone = alone();
        let all: Vec<(&Door, &str)> =
            DOORS.iter().flat_map(|door| door.files.iter().map(move |file| (door, *file))).collect();
        let (door, name) = all[which.index(all.len())];
        let folder = door.copied();
        let path = folder.path().join(name);
        let mut bytes = std::fs::read(&path).unwrap();
        if inflate && is(name, "mat") {
            bytes = unpacked(&bytes);
        }
        for (at, byte) in edits {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        std::fs::write(&path, &bytes).unwrap();
        let taken = door.walk(folder.path(), true);
        prop_assert!(taken < LIMIT, "{name}: {taken}");
    }
}
