//! Looks for dead links in a book that rustdoc made: files that are not there, and headings that no page has.
//!
//! ```text
//! cargo doc --workspace --no-deps && cargo run -p unsphere-docs --example dead_links -- target/doc/book
//! ```
#![allow(clippy::print_stdout, reason = "a program")]

use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("which folder? for instance target/doc/book")?;
    let pages = pages(Path::new(&folder))?;
    let mut dead = BTreeSet::new();
    let mut links = 0;
    for (page, text) in &pages {
        for target in values(text, "href=\"").chain(values(text, "src=\"")) {
            // Addresses, pictures, and what a script fills in.
            if ["://", "data:", "${"].iter().any(|elsewhere| target.contains(elsewhere)) {
                continue;
            }
            links += 1;
            if !is_alive(&pages, page, target) {
                dead.insert(format!("{}: {target}", page.display()));
            }
        }
    }
    println!("{} pages, {links} links within the book", pages.len());
    if pages.len() < 20 || links < 500 {
        return Err("that is no book".into());
    }
    if dead.is_empty() {
        Ok(())
    } else {
        Err(dead.into_iter().collect::<Vec<_>>().join("\n").into())
    }
}

/// All pages below a folder.
fn pages(folder: &Path) -> Result<BTreeMap<PathBuf, String>, Box<dyn Error>> {
    let mut found = BTreeMap::new();
    let mut pending =
        vec![folder.canonicalize().map_err(|e| format!("{}: {e}", folder.display()))?];
    while let Some(folder) = pending.pop() {
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() {
                pending.push(path);
            } else if path.extension().is_some_and(|end| end == "html") {
                found.insert(path.clone(), fs::read_to_string(path)?);
            }
        }
    }
    Ok(found)
}

/// The values of an attribute, wherever it stands.
fn values<'a>(text: &'a str, attribute: &'a str) -> impl Iterator<Item = &'a str> {
    text.split(attribute).skip(1).filter_map(|rest| rest.split('"').next())
}

fn is_alive(pages: &BTreeMap<PathBuf, String>, page: &Path, target: &str) -> bool {
    let (file, heading) = target.split_once('#').unwrap_or((target, ""));
    let place = if file.is_empty() {
        page.to_owned()
    } else {
        let Some(Ok(place)) = page.parent().map(|folder| folder.join(file).canonicalize()) else {
            return false;
        };
        place
    };
    // Pages of others may be asked for, but not which headings they have.
    let Some(text) = pages.get(&place) else { return true };
    heading.is_empty() || values(text, "id=\"").any(|id| id == heading)
}
