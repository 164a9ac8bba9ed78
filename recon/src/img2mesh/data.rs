//! Views as the model takes them: one object with many views, or many objects.

use std::sync::Arc;

use datasets::{Dataset, Layout, ReadOptions, Subset, View, Views, shapes::AlarmClock, split};
use mesh_core::Image;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::config::Img2MeshConfig;
use crate::evaluate::masked;
use crate::fit::cones;
use crate::synthetic::{Orbit, RenderOptions, render_views};
use crate::train::{DataError, Fingerprint};

/// Objects whose views say where the frame of many lies.
const FRAME_OBJECTS: usize = 8;

/// What img2mesh learns from.
#[derive(Debug)]
pub struct Data {
    /// Centre and scale of the frame in the world of the cameras.
    pub(super) frame: [f64; 4],
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
    Many { dataset: Box<dyn Dataset>, options: ReadOptions },
}

/// One view, resized for encoder and losses. Its camera is relative to the frame.
#[derive(Debug)]
pub(super) struct Prepared {
    pub(super) name: String,
    /// `[S, S, 3]`, black outside of the object.
    pub(super) image: Vec<f32>,
    /// `[R, R, 3]`, the same.
    pub(super) target: Vec<f32>,
    /// `[R, R]`, the share of the object in each pixel.
    pub(super) mask: Vec<f32>,
    /// `[3, 4]`.
    pub(super) matrix: Vec<f32>,
}

/// Views of one object.
#[derive(Debug)]
pub struct Sample {
    /// Those that the model is given, then those that it is only compared with.
    pub(super) views: Vec<Arc<Prepared>>,
}

impl Prepared {
    pub(super) fn new(
        view: &View,
        config: &Img2MeshConfig,
        frame: [f64; 4],
    ) -> Result<Self, DataError> {
        if !view.camera.is_perspective() {
            let text =
                format!("view {}: its camera is orthographic, expected a pinhole", view.name);
            return Err(DataError::Unfit(text));
        }
        let [x, y, z, scale] = frame;
        let rows = view.camera.projection();
        // M (c + s q) = s (M q): all rows are divided by s, so that depth counts in the frame.
        let row = |m: [f64; 4]| [m[0], m[1], m[2], (m[0] * x + m[1] * y + m[2] * z + m[3]) / scale];
        let color = masked(view);
        let (image, target) = (config.image_size, config.render_size);
        let floats = |side: usize| Image::from(&color.resized(side, side)).data;
        Ok(Self {
            name: view.name.clone(),
            image: floats(image),
            target: floats(target),
            mask: Image::from(&view.mask.resized(target, target)).data,
            matrix: rows.iter().flat_map(|&m| row(m)).map(|x| x as f32).collect(),
        })
    }
}

impl Data {
    /// Views of a single object: random groups of them train, every `hold-out`th is scored.
    ///
    /// # Errors
    /// If there are fewer views than a group has, or a camera cannot be used.
    pub fn one(views: &Views, config: &Img2MeshConfig) -> Result<Self, DataError> {
        let parts = split(views.len(), config.hold_out, config.hold_out.saturating_sub(1));
        let group = config.views + config.extra_views;
        if parts.fit.len() < group {
            let (left, source) = (parts.fit.len(), views.source.display());
            return Err(DataError::Unfit(format!(
                "{source}: {left} views to train on, but `views` and `extra-views` ask for {group}"
            )));
        }
        let fitted: Vec<&View> = parts.fit.iter().map(|&i| &views.views[i]).collect();
        let frame = frame_of(&[fitted])?;
        let prepared: Vec<Result<Prepared, DataError>> =
            views.views.par_iter().map(|view| Prepared::new(view, config, frame)).collect();
        let prepared = prepared.into_iter().map(|p| p.map(Arc::new)).collect::<Result<_, _>>()?;
        let hash = views.views.iter().fold(Fingerprint::new(), |hash, view| {
            let camera: Vec<u8> = view
                .camera
                .projection()
                .as_flattened()
                .iter()
                .flat_map(|x| x.to_le_bytes())
                .collect();
            hash.with(&view.color.data).with(&view.mask.data).with(&camera)
        });
        let held = if parts.held_out.is_empty() { parts.fit.clone() } else { parts.held_out };
        let hash = hash.value();
        Ok(Self { frame, objects: Objects::One(prepared), train: parts.fit, held, hash })
    }

