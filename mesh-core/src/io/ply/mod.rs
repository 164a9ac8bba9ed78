//! Stanford PLY: ASCII, little-endian and big-endian.

mod faces;
mod header;
mod numbers;
mod read;
mod write;

pub(super) use read::mesh;
pub use read::{decode, decode_with, read, read_with};
pub use write::{Encoding, encode, write};
