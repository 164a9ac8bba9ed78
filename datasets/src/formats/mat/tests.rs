#![allow(clippy::unwrap_used, reason = "tests")]

use std::path::Path;

use proptest::prelude::*;

use super::value::Data;
use super::*;

const PLAIN: &[u8] = include_bytes!("../../../tests/fixtures/mat/plain.mat");
const COMPRESSED: &[u8] = include_bytes!("../../../tests/fixtures/mat/compressed.mat");
const BIG_ENDIAN: &[u8] = include_bytes!("../../../tests/fixtures/mat/big_endian.mat");
const VERSION_4: &[u8] = include_bytes!("../../../tests/fixtures/mat/version4.mat");

fn read(bytes: &[u8]) -> Result<Mat, ReadViewsError> {
    Mat::read(&Content::from(bytes), file())
}

fn file() -> &'static Path {
    Path::new("a.mat")
}

fn message(bytes: &[u8]) -> String {
    read(bytes).unwrap_err().to_string()
}

/// A file of one variable `t` of characters, `rows` by `columns`.
fn characters(rows: i32, columns: i32, letters: &[u8]) -> Vec<u8> {
    let element = |kind: u32, bytes: &[u8]| {
        let mut out = [kind.to_le_bytes(), (bytes.len() as u32).to_le_bytes()].concat();
        out.extend_from_slice(bytes);
        out.resize(out.len().next_multiple_of(8), 0);
        out
    };
    let parts = [
        element(6, &[4, 0, 0, 0, 0, 0, 0, 0]),
        element(5, &[rows.to_le_bytes(), columns.to_le_bytes()].concat()),
        element(1, b"t"),
        element(16, letters),
    ];
    let mut bytes = vec![b' '; 124];
    bytes.extend_from_slice(&[0, 1, b'I', b'M']);
    bytes.extend_from_slice(&element(14, &parts.concat()));
    bytes
}

#[test]
fn text_of_many_rows_takes_the_time_of_its_letters() {
    let text =
        |bytes: &[u8]| read(bytes).unwrap().need("t", file()).unwrap().text().unwrap().to_owned();
    assert_eq!(text(&characters(2, 3, b"adbecf")), "abc\ndef");
    // By the square of the rows this took minutes.
    let rows = 400_000;
    assert_eq!(text(&characters(rows, 1, &vec![b'x'; rows as usize])).len(), 2 * rows as usize - 1);
    // As many ends of lines would take two gigabytes.
    assert_eq!(text(&characters(i32::MAX, 0, b"")), "");
}

#[test]
fn what_scipy_wrote_is_read_in_every_form() {
    for bytes in [PLAIN, COMPRESSED, BIG_ENDIAN] {
        let mat = read(bytes).unwrap();
        let get = |name: &str| mat.need(name, file()).unwrap();
        let images = get("images").elements().unwrap();
        assert_eq!(images.len(), 3);
        for (i, image) in images.iter().enumerate() {
            assert_eq!(image.need("name").unwrap().text().unwrap(), format!("bird_{i}.jpg"));
            let bbox = image.need("bbox").unwrap();
            assert_eq!(bbox.need("x1").unwrap().number().unwrap(), 10.0 + i as f64);
            assert_eq!(bbox.need("y1").unwrap().number().unwrap(), 0.5 * i as f64);
            let (mask, 5, 7) = image.need("mask").unwrap().table().unwrap() else { panic!() };
            assert!(matches!(mask.data, Data::Bits(35, _)));
            for (row, column) in (0..5).flat_map(|r| (0..7).map(move |c| (r, c))) {
                let inside = row == i && (2..5).contains(&column);
                assert_eq!(mask.at(column * 5 + row), f64::from(inside), "{row} {column}");
            }
            let (parts, 3, 2) = image.need("parts").unwrap().table().unwrap() else { panic!() };
            assert_eq!(parts.at(3), 1.0 + i as f64);
        }
        let cells = get("cells").elements().unwrap();
        assert_eq!(cells[0].vector().unwrap(), [1.0, 3.0, -2.0, 4.0]);
        assert_eq!(cells[1].text().unwrap(), "word");
        assert_eq!(cells[2].elements().unwrap()[0].number().unwrap(), 7.25);
        assert_eq!(get("small").number().unwrap(), 3.0);
        assert_eq!(get("single").vector().unwrap(), [1.5, -2.5, f64::from(1e-3f32)]);
        assert_eq!(get("long").vector().unwrap(), [1_099_511_627_776.0, -5.0]);
        let cube = get("cube").numbers().unwrap();
        assert_eq!(cube.dims, [2, 3, 4]);
        assert_eq!((cube.at(0), cube.at(1), cube.at(2), cube.at(23)), (0.0, 12.0, 4.0, 23.0));
        assert!(get("nothing").is_empty());
        assert_eq!(get("flag").vector().unwrap(), [1.0, 0.0, 1.0]);
        assert_eq!(get("rows").text().unwrap(), "one\nthree");
        assert_eq!(get("greek").text().unwrap(), "\u{3b1}\u{3b2}");
        let sparse = get("sparse").numbers().unwrap_err().to_string();
        assert!(sparse.contains("a.mat") && sparse.contains("full(x)"), "{sparse}");
        assert!(get("complex").number().unwrap_err().to_string().contains("complex"));
    }
}

