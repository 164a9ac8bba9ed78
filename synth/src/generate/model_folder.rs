//! A folder of meshes as the objects of a dataset.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::hash::Hasher;
use std::path::{Path, PathBuf};

use fnv::FnvHasher;

use super::model::{Model, Normalize, ReadModelError, plain};
use super::split_list::SplitList;
use crate::shapes::Family;

/// Endings of the files that are read.
const ENDINGS: [&str; 5] = ["glb", "obj", "off", "ply", "stl"];

/// The meshes of a folder: those in its subfolders, each of which is a kind of thing.
///
/// ```
/// use synth::generate::{ModelFolder, Normalize};
/// use mesh_core::{primitives, write_mesh};
///
/// let place = tempfile::tempdir()?;
/// std::fs::create_dir(place.path().join("chair"))?;
/// write_mesh(place.path().join("chair/block.ply"), &primitives::cuboid([1.0, 2.0, 2.0]))?;
/// let found = ModelFolder::read(place.path(), Normalize::UnitDiagonal, None)?;
/// assert_eq!((&*found.models[0].category, &*found.models[0].name), ("chair", "block"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Default)]
pub struct ModelFolder {
    /// In the order of their kinds and names.
    pub models: Vec<Model>,
    /// Files that hold nothing that could be rendered, each with the reason.
    pub refused: Vec<ReadModelError>,
    /// How many the list leaves out: it does not have them, or has them for something else.
    pub unlisted: usize,
    /// What the list has a subset for and the folder does not have, in the order of the alphabet.
    pub absent: Vec<String>,
}

impl ModelFolder {
    /// Reads the meshes in the subfolders of a folder. With a list, those that it has, for what it says.
    ///
    /// All are in memory together.
    ///
    /// # Errors
    /// If a folder or the list cannot be read, or no mesh can be used. A single file that cannot is told in
    /// [`refused`](Self::refused).
    pub fn read(
        folder: &Path,
        normalize: Normalize,
        list: Option<&SplitList>,
    ) -> Result<Self, ReadModelError> {
        let mut found = Self::default();
        let mut kinds = Vec::new();
        for kind in listed(folder)?.into_iter().filter(|path| path.is_dir()) {
            let files: Vec<PathBuf> =
                listed(&kind)?.into_iter().filter(|path| is_mesh(path)).collect();
            kinds.push((last(&kind), files));
        }
        let mut unseen = list.map(SplitList::files).unwrap_or_default();
        for ((kind, files), names) in kinds.iter().zip(names(&kinds)) {
            let category = plain(kind, "model");
            for (file, name) in files.iter().zip(names) {
                let within = format!("{kind}/{}", last(file));
                unseen.remove(&*within);
                let subset = match list.map(|list| list.subset(&within)) {
                    Some(None) => {
                        found.unlisted += 1;
                        continue;
                    }
                    Some(Some(subset)) => Some(subset),
                    None => None,
                };
                match Model::read(file, normalize) {
                    Ok(model) => {
                        let stream = stream(&category, &name);
                        let (category, synset) = (category.clone(), synset(&category));
                        found.models.push(Model {
                            category,
                            name,
                            subset,
                            synset,
                            stream,
                            ..model
                        });
                    }
                    Err(error) => found.refused.push(error),
                }
            }
        }
        found.absent = unseen.into_iter().map(str::to_owned).collect();
        if found.models.is_empty() {
            return Err(match found.refused.into_iter().next() {
                Some(error) => error,
                None => ReadModelError::NoModels { path: folder.to_owned() },
            });
        }
        Ok(found)
    }
}

/// What is in a folder, by name.
fn listed(folder: &Path) -> Result<Vec<PathBuf>, ReadModelError> {
    let failed = |source| ReadModelError::Folder { path: folder.to_owned(), source };
    let entries = fs::read_dir(folder).map_err(failed)?;
    let paths = entries.map(|entry| entry.map(|entry| entry.path()));
    let mut paths = paths.collect::<Result<Vec<_>, _>>().map_err(failed)?;
    paths.sort();
    Ok(paths)
}

