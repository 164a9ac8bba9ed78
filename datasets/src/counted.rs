//! How many there are of something that is spoken of, in words.

use mesh_core::counted;

/// `1 object is`, `3 objects are`.
pub(crate) fn counted_are(count: usize, noun: &str) -> String {
    format!("{} {}", counted(count, noun), if count == 1 { "is" } else { "are" })
}
