//! No circle of files: which file of a crate uses what another one defines.
//!
//! An edge goes from the file that names an item to the file that defines it, through whatever re-exports; to
//! the module's file where it cannot be told. Re-exports in `lib.rs` and `mod.rs` are no edges, tests are not
//! read. In a circle no file can be understood before the others.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Of how many files a circle may be: two that know each other are one thought in two parts.
const MOST: usize = 2;
/// Circles that are still to be opened: the crate, and how many files its largest one has. Numbers only fall.
const KNOWN: &[(&str, usize)] = &[("autodiff-lite", 11)];

/// A path as code writes it, and what it is called in the file.
type Import = (Vec<String>, String);

/// What a file says of itself.
#[derive(Default)]
struct File {
    module: Vec<String>,
    defined: BTreeSet<String>,
    imports: Vec<Import>,
    /// All paths that are edges.
    used: Vec<Vec<String>>,
    /// Modules that only tests have.
    tests: BTreeSet<String>,
}

/// Words and signs without comments, texts and numbers' insides.
fn tokens(text: &str) -> Vec<String> {
    let chars: Vec<char> = text.chars().collect();
    let (mut out, mut i) = (Vec::new(), 0);
    let starts =
        |i: usize, with: &str| with.chars().enumerate().all(|(k, c)| chars.get(i + k) == Some(&c));
    while i < chars.len() {
        let c = chars[i];
        if starts(i, "//") {
            i += chars[i..].iter().position(|&c| c == '\n').unwrap_or(chars.len() - i);
        } else if c == 'r' && (starts(i + 1, "\"") || starts(i + 1, "#\"") || starts(i + 1, "##\""))
        {
            let hashes = chars[i + 1..].iter().take_while(|&&c| c == '#').count();
            let end = format!("\"{}", "#".repeat(hashes));
            i += hashes + 2;
            while i < chars.len() && !starts(i, &end) {
                i += 1;
            }
            i += end.len();
        } else if c == '"' {
            i += 1;
            while i < chars.len() && chars[i] != '"' {
                i += if chars[i] == '\\' { 2 } else { 1 };
            }
            i += 1;
        } else if c == '\'' && (starts(i + 1, "\\") || chars.get(i + 2) == Some(&'\'')) {
            i += if starts(i + 1, "\\") { 3 } else { 2 };
            while i < chars.len() && chars[i] != '\'' {
                i += 1;
            }
            i += 1;
        } else if c.is_alphanumeric() || c == '_' {
            let length =
                chars[i..].iter().take_while(|c| c.is_alphanumeric() || **c == '_').count();
            let word: String = chars[i..i + length].iter().collect();
            // Of a byte string the mark is left.
            if !(starts(i + length, "\"") && word == "b") {
                out.push(word);
            }
            i += length;
        } else if starts(i, "::") {
            out.push("::".to_owned());
            i += 2;
        } else {
            if !c.is_whitespace() {
                out.push(c.to_string());
            }
            i += 1;
        }
    }
    out
}

/// Where an item ends that begins here: behind its `;`, or its braces.
fn end_of_item(tokens: &[String], mut i: usize) -> usize {
    let mut depth = 0_i32;
    while i < tokens.len() {
        match tokens[i].as_str() {
            "{" | "(" | "[" => depth += 1,
            ")" | "]" => depth -= 1,
            "}" => {
                depth -= 1;
                // `use a::{b};` goes on behind its braces.
                if depth == 0 && tokens.get(i + 1).is_none_or(|t| t != ";") {
                    return i + 1;
                }
            }
            ";" if depth == 0 => return i + 1,
            _ => {}
        }
        i += 1;
    }
    i
}

/// The paths of a `use`, from behind the word up to `;`; where it ends.
fn imports(tokens: &[String], mut i: usize, before: &[String], out: &mut Vec<Import>) -> usize {
    let mut path = before.to_vec();
    loop {
        match tokens.get(i).map_or(";", String::as_str) {
            "::" => i += 1,
            "{" => {
                i += 1;
                while tokens.get(i).is_some_and(|t| t != "}") {
                    i = imports(tokens, i, &path, out);
                    if tokens.get(i).is_some_and(|t| t == ",") {
                        i += 1;
                    }
                }
                return i + 1;
            }
            "as" => {
                out.push((path, tokens[i + 1].clone()));
                return i + 2;
            }
            "," | "}" | ";" => {
                if path.last().is_some_and(|last| last == "self") {
                    path.pop();
                }
                if let Some(name) = path.last().cloned() {
                    out.push((path, name));
                }
                return i;
            }
            word => {
                path.push(word.to_owned());
                i += 1;
            }
        }
    }
}

