//! Paths as text: what JSON cannot say of one that is not UTF-8 is replaced by `U+FFFD`.
//!
//! ```
//! use std::path::PathBuf;
//!
//! #[derive(serde::Serialize)]
//! struct Written {
//!     #[serde(serialize_with = "train::path_text::serialize")]
//!     output: PathBuf,
//! }
//! let json = serde_json::to_string(&Written { output: "mesh.glb".into() })?;
//! assert_eq!(json, r#"{"output":"mesh.glb"}"#);
//! # Ok::<(), serde_json::Error>(())
//! ```

use std::path::Path;

use serde::Serializer;

/// For `#[serde(serialize_with = ..)]` at a field that is a path.
///
/// # Errors
/// Those of the serializer; serde itself refuses a path that is not UTF-8.
pub fn serialize<S: Serializer>(path: impl AsRef<Path>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&path.as_ref().display())
}

/// For a field that may have none.
///
/// # Errors
/// As [`serialize`].
pub fn serialize_optional<P: AsRef<Path>, S: Serializer>(
    path: &Option<P>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    match path {
        Some(path) => serialize(path, serializer),
        None => serializer.serialize_none(),
    }
}

#[cfg(all(test, unix))]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt as _;

    use super::*;

    #[test]
    fn what_is_not_utf8_is_replaced() {
        let path = Path::new(OsStr::from_bytes(b"caf\xe9/mesh.glb"));
        let text = serialize(path, serde_json::value::Serializer).unwrap();
        assert_eq!(text, "caf\u{fffd}/mesh.glb");
        assert_eq!(serialize_optional(&Some(path), serde_json::value::Serializer).unwrap(), text);
    }
}
