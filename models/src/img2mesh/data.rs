//! Views as the model takes them: one object with many views, or many objects.

use std::sync::Arc;

use datasets::{Dataset, ReadOptions, Subsets, View, Views};
use mesh_core::TriMesh;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use recon::fit::bounding_sphere;
use synth::shapes::AlarmClock;
use synth::{Orbit, Procedural, RenderOptions, families_named, render_views};
use train::{DataError, DataSummary, Fingerprint, Subset};

use super::config::Img2MeshConfig;
use super::prepared::Prepared;
use crate::parts;
use crate::view_cache::ViewCache;

/// Objects whose views say where the frame of many lies.
const FRAME_OBJECTS: usize = 8;
/// Views of each of many objects that are scored at most: the rest costs time and tells little.
const MOST_SCORED: usize = 8;
/// Groups that are scored of many objects, if each can give up to three: of few objects one group
/// each would leave much to chance.
const TRIALS: usize = 120;

/// What img2mesh learns from.
#[derive(Debug)]
pub struct Data {
    /// Centre and scale of a frame for a model that begins here, in the world of the cameras; or
    /// why these views have none.
    frame: Result<[f64; 4], String>,
    objects: Objects,
    /// Indices of views of the one object, or of objects.
    parts: Subsets,
    hash: u64,
}

#[derive(Debug)]
enum Objects {
    /// What it is called, and its views.
    One(String, Vec<Arc<Prepared>>),
    Many(Box<ViewCache<Prepared>>),
}

/// A group of views that is scored.
#[derive(Debug)]
pub(super) struct Trial {
    /// What the object is called.
    pub(super) object: String,
    /// What of its name is its family's; of one object nothing.
    pub(super) family: String,
    pub(super) given: Vec<Arc<Prepared>>,
    /// Those that were not given, unless there are no others.
    pub(super) scored: Vec<Arc<Prepared>>,
    /// The true surface in the world of the cameras, where it is known.
    pub(super) truth: Option<TriMesh>,
}

/// Views of one object: those that are given, and those that a mesh made of them is scored at.
#[derive(Clone, Debug)]
pub struct Group {
    /// What the object is called.
    pub object: String,
    /// Those given.
    pub given: Vec<View>,
    /// Those that were not, unless there are no others.
    pub scored: Vec<View>,
    /// The true surface in the world of the cameras, where it is known.
    pub truth: Option<TriMesh>,
}

/// Views of one object.
#[derive(Debug)]
pub struct Sample {
    /// Those that the model is given, then those that it is only compared with.
    pub(super) views: Vec<Arc<Prepared>>,
}

impl Data {
    /// Views of a single object: random groups of them train, every `hold-out`th is held out, by turns for validation and
    /// for tests.
    ///
    /// # Errors
    /// If a camera cannot be used.
    pub fn one(views: &Views, config: &Img2MeshConfig) -> Result<Self, DataError> {
        let parts = Subsets::of_views(views.len(), &views.test, config.hold_out);
        let fitted: Vec<&View> = parts.train.iter().map(|&i| &views.views[i]).collect();
        let frame = frame_of(&[fitted]);
        let prepared =
            parts::of_all(views.len(), |i| Ok(Arc::new(Prepared::new(&views.views[i], config)?)))?;
        let hash = hashed(Fingerprint::new(), &views.views).value();
        let name = views.source.file_name().unwrap_or(views.source.as_os_str());
        let objects = Objects::One(name.to_string_lossy().into_owned(), prepared);
        Ok(Self { frame, objects, parts, hash })
    }

    /// Many objects: each epoch takes random views of each that is trained on. They are parted as [`Subsets::of`] does.
    ///
    /// # Errors
    /// If there are no views, or those of the first objects cannot be read.
    pub fn many(
        dataset: Box<dyn Dataset>,
        options: ReadOptions,
        config: &Img2MeshConfig,
    ) -> Result<Self, DataError> {
        let cache = ViewCache::new(dataset, options);
        let parts = cache.parts(config.hold_out)?;
        let hash = cache.fingerprint();
        // What is in the files is told by a few objects, which have to be read for the frame.
        let objects = parts
            .train
            .iter()
            .take(FRAME_OBJECTS)
            .map(|&i| cache.whole(i))
            .collect::<Result<Vec<Views>, DataError>>()?;
        let hash = objects.iter().fold(hash, |hash, object| hashed(hash, &object.views));
        let views: Vec<Vec<&View>> = objects.iter().map(|o| o.views.iter().collect()).collect();
        let frame = frame_of(&views);
        Ok(Self { frame, objects: Objects::Many(Box::new(cache)), parts, hash: hash.value() })
    }

    /// Procedural objects of the configuration's families, or of the one clock if it asks for none.
    ///
    /// # Errors
    /// As [`many`](Self::many) and [`one`](Self::one).
    pub fn synthetic(config: &Img2MeshConfig) -> Result<Self, DataError> {
        let Some(objects) = config.objects else {
            return Self::clock(config);
        };
        let families = families_named(&config.families).map_err(DataError::Unfit)?;
        let orbit = orbit(config, &Procedural::orbit());
        let set = Procedural::new(&families, config.counts(objects), orbit);
        let set = if config.turned { set.turned() } else { set }.placed(config.placed);
        Self::many(Box::new(set), ReadOptions::default(), config)
    }

