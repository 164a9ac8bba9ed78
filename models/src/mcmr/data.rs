//! Photo collections: one photograph of each object, where it stands roughly, and its mask.

use std::sync::{Arc, OnceLock};

use datasets::{Dataset, Layout, ReadOptions, Subsets};
use mesh_core::TriMesh;
use synth::generate::read_rough_poses;
use synth::{Orbit, Procedural, families_named};
use train::{DataError, DataSummary, Source, Subset};

use super::config::McmrConfig;
use super::perceptual::PerceptualMetrics;
use super::photo::{Masking, Photo, Rough, Sample};
use crate::parts;
use crate::view_cache::ViewCache;

/// Photographs whose content is told by the fingerprint.
const HASHED: usize = 8;
/// Points on an object by which its symmetry is found.
const POINTS: usize = 1000;

/// A collection, parted into training, validation and test.
#[derive(Debug)]
pub struct Data {
    cache: ViewCache<Photo>,
    rough: Vec<Rough>,
    truths: Vec<OnceLock<Option<Arc<TriMesh>>>>,
    turns: Vec<OnceLock<Vec<f64>>>,
    parts: Subsets,
    /// Category of each object, as a number.
    kinds: Vec<usize>,
    categories: Vec<String>,
    perceptual: Arc<PerceptualMetrics>,
    masking: Masking,
    hash: u64,
}

impl Data {
    /// Reads what the layout at a path offers, or makes procedural objects.
    ///
    /// # Errors
    /// If files are damaged, or nothing shows an object.
    pub fn open(config: &McmrConfig, source: &Source<'_, ReadOptions>) -> Result<Self, DataError> {
        let data_seed = config.data_seed.or(Some(source.seed));
        let config = &McmrConfig { data_seed, ..config.clone() };
        match source.path {
            None => Self::synthetic(config),
            Some(path) => {
                let dataset = datasets::open_with(path, source.options).map_err(DataError::read)?;
                Self::of(dataset, source.options.clone(), config)
            }
        }
    }

    /// Procedural objects of the configuration's families, one photograph and a noisy pose each.
    ///
    /// # Errors
    /// As [`of`](Self::of).
    pub fn synthetic(config: &McmrConfig) -> Result<Self, DataError> {
        let families = families_named(&config.families).map_err(DataError::Unfit)?;
        // Objects fill about half of such an image, so a crop has the size of the network's.
        let side = 2 * config.image_size;
        let seed = config.data_seed();
        let orbit = Orbit { width: side, height: side, seed, ..Orbit::photos() };
        let set = Procedural::new(&families, config.counts(), orbit);
        Self::of(Box::new(set), ReadOptions::default(), config)
    }

    /// A dataset, of which the first view of each object counts, parted as [`Subsets::of`] does. Poses of objects that are made here are disturbed; those of
    /// `data generate`'s collections are the rough ones of their files; all others are taken as they are.
    ///
    /// # Errors
    /// If no object has a view, or the first ones cannot be read or show nothing.
    pub fn of(
        dataset: Box<dyn Dataset>,
        options: ReadOptions,
        config: &McmrConfig,
    ) -> Result<Self, DataError> {
        let made = dataset.layout() == Layout::Memory;
        let rough = |object: usize| -> Result<Rough, DataError> {
            if made {
                return Ok(Rough::Noisy(config.noise(), config.data_seed()));
            }
            let entry = &dataset.entries()[object];
            let folder = dataset.root().join(&entry.category).join(&entry.name);
            if !folder.join("rough_poses.json").is_file() {
                return Ok(Rough::Exact);
            }
            let poses = read_rough_poses(&folder).map_err(DataError::unfit)?;
            Ok(poses.into_iter().next().map_or(Rough::Exact, |pose| Rough::Known(pose.rough)))
        };
        let rough = (0..dataset.entries().len()).map(rough).collect::<Result<Vec<_>, _>>()?;
        let mut categories: Vec<String> = Vec::new();
        let mut kinds = Vec::new();
        for entry in dataset.entries() {
            let known = categories.iter().position(|c| *c == entry.category);
            kinds.push(known.unwrap_or(categories.len()));
            if known.is_none() {
                categories.push(entry.category.clone());
            }
        }
        let truths = kinds.iter().map(|_| OnceLock::new()).collect();
        let turns = kinds.iter().map(|_| OnceLock::new()).collect();
        let perceptual = Arc::new(PerceptualMetrics::open(config)?);
        let cache = ViewCache::new(dataset, options);
        let parts = cache.parts(config.hold_out)?;
        let fingerprint = cache.fingerprint();
        let mut data = Self {
            cache,
            rough,
            truths,
            turns,
            parts,
            kinds,
            categories,
            perceptual,
            masking: Masking::of(config),
            hash: 0,
        };
        let first = data.parts.train.iter().take(HASHED);
        let hash = first
            .map(|&object| Ok(data.photo(object)?.plain(Subset::Train, config)))
            .try_fold(fingerprint, |hash, sample: Result<Sample, DataError>| {
                let sample = sample?;
                let pose = sample.pose.projection(super::photo::lens_of(config));
                let pose: Vec<u8> = pose.iter().flat_map(|x| x.to_le_bytes()).collect();
                Ok::<_, DataError>(hash.with(&sample.image).with(&sample.mask).with(&pose))
            })?;
        data.hash = hash.value();
        Ok(data)
    }

