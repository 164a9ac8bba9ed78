//! Links within the repository's pages lead somewhere: to files that are there, and to headings that stand in them.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// All pages, by their path from the root, with their text outside of code.
fn pages(root: &Path) -> BTreeMap<PathBuf, String> {
    let mut found = BTreeMap::new();
    let mut pending = vec![root.to_path_buf()];
    while let Some(folder) = pending.pop() {
        for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            let name = path.file_name().unwrap().to_str().unwrap();
            if path.is_dir() && !name.starts_with('.') && name != "target" && name != "corpus" {
                pending.push(path);
            } else if path.extension().is_some_and(|end| end == "md") {
                let text = prose(&fs::read_to_string(&path).unwrap());
                found.insert(path.strip_prefix(root).unwrap().to_owned(), text);
            }
        }
    }
    found
}

/// The text without what is quoted as code.
fn prose(text: &str) -> String {
    let mut fenced = false;
    let mut kept = String::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        } else if !fenced {
            kept.push_str(line);
            kept.push('\n');
        }
    }
    kept
}

/// Where the links of a text lead: what stands in the brackets of `](..)`.
fn targets(text: &str) -> impl Iterator<Item = &str> {
    // A link within code is none.
    let spoken = text.split('`').step_by(2);
    spoken.flat_map(|part| part.split("](").skip(1).filter_map(|rest| rest.split(')').next()))
}

/// What a heading is called in links.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || [' ', '-', '_'].contains(c));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

fn has_heading(text: &str, wanted: &str) -> bool {
    let headings = text.lines().filter(|line| line.starts_with('#'));
    headings.map(|line| anchor(line.trim_start_matches('#'))).any(|found| found == wanted)
}

/// What is wrong with a page's links.
fn dead(root: &Path, pages: &BTreeMap<PathBuf, String>, page: &Path, text: &str) -> Vec<String> {
    let mut dead = Vec::new();
    for target in targets(text).filter(|target| !target.contains("://")) {
        let (file, heading) = target.split_once('#').unwrap_or((target, ""));
        let place = if file.is_empty() {
            page.to_owned()
        } else {
            let beside = root.join(page.parent().unwrap()).join(file);
            let Ok(there) = beside.canonicalize() else {
                dead.push(format!("{}: {target}: no such file", page.display()));
                continue;
            };
            there.strip_prefix(root).map_or_else(|_| there.clone(), Path::to_owned)
        };
        let known = pages.get(&place);
        if !heading.is_empty() && !known.is_some_and(|text| has_heading(text, heading)) {
            dead.push(format!("{}: {target}: no such heading", page.display()));
        }
    }
    dead
}

#[test]
fn no_link_is_dead() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().canonicalize().unwrap();
    let pages = pages(&root);
    assert!(pages.len() > 20 && pages.contains_key(Path::new("docs/onnx.md")));
    let links: usize = pages.values().map(|text| targets(text).count()).sum();
    assert!(links > 60, "{links}");
    let found: Vec<String> =
        pages.iter().flat_map(|(page, text)| dead(&root, &pages, page, text)).collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn a_dead_one_would_be_found() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().canonicalize().unwrap();
    let page = Path::new("docs/made-up.md");
    let text = "# One two, three!\n[a](#one-two-three) [b](#four) [c](none.md) `[d](e.md)` \
                [f](../README.md) [g](https://example.org/x)\n";
    let pages = BTreeMap::from([(page.to_owned(), text.to_owned())]);
    let found = dead(&root, &pages, page, text);
    assert_eq!(
        found,
        ["docs/made-up.md: #four: no such heading", "docs/made-up.md: none.md: no such file"]
    );
}
