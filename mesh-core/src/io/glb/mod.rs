//! Binary glTF 2.0.

mod accessor;
mod container;
mod document;
mod material;
mod read;
mod soup;
mod uri;
mod write;

pub(super) use read::assemble;
pub use read::{decode, decode_with, read, read_with};
pub use write::{encode, encode_upright, write, write_upright};

/// What files of this crate name as their generator, before its version.
const GENERATOR: &str = "mesh-core ";
/// `glTF`, the first four bytes.
const MAGIC: u32 = 0x4654_6c67;
/// `JSON`, the type of the first chunk.
const JSON: u32 = 0x4e4f_534a;
/// `BIN`, the type of the second.
const BIN: u32 = 0x004e_4942;

/// Numbers of the standard for the types of accessors.
mod component {
    pub(super) const I8: u32 = 5120;
    pub(super) const U8: u32 = 5121;
    pub(super) const I16: u32 = 5122;
    pub(super) const U16: u32 = 5123;
    pub(super) const U32: u32 = 5125;
    pub(super) const F32: u32 = 5126;
}