#[test]
fn messages_name_the_place_as_matlab_counts() {
    let mat = read(COMPRESSED).unwrap();
    let image = mat.need("images", file()).unwrap().elements().unwrap().swap_remove(1);
    let error = image.need("bbox").unwrap().need("x9").unwrap_err().to_string();
    assert!(error.contains("`images(2).bbox`") && error.contains("x9"), "{error}");
    let error = image.need("mask").unwrap().number().unwrap_err().to_string();
    assert!(error.contains("`images(2).mask`") && error.contains("5x7 numbers"), "{error}");
    let error = mat.need("birds", file()).unwrap_err().to_string();
    assert!(error.contains("`birds`") && error.contains("images, cells"), "{error}");
}

#[test]
fn other_versions_are_refused_with_the_remedy() {
    assert!(message(VERSION_4).contains("header"), "{}", message(VERSION_4));
    let mut hdf5 = PLAIN[..128].to_vec();
    hdf5[124..126].copy_from_slice(&[0, 2]);
    assert!(message(&hdf5).contains("7.3") && message(&hdf5).contains("-v7"));
    assert!(message(b"\x89HDF\r\n\x1a\n and more").contains("HDF5"));
    assert!(message(&[b' '; 200]).contains("no MAT file"));
    assert!(message(b"").contains("0 bytes"));
}

#[test]
fn a_file_cut_anywhere_is_an_error_or_the_variables_before() {
    for bytes in [PLAIN, COMPRESSED, BIG_ENDIAN] {
        let whole = read(bytes).unwrap();
        let mut survived = 0;
        for end in 0..bytes.len() {
            if let Ok(part) = read(&bytes[..end]) {
                survived += 1;
                assert!(part.variables.len() < whole.variables.len() || end + 8 > bytes.len());
            }
        }
        // Right behind a variable, or within its padding.
        assert!(survived <= 8 * whole.variables.len(), "{survived} of {} cuts", bytes.len());
    }
}

#[test]
fn small_elements_hold_no_others() {
    for kind in [14u8, 15] {
        for size in 1..=4 {
            let bytes = [&PLAIN[..128], &[kind, 0, size, 0, 0, 0, 0, 0]].concat();
            assert!(message(&bytes).contains("small element"), "{}", message(&bytes));
        }
    }
    // In a cell, whose last element it is.
    let mut cell = vec![6, 0, 0, 0, 8, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0];
    cell.extend_from_slice(&[5, 0, 0, 0, 8, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]);
    cell.extend_from_slice(&[1, 0, 0, 0, 0, 0, 0, 0, 14, 0, 4, 0, 0, 0, 0, 0]);
    let head = [14, 0, 0, 0, cell.len() as u8, 0, 0, 0];
    let bytes = [&PLAIN[..128], &head, &cell].concat();
    assert!(message(&bytes).contains("small element"), "{}", message(&bytes));
}

#[test]
fn padding_may_be_missing_or_cut() {
    // A 1x5 matrix of bytes called `a`, the last of whose 53 bytes is the last number.
    let mut matrix = vec![6, 0, 0, 0, 8, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0];
    matrix.extend_from_slice(&[5, 0, 0, 0, 8, 0, 0, 0, 1, 0, 0, 0, 5, 0, 0, 0]);
    matrix.extend_from_slice(&[1, 0, 1, 0, b'a', 0, 0, 0]);
    matrix.extend_from_slice(&[2, 0, 0, 0, 5, 0, 0, 0, 1, 2, 3, 4, 5]);
    assert_eq!(matrix.len(), 53);
    let whole = [&PLAIN[..128], &[14, 0, 0, 0, 53, 0, 0, 0], &matrix].concat();
    for behind in 0..4 {
        let bytes = [&whole, &[0; 4][..behind]].concat();
        let mat = read(&bytes).unwrap();
        assert_eq!(mat.need("a", file()).unwrap().vector().unwrap(), [1.0, 2.0, 3.0, 4.0, 5.0]);
    }
}

