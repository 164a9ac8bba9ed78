//! Where the files of a dataset go, and how they come to be there whole or not at all.

use std::collections::BTreeMap;
use std::fs;
use std::hash::Hasher;
use std::path::{Path, PathBuf};

use datasets::{Subset, View, write_kaolin, write_transforms};
use fnv::FnvHasher;
use mesh_core::io::{write_atomic, write_mesh};
use mesh_core::{ByteImage, Camera, TriMesh, encode_exr, encode_png};
use serde::Serialize;
use train::Shard;
use train::output::{disk, is_incidental, write_within};
use train::settings::settings_of;

use super::claim::{Claim, lock_now, lock_soon};
use super::config::{GenerateConfig, MANIFEST, OutputLayout};
use super::error::GenerateError;
use super::model::Model;
use super::object::{Job, Made, ObjectInfo};
use super::{rough, shapenet};

/// What is known of an object; in the folder that is moved to its place last.
const OBJECT: &str = "object.json";

/// What must be the same for a run that goes on.
#[derive(Serialize)]
struct Manifest<'a> {
    /// Of the program: other versions may draw other shapes.
    version: &'a str,
    /// The model or models, where it is not the families.
    model: Option<&'a str>,
    dataset: &'a GenerateConfig,
}

/// The folder of a dataset.
#[derive(Debug)]
pub(super) struct Store {
    root: PathBuf,
    claim: Claim,
    /// Whether others work in it too, at other objects.
    shared: bool,
    layout: OutputLayout,
}

impl Store {
    /// Begins a dataset, or finds one that was begun with the same configuration.
    pub(super) fn open(
        root: &Path,
        config: &GenerateConfig,
        models: &[Model],
        shard: Shard,
    ) -> Result<Self, GenerateError> {
        disk::make_folders(root).map_err(GenerateError::io(root))?;
        let shared = !shard.is_whole();
        let lock = if shared { lock_soon(root)? } else { lock_now(root)? };
        let manifest = root.join(MANIFEST);
        let asked = train::settings::toml::to_string_pretty(&Manifest {
            version: env!("CARGO_PKG_VERSION"),
            model: fingerprint(models).as_deref(),
            dataset: config,
        })
        .expect("a plain table");
        if manifest.exists() {
            let found = fs::read_to_string(&manifest).map_err(GenerateError::io(&manifest))?;
            if let Some((found, asked)) = first_difference(&found, &asked) {
                return Err(GenerateError::Different { path: manifest, found, asked });
            }
        } else {
            let entries = fs::read_dir(root).map_err(GenerateError::io(root))?;
            if !entries.flatten().all(|entry| is_incidental(&entry.file_name())) {
                return Err(GenerateError::Foreign { path: root.to_owned() });
            }
            put_for_good(root, MANIFEST, asked.as_bytes())?;
        }
        let claim = Claim::new(root, lock, shard)?;
        Ok(Self { root: root.to_owned(), claim, shared, layout: config.layout })
    }

    /// Removes what this run left unfinished.
    pub(super) fn clear(&self) {
        // There may be none; one that resists is in nobody's way.
        let _ = fs::remove_dir_all(&self.claim.unfinished);
    }

    /// What is known of an object that is there as a whole.
    pub(super) fn find(&self, job: &Job<'_>) -> Option<ObjectInfo> {
        let (category, synset) = (job.of.category(), job.of.synset());
        let folders = self.folders(category, synset, &job.name);
        let last = self.root.join(folders.last()?).join(OBJECT);
        let info: ObjectInfo = serde_json::from_slice(&fs::read(last).ok()?).ok()?;
        // It appears last, so the others are there.
        ((info.seed, info.view_seed) == (job.seed, job.view_seed)).then_some(info)
    }

    /// Folders of an object below the root, in the order in which they appear.
    fn folders(&self, category: &str, synset: &str, name: &str) -> Vec<PathBuf> {
        match self.layout {
            OutputLayout::Kaolin | OutputLayout::Transforms => {
                vec![Path::new(category).join(name)]
            }
            OutputLayout::R2n2 => {
                shapenet::PARTS.map(|part| Path::new(part).join(synset).join(name)).to_vec()
            }
        }
    }