    /// Many objects: each epoch takes random views of each. What the layout calls test or
    /// validation is held out, or else every `hold-out`th object.
    ///
    /// # Errors
    /// If no object has enough views, or the first cannot be read.
    pub fn many(
        dataset: Box<dyn Dataset>,
        options: ReadOptions,
        config: &Img2MeshConfig,
    ) -> Result<Self, DataError> {
        let entries = dataset.entries();
        let group = config.views + config.extra_views;
        let enough: Vec<usize> =
            (0..entries.len()).filter(|&i| entries[i].views >= group).collect();
        let said = enough.iter().any(|&i| entries[i].subset.is_some_and(|s| s != Subset::Train));
        let every = config.hold_out;
        let (held, train): (Vec<usize>, Vec<usize>) =
            enough.iter().partition(|&&i| match entries[i].subset {
                Some(subset) if said => subset != Subset::Train,
                _ if said => false,
                _ => every > 0 && i % every == every - 1,
            });
        if train.is_empty() {
            let root = dataset.root().display();
            return Err(DataError::Unfit(format!(
                "{root}: no object to train on has the {group} views that `views` and `extra-views` ask for"
            )));
        }
        let mut hash = Fingerprint::new();
        for entry in entries {
            hash = hash.with(entry.category.as_bytes()).with(entry.name.as_bytes());
            hash = hash.with(&entry.views.to_le_bytes());
        }
        let objects = train
            .iter()
            .take(FRAME_OBJECTS)
            .map(|&i| Ok(dataset.views(i, None, &options, &|_, _| ())?))
            .collect::<Result<Vec<Views>, DataError>>()?;
        let views: Vec<Vec<&View>> = objects.iter().map(|o| o.views.iter().collect()).collect();
        let frame = frame_of(&views)?;
        let held = if held.is_empty() { train.clone() } else { held };
        Ok(Self {
            frame,
            objects: Objects::Many { dataset, options },
            train,
            held,
            hash: hash.value(),
        })
    }

    /// Views of a procedural clock, from all around.
    ///
    /// # Errors
    /// As [`one`](Self::one).
    pub fn clock(config: &Img2MeshConfig, seed: u64) -> Result<Self, DataError> {
        let side = config.image_size.max(config.render_size);
        let orbit = Orbit {
            count: config.synthetic_views,
            width: side,
            height: side,
            seed,
            ..Orbit::default()
        };
        let views = render_views(
            &AlarmClock::default().build(),
            &orbit.cameras(),
            &RenderOptions::default(),
            &|_, _| (),
        )
        .map_err(|error| DataError::Unfit(error.to_string()))?;
        let views = Views {
            views,
            source: "procedural clock".into(),
            layout: Layout::Memory,
            warnings: vec![],
        };
        Self::one(&views, config)
    }

    pub(super) fn fingerprint(&self) -> u64 {
        self.hash
    }

    /// Samples in an epoch: each view once, or each object.
    pub(super) fn epoch_len(&self, config: &Img2MeshConfig) -> usize {
        match &self.objects {
            Objects::One(_) => (self.train.len() / config.views).max(1),
            Objects::Many { .. } => self.train.len(),
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
            Objects::Many { .. } => {
                let object = self.train[item];
                let mut choice: Vec<usize> = (0..self.view_count(object)).collect();
                let (chosen, _) = choice.partial_shuffle(rng, group);
                self.read(config, object, Some(chosen))
            }
        }
    }

    fn view_count(&self, object: usize) -> usize {
        match &self.objects {
            Objects::One(views) => views.len(),
            Objects::Many { dataset, .. } => dataset.entries()[object].views,
        }
    }

    fn read(
        &self,
        config: &Img2MeshConfig,
        object: usize,
        which: Option<&[usize]>,
    ) -> Result<Sample, DataError> {
        let Objects::Many { dataset, options } = &self.objects else {
            unreachable!("only many objects are read one by one")
        };
        let views = dataset.views(object, which, options, &|_, _| ())?;
        let prepare = |view: &View| {
            let mut prepared = Prepared::new(view, config, self.frame)?;
            prepared.name = format!("{} view {}", dataset.entries()[object].name, view.name);
            Ok(Arc::new(prepared))
        };
        Ok(Sample { views: views.views.iter().map(prepare).collect::<Result<_, DataError>>()? })
    }

    /// How many groups are scored, with `views` given in each.
    pub(super) fn trials(&self, views: usize) -> usize {
        match &self.objects {
            Objects::One(_) => (self.held.len() / views).max(1),
            Objects::Many { .. } => self.held.len(),
        }
    }

    /// The `k`-th group that is scored: `views` that are given, then those that were not.
    pub(super) fn trial(
        &self,
        config: &Img2MeshConfig,
        views: usize,
        k: usize,
    ) -> Result<Sample, DataError> {
        match &self.objects {
            Objects::One(all) => {
                let mut order = self.held.clone();
                let first = (k * views).min(order.len() - 1);
                order.rotate_left(first);
                Ok(Sample { views: order.iter().map(|&i| Arc::clone(&all[i])).collect() })
            }
            Objects::Many { .. } => self.read(config, self.held[k], None),
        }
    }
}

/// Around the point that the cameras of each object look at, as wide as the widest object.
fn frame_of(objects: &[Vec<&View>]) -> Result<[f64; 4], DataError> {
    let mut frame = [0.0; 4];
    for views in objects {
        let (center, radius) = cones(views).map_err(|error| DataError::Unfit(error.to_string()))?;
        for k in 0..3 {
            frame[k] += center[k] / objects.len() as f64;
        }
        frame[3] = frame[3].max(radius);
    }
    Ok(frame)
}