    /// Objects that are trained on.
    pub fn trained(&self) -> &[usize] {
        &self.parts.train
    }

    /// Objects that are for this; none where there are none.
    pub fn listed(&self, subset: Subset) -> &[usize] {
        parts::listed(&self.parts, subset)
    }

    /// The same, at least one.
    pub(super) fn wanted(&self, subset: Subset) -> Result<&[usize], DataError> {
        parts::wanted(&self.parts, subset)
    }

    /// The photographs of a subset's objects as they are scored: neither moved nor mirrored.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub(super) fn samples(
        &self,
        objects: &[usize],
        subset: Subset,
        config: &McmrConfig,
    ) -> Result<Vec<Sample>, DataError> {
        parts::of_all(objects.len(), |i| Ok(self.photo(objects[i])?.plain(subset, config)))
    }

    pub(super) fn summary(&self) -> DataSummary {
        parts::summary(&self.parts, "objects")
    }

    /// What an object is called: category and name.
    pub(super) fn name(&self, object: usize) -> String {
        self.cache.entries()[object].object_name()
    }

    /// What an object is called: `category/name`.
    pub fn object_name(&self, object: usize) -> String {
        let entry = &self.cache.entries()[object];
        format!("{}/{}", entry.category, entry.name)
    }

    /// The category of an object, as a number and by name.
    pub fn category(&self, object: usize) -> (usize, &str) {
        let kind = self.kinds[object];
        (kind, &self.categories[kind])
    }

    /// All categories, in the order of the data.
    pub fn categories(&self) -> &[String] {
        &self.categories
    }

    /// Networks that compare images.
    pub(super) fn perceptual(&self) -> &Arc<PerceptualMetrics> {
        &self.perceptual
    }

    pub(super) fn fingerprint(&self) -> u64 {
        self.hash
    }

    /// The photograph of an object.
    pub(super) fn photo(&self, object: usize) -> Result<Arc<Photo>, DataError> {
        let rough = &self.rough[object];
        let identity = self.cache.identity(object);
        let prepare = |view: &datasets::View| Photo::new(view, rough, identity, self.masking);
        Ok(self.cache.views(object, &[0], &prepare)?.swap_remove(0))
    }

    /// The true surface of an object in the world of its camera, where the data knows it.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn truth(&self, object: usize) -> Result<Option<Arc<TriMesh>>, DataError> {
        let place = &self.truths[object];
        if let Some(truth) = place.get() {
            return Ok(truth.clone());
        }
        let truth = self.cache.truth(object)?.mesh.filter(|mesh| !mesh.faces.is_empty());
        Ok(place.get_or_init(|| truth.map(Arc::new)).clone())
    }

    /// The turns about the upright axis that leave a true surface as it is, degrees.
    pub(super) fn turns(&self, object: usize, truth: &TriMesh) -> &[f64] {
        self.turns[object].get_or_init(|| losses::metrics::turns(truth, POINTS))
    }
}
