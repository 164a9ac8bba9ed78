//! Which objects are for training: Mesh R-CNN's JSON, and plain lists.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::{Path, PathBuf};

use crate::assemble::put;
use crate::content::{cut, numbered, over};
use crate::counted::counted_are;
use crate::dataset::Subset;
use crate::error::{ReadViewsError, WriteViewsError};
use crate::formats::json::{Node, parse};
use crate::source::Source;

/// The file that we write.
const JSON: &str = "splits.json";
/// No file of splits is longer than this: the whole of ShapeNet takes a tenth.
const MOST_BYTES: u64 = 1 << 28;
/// What is said about an object takes so much: its names, and the nodes of the tree that it is in.
const OBJECT: usize = 400;

/// Which objects, and which of their views, belong to which subset.
///
/// Two forms are read, the first that is there: Mesh R-CNN's JSON in the root, any file
/// `*split*.json`, `{subset: {synset: {model: [views]}}}`, where no views means all of them; or
/// `train.lst`, `val.lst` and `test.lst`, one model a line in the folder of a category, or one
/// `synset/model` a line in the root.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Splits {
    objects: BTreeMap<(String, String), Vec<ObjectSplit>>,
}

/// The views of one object that belong to one subset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectSplit {
    /// What they are for.
    pub subset: Subset,
    /// Which views; none stands for all.
    pub views: Vec<usize>,
}

/// Mesh R-CNN's file: subset, synset, model, views.
type Json = BTreeMap<String, BTreeMap<String, BTreeMap<String, Vec<usize>>>>;

impl Splits {
    /// Says that views of an object belong to a subset; none stands for all.
    pub fn insert(&mut self, synset: &str, model: &str, subset: Subset, views: Vec<usize>) {
        let parts = self.objects.entry((synset.to_owned(), model.to_owned())).or_default();
        parts.push(ObjectSplit { subset, views });
    }

    /// What is said about an object: nothing, one subset, or several of its views each.
    pub fn of(&self, synset: &str, model: &str) -> &[ObjectSplit] {
        self.objects.get(&(synset.to_owned(), model.to_owned())).map_or(&[], Vec::as_slice)
    }

    /// The subset that an object belongs to; `None` where it is in none, or in several.
    pub fn subset(&self, synset: &str, model: &str) -> Option<Subset> {
        let (first, rest) = self.of(synset, model).split_first()?;
        rest.iter().all(|part| part.subset == first.subset).then_some(first.subset)
    }

    /// The views of an object that are for its subset, of so many, ascending; `None` where that is all of them, or it has none.
    pub(super) fn views(&self, synset: &str, model: &str, count: usize) -> Option<Vec<usize>> {
        self.subset(synset, model)?;
        let parts = self.of(synset, model);
        if parts.iter().any(|part| part.views.is_empty()) {
            return None;
        }
        let mut views: Vec<usize> = parts.iter().flat_map(|part| part.views.clone()).collect();
        views.retain(|&view| view < count);
        views.sort_unstable();
        views.dedup();
        Some(views)
    }

    /// Says which objects are in several subsets, as views of theirs may be: such an object is in none.
    fn warn(&self, warnings: &mut Vec<String>) {
        let mut several =
            self.objects.keys().filter(|(synset, model)| self.subset(synset, model).is_none());
        let Some((synset, model)) = several.next() else { return };
        warnings.push(format!(
            "{} in several lists of the split, the first is {synset}/{model}: with all of its views it is in no subset",
            counted_are(1 + several.count(), "object")
        ));
    }

    /// Whether nothing is said about any object.
    pub fn is_empty(&self) -> bool {
        self.objects.is_empty()
    }

    /// Reads what stands in the root, or in the folders of the categories.
    pub(super) fn read(
        root: Option<&Path>,
        categories: &BTreeMap<String, PathBuf>,
        warnings: &mut Vec<String>,
    ) -> Result<Self, ReadViewsError> {
        let mut splits = Self::default();
        if let Some(root) = root {
            let source = Source::folder(root);
            let mut names = source.root_names()?;
            let is_json = |n: &str| Path::new(n).extension().is_some_and(|e| e == "json");
            names.retain(|n| is_json(n) && n.contains("split") && source.has(n));
            if let Some((first, others)) = names.split_first() {
                if !others.is_empty() {
                    let others = others.join(", ");
                    warnings.push(format!("the split is that of {first}; {others} is not read"));
                }
                splits.read_json(&source, first, warnings)?;
                splits.warn(warnings);
                return Ok(splits);
            }
            splits.read_lists(&source, None)?;
        }
        for (category, folder) in categories {
            splits.read_lists(&Source::folder(folder), Some(category))?;
        }
        splits.warn(warnings);
        Ok(splits)
    }