#[test]
fn claims_are_checked_against_what_is_there() {
    // The shape of `small`: 1x1 becomes 2^31-1 x 2^31-1.
    let at = PLAIN.windows(5).position(|w| w == b"small").unwrap();
    let mut bytes = PLAIN.to_vec();
    bytes[at - 16..at - 8].copy_from_slice(&[255, 255, 255, 127, 255, 255, 255, 127]);
    assert!(message(&bytes).contains("small: numbers"), "{}", message(&bytes));
    // 2^30 structs of one field in a file without any.
    let mut bytes = PLAIN[..128].to_vec();
    let mut element = Vec::new();
    let mut put = |kind: u32, data: &[u8]| {
        element.extend_from_slice(&kind.to_le_bytes());
        element.extend_from_slice(&(data.len() as u32).to_le_bytes());
        element.extend_from_slice(data);
        element.resize(element.len().next_multiple_of(8), 0);
    };
    put(6, &[2, 0, 0, 0, 0, 0, 0, 0]);
    put(5, &[0, 0, 0, 64, 1, 0, 0, 0]);
    put(1, b"many");
    put(5, &4i32.to_le_bytes());
    put(1, b"abc\0");
    bytes.extend_from_slice(&14u32.to_le_bytes());
    bytes.extend_from_slice(&(element.len() as u32).to_le_bytes());
    bytes.extend_from_slice(&element);
    assert!(message(&bytes).contains("many: element"), "{}", message(&bytes));
}

#[test]
fn nesting_ends_before_the_stack_does() {
    // A cell in a cell in a cell, 100 deep.
    let mut inner = Vec::new();
    for _ in 0..100 {
        let mut next = Vec::new();
        next.extend_from_slice(&[6, 0, 0, 0, 8, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0]);
        next.extend_from_slice(&[5, 0, 0, 0, 8, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]);
        next.extend_from_slice(&[1, 0, 0, 0, 0, 0, 0, 0]);
        next.extend_from_slice(&inner);
        inner = [&[14, 0, 0, 0], (next.len() as u32).to_le_bytes().as_slice(), &next].concat();
    }
    let bytes = [&PLAIN[..128], &inner].concat();
    assert!(message(&bytes).contains("nesting"), "{}", message(&bytes));
}

#[test]
fn numbers_take_the_narrowest_form_and_keep_their_values() {
    let array = |name: &str, bytes: &[u8]| {
        let mat = read(bytes).unwrap();
        mat.need(name, file()).unwrap().numbers().unwrap().clone()
    };
    assert!(matches!(array("flag", PLAIN).data, Data::Bits(3, _)));
    assert!(matches!(array("cube", PLAIN).data, Data::Bytes(_)));
    assert!(matches!(array("single", PLAIN).data, Data::Floats(_)));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn no_damage_makes_it_panic(
        which in 0usize..3,
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in proptest::option::of(any::<prop::sample::Index>()),
    ) {
        let mut bytes = [PLAIN, COMPRESSED, BIG_ENDIAN][which].to_vec();
        for (at, byte) in edits {
            let at = 124 + at.index(bytes.len() - 124);
            bytes[at] = byte;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        if let Ok(mat) = read(&bytes) {
            for (name, _) in &mat.variables {
                let node = mat.need(name, file()).unwrap();
                let _ = (node.text(), node.number(), node.matrix3(), node.keys());
                let _ = node.elements().map(|all| all.len());
            }
        }
    }

    #[test]
    fn no_bytes_make_it_panic(tail in proptest::collection::vec(any::<u8>(), 0..300)) {
        let _ = read(&[&PLAIN[..128], &tail].concat());
        let packed = [&[15, 0, 0, 0], (tail.len() as u32).to_le_bytes().as_slice(), &tail].concat();
        let _ = read(&[&PLAIN[..128], &packed].concat());
    }
}