fn last(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn is_mesh(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    ENDINGS.contains(&&*ending) && path.is_file()
}

/// What the objects of all files are called within their kinds, in plain letters, each once.
///
/// Those that are plain already keep their names. Others get a number behind theirs where it is taken, in the order of their
/// files: another file that is the same in plain letters may move them.
fn names(kinds: &[(String, Vec<PathBuf>)]) -> Vec<Vec<String>> {
    let mut taken = BTreeSet::new();
    let mut names: Vec<Vec<String>> = Vec::with_capacity(kinds.len());
    for (kind, files) in kinds {
        let category = plain(kind, "model");
        let own = |file: &PathBuf| -> String {
            let (stem, name) = stem_of(file);
            let is_plain = *kind == category && stem == name;
            let free = is_plain && taken.insert((category.clone(), name.clone()));
            if free { name } else { String::new() }
        };
        names.push(files.iter().map(own).collect());
    }
    let mut next: BTreeMap<(String, String), usize> = BTreeMap::new();
    for ((kind, files), names) in kinds.iter().zip(&mut names) {
        let category = plain(kind, "model");
        for (file, own) in files.iter().zip(names).filter(|(_, own)| own.is_empty()) {
            let name = stem_of(file).1;
            // Where the last of that name left off, or many of them would be counted through for each.
            let number = next.entry((category.clone(), name.clone())).or_insert(1);
            while own.is_empty() {
                let numbered = match *number {
                    1 => name.clone(),
                    k => format!("{name}_{k}"),
                };
                *number += 1;
                if taken.insert((category.clone(), numbered.clone())) {
                    *own = numbered;
                }
            }
        }
    }
    names
}

/// A file's name without its extension, and that in plain letters.
fn stem_of(file: &Path) -> (String, String) {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let name = plain(&stem, "model");
    (stem, name)
}

/// More meshes in the folder move no other, but for names that are the same in plain letters.
fn stream(category: &str, name: &str) -> u32 {
    let mut hash = FnvHasher::default();
    hash.write(format!("{category}/{name}").as_bytes());
    hash.finish() as u32
}

/// ShapeNet's for its kinds; for others a number that none of these has.
fn synset(category: &str) -> String {
    category.parse::<Family>().map_or_else(
        |_| {
            let mut hash = FnvHasher::default();
            hash.write(category.as_bytes());
            format!("9{:07}", hash.finish() % 10_000_000)
        },
        |family| family.synset().to_owned(),
    )
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use datasets::Subset;
    use mesh_core::{primitives, write_mesh};

    use super::*;

    fn folder() -> tempfile::TempDir {
        let place = tempfile::tempdir().unwrap();
        for (kind, name) in [("chair", "a b.ply"), ("chair", "a_b.ply"), ("dog", "rex.obj")] {
            fs::create_dir_all(place.path().join(kind)).unwrap();
            write_mesh(place.path().join(kind).join(name), &primitives::cuboid([1.0; 3])).unwrap();
        }
        fs::write(place.path().join("chair/notes.txt"), "none").unwrap();
        fs::write(place.path().join("dog/broken.glb"), "none").unwrap();
        place
    }

    #[test]
    fn subfolders_are_kinds_and_names_are_free() {
        let place = folder();
        let found = ModelFolder::read(place.path(), Normalize::UnitBox, None).unwrap();
        let names: Vec<_> =
            found.models.iter().map(|m| (m.category.as_str(), m.name.as_str())).collect();
        assert_eq!(names, [("chair", "a_b_2"), ("chair", "a_b"), ("dog", "rex")]);
        assert!(found.refused.len() == 1 && found.refused[0].to_string().contains("broken.glb"));
        let synsets: Vec<&str> = found.models.iter().map(|m| m.synset.as_str()).collect();
        assert_eq!(synsets[0], Family::Chair.synset());
        assert!(synsets[2].starts_with('9') && synsets[2].len() == 8);
        // What is added moves none.
        let streams =
            |found: &ModelFolder| found.models.iter().map(|m| m.stream).collect::<Vec<_>>();
        let before = streams(&found);
        write_mesh(place.path().join("chair/aa.ply"), &primitives::cuboid([1.0; 3])).unwrap();
        let found = ModelFolder::read(place.path(), Normalize::UnitBox, None).unwrap();
        assert!(before.iter().all(|stream| streams(&found).contains(stream)));
    }

    #[test]
    fn what_is_plain_keeps_its_name() {
        let named = |stems: &[&str]| {
            let files = stems.iter().map(|stem| PathBuf::from(format!("{stem}.ply"))).collect();
            names(&[("chair".to_owned(), files)]).remove(0)
        };
        assert_eq!(named(&["a_b"]), ["a_b"]);
        assert_eq!(named(&["a b", "a.b", "a_b", "a_b_2"]), ["a_b_3", "a_b_4", "a_b", "a_b_2"]);
        // Kinds that are the same in plain letters share their names.
        let kinds = ["a b", "a_b"].map(|kind| (kind.to_owned(), vec![PathBuf::from("x.ply")]));
        assert_eq!(names(&kinds), [["x_2"], ["x"]]);
        // One by one this took minutes.
        let many: Vec<PathBuf> = (0..50_000).map(|_| PathBuf::from("a b.ply")).collect();
        assert_eq!(names(&[("dog".to_owned(), many)])[0][49_999], "a_b_50000");
    }

    #[test]
    fn what_the_folder_does_not_have_is_told() {
        let place = folder();
        let path = place.path().join("list.csv");
        let rows =
            "file,split\nchair/a_b.ply,test\ndog/rex.objj,val\ncat/tom.ply,train\nx/y.ply,sold\n";
        fs::write(&path, rows).unwrap();
        let list = SplitList::read(&path).unwrap();
        let found = ModelFolder::read(place.path(), Normalize::UnitBox, Some(&list)).unwrap();
        assert_eq!(found.absent, ["cat/tom.ply", "dog/rex.objj"]);
    }

    #[test]
    fn a_list_says_what_they_are_for() {
        let place = folder();
        let path = place.path().join("list.csv");
        fs::write(&path, "split,title,file\ntest,\"A, B\",chair/a b.ply\nval,,dog/rex.obj\noutside,,chair/a_b.ply\n")
            .unwrap();
        let list = SplitList::read(&path).unwrap();
        let found = ModelFolder::read(place.path(), Normalize::UnitBox, Some(&list)).unwrap();
        let subsets: Vec<_> = found.models.iter().map(|model| model.subset).collect();
        assert_eq!(subsets, [Some(Subset::Test), Some(Subset::Validation)]);
        assert_eq!((found.unlisted, found.refused.len()), (2, 0));
    }

    #[test]
    fn folders_without_meshes_are_refused_by_name() {
        let place = tempfile::tempdir().unwrap();
        let read =
            || ModelFolder::read(place.path(), Normalize::None, None).unwrap_err().to_string();
        assert!(read().contains("found none"), "{}", read());
        fs::create_dir(place.path().join("dog")).unwrap();
        fs::write(place.path().join("dog/broken.glb"), "none").unwrap();
        assert!(read().contains("broken.glb"), "{}", read());
        let gone = ModelFolder::read(&place.path().join("gone"), Normalize::None, None);
        assert!(gone.unwrap_err().to_string().contains("gone"));
    }
}
