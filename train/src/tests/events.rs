//! Reads TensorBoard's event files back.

use std::path::Path;

/// Tag, step and value of every scalar in the event files of a folder; frames are checked for
/// their lengths only, the checksum has a test of its own.
pub(super) fn scalars(folder: &Path) -> Vec<(String, u64, f32)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let bytes = std::fs::read(entry.unwrap().path()).unwrap();
        let mut rest = &bytes[..];
        while !rest.is_empty() {
            let length = u64::from_le_bytes(rest[..8].try_into().unwrap()) as usize;
            let event = fields(&rest[12..12 + length]);
            rest = &rest[16 + length..];
            let step = event.iter().find(|f| f.0 == 2).map_or(0, |f| f.1);
            for summary in event.iter().filter(|f| f.0 == 5) {
                for value in fields(summary.2) {
                    let value = fields(value.2);
                    let tag = String::from_utf8(value[0].2.to_vec()).unwrap();
                    if value[1].0 == 2 {
                        found.push((tag, step, f32::from_bits(value[1].1 as u32)));
                    }
                }
            }
        }
    }
    found
}

/// Field number, value if it is a number, bytes if it is not.
fn fields(mut bytes: &[u8]) -> Vec<(u8, u64, &[u8])> {
    fn varint(bytes: &mut &[u8]) -> u64 {
        let mut value = 0;
        for shift in (0..).step_by(7) {
            let byte = bytes[0];
            *bytes = &bytes[1..];
            value |= u64::from(byte & 127) << shift;
            if byte < 128 {
                break;
            }
        }
        value
    }
    let mut all = Vec::new();
    while !bytes.is_empty() {
        let key = varint(&mut bytes) as u8;
        let length = match key & 7 {
            0 => {
                all.push((key >> 3, varint(&mut bytes), &[][..]));
                continue;
            }
            1 => 8,
            5 => 4,
            _ => varint(&mut bytes) as usize,
        };
        let (value, rest) = bytes.split_at(length);
        let number = if key & 7 == 5 { u32::from_le_bytes(value.try_into().unwrap()) } else { 0 };
        all.push((key >> 3, u64::from(number), value));
        bytes = rest;
    }
    all
}