    fn read_json(
        &mut self,
        source: &Source,
        name: &str,
        warnings: &mut Vec<String>,
    ) -> Result<(), ReadViewsError> {
        let bytes = source.open()?.read(name, "split", MOST_BYTES)?;
        let path = source.locate(name);
        let mut budget = bytes.budget();
        let value = parse(&bytes, &path)?;
        for (subset, categories) in Node::root(&value, &path).members()? {
            let Some(known) = subset_named(subset) else {
                let subset = cut(subset);
                warnings.push(format!("{name} has a subset {subset:?}, which is not read"));
                continue;
            };
            for (category, models) in categories.members()? {
                for (model, views) in models.members()? {
                    // The tree of the file is there as well, which takes at least as much.
                    let names = category.len() + model.len();
                    let taken = budget.take((2 * OBJECT + names) as u64);
                    taken.map_err(|limit| over(&path, "objects", limit))?;
                    let views = views.elements()?;
                    let views = views.iter().map(Node::index).collect::<Result<_, _>>()?;
                    self.insert(category, model, known, views);
                }
            }
        }
        Ok(())
    }

    /// The lists in a folder, of one category or with the category before each name.
    fn read_lists(&mut self, source: &Source, of: Option<&str>) -> Result<(), ReadViewsError> {
        for (name, subset) in Subset::NAMES.map(|(name, subset)| (format!("{name}.lst"), subset)) {
            if !source.has(&name) {
                continue;
            }
            let list = source.open()?.read(&name, "split", MOST_BYTES)?;
            for (i, line) in numbered(&list.text(OBJECT, &source.locate(&name))?) {
                let (category, model) = match (of, line.split_once('/')) {
                    (Some(category), None) => (category, line),
                    (None, Some(pair)) => pair,
                    (of, _) => {
                        let expected = if of.is_some() { "a model" } else { "synset/model" };
                        let (path, field) = (source.locate(&name), format!("line {i}"));
                        return Err(ReadViewsError::field(path, field, cut(line), expected));
                    }
                };
                self.insert(category, model, subset, Vec::new());
            }
        }
        Ok(())
    }
}

fn subset_named(name: &str) -> Option<Subset> {
    match name {
        "train" | "training" => Some(Subset::Train),
        "val" | "valid" | "validation" => Some(Subset::Validation),
        "test" | "testing" => Some(Subset::Test),
        _ => None,
    }
}

/// Writes the split of a root as Mesh R-CNN's JSON, `splits.json`, atomically.
///
/// # Errors
/// If the file cannot be written.
pub fn write_splits(root: &Path, splits: &Splits) -> Result<(), WriteViewsError> {
    let mut json = Json::new();
    for ((category, model), parts) in &splits.objects {
        for part in parts {
            let models = json.entry(part.subset.name().to_owned()).or_default();
            let models = models.entry(category.clone()).or_default();
            match models.entry(model.clone()) {
                Entry::Vacant(new) => {
                    new.insert(part.views.clone());
                }
                // No views stand for all, and some of them are among those.
                Entry::Occupied(mut said) if said.get().is_empty() || part.views.is_empty() => {
                    said.get_mut().clear();
                }
                Entry::Occupied(mut said) => said.get_mut().extend(&part.views),
            }
        }
    }
    let path = root.join(JSON);
    let bytes = serde_json::to_vec(&json).map_err(|e| WriteViewsError::new(&path, e))?;
    put(&path, &bytes)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn all_views_and_some_of_them_are_all() {
        for parts in [[vec![], vec![1]], [vec![1], vec![]]] {
            let mut splits = Splits::default();
            for views in parts {
                splits.insert("02958343", "a", Subset::Train, views);
            }
            splits.insert("02958343", "b", Subset::Train, vec![2]);
            splits.insert("02958343", "b", Subset::Train, vec![0]);
            let root = tempfile::tempdir().unwrap();
            write_splits(root.path(), &splits).unwrap();
            let read = Splits::read(Some(root.path()), &BTreeMap::new(), &mut Vec::new()).unwrap();
            assert_eq!(read.of("02958343", "a")[0].views, Vec::<usize>::new());
            assert_eq!(read.of("02958343", "b")[0].views, [2, 0]);
        }
    }
}
