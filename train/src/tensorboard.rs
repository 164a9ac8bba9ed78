//! TensorBoard's event files: protocol buffers in TFRecord frames, written by hand.
//!
//! A frame is the length as u64, its masked CRC-32C, the record, and the record's masked CRC-32C, all
//! little-endian; the mask is a rotation right by 15 bits and a sum with `0xa282ead8`. A record is
//! an `Event { 1: double wall_time, 2: int64 step, 3: string file_version, 5: Summary,
//! 7: SessionLog }`, a `Summary` repeats `1: Value { 1: tag, 2: float simple_value, 4: Image }`,
//! and an `Image` is `{ 1: height, 2: width, 3: colorspace, 4: PNG }` (tensorflow's `event.proto`,
//! `summary.proto`, `record_writer.cc`).

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::error::RunError;

/// An event file under way.
#[derive(Debug)]
pub(super) struct Events {
    path: PathBuf,
    file: File,
}

impl Events {
    /// Begins a file in `folder`. `step` is where the run goes on: TensorBoard then forgets what an
    /// earlier file says of later steps.
    pub(super) fn create(folder: &Path, wall_time: f64, step: u64) -> Result<Self, RunError> {
        std::fs::create_dir_all(folder).map_err(RunError::io(folder))?;
        // Two parts of a run may begin within a second.
        let mut name = format!("events.out.tfevents.{:010}.unsphere", wall_time as u64);
        while folder.join(&name).exists() {
            name.push('+');
        }
        let path = folder.join(name);
        let file = File::create(&path).map_err(RunError::io(&path))?;
        let mut events = Self { path, file };
        let mut version = Message::event(wall_time, 0);
        version.bytes(3, b"brain.Event:2");
        events.append(&version)?;
        if step > 0 {
            let mut start = Message::event(wall_time, step + 1);
            let mut session = Message::default();
            session.integer(1, 1);
            start.message(7, &session);
            events.append(&start)?;
        }
        Ok(events)
    }

    /// Numbers of one step by tag.
    pub(super) fn scalars(
        &mut self,
        wall_time: f64,
        step: u64,
        values: &[(String, f64)],
    ) -> Result<(), RunError> {
        let mut summary = Message::default();
        for (tag, value) in values {
            let mut entry = Message::tagged(tag);
            entry.single(2, *value as f32);
            summary.message(1, &entry);
        }
        self.summary(wall_time, step, &summary)
    }

    /// An image of one step.
    pub(super) fn picture(
        &mut self,
        wall_time: f64,
        step: u64,
        tag: &str,
        [height, width]: [usize; 2],
        png: &[u8],
    ) -> Result<(), RunError> {
        let mut image = Message::default();
        image.integer(1, height as u64);
        image.integer(2, width as u64);
        image.integer(3, 3);
        image.bytes(4, png);
        let mut entry = Message::tagged(tag);
        entry.message(4, &image);
        let mut summary = Message::default();
        summary.message(1, &entry);
        self.summary(wall_time, step, &summary)
    }

    fn summary(&mut self, wall_time: f64, step: u64, summary: &Message) -> Result<(), RunError> {
        let mut event = Message::event(wall_time, step);
        event.message(5, summary);
        self.append(&event)
    }

    fn append(&mut self, record: &Message) -> Result<(), RunError> {
        self.file.write_all(&frame(&record.0)).map_err(RunError::io(&self.path))
    }
}

/// A protocol buffer message, field after field.
#[derive(Default)]
struct Message(Vec<u8>);

impl Message {
    fn event(wall_time: f64, step: u64) -> Self {
        let mut event = Self::default();
        event.0.push(1 << 3 | 1);
        event.0.extend(wall_time.to_le_bytes());
        event.integer(2, step);
        event
    }

    /// A value of a summary, as far as its name.
    fn tagged(tag: &str) -> Self {
        let mut entry = Self::default();
        entry.bytes(1, tag.as_bytes());
        entry
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    fn integer(&mut self, field: u8, value: u64) {
        self.0.push(field << 3);
        self.varint(value);
    }

    fn single(&mut self, field: u8, value: f32) {
        self.0.push((field << 3) | 5);
        self.0.extend(value.to_le_bytes());
    }

    fn bytes(&mut self, field: u8, value: &[u8]) {
        self.0.push((field << 3) | 2);
        self.varint(value.len() as u64);
        self.0.extend(value);
    }

    fn message(&mut self, field: u8, value: &Self) {
        self.bytes(field, &value.0);
    }
}

fn frame(record: &[u8]) -> Vec<u8> {
    let length = (record.len() as u64).to_le_bytes();
    let mut bytes = Vec::with_capacity(record.len() + 16);
    bytes.extend(length);
    bytes.extend(masked(crc32c(&length)).to_le_bytes());
    bytes.extend(record);
    bytes.extend(masked(crc32c(record)).to_le_bytes());
    bytes
}

fn masked(crc: u32) -> u32 {
    crc.rotate_right(15).wrapping_add(0xa282_ead8)
}

/// Castagnoli's CRC, reflected, by a table of 256 remainders.
fn crc32c(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0; 256];
        let mut k = 0;
        while k < 256 {
            let mut crc = k as u32;
            let mut bit = 0;
            while bit < 8 {
                crc = if crc & 1 == 1 { (crc >> 1) ^ 0x82f6_3b78 } else { crc >> 1 };
                bit += 1;
            }
            table[k] = crc;
            k += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |crc: u32, &b| (crc >> 8) ^ TABLE[(crc as u8 ^ b) as usize])
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_castagnolis() {
        // RFC 3720, B.4: thirty-two bytes of zeros, of ones, and ascending; and the usual check.
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
        assert_eq!(crc32c(&(0..32).collect::<Vec<u8>>()), 0x46dd_794e);
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
    }

    #[test]
    fn a_record_byte_by_byte() {
        let folder = tempfile::tempdir().unwrap();
        let mut events = Events::create(folder.path(), 1.0, 0).unwrap();
        events.scalars(1.5, 300, &[("loss".to_owned(), 0.25)]).unwrap();
        let bytes = std::fs::read(&events.path).unwrap();
        // Event { wall_time: 1.0, step: 0, file_version: "brain.Event:2" } is 9 + 2 + 15 bytes.
        assert_eq!(&bytes[..8], 26_u64.to_le_bytes());
        assert_eq!(&bytes[12..23], [9, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f, 16, 0]);
        assert_eq!(&bytes[23..38], b"\x1a\x0dbrain.Event:2");
        let second = &bytes[8 + 4 + 26 + 4..];
        // { 1: 1.5, 2: 300, 5: { 1: { 1: "loss", 2: 0.25 } } }
        let expected =
            b"\x09\0\0\0\0\0\0\xf8\x3f\x10\xac\x02\x2a\x0d\x0a\x0b\x0a\x04loss\x15\0\0\x80\x3e";
        assert_eq!(&second[..8], (expected.len() as u64).to_le_bytes());
        assert_eq!(&second[12..12 + expected.len()], expected);
        let tail = masked(crc32c(expected)).to_le_bytes();
        assert_eq!(&second[12 + expected.len()..], tail);
    }
}