    /// Writes an object.
    pub(super) fn put(
        &self,
        made: Made<'_>,
        config: &GenerateConfig,
    ) -> Result<ObjectInfo, GenerateError> {
        let ObjectInfo { category, synset, name, .. } = &made.info;
        let folders = self.folders(category, synset, name);
        let work = work_folder(&self.claim.unfinished, category, name);
        fs::create_dir_all(&work).map_err(GenerateError::io(&work))?;
        let last = work.join(folders.last().expect("every layout has a folder"));
        fs::create_dir_all(&last).map_err(GenerateError::io(&last))?;
        let info = match self.layout {
            OutputLayout::Kaolin => write_folder(made, config, &last, &KAOLIN)?,
            OutputLayout::Transforms => write_folder(made, config, &last, &TRANSFORMS)?,
            OutputLayout::R2n2 => shapenet::write(made, config, &work, &last)?,
        };
        let text = serde_json::to_string_pretty(&info).expect("numbers and names");
        write_atomic(last.join(OBJECT), |w| w.write_all(text.as_bytes()))?;
        // Without voxels there is no folder for them.
        for folder in folders.iter().filter(|folder| work.join(folder).is_dir()) {
            let place = self.root.join(folder);
            disk::publish(&work.join(folder), &place).map_err(GenerateError::io(&place))?;
        }
        fs::remove_dir_all(&work).map_err(GenerateError::io(&work))?;
        Ok(info)
    }

    /// Writes what there is of the whole.
    pub(super) fn finish(
        &self,
        objects: &[ObjectInfo],
        subsets: &[Subset],
        sheet: &ByteImage,
    ) -> Result<(), GenerateError> {
        let _others_wait = self.shared.then(|| lock_soon(&self.root)).transpose()?;
        let text = serde_json::to_string_pretty(objects).expect("numbers and names");
        put_for_good(&self.root, "objects.json", text.as_bytes())?;
        let mut splits: BTreeMap<&str, BTreeMap<&str, BTreeMap<&str, Vec<usize>>>> =
            Subset::NAMES.map(|(name, _)| (name, BTreeMap::new())).into();
        for (object, subset) in objects.iter().zip(subsets) {
            let category = match self.layout {
                OutputLayout::R2n2 => &object.synset,
                _ => &object.category,
            };
            let of = splits.entry(subset.name()).or_default().entry(category).or_default();
            of.insert(&object.name, (0..object.views).collect());
        }
        let text = serde_json::to_string(&splits).expect("numbers and names");
        put_for_good(&self.root, "splits.json", text.as_bytes())?;
        put_for_good(&self.root, "contact_sheet.png", &encode_png(sheet))
    }
}

/// Where an object is put together, beside others that are drawn at the same time. Neither name has a slash in it, so it is nobody else's.
fn work_folder(unfinished: &Path, category: &str, name: &str) -> PathBuf {
    unfinished.join(category).join(name)
}

/// What tells models from others; none where there are none.
fn fingerprint(models: &[Model]) -> Option<String> {
    if let [] | [_] = models {
        return models.first().map(|model| model.fingerprint.clone());
    }
    let mut hash = FnvHasher::default();
    for model in models {
        let Model { category, name, subset, fingerprint, .. } = model;
        hash.write(format!("{category}/{name} {subset:?} {fingerprint}\n").as_bytes());
    }
    Some(format!("{} meshes {:016x}", models.len(), hash.finish()))
}

/// How a layout of one folder for each object names what it has besides views.
struct Names {
    views: fn(&[View], &Path) -> Result<(), datasets::WriteViewsError>,
    monocular: fn(usize) -> String,
    normals: fn(usize) -> String,
}

const KAOLIN: Names = Names {
    views: write_kaolin,
    monocular: |i| format!("{i}_monocular.exr"),
    normals: |i| format!("{i}_normals.png"),
};

