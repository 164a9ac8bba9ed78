//! A table of what meshes are for.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use datasets::Subset;

use super::model::ReadModelError;

/// A table (CSV, with a header) of which the columns `file`, a path below the folder of meshes, and `split` count: `train`,
/// `validation` or `val`, `test`. Rows with another word are for something else.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SplitList(BTreeMap<String, Option<Subset>>);

impl SplitList {
    /// Reads a table.
    ///
    /// # Errors
    /// If it cannot be read, is no table, lacks one of the columns, or names a file twice.
    pub fn read(path: &Path) -> Result<Self, ReadModelError> {
        let wrong = |what: String| ReadModelError::List { path: path.to_owned(), what };
        let mut reader = csv::Reader::from_path(path).map_err(|error| wrong(error.to_string()))?;
        let header = reader.headers().map_err(|error| wrong(error.to_string()))?.clone();
        let column = |name: &str| {
            let found = header.iter().position(|title| title.trim() == name);
            let titles = header.iter().take(20).collect::<Vec<_>>().join(", ");
            found.ok_or_else(|| wrong(format!("columns: found {titles}, expected `{name}`")))
        };
        let (file, split) = (column("file")?, column("split")?);
        let mut rows = BTreeMap::new();
        for row in reader.records() {
            let row = row.map_err(|error| wrong(error.to_string()))?;
            let name = row[file].trim().replace('\\', "/");
            let subset = match row[split].trim() {
                "train" => Some(Subset::Train),
                "val" | "validation" => Some(Subset::Validation),
                "test" => Some(Subset::Test),
                _ => None,
            };
            if rows.insert(name.clone(), subset).is_some() {
                let name: String = name.chars().take(200).collect();
                return Err(wrong(format!("column `file`: found {name:?} twice")));
            }
        }
        Ok(Self(rows))
    }

    /// The files that are for something.
    pub(super) fn files(&self) -> BTreeSet<&str> {
        let meant = self.0.iter().filter(|(_, subset)| subset.is_some());
        meant.map(|(file, _)| file.as_str()).collect()
    }

    /// What a file is for; none where the list does not have it, or has it for something else.
    pub fn subset(&self, file: &str) -> Option<Subset> {
        self.0.get(file).copied().flatten()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_list_is_named() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("list.csv");
        let error = |text: &str| {
            std::fs::write(&path, text).unwrap();
            SplitList::read(&path).unwrap_err().to_string()
        };
        for (text, part) in [
            ("", "expected `file`"),
            ("file,kind\na,b\n", "found file, kind, expected `split`"),
            ("file,split\na,test\na,train\n", "\"a\" twice"),
            ("file,split\na\n", "list.csv"),
        ] {
            let error = error(text);
            assert!(error.contains("list.csv") && error.contains(part), "{text:?}: {error}");
        }
        std::fs::write(&path, b"file,split\n\xff,test\n").unwrap();
        assert!(SplitList::read(&path).is_err());
        assert!(SplitList::read(&place.path().join("gone.csv")).is_err());
    }
}
