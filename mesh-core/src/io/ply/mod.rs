//! Stanford PLY: ASCII, little-endian and big-endian.

mod header;
mod read;
mod write;

pub use read::{decode, read};
pub use write::{Encoding, encode, write};