/// Where a path ends that begins here.
fn end_of_path(tokens: &[String], mut i: usize) -> usize {
    let named = |k: usize| {
        tokens.get(k).is_some_and(|t| t.starts_with(|c: char| c.is_alphabetic() || c == '_'))
    };
    while tokens.get(i + 1).is_some_and(|t| t == "::") && named(i + 2) {
        i += 2;
    }
    i + 1
}

/// A path in a module within a file, as the file's own module would write it.
fn outside(path: &mut Vec<String>, depth: usize) {
    let supers = path.iter().take(depth).take_while(|word| *word == "super").count();
    if supers > 0 {
        path.splice(..supers, ["self".to_owned()]);
    }
}

fn scan(text: &str, module: Vec<String>, gathers: bool) -> File {
    let tokens = tokens(text);
    let word = |i: usize| tokens.get(i).map_or("", String::as_str);
    let mut file = File { module, ..File::default() };
    let (mut i, mut depth) = (0, 0_i32);
    // Depths at which modules within the file begin.
    let mut inner: Vec<i32> = Vec::new();
    while i < tokens.len() {
        let test = ["#", "[", "cfg", "(", "test", ")", "]"];
        if test.iter().enumerate().all(|(k, t)| word(i + k) == *t) {
            i += test.len();
            while word(i) == "#" {
                i = 1 + (i..tokens.len()).find(|&k| word(k) == "]").unwrap();
            }
            if word(i) == "mod" {
                file.tests.insert(word(i + 1).to_owned());
            }
            i = end_of_item(&tokens, i);
            continue;
        }
        match word(i) {
            "{" => depth += 1,
            "}" => {
                depth -= 1;
                inner.retain(|&begun| begun < depth);
            }
            "mod" if word(i + 2) == "{" => inner.push(depth),
            "use" => {
                let public = i > 0 && matches!(word(i - 1), "pub" | ")");
                let mut found = Vec::new();
                i = imports(&tokens, i + 1, &[], &mut found);
                for (path, _) in &mut found {
                    outside(path, inner.len());
                }
                if !(public && gathers) {
                    file.used.extend(found.iter().map(|(path, _)| path.clone()));
                }
                file.imports.extend(found);
                continue;
            }
            "fn" | "struct" | "enum" | "trait" | "type" | "const" | "static" | "union"
                if depth == 0 =>
            {
                let name = if word(i + 1) == "mut" || word(i + 1) == "fn" { i + 2 } else { i + 1 };
                file.defined.insert(word(name).to_owned());
            }
            "macro_rules" => drop(file.defined.insert(word(i + 2).to_owned())),
            // `pub(in path)` says who may use, and uses nothing.
            "pub" if word(i + 2) == "in" => i = end_of_path(&tokens, i + 3),
            _ if word(i + 1) == "::" && word(i.wrapping_sub(1)) != "::" => {
                let end = end_of_path(&tokens, i);
                let mut path: Vec<String> = tokens[i..end].iter().step_by(2).cloned().collect();
                outside(&mut path, inner.len());
                file.used.push(path);
            }
            _ => {}
        }
        i += 1;
    }
    file
}

/// The files of a crate by their modules.
struct Crate {
    files: Vec<(PathBuf, File)>,
    modules: BTreeMap<Vec<String>, usize>,
}

