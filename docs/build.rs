//! Makes a module of each page of the repository, so that rustdoc shows them as a book and tests their code.
//!
//! Links from page to page become links from module to module, pictures become part of the page, and links to files that are no
//! pages lose their target: a browser that shows the book has no repository beside it.

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write as _;
use std::path::{Component, Path, PathBuf};
use std::{env, fs};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

/// Folders of the repository that have pages of their own, beside the members' READMEs.
const FOLDERS: [&str; 5] = ["docs", "weights", "fuzz", "benches/results", "benches/peers"];

fn main() -> Result<(), Box<dyn Error>> {
    let root = PathBuf::from(env::var("CARGO_MANIFEST_DIR")?).join("..").canonicalize()?;
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let pages = pages(&root)?;
    for (page, module) in &pages {
        let from = root.join(page);
        println!("cargo::rerun-if-changed={}", from.display());
        let text = Page { root: &root, path: page, module, pages: &pages }
            .rewritten(&fs::read_to_string(from)?)?;
        let to = out.join("pages").join(page);
        fs::create_dir_all(to.parent().ok_or("a page lies in a folder")?)?;
        fs::write(to, text)?;
    }
    let mut tree = Chapter::default();
    for (page, module) in pages.iter().filter(|(_, module)| !module.is_empty()) {
        tree.add(module, page);
    }
    fs::write(out.join("book.rs"), tree.source("", &out.join("pages")))?;
    Ok(())
}

/// All pages, by their paths from the root, and the modules that they become.
fn pages(root: &Path) -> Result<BTreeMap<PathBuf, Vec<String>>, Box<dyn Error>> {
    let mut found = BTreeMap::new();
    for path in markdown(root)? {
        found.insert(path.clone(), vec![name(&path)]);
    }
    let mut pending: Vec<PathBuf> = FOLDERS.iter().map(PathBuf::from).collect();
    while let Some(folder) = pending.pop() {
        println!("cargo::rerun-if-changed={}", root.join(&folder).display());
        for entry in fs::read_dir(root.join(&folder))? {
            let entry = entry?;
            if entry.file_type()?.is_dir() && folder.starts_with("docs") {
                pending.push(folder.join(entry.file_name()));
            }
        }
        for file in markdown(&root.join(&folder))? {
            let path = folder.join(file);
            // The folder of the book is not a chapter of it, and a folder's README is the chapter itself.
            let chapters = folder.iter().skip(usize::from(folder.starts_with("docs")));
            let mut module: Vec<String> = chapters.map(|part| name(Path::new(part))).collect();
            if path.file_stem().is_some_and(|stem| stem != "README") {
                module.push(name(&path));
            }
            found.insert(path, module);
        }
    }
    for entry in fs::read_dir(root)? {
        let entry = entry?;
        let page = PathBuf::from(entry.file_name()).join("README.md");
        if entry.path().join("Cargo.toml").is_file()
            && root.join(&page).is_file()
            && !found.contains_key(&page)
        {
            let member = name(Path::new(&entry.file_name()));
            found.insert(page, vec!["crates".to_owned(), member]);
        }
    }
    Ok(found)
}

/// The Markdown files right in a folder.
fn markdown(folder: &Path) -> Result<Vec<PathBuf>, std::io::Error> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let name = PathBuf::from(entry?.file_name());
        if name.extension().is_some_and(|end| end == "md") {
            found.push(name);
        }
    }
    Ok(found)
}

/// What a file is called as a module, whose name begins with no digit.
fn name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
    let name = stem.replace(|c: char| !c.is_alphanumeric(), "_");
    if name.starts_with(|c: char| c.is_numeric()) { format!("_{name}") } else { name }
}

/// A module and those within it.
#[derive(Default)]
struct Chapter {
    page: Option<PathBuf>,
    within: BTreeMap<String, Chapter>,
}

impl Chapter {
    fn add(&mut self, module: &[String], page: &Path) {
        match module {
            [] => self.page = Some(page.to_owned()),
            [first, rest @ ..] => self.within.entry(first.clone()).or_default().add(rest, page),
        }
    }

    /// The module as Rust, without the outermost one, which has no name.
    fn source(&self, name: &str, pages: &Path) -> String {
        let mut text = String::new();
        if !name.is_empty() {
            let _ = match &self.page {
                Some(page) => {
                    let path = pages.join(page);
                    writeln!(text, "#[doc = include_str!(r#\"{}\"#)]", path.display())
                }
                None => writeln!(text, "/// Pages of the folder `{name}`."),
            };
            let _ = writeln!(text, "pub mod {name} {{");
        }
        for (name, chapter) in &self.within {
            text.push_str(&chapter.source(name, pages));
        }
        if !name.is_empty() {
            text.push_str("}\n");
        }
        text
    }
}

