//! What a file of weights makes its reader take is in proportion to the file: 256 MB, and 20 bytes for
//! each of its own. The densest contents are tried at a size where more would show.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "../../mesh-core/tests/counting/mod.rs"]
mod counting;

use std::io::Write;

use counting::{alone, limit, peak};
use nets::{FormatError, weights_from_bytes};

/// As long as the nested pickles that once took 396 MB.
const SIZE: usize = 6_000_000;
/// What stands before the object in a file of PyTorch's old layout.
const OLD: &[u8] = b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19.\x80\x02M\xe9\x03.\x80\x02}.";

fn held(what: &str, bytes: &[u8]) -> Result<(), FormatError> {
    let (taken, result) = peak(|| weights_from_bytes(bytes).map(drop));
    let most = limit(bytes.len());
    assert!(taken <= most, "{what}: {taken} bytes for {}, at most {most}", bytes.len());
    result
}

/// As much of the unit as fits, between two ends.
fn filled(start: &[u8], unit: &[u8], end: &[u8]) -> Vec<u8> {
    [start, &unit.repeat((SIZE - start.len() - end.len()) / unit.len()), end].concat()
}

/// A dictionary whose values all are the same tensor of `numbers` floats.
fn shared(numbers: u32, names: u32) -> Vec<u8> {
    let mut bytes = OLD.to_vec();
    bytes.extend(b"\x80\x02}(ctorch._utils\n_rebuild_tensor_v2\n((X\x07\0\0\0storage");
    bytes.extend(b"ctorch\nFloatStorage\nX\x01\0\0\0kX\x03\0\0\0cpuJ");
    bytes.extend(numbers.to_le_bytes());
    bytes.extend(b"tQK\0(J");
    bytes.extend(numbers.to_le_bytes());
    bytes.extend(b"t(K\x01t\x89}tRq\x000");
    for name in 0..names {
        bytes.extend(b"X\x04\0\0\0");
        bytes.extend(format!("{name:04}").bytes());
        bytes.extend(b"h\0");
    }
    bytes.extend(b"u.\x80\x02]X\x01\0\0\0ka.");
    bytes.extend(u64::from(numbers).to_le_bytes());
    bytes.resize(bytes.len() + 4 * numbers as usize, 0);
    bytes
}

#[test]
fn pickles() {
    let _alone = alone();
    for (what, unit, end) in [
        ("empty lists", &b"]"[..], &b"."[..]),
        ("dictionaries of one", b"}NNs", b"."),
        ("lists of one", b"]Na", b"."),
        ("numbers", b"K\x01", b"."),
        ("marks", b"(", b"."),
        ("lists in lists", b"(l", b"."),
        ("remembered", b"Nq\x01", b"."),
        ("remembered in turn", b"N\x94", b"."),
        ("names", b"c\n\n", b"."),
        ("texts", b"U\0", b"."),
        ("broken texts", b"U\xff\xff", b"."),
        ("calls", b"ccollections\nOrderedDict\n)R", b"."),
        ("tuples of one", b"N\x85", b"."),
    ] {
        assert!(held(what, &filled(OLD, unit, end)).is_err(), "{what}");
        // As a part of the other layout.
        let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        let stored = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored);
        zip.start_file("a/data.pkl", stored).unwrap();
        zip.write_all(&filled(b"\x80\x02", unit, end)).unwrap();
        assert!(held(what, &zip.finish().unwrap().into_inner()).is_err(), "{what}");
    }
    let broken = [OLD, b"\x80\x02V", &vec![0xff; SIZE], b"\n."].concat();
    assert!(held("a long text", &broken).is_err());
}

#[test]
fn tensors_that_share_their_numbers() {
    let _alone = alone();
    held("a few", &shared(1000, 20)).unwrap();
    held("as large as the file", &shared(SIZE as u32 / 4, 3)).unwrap();
    let error = held("many", &shared(SIZE as u32 / 4, 1000)).unwrap_err();
    assert!(error.to_string().contains("share"), "{error}");
    // An empty axis makes no shape one that an array can have.
    let axes = |last: &[u8]| {
        let start = b"\x80\x02}X\x01\0\0\0wctorch._utils\n_rebuild_tensor_v2\n((X\x07\0\0\0storage";
        let storage = b"ctorch\nFloatStorage\nX\x01\0\0\0kX\x03\0\0\0cpuK\0tQK\0(K\0";
        let rest = b"t(K\x01K\x01K\x01t\x89}tRs.\x80\x02]X\x01\0\0\0ka.\0\0\0\0\0\0\0\0";
        [OLD, start, storage, last, rest].concat()
    };
    held("an empty array", &axes(b"K\x02K\x03")).unwrap();
    let long = [b"\x8a\x08\0\0\0\0\0\0\0\x40", &b"K\x04"[..]].concat();
    let error = held("a shape beyond counting", &axes(&long)).unwrap_err();
    assert!(error.to_string().contains("too large"), "{error}");
}

#[test]
fn archives_of_many_files() {
    let _alone = alone();
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for k in 0..SIZE / 90 {
        zip.start_file(format!("{k:x}"), zip::write::SimpleFileOptions::default()).unwrap();
    }
    assert!(held("many files", &zip.finish().unwrap().into_inner()).is_err());
}

/// The header of a safetensors file.
fn header(text: &[u8]) -> Vec<u8> {
    [&(text.len() as u64).to_le_bytes()[..], text].concat()
}

#[test]
fn safetensors() {
    let _alone = alone();
    let array =
        |k| format!(",\"{k:x}\":{{\"dtype\":\"F32\",\"shape\":[0],\"data_offsets\":[0,0]}}");
    let arrays = (0..SIZE / 60).flat_map(|k| array(k).into_bytes()).skip(1);
    let arrays: Vec<u8> = [b'{'].into_iter().chain(arrays).chain([b'}']).collect();
    let _ = held("arrays", &header(&arrays));
    let end = b"1],\"data_offsets\":[0,0]}}";
    let axes = filled(b"{\"a\":{\"dtype\":\"F32\",\"shape\":[", b"0,", end);
    let _ = held("axes", &header(&axes));
    let words = filled(b"{\"__metadata__\":{", b"\"a\":\"\",", b"\"b\":\"\"}}");
    let _ = held("words", &header(&words));
    let shape =
        b"{\"a\":{\"dtype\":\"F32\",\"shape\":[0,4611686018427387904,4],\"data_offsets\":[0,0]}}";
    let file = header(shape);
    assert!(file.len() < 100);
    let error = held("a shape beyond counting", &file).unwrap_err();
    assert!(error.to_string().contains("safetensors"), "{error}");
}
