//! How many there are of something, in words.

/// A count with its noun, which gets an `s` where there is not one of it.
///
/// ```
/// use mesh_core::counted;
///
/// assert_eq!([0, 1, 3].map(|count| counted(count, "view")), ["0 views", "1 view", "3 views"]);
/// ```
pub fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}