    /// Views of a procedural clock, from all around.
    ///
    /// # Errors
    /// As [`one`](Self::one).
    pub fn clock(config: &Img2MeshConfig) -> Result<Self, DataError> {
        let orbit = orbit(config, &Orbit::default());
        let views = render_views(
            &AlarmClock::default().build(),
            &orbit.cameras(),
            &RenderOptions::default(),
            &|_, _| (),
        )
        .map_err(DataError::unfit)?;
        Self::one(&Views { source: "procedural clock".into(), ..Views::in_memory(views) }, config)
    }

    /// The frame of a model that begins to learn from these views: centre and scale.
    ///
    /// # Errors
    /// If nothing can be learned from them: the cameras do not say where the object is, or there are
    /// fewer views than a sample has.
    pub fn frame(&self, config: &Img2MeshConfig) -> Result<[f64; 4], DataError> {
        let group = config.views + config.extra_views;
        let least = match &self.objects {
            Objects::One(..) => self.parts.train.len(),
            Objects::Many(cache) => {
                let counts = self.parts.train.iter().map(|&object| cache.count(object));
                counts.min().unwrap_or_default()
            }
        };
        if least < group {
            return Err(DataError::Unfit(format!(
                "{least} views of an object to train on, but `views` and `extra-views` ask for {group}"
            )));
        }
        self.frame.clone().map_err(DataError::Unfit)
    }

    /// Whether it is a single object.
    pub fn is_one(&self) -> bool {
        matches!(self.objects, Objects::One(..))
    }

    pub(super) fn fingerprint(&self) -> u64 {
        self.hash
    }

    /// Samples in an epoch: as many as there are groups of views, or objects.
    pub(super) fn epoch_len(&self, config: &Img2MeshConfig) -> usize {
        match &self.objects {
            Objects::One(..) => (self.parts.train.len() / config.views).max(1),
            Objects::Many(_) => self.parts.train.len(),
        }
    }

    /// A group of views, drawn by `rng`; of object `item` where there are many.
    pub(super) fn draw(
        &self,
        config: &Img2MeshConfig,
        item: usize,
        rng: &mut ChaCha8Rng,
    ) -> Result<Sample, DataError> {
        let group = config.views + config.extra_views;
        match &self.objects {
            Objects::One(_, views) => {
                let mut choice = self.parts.train.clone();
                let (chosen, _) = choice.partial_shuffle(rng, group);
                Ok(Sample { views: chosen.iter().map(|&i| Arc::clone(&views[i])).collect() })
            }
            Objects::Many(cache) => {
                let object = self.parts.train[item];
                let mut choice: Vec<usize> = (0..cache.count(object)).collect();
                let (chosen, _) = choice.partial_shuffle(rng, group);
                Ok(Sample {
                    views: cache.views(object, chosen, &|view| Prepared::new(view, config))?,
                })
            }
        }
    }

    /// The views of the one object, or the objects, that are for this.
    pub fn listed(&self, subset: Subset) -> &[usize] {
        parts::listed(&self.parts, subset)
    }

    /// The names of the objects that are tested; of one object's views there is none.
    pub(super) fn tested(&self) -> Vec<String> {
        let Objects::Many(cache) = &self.objects else { return Vec::new() };
        let name = |&object: &usize| cache.entries()[object].object_name();
        self.listed(Subset::Test).iter().map(name).collect()
    }

    pub(super) fn summary(&self) -> DataSummary {
        parts::summary(&self.parts, if self.is_one() { "views" } else { "objects" })
    }

    /// How many groups of a subset are scored, with `views` given in each; of each object as many.
    ///
    /// # Errors
    /// If there is nothing for that.
    pub fn trials(&self, subset: Subset, views: usize) -> Result<usize, DataError> {
        let count = parts::wanted(&self.parts, subset)?.len();
        Ok(match &self.objects {
            Objects::One(..) => (count / views).max(1),
            Objects::Many(_) => count * (TRIALS / count).clamp(1, 3),
        })
    }

