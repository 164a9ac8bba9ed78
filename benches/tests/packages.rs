//! What a registry gets: each package complete by itself.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::fs;
use std::path::{Path, PathBuf};

use benches::workspace::{packages, root};
use serde_json::Value;

/// The packages that are published, with their folders.
fn published() -> Vec<(Value, PathBuf)> {
    let published = packages().into_iter().filter(|package| package["publish"].is_null());
    let folder =
        |p: &Value| Path::new(p["manifest_path"].as_str().unwrap()).parent().unwrap().into();
    let all: Vec<_> = published.map(|package| (package.clone(), folder(&package))).collect();
    assert_eq!(all.len(), 14, "benches and docs are not for others");
    all
}

fn text(package: &Value, key: &str) -> String {
    package[key].as_str().unwrap_or_default().to_owned()
}

fn list(package: &Value, key: &str) -> Vec<String> {
    let all = package[key].as_array().unwrap().iter();
    all.map(|value| value.as_str().unwrap().to_owned()).collect()
}

#[test]
fn each_has_the_texts_of_both_licences() {
    for name in ["LICENSE-MIT", "LICENSE-APACHE"] {
        let whole = fs::read_to_string(root().join(name)).unwrap();
        for (package, folder) in published() {
            assert_eq!(text(&package, "license"), "MIT OR Apache-2.0", "{}", package["name"]);
            let own = fs::read_to_string(folder.join(name)).unwrap_or_default();
            assert!(own == whole, "{}: not the text of {name}", folder.display());
        }
    }
}

#[test]
fn each_can_be_found() {
    for (package, folder) in published() {
        let name = text(&package, "name");
        assert!((30..200).contains(&text(&package, "description").len()), "{name}: description");
        assert_eq!(text(&package, "documentation"), format!("https://docs.rs/{name}"));
        let keywords = list(&package, "keywords");
        assert!((3..=5).contains(&keywords.len()), "{name}: {} keywords", keywords.len());
        for word in &keywords {
            let plain = word.chars().all(|c| c.is_ascii_alphanumeric() || "-_+".contains(c));
            assert!(plain && word.len() <= 20, "{name}: {word} is no keyword for a registry");
        }
        assert!((1..=5).contains(&list(&package, "categories").len()), "{name}: categories");
        assert_eq!(text(&package, "readme"), "README.md", "{name}");
        assert!(folder.join("README.md").is_file(), "{name}");
        assert_documented(&package);
        assert_eq!(text(&package, "rust_version"), "1.89", "{name}");
    }
}

/// docs.rs shows all features, but for the one that needs an MPI library.
#[track_caller]
fn assert_documented(package: &serde_json::Value) {
    let (name, shown) = (&package["name"], &package["metadata"]["docs"]["rs"]);
    let mut features: Vec<_> = package["features"].as_object().unwrap().keys().collect();
    if !features.iter().any(|feature| *feature == "mpi") {
        assert_eq!(shown["all-features"], true, "{name}: docs.rs");
        return;
    }
    features.retain(|feature| !["mpi", "default"].contains(&feature.as_str()));
    assert_eq!(shown["features"], serde_json::json!(features), "{name}: docs.rs");
}

/// A registry knows no paths: whoever is needed has a version, and is published too.
#[test]
fn each_finds_its_neighbors() {
    let all = published();
    let version_of =
        |name: &str| all.iter().find(|(p, _)| p["name"] == name).map(|(p, _)| text(p, "version"));
    for (package, _) in &all {
        for needed in package["dependencies"].as_array().unwrap() {
            let (Some(_), true) = (needed.get("path"), needed["kind"].is_null()) else { continue };
            let needed_name = text(needed, "name");
            let version = version_of(&needed_name);
            let version = version.unwrap_or_else(|| panic!("{needed_name} is not published"));
            assert_eq!(text(needed, "req"), format!("^{version}"), "{}", package["name"]);
        }
    }
}

/// Files that are compiled in lie in the package.
#[test]
fn each_has_what_it_includes() {
    for (_, folder) in published() {
        let mut pending = vec![folder.join("src")];
        while let Some(at) = pending.pop() {
            for path in fs::read_dir(&at).unwrap().map(|entry| entry.unwrap().path()) {
                if path.is_dir() {
                    pending.push(path);
                    continue;
                }
                if path.extension().is_none_or(|e| e != "rs") {
                    continue;
                }
                let source = fs::read_to_string(&path).unwrap();
                for opening in ["include_str!(\"", "include_bytes!(\""] {
                    for after in source.split(opening).skip(1) {
                        let name = after.split('"').next().unwrap();
                        let file = at.join(name).canonicalize().unwrap();
                        assert!(file.starts_with(&folder), "{}: {name} is outside", path.display());
                    }
                }
            }
        }
    }
}

/// A stranger reads one screen: what it is, lines that run, how fast, what it needs.
#[test]
fn each_says_on_one_screen_what_it_is() {
    for (package, folder) in published() {
        let readme = fs::read_to_string(folder.join("README.md")).unwrap();
        let screen: Vec<&str> = readme.lines().take(45).collect();
        for wanted in ["```", "**Speed.**", "**Needs.**"] {
            let found = screen.iter().any(|line| line.starts_with(wanted));
            assert!(found, "{}: no {wanted} on the first screen", package["name"]);
        }
    }
}

#[test]
fn the_citation_is_of_this_version() {
    let citation = fs::read_to_string(root().join("CITATION.cff")).unwrap();
    let version = text(&published()[0].0, "version");
    assert!(citation.lines().any(|line| line == format!("version: {version}")));
}

#[test]
fn cards_of_weights_name_no_folder_of_a_machine() {
    let mut cards = 0;
    for entry in fs::read_dir(root().join("weights")).unwrap() {
        let path = entry.unwrap().path();
        let card = if path.extension().is_some_and(|ending| ending == "safetensors") {
            let bytes = fs::read(&path).unwrap();
            let length = u64::from_le_bytes(*bytes.first_chunk().unwrap()) as usize;
            let header: Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
            text(&header["__metadata__"], "card")
        } else {
            fs::read_to_string(&path).unwrap()
        };
        let word = card.split_whitespace().find(|word| word.starts_with('/') && word.len() > 1);
        assert_eq!(word, None, "{}", path.display());
        cards += usize::from(!card.is_empty());
    }
    assert!(cards >= 14, "a card inside of each file, and one beside it: {cards}");
}
