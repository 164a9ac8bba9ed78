//! Views as the model takes them: one object with many views, or many objects.

use std::sync::Arc;

use datasets::{Dataset, Layout, ReadOptions, View, Views, split};
use mesh_core::TriMesh;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use recon::fit::cones;
use synth::shapes::AlarmClock;
use synth::{Orbit, Procedural, RenderOptions, families_named, render_views};
use train::{DataError, Fingerprint};

use super::config::Img2MeshConfig;
use super::prepared::Prepared;
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
    /// Indices of what is trained on: views of the one object, or objects.
    pub(super) train: Vec<usize>,
    /// Indices of what is scored; of what is trained on if nothing is held out.
    pub(super) held: Vec<usize>,
    hash: u64,
}

#[derive(Debug)]
enum Objects {
    One(Vec<Arc<Prepared>>),
    Many(ViewCache<Prepared>),
}

/// A group of views that is scored.
#[derive(Debug)]
pub(super) struct Trial {
    pub(super) given: Vec<Arc<Prepared>>,
    /// Those that were not given, unless there are no others.
    pub(super) scored: Vec<Arc<Prepared>>,
    /// The true surface in the world of the cameras, where it is known.
    pub(super) truth: Option<TriMesh>,
}

/// Views of one object.
#[derive(Debug)]
pub struct Sample {
    /// Those that the model is given, then those that it is only compared with.
    pub(super) views: Vec<Arc<Prepared>>,
}

impl Data {
    /// Views of a single object: random groups of them train, every `hold-out`th is scored.
    ///
    /// # Errors
    /// If a camera cannot be used.
    pub fn one(views: &Views, config: &Img2MeshConfig) -> Result<Self, DataError> {
        let parts = split(views.len(), config.hold_out);
        let fitted: Vec<&View> = parts.fit.iter().map(|&i| &views.views[i]).collect();
        let frame = frame_of(&[fitted]);
        let prepared: Vec<Result<Prepared, DataError>> =
            views.views.par_iter().map(|view| Prepared::new(view, config)).collect();
        let prepared = prepared.into_iter().map(|p| p.map(Arc::new)).collect::<Result<_, _>>()?;
        let hash = hashed(Fingerprint::new(), &views.views);
        let held = if parts.held_out.is_empty() { parts.fit.clone() } else { parts.held_out };
        let hash = hash.value();
        Ok(Self { frame, objects: Objects::One(prepared), train: parts.fit, held, hash })
    }

    /// Many objects: each epoch takes random views of each. What the layout calls test or
    /// validation is held out, or else every `hold-out`th object.
    ///
    /// # Errors
    /// If there are no views, or those of the first objects cannot be read.
    pub fn many(
        dataset: Box<dyn Dataset>,
        options: ReadOptions,
        config: &Img2MeshConfig,
    ) -> Result<Self, DataError> {
        let cache = ViewCache::new(dataset, options);
        let [train, held] = cache.split(config.hold_out)?;
        let hash = cache.fingerprint();
        // What is in the files is told by a few objects, which have to be read for the frame.
        let objects = train
            .iter()
            .take(FRAME_OBJECTS)
            .map(|&i| cache.whole(i))
            .collect::<Result<Vec<Views>, DataError>>()?;
        let hash = objects.iter().fold(hash, |hash, object| hashed(hash, &object.views));
        let views: Vec<Vec<&View>> = objects.iter().map(|o| o.views.iter().collect()).collect();
        let frame = frame_of(&views);
        Ok(Self { frame, objects: Objects::Many(cache), train, held, hash: hash.value() })
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
        let set = Procedural::new(&families, objects, config.test_objects, orbit);
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
        let views = Views {
            views,
            source: "procedural clock".into(),
            layout: Layout::Memory,
            warnings: vec![],
        };
        Self::one(&views, config)
    }

