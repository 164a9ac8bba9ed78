//! Stanford PLY: ASCII, little-endian and big-endian.

mod faces;
mod header;
mod numbers;
mod read;
mod write;

pub(super) use read::read_with_uvs;
pub use read::{decode, decode_with, read, read_with};
pub use write::{Encoding, encode, write};