const TRANSFORMS: Names = Names {
    views: write_transforms,
    monocular: |i| format!("monocular/{i:04}.exr"),
    normals: |i| format!("normals/{i:04}.png"),
};

/// Views, truth and extras in one folder.
fn write_folder(
    made: Made<'_>,
    config: &GenerateConfig,
    folder: &Path,
    names: &Names,
) -> Result<ObjectInfo, GenerateError> {
    let Made { info, mesh, renderings, monocular, rough, .. } = made;
    for (i, image) in monocular.iter().enumerate() {
        put(&folder.join((names.monocular)(i)), &encode_exr(image))?;
    }
    for (i, rendering) in renderings.iter().enumerate() {
        if let Some(normals) = rendering.normal_image() {
            put(&folder.join((names.normals)(i)), &encode_png(&normals))?;
        }
    }
    let views: Vec<View> = renderings
        .into_iter()
        .map(|rendering| {
            let mut view = rendering.view;
            // It may have been drawn for the guess alone.
            view.depth = view.depth.filter(|_| config.depth);
            view
        })
        .collect();
    (names.views)(&views, folder)?;
    let cameras: Vec<_> = views.iter().map(|view| &view.camera).collect();
    put_rough(folder, &cameras, &rough)?;
    write_mesh(folder.join(mesh_name(&mesh)), &mesh)?;
    Ok(info)
}

/// PLY keeps every bit of a coloured mesh, but no texture.
fn mesh_name(mesh: &TriMesh) -> &'static str {
    if mesh.texture.is_some() { "mesh.glb" } else { "mesh.ply" }
}

/// Writes rough poses beside the true ones, where there are any.
pub(super) fn put_rough(
    folder: &Path,
    cameras: &[&Camera],
    rough: &[Camera],
) -> Result<(), GenerateError> {
    if rough.is_empty() {
        return Ok(());
    }
    let pairs: Vec<_> = cameras.iter().copied().zip(rough).collect();
    put(&folder.join(rough::FILE), rough::text(&pairs).as_bytes())
}

pub(super) fn put(path: &Path, bytes: &[u8]) -> Result<(), GenerateError> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(GenerateError::io(folder))?;
    }
    Ok(write_atomic(path, |w| w.write_all(bytes))?)
}

/// Writes a file that a power cut does not take. Files of objects need that only together, when they are published.
fn put_for_good(root: &Path, name: &str, bytes: &[u8]) -> Result<(), GenerateError> {
    write_within(root, name, bytes).map_err(|(path, source)| GenerateError::io(&path)(source))
}

/// The first setting that differs, as it is found and as it is asked for.
fn first_difference(found: &str, asked: &str) -> Option<(String, String)> {
    let (found, asked) = (settings_of(found), settings_of(asked));
    let keys = found.keys().chain(asked.keys());
    let key = keys.filter(|&key| found.get(key) != asked.get(key)).min()?;
    let line = |settings: &BTreeMap<String, String>| match settings.get(key) {
        Some(value) => format!("{key} = {value}"),
        None => format!("no {key}"),
    };
    Some((line(&found), line(&asked)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_objects_are_put_together_in_one_folder() {
        let place = |category, name| work_folder(Path::new("unfinished"), category, name);
        assert_ne!(place("a", "b-c"), place("a-b", "c"));
    }

    #[test]
    fn the_setting_that_differs_is_named() {
        let a = "version = \"1\"\n[d]\nf = [\n \"x\",\n]\ns = 3\n";
        assert_eq!(first_difference(a, a), None);
        assert_eq!(first_difference(a, "version=\"1\"\n[d]\ns=3\nf=[\"x\"]"), None);
        let other = a.replace("\"x\"", "\"y\"").replace("s = 3", "s = 4");
        let named = first_difference(a, &other).expect("they differ");
        assert_eq!(named, ("d.f = [\"x\"]".to_owned(), "d.f = [\"y\"]".to_owned()));
        let damaged = first_difference("[[[", a).expect("nothing is left of it");
        assert_eq!(damaged, ("no d.f".to_owned(), "d.f = [\"x\"]".to_owned()));
    }
}