    /// The `k`-th group of a subset that is scored. Of many objects' the views given are the first of an order
    /// that object and group decide, and those that are scored the last: with more views given they
    /// are the same ones and others, scored at the same cameras as long as there are enough.
    pub(super) fn trial(
        &self,
        config: &Img2MeshConfig,
        (subset, views): (Subset, usize),
        k: usize,
    ) -> Result<Trial, DataError> {
        let listed = parts::wanted(&self.parts, subset)?;
        let (object, family, all, truth) = match &self.objects {
            Objects::One(name, all) => {
                let mut order = listed.to_vec();
                let first = (k * views).min(order.len() - 1);
                order.rotate_left(first);
                let views: Vec<_> = order.iter().map(|&i| Arc::clone(&all[i])).collect();
                (name.clone(), String::new(), views, None)
            }
            Objects::Many(cache) => {
                let object = listed[k % listed.len()];
                let order = tried(cache, object, k / listed.len(), views);
                let views = cache.views(object, &order, &|view| Prepared::new(view, config))?;
                let entry = &cache.entries()[object];
                let (name, family) = (entry.object_name(), entry.category.clone());
                (name, family, views, cache.truth(object)?.mesh)
            }
        };
        let (given, others) = all.split_at(views.min(all.len()));
        let scored = if others.is_empty() { given } else { others };
        Ok(Trial { object, family, given: given.to_vec(), scored: scored.to_vec(), truth })
    }

    /// The `k`-th group of a subset that is scored, as it was read, of many objects.
    ///
    /// # Errors
    /// If a file cannot be read, or these are views of one object.
    pub fn group(&self, (subset, views): (Subset, usize), k: usize) -> Result<Group, DataError> {
        let listed = parts::wanted(&self.parts, subset)?;
        let object = listed[k % listed.len()];
        let Objects::Many(cache) = &self.objects else {
            return Err(DataError::Unfit("groups are of many objects, this is one".to_owned()));
        };
        let whole = cache.whole(object)?.views;
        let order = tried(cache, object, k / listed.len(), views);
        let all: Vec<View> = order.iter().map(|&i| whole[i].clone()).collect();
        let (given, others) = all.split_at(views.min(all.len()));
        let scored = if others.is_empty() { given } else { others };
        let (given, scored) = (given.to_vec(), scored.to_vec());
        let (object, truth) = (cache.entries()[object].object_name(), cache.truth(object)?.mesh);
        Ok(Group { object, given, scored, truth })
    }
}

/// Views of an object in the order of a group: those given, then those that are scored.
fn tried(cache: &ViewCache<Prepared>, object: usize, draw: usize, views: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..cache.count(object)).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(cache.identity(object));
    rng.set_stream(draw as u64);
    order.shuffle(&mut rng);
    let last = views.max(order.len().saturating_sub(MOST_SCORED));
    order.drain(views.min(order.len())..last.min(order.len()));
    order
}

/// Around the point that the cameras of each object look at, as wide as the widest object.
fn frame_of(objects: &[Vec<&View>]) -> Result<[f64; 4], String> {
    let mut frame = [0.0; 4];
    for views in objects {
        let (center, radius) = bounding_sphere(views).map_err(|error| error.to_string())?;
        for k in 0..3 {
            frame[k] += center[k] / objects.len() as f64;
        }
        frame[3] = frame[3].max(radius);
    }
    Ok(frame)
}

/// With the images, masks and cameras of these views.
fn hashed(hash: Fingerprint, views: &[View]) -> Fingerprint {
    views.iter().fold(hash, |hash, view| {
        let camera = view.camera.projection();
        let camera: Vec<u8> = camera.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
        hash.with(&view.color.data).with(&view.mask.data).with(&camera)
    })
}

/// The cameras of views that are made, as sharp as the sharpest of what looks at them.
fn orbit(config: &Img2MeshConfig, base: &Orbit) -> Orbit {
    let side = config.image_size.max(config.render_size);
    let (count, seed) = (config.synthetic_views, config.data_seed());
    Orbit { count, width: side, height: side, seed, ..base.clone() }
}

#[cfg(test)]
mod tests {
    use train::System as _;

    use super::*;
    use crate::img2mesh::Img2Mesh;
    use crate::testing::preset_with;

    /// Lengths of the clock's frame are 70.76 of its units: the published 37.5 is 0.53, and 1e-8 for squares 5.007e-5.
    #[test]
    #[ignore = "needs UNSPHERE_DATA"]
    fn the_clocks_frame_makes_published_lengths() {
        let folder =
            std::env::var("UNSPHERE_DATA").expect("UNSPHERE_DATA names a folder of real inputs");
        let path = std::path::Path::new(&folder).join("rendered_clock/views_256");
        let views = datasets::read_views(&path, &ReadOptions::default(), &|_, _| ())
            .expect("the real clock");
        let small = [("image-size", "32"), ("render-size", "32")];
        let config = preset_with::<Img2Mesh>("paper", &small).system;
        let frame = Data::one(&views, &config)
            .expect("the real clock")
            .frame(&config)
            .expect("the real clock");
        assert!((config.radius * frame[3] / 37.5 - 1.0).abs() < 0.01, "{frame:?}");
        assert!((config.offset_scale * frame[3] - 1.0).abs() < 0.01, "{frame:?}");
        assert!((config.edge_weight / frame[3].powi(2) / 1e-8 - 1.0).abs() < 0.02, "{frame:?}");
        let mut system = Img2Mesh::new(&config, 0);
        system
            .init_from_data(&Data::one(&views, &config).expect("the real clock"), None)
            .expect("the real clock");
        assert_eq!(system.model.frame.as_slice()[..3], [0.0; 3]);
    }
}