impl Crate {
    fn read(source: &Path) -> Self {
        let mut files = Vec::new();
        let mut pending = vec![source.to_path_buf()];
        while let Some(folder) = pending.pop() {
            for path in fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()) {
                if path.is_dir() {
                    pending.push(path);
                } else if path.extension().is_some_and(|e| e == "rs") {
                    let inside = path.strip_prefix(source).unwrap().with_extension("");
                    let mut module: Vec<String> =
                        inside.iter().map(|part| part.to_string_lossy().into_owned()).collect();
                    let gathers = ["lib", "main", "mod"].contains(&module.last().unwrap().as_str());
                    if gathers {
                        module.pop();
                    }
                    files.push((
                        path.clone(),
                        scan(&fs::read_to_string(&path).unwrap(), module, gathers),
                    ));
                }
            }
        }
        let tests: BTreeSet<Vec<String>> = files
            .iter()
            .flat_map(|(_, f)| {
                f.tests.iter().map(|name| [&f.module[..], std::slice::from_ref(name)].concat())
            })
            .collect();
        files.retain(|(_, file)| {
            !(1..=file.module.len()).any(|k| tests.contains(&file.module[..k]))
        });
        files.sort_by(|a, b| a.0.cmp(&b.0));
        let modules = files.iter().enumerate().map(|(i, (_, f))| (f.module.clone(), i)).collect();
        Self { files, modules }
    }

    /// The file that defines what a path leads to, seen from a module.
    fn target(&self, from: &[String], path: &[String], depth: usize) -> Option<usize> {
        let (first, rest) = path.split_first()?;
        let mut module = from.to_vec();
        let mut rest = rest;
        match first.as_str() {
            "crate" => module.clear(),
            "self" => {}
            "super" => drop(module.pop()?),
            _ => rest = path,
        }
        while rest.first().is_some_and(|word| word == "super") {
            module.pop()?;
            rest = &rest[1..];
        }
        let relative = rest.len() == path.len();
        for (k, word) in rest.iter().enumerate() {
            let child = [&module[..], std::slice::from_ref(word)].concat();
            if self.modules.contains_key(&child) {
                module = child;
                continue;
            }
            let own = *self.modules.get(&module)?;
            let file = &self.files[own].1;
            if file.defined.contains(word) {
                return Some(own);
            }
            let import = file.imports.iter().find(|(path, name)| name == word && path != rest);
            if let Some((path, _)) = import.filter(|_| depth < 8) {
                return self.target(&module, &[&path[..], &rest[k + 1..]].concat(), depth + 1);
            }
            // A name that nobody here knows is another crate's, or of the prelude.
            return if relative && k == 0 { None } else { Some(own) };
        }
        self.modules.get(&module).copied()
    }

    fn edges(&self) -> Vec<BTreeSet<usize>> {
        let targets = |(own, (_, file)): (usize, &(PathBuf, File))| {
            let found = file.used.iter().filter_map(|path| self.target(&file.module, path, 0));
            found.filter(|&target| target != own).collect()
        };
        self.files.iter().enumerate().map(targets).collect()
    }
}

/// The largest set of files of which each leads to each, as a list of names.
fn largest_circle(edges: &[BTreeSet<usize>]) -> Vec<usize> {
    let reach: Vec<BTreeSet<usize>> = (0..edges.len())
        .map(|start| {
            let (mut seen, mut pending) = (BTreeSet::new(), vec![start]);
            while let Some(at) = pending.pop() {
                pending.extend(edges[at].iter().copied().filter(|&next| seen.insert(next)));
            }
            seen
        })
        .collect();
    let circle = |i: usize| reach[i].iter().copied().filter(|&k| reach[k].contains(&i)).collect();
    (0..edges.len()).map(circle).max_by_key(Vec::len).unwrap_or_default()
}

#[test]
fn no_circle_of_files_is_larger_than_two() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut wrong = Vec::new();
    for entry in fs::read_dir(root).unwrap().map(|entry| entry.unwrap().path()) {
        let source = entry.join("src");
        if !source.is_dir() || !entry.join("Cargo.toml").is_file() {
            continue;
        }
        let name = entry.file_name().unwrap().to_string_lossy().into_owned();
        let read = Crate::read(&source);
        let edges = read.edges();
        let circle = largest_circle(&edges);
        let most = KNOWN.iter().find(|known| known.0 == name).map_or(MOST, |known| known.1);
        if circle.len() > most || (most > MOST && circle.len() < most) {
            let file =
                |i: usize| read.files[i].0.strip_prefix(&source).unwrap().display().to_string();
            let lines: Vec<String> = circle
                .iter()
                .map(|&i| {
                    let inside = edges[i].iter().filter(|k| circle.contains(k));
                    format!(
                        "  {} -> {}",
                        file(i),
                        inside.map(|&k| file(k)).collect::<Vec<_>>().join(", ")
                    )
                })
                .collect();
            wrong.push(format!(
                "{name}: {} files, known {most}\n{}",
                circle.len(),
                lines.join("\n")
            ));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn circles_are_found_through_re_exports() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("lib.rs", "mod a;\nmod b;\nmod c;\npub use c::C;\n#[cfg(test)]\nmod tests;\n");
    write(
        "a.rs",
        "use crate::b::{B, other as o};\n/// crate::c\nfn a() -> &'static str { \"super::c\" }\n",
    );
    write("b.rs", "pub struct B;\nfn f(_: crate::C) {}\n");
    write(
        "c.rs",
        "pub struct C;\nfn g() { super::a::a() }\n#[cfg(test)]\nmod tests { use crate::tests::t; }\n",
    );
    write("tests.rs", "use crate::a::a;\nfn t() {}\n");
    let read = Crate::read(folder.path());
    assert_eq!(read.files.len(), 4, "tests are left out");
    assert_eq!(largest_circle(&read.edges()), [0, 1, 2]);
    write("b.rs", "pub struct B;\n");
    assert_eq!(largest_circle(&Crate::read(folder.path()).edges()).len(), 0);
}
