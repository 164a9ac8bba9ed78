//! Arrays of NumPy's: its own files, and pickles with arrays in them.

use datasets::pixel2mesh::{Ellipsoid, read_sample};

use super::scratch::with_files;

pub(crate) fn npy(bytes: &[u8]) {
    with_files(&[("a.npy", bytes)], |root| {
        let _ = datasets::read_depth_file(root.join("a.npy"), 1.0);
    });
}

pub(crate) fn npy_seeds() -> Vec<Vec<u8>> {
    let file = |descr: &str, fortran: &str, size: usize| {
        let header =
            format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': (2, 3), }}\n");
        let mut bytes = b"\x93NUMPY\x01\0".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.bytes());
        bytes.resize(bytes.len() + 6 * size, 1);
        bytes
    };
    vec![
        file("<f4", "False", 4),
        file(">f8", "True", 8),
        file("|u1", "True", 1),
        file("<i2", "False", 2),
    ]
}

pub(crate) fn pickle(bytes: &[u8]) {
    with_files(&[("a.dat", bytes)], |root| {
        let _ = read_sample(&root.join("a.dat"));
    });
}

pub(crate) fn pickle_seeds() -> Vec<Vec<u8>> {
    let files: [&[u8]; 8] = [
        include_bytes!("../../datasets/tests/fixtures/original.dat"),
        include_bytes!("../../datasets/tests/fixtures/port.dat"),
        include_bytes!("../../datasets/tests/fixtures/fortran.dat"),
        include_bytes!("../../datasets/tests/fixtures/big_endian.dat"),
        include_bytes!("../../datasets/tests/fixtures/protocol0.dat"),
        include_bytes!("../../datasets/tests/fixtures/protocol2.dat"),
        include_bytes!("../../datasets/tests/fixtures/protocol4.dat"),
        include_bytes!("../../datasets/tests/fixtures/protocol5.dat"),
    ];
    files.map(<[u8]>::to_vec).to_vec()
}

pub(crate) fn ellipsoid(bytes: &[u8]) {
    with_files(&[("info_ellipsoid.dat", bytes)], |root| {
        let _ = Ellipsoid::open(root.join("info_ellipsoid.dat"));
    });
}

pub(crate) fn ellipsoid_seeds() -> Vec<Vec<u8>> {
    vec![include_bytes!("../../datasets/tests/fixtures/tiny_ellipsoid.dat").to_vec()]
}
