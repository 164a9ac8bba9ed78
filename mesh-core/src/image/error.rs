//! What can be wrong with an image file.

use std::path::PathBuf;

/// Why an image could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The file could not be opened or read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The bytes are not an image of a known format, or are damaged.
    #[error("{}: not a readable image: {what}", path.display())]
    Decode {
        /// The file, or the name given for the bytes.
        path: PathBuf,
        /// What the decoder said.
        what: String,
    },
    /// The header claims an image larger than the file or the memory can hold.
    #[error(
        "{}: the header claims {width} x {height} pixels ({bytes} bytes), more than {limit} bytes \
         that a file of {length} bytes may unpack to",
        path.display()
    )]
    TooLarge {
        /// The file, or the name given for the bytes.
        path: PathBuf,
        /// Claimed columns.
        width: u64,
        /// Claimed rows.
        height: u64,
        /// Bytes that the pixels would take.
        bytes: u64,
        /// Bytes that are allowed.
        limit: u64,
        /// Bytes in the file.
        length: u64,
    },
    /// An EXR file without a channel that could be depth.
    #[error(
        "{}: no depth channel: expected Z, V, depth.V, View Layer.Depth.Z or R, found {found}",
        path.display()
    )]
    NoDepth {
        /// The file.
        path: PathBuf,
        /// The channels that it has.
        found: String,
    },
}
