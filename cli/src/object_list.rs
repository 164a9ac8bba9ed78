//! The list of objects that a batch is of.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use crate::failure::Failure;

/// A list is text for people; one of this size names a million objects.
const LARGEST: u64 = 256 << 20;

/// One object of a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ListedObject {
    /// What its results are called: its path, with `_` between the parts.
    pub(crate) name: String,
    /// As it stands in the list.
    pub(crate) entry: String,
    pub(crate) views: PathBuf,
    pub(crate) truth: Option<PathBuf>,
}

/// Reads a list: views in each line, relative to the list's folder; behind a tab the true mesh, where it is known. Empty lines and
/// those that begin with `#` say nothing.
pub(crate) fn read(path: &Path) -> Result<Vec<ListedObject>, Failure> {
    let fails = |what: String| Failure::Input(format!("{}: {what}", path.display()));
    let size = std::fs::metadata(path).map_err(|error| fails(error.to_string()))?.len();
    if size > LARGEST {
        return Err(fails(format!("found {size} bytes, expected a list of at most {LARGEST}")));
    }
    let text = std::fs::read_to_string(path).map_err(|error| fails(error.to_string()))?;
    let folder = path.parent().unwrap_or_else(|| Path::new(""));
    parsed(&text, folder).map_err(fails)
}

fn parsed(text: &str, folder: &Path) -> Result<Vec<ListedObject>, String> {
    let mut found = Vec::new();
    for (k, line) in text.lines().enumerate() {
        let line = line.trim_end_matches('\r').trim_end();
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        let mut columns = line.split('\t').map(str::trim).filter(|column| !column.is_empty());
        let (views, truth, rest) = (columns.next(), columns.next(), columns.next());
        let Some(views) = views.filter(|_| rest.is_none()) else {
            return Err(format!("line {}: expected views and, behind a tab, the true mesh", k + 1));
        };
        found.push((k + 1, views, truth));
    }
    if found.is_empty() {
        return Err("found no object, expected the path of its views in each line".to_owned());
    }
    let mut lines: BTreeMap<String, usize> = BTreeMap::new();
    let mut objects = Vec::new();
    for (line, views, truth) in found {
        let name = name_of(views);
        // On some systems names of other case are the same folder.
        if let Some(first) = lines.insert(name.to_lowercase(), line) {
            return Err(format!("lines {first} and {line} both name {name}"));
        }
        objects.push(ListedObject {
            name,
            entry: views.to_owned(),
            views: folder.join(views),
            truth: truth.map(|truth| folder.join(truth)),
        });
    }
    Ok(objects)
}

/// The parts of a path joined, so that a name follows from its line alone: an archive stands for its stem, and a
/// `transforms.json` for its folder.
fn name_of(path: &str) -> String {
    let path = Path::new(path);
    let is = |kind: &str| path.extension().is_some_and(|extension| extension == kind);
    let named = match path.parent() {
        Some(folder) if is("json") && folder.file_name().is_some() => folder.to_owned(),
        _ if is("json") || is("zip") => path.with_extension(""),
        _ => path.to_owned(),
    };
    let parts: Vec<String> = named
        .components()
        .filter_map(|part| match part {
            Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
            _ => None,
        })
        .collect();
    let safe = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let name: String = parts.join("_").chars().map(safe).collect();
    match name.trim_start_matches('.') {
        "" => "object".to_owned(),
        name => name.to_owned(),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn objects_are_called_after_their_paths() {
        for (path, name) in [
            ("mug.zip", "mug"),
            ("chair/0000", "chair_0000"),
            ("/data/cup/", "data_cup"),
            ("x/1/transforms.json", "x_1"),
            ("transforms.json", "transforms"),
            ("../a b/c:d", "a_b_c_d"),
            ("./.e", "e"),
            ("..", "object"),
        ] {
            assert_eq!(name_of(path), name, "{path}");
        }
    }

    #[test]
    fn a_list_is_paths_and_truths() {
        let found =
            parsed("# mine\n\nmug.zip\r\ncup\ttruth/cup.obj\n", Path::new("lists")).unwrap();
        assert_eq!(found.len(), 2);
        assert_eq!(found[0].views, Path::new("lists/mug.zip"));
        assert_eq!((found[0].name.as_str(), found[0].entry.as_str()), ("mug", "mug.zip"));
        assert_eq!(found[1].truth.as_deref(), Some(Path::new("lists/truth/cup.obj")));
        let fails = |text: &str| parsed(text, Path::new("")).unwrap_err();
        assert!(fails("# nothing\n").contains("no object"));
        assert!(fails("a\tb\tc\n").contains("line 1"));
        assert!(fails("x/a\nx/b\nx/A\n").contains("lines 1 and 3 both name x_A"));
    }
}
