//! The workspace as its tests read it: packages by cargo's word, sources as text.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Its folder.
pub fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().expect("this crate is in a folder of the workspace").to_path_buf()
}

/// What `cargo metadata` says of each member.
///
/// # Panics
/// If cargo cannot be asked.
pub fn packages() -> Vec<Value> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .current_dir(root())
        .output()
        .expect("cargo runs, as it built this");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut metadata: Value = serde_json::from_slice(&output.stdout).expect("JSON, as asked for");
    let Value::Array(packages) = metadata["packages"].take() else {
        panic!("cargo metadata: no packages")
    };
    packages
}

/// All Rust files under a folder in the order of their paths, with their text up to the unit tests; none where there is no
/// folder.
///
/// # Panics
/// If a file is not UTF-8 or cannot be read.
pub fn sources(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    let mut pending = vec![folder.to_path_buf()];
    while let Some(folder) = pending.pop() {
        let Ok(entries) = fs::read_dir(folder) else { continue };
        for path in entries.map(|entry| entry.expect("the folder can be listed").path()) {
            if path.is_dir() {
                pending.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let text = fs::read_to_string(&path).expect("sources are text");
                let end = text.find("\n#[cfg(test)]\nmod ").unwrap_or(text.len());
                // `mod tests;` in a file of its own: what follows is not a test.
                let inline = text[end..].lines().nth(2).is_some_and(|line| line.ends_with('{'))
                    || text[end..].contains("mod tests {");
                found.push((path, if inline { text[..end].to_owned() } else { text }));
            }
        }
    }
    found.sort();
    found
}
