//! The places that ARCHITECTURE.md names by file and line: `name` (path:line).

#![allow(clippy::unwrap_used, reason = "tests")]

use std::fs;
use std::path::Path;

/// A place in the text: where its line number stands, and what should be found there.
struct Place {
    number: std::ops::Range<usize>,
    path: String,
    name: String,
}

/// All of the form `` `name` (path:number``, what follows being anything.
fn places(text: &str) -> Vec<Place> {
    let mut found = Vec::new();
    for (start, _) in text.match_indices("` (") {
        let name = text[..start].rsplit('`').next().unwrap();
        let rest = &text[start + 3..];
        let Some((path, behind)) = rest.split_once(':') else { continue };
        let digits = behind.bytes().take_while(u8::is_ascii_digit).count();
        if digits == 0 || path.contains([' ', '`', ')']) {
            continue;
        }
        let at = start + 3 + path.len() + 1;
        found.push(Place { number: at..at + digits, path: path.to_owned(), name: name.to_owned() });
    }
    found
}

/// Whether a line defines the name: a function, a type, an option's value, or, where nothing does, the word.
fn defines(line: &str, name: &str) -> bool {
    let line = line.trim_start();
    let behind = |before: &str| {
        let at = line.find(before).map(|at| &line[at + before.len()..]);
        at.and_then(|rest| rest.strip_prefix(name))
            .is_some_and(|rest| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_'))
    };
    !line.starts_with("//")
        && (["fn ", "struct ", "enum "].iter().any(|word| behind(word))
            || line.starts_with(&format!("{name} = ")))
}

/// The line of a file, from 1, that a place means: of several the nearest to the one that it says. What is
/// called `Type::name` is looked for in blocks of that type.
fn line_of(root: &Path, place: &Place, said: usize) -> usize {
    let path = root.join(&place.path);
    let text = fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    if let Some((of, name)) = place.name.split_once("::") {
        let mut inside = false;
        let within = text.lines().enumerate().filter(|(_, line)| {
            if line.starts_with("impl") {
                inside = line.split([' ', '<', '>', '&']).any(|word| word == of);
            }
            inside && defines(line, name)
        });
        let nearest = within.map(|(k, _)| k + 1).min_by_key(|&line| line.abs_diff(said));
        return nearest.unwrap_or_else(|| panic!("{} does not have {}", place.path, place.name));
    }
    let lines = |found: &dyn Fn(&str) -> bool| -> Vec<usize> {
        text.lines().enumerate().filter(|(_, line)| found(line)).map(|(k, _)| k + 1).collect()
    };
    let mut candidates = lines(&|line| defines(line, &place.name));
    if candidates.is_empty() {
        candidates =
            lines(&|line| line.contains(&place.name) && !line.trim_start().starts_with("//"));
    }
    let nearest = candidates.into_iter().min_by_key(|&line| line.abs_diff(said));
    nearest.unwrap_or_else(|| panic!("{} does not have {}", place.path, place.name))
}

#[test]
fn every_place_is_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let file = root.join("ARCHITECTURE.md");
    let mut text = fs::read_to_string(&file).unwrap();
    let update = std::env::var_os("UPDATE_DOCS").is_some();
    let found = places(&text);
    assert!(found.len() >= 20, "{} places", found.len());
    let mut old = Vec::new();
    for place in found.iter().rev() {
        let said: usize = text[place.number.clone()].parse().unwrap();
        let line = line_of(root, place, said);
        if line != said {
            old.push(format!("{} ({}:{said}) is in line {line}", place.name, place.path));
            text.replace_range(place.number.clone(), &line.to_string());
        }
    }
    if update {
        fs::write(&file, text).unwrap();
    } else {
        let remedy = "UPDATE_DOCS=1 cargo test -p unsphere-benches --test places";
        assert!(old.is_empty(), "{}\nremedy: {remedy}", old.join("\n"));
    }
}