    /// The frame of a model that begins to learn from these views: centre and scale.
    ///
    /// # Errors
    /// If nothing can be learned from them: the cameras do not say where the object is, or there are
    /// fewer views than a sample has.
    pub(super) fn frame(&self, config: &Img2MeshConfig) -> Result<[f64; 4], DataError> {
        let group = config.views + config.extra_views;
        let least = match &self.objects {
            Objects::One(_) => self.train.len(),
            Objects::Many(cache) => {
                self.train.iter().map(|&object| cache.count(object)).min().unwrap_or_default()
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
        matches!(self.objects, Objects::One(_))
    }

    pub(super) fn fingerprint(&self) -> u64 {
        self.hash
    }

    /// Samples in an epoch: as many as there are groups of views, or objects.
    pub(super) fn epoch_len(&self, config: &Img2MeshConfig) -> usize {
        match &self.objects {
            Objects::One(_) => (self.train.len() / config.views).max(1),
            Objects::Many(_) => self.train.len(),
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
            Objects::One(views) => {
                let mut choice = self.train.clone();
                let (chosen, _) = choice.partial_shuffle(rng, group);
                Ok(Sample { views: chosen.iter().map(|&i| Arc::clone(&views[i])).collect() })
            }
            Objects::Many(cache) => {
                let object = self.train[item];
                let mut choice: Vec<usize> = (0..cache.count(object)).collect();
                let (chosen, _) = choice.partial_shuffle(rng, group);
                Ok(Sample {
                    views: cache.views(object, chosen, &|view| Prepared::new(view, config))?,
                })
            }
        }
    }

    /// The names of the objects that are scored; of one object's views there is none.
    pub(super) fn scored_names(&self) -> Vec<String> {
        let Objects::Many(cache) = &self.objects else { return Vec::new() };
        let name = |&object: &usize| {
            let entry = &cache.entries()[object];
            format!("{}/{}", entry.category, entry.name)
        };
        self.held.iter().map(name).collect()
    }

    /// How many groups are scored, with `views` given in each.
    pub(super) fn trials(&self, views: usize) -> usize {
        match &self.objects {
            Objects::One(_) => (self.held.len() / views).max(1),
            Objects::Many(_) => self.held.len() * (TRIALS / self.held.len()).clamp(1, 3),
        }
    }

    /// The `k`-th group that is scored. Of many objects' the views given are the first of an order
    /// that object and group decide, and those that are scored the last: with more views given they
    /// are the same ones and others, scored at the same cameras as long as there are enough.
    pub(super) fn trial(
        &self,
        config: &Img2MeshConfig,
        views: usize,
        k: usize,
    ) -> Result<Trial, DataError> {
        let (all, truth) = match &self.objects {
            Objects::One(all) => {
                let mut order = self.held.clone();
                let first = (k * views).min(order.len() - 1);
                order.rotate_left(first);
                (order.iter().map(|&i| Arc::clone(&all[i])).collect::<Vec<_>>(), None)
            }
            Objects::Many(cache) => {
                let object = self.held[k % self.held.len()];
                let mut order: Vec<usize> = (0..cache.count(object)).collect();
                let mut rng = ChaCha8Rng::seed_from_u64(object as u64);
                rng.set_stream((k / self.held.len()) as u64);
                order.shuffle(&mut rng);
                let last = views.max(order.len().saturating_sub(MOST_SCORED));
                order.drain(views.min(order.len())..last.min(order.len()));
                let views = cache.views(object, &order, &|view| Prepared::new(view, config))?;
                (views, cache.truth(object)?.mesh)
            }
        };
        let (given, others) = all.split_at(views.min(all.len()));
        let scored = if others.is_empty() { given } else { others };
        Ok(Trial { given: given.to_vec(), scored: scored.to_vec(), truth })
    }
}

/// Around the point that the cameras of each object look at, as wide as the widest object.
fn frame_of(objects: &[Vec<&View>]) -> Result<[f64; 4], String> {
    let mut frame = [0.0; 4];
    for views in objects {
        let (center, radius) = cones(views).map_err(|error| error.to_string())?;
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
    let (count, seed) = (config.synthetic_views, config.data_seed);
    Orbit { count, width: side, height: side, seed, ..base.clone() }
}