/// A page on its way into the book.
struct Page<'a> {
    root: &'a Path,
    path: &'a Path,
    module: &'a [String],
    pages: &'a BTreeMap<PathBuf, Vec<String>>,
}

impl Page<'_> {
    fn rewritten(&self, text: &str) -> Result<String, Box<dyn Error>> {
        let mut made = String::with_capacity(text.len());
        let (mut fenced, mut paragraph) = (false, String::new());
        for line in text.split_inclusive('\n') {
            let fence = line.trim_start().starts_with("```");
            if !fenced && !fence && !line.trim().is_empty() {
                paragraph.push_str(line);
                continue;
            }
            fenced ^= fence;
            self.rewrite(&std::mem::take(&mut paragraph), &mut made)?;
            made.push_str(line);
        }
        self.rewrite(&paragraph, &mut made)?;
        if let [folder, member] = self.module
            && folder == "crates"
            && !["cli", "python"].contains(&member.as_str())
        {
            let _ = writeln!(made, "\n[All items of `{member}`](../../../{member}/index.html)");
        }
        Ok(made)
    }

    /// A paragraph, whose links may go over the ends of lines; what stands between backquotes is code.
    fn rewrite(&self, paragraph: &str, made: &mut String) -> Result<(), Box<dyn Error>> {
        let mut rest = paragraph;
        while let Some(at) = rest.find(['[', '`']) {
            made.push_str(&rest[..at]);
            rest = &rest[at..];
            let taken = if rest.starts_with('`') { code(rest) } else { None };
            if let Some(taken) = taken {
                made.push_str(&rest[..taken]);
                rest = &rest[taken..];
            } else if let Some(link) = Link::read(rest) {
                let picture = made.ends_with('!');
                if picture {
                    self.picture(&link, made)?;
                } else {
                    self.link(&link, made);
                }
                rest = &rest[link.length..];
            } else {
                made.push_str(&rest[..1]);
                rest = &rest[1..];
            }
        }
        made.push_str(rest);
        Ok(())
    }

    fn picture(&self, link: &Link<'_>, made: &mut String) -> Result<(), Box<dyn Error>> {
        let file = self.root.join(self.beside(link.target));
        let kind = file.extension().unwrap_or_default().to_string_lossy().into_owned();
        let data =
            STANDARD.encode(fs::read(&file).map_err(|e| format!("{}: {e}", file.display()))?);
        let _ = write!(made, "[{}](data:image/{kind};base64,{data})", link.text);
        Ok(())
    }

    fn link(&self, link: &Link<'_>, made: &mut String) {
        let (file, heading) = link.target.split_once('#').unwrap_or((link.target, ""));
        let heading = if heading.is_empty() { String::new() } else { format!("#{heading}") };
        if link.target.contains("://") || file.is_empty() {
            let _ = write!(made, "[{}]({})", link.text, link.target);
        } else if let Some(module) = self.pages.get(&self.beside(file)) {
            let mut way = "../".repeat(self.module.len());
            for part in module {
                way.push_str(part);
                way.push('/');
            }
            let _ = write!(made, "[{}]({way}index.html{heading})", link.text);
        } else {
            made.push_str(link.text);
        }
    }

    /// What a page calls `target`, as a path from the root.
    fn beside(&self, target: &str) -> PathBuf {
        let mut path = PathBuf::new();
        let folder = self.path.parent().unwrap_or_else(|| Path::new(""));
        for part in folder.join(target).components() {
            match part {
                Component::ParentDir => drop(path.pop()),
                Component::Normal(part) => path.push(part),
                _ => {}
            }
        }
        path
    }
}

/// How long the code is that a text begins with, backquotes included.
fn code(text: &str) -> Option<usize> {
    let ticks = text.len() - text.trim_start_matches('`').len();
    let end = text[ticks..].find(&text[..ticks])?;
    Some(ticks + end + ticks)
}

/// A link or picture: `[text](target)`.
struct Link<'a> {
    text: &'a str,
    target: &'a str,
    length: usize,
}

impl<'a> Link<'a> {
    /// The one that a text begins with.
    fn read(text: &'a str) -> Option<Self> {
        let mut depth = 0;
        let end = text.char_indices().find_map(|(i, c)| {
            depth += i32::from(c == '[') - i32::from(c == ']');
            (depth == 0).then_some(i)
        })?;
        let target = text[end + 1..].strip_prefix('(')?;
        let target = &target[..target.find(')')?];
        Some(Self { text: &text[1..end], target, length: end + target.len() + 3 })
    }
}
