//! Datasets of our own making: objects, images, truth, in layouts that others read too.
//!
//! ```
//! use synth::shapes::Family;
//! use synth::generate::{GenerateConfig, generate};
//! use synth::progress::Watch;
//!
//! let config = GenerateConfig {
//!     families: vec![Family::AlarmClock],
//!     objects: 2,
//!     views: 3,
//!     width: 32,
//!     height: 24,
//!     ..GenerateConfig::default()
//! };
//! let place = tempfile::tempdir()?;
//! let folder = place.path().join("clocks");
//! let made = generate(&config, &[], &folder, &mut Watch::default())?;
//! assert_eq!((made.made, made.skipped), (2, 0));
//! let views = datasets::read_views(
//!     &folder.join("alarm_clock/0001"),
//!     &datasets::ReadOptions::default(),
//!     &|_, _| {},
//! )?;
//! assert_eq!(views.len(), 3);
//!
//! // What is there already is not made again.
//! assert_eq!(generate(&config, &[], &folder, &mut Watch::default())?.skipped, 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Files
//!
//! | file | what |
//! |---|---|
//! | `dataset.toml` | the configuration; another one is refused in this folder |
//! | `objects.json` | every object with its seeds and what was drawn, in words |
//! | `splits.json` | `{train, val, test}: {category: {object: [views]}}`, by object |
//! | `contact_sheet.png` | a row for each category, up to eight objects each |
//! | `<category>/<object>/` | the views of an object; `object.json`; `mesh.ply`, or `mesh.glb` where there is a texture |
//!
//! A folder of kaolin's layout has `N_rgb.png`, `N_semantic.npy`, `N_metadata.json`, and as asked
//! `N_depth.exr`, `N_monocular.exr`, `N_normals.png`; one with a `transforms.json` has `images/`,
//! `masks/` and as asked `depth/`, `monocular/`, `normals/`. Photo collections have
//! `rough_poses.json`, see [`read_rough_poses`]. Monocular depth is disparity up to scale and
//! shift (see [`Monocular`](crate::Monocular)), channel `V`, floats; normals are
//! `(n + 1) / 2`.
//!
//! In 3D-R2N2's layout objects stand where [`datasets::r2n2`] says, under ShapeNet's synsets, with
//! points, voxels and meshes; `NN_monocular.exr`, `object.json` and `rough_poses.json` are beside
//! the images.
//!
//! # Promises
//!
//! - An object's files appear together or not at all, and what has appeared outlasts a power cut; a run that was stopped
//!   is taken up by running it again.
//! - The bytes are a function of the configuration alone, whatever the number of threads, however
//!   often it was stopped. Adding objects or families changes no other object's files; which subset of `splits.json` an object is in
//!   is dealt anew among those of its category, so that every one has its shares.

mod claim;
mod config;
mod error;
mod model;
mod model_folder;
mod object;
mod rough;
mod shapenet;
mod sheet;
mod split_list;
mod splits;
mod store;
mod visible;

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use rayon::prelude::*;
use train::Shard;
use train::progress::{Ended, Event, Watch};

pub use claim::UNFINISHED;
pub use config::{CameraSet, GenerateConfig, OutputLayout};
pub use error::GenerateError;
pub use model::{Model, Normalize, ReadModelError};
pub use model_folder::ModelFolder;
pub use object::ObjectInfo;
pub use rough::{RoughPosesError, read_rough_poses};
pub use split_list::SplitList;

use object::{Job, jobs};
use store::Store;

/// What [`generate`] did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Generated {
    /// Objects of this share that are there now, in their order; all of them unless it was stopped.
    pub objects: Vec<ObjectInfo>,
    /// Objects that were made.
    pub made: usize,
    /// Objects that were there already.
    pub skipped: usize,
    /// Objects that this share has, of the dataset.
    pub total: usize,
    /// Whether it came to its end.
    pub ended: Ended,
    /// Whether the whole dataset is there: of a share, whether the others were done before.
    pub complete: bool,
}

/// Makes a dataset in a folder, or goes on with one that was begun there.
///
/// With models, the objects are these meshes instead of those of the families. `watch` hears how many views are done, of how
/// many. Once it is [cancelled](train::progress::Cancel), what is being drawn is finished, and the rest is left for the next run.
///
/// # Errors
/// Values out of their range; a folder of another dataset or of something else; a model whose
/// faces are wrong, or that is nothing that 3D-R2N2's cameras stand around; files that cannot be written.
///
/// # Cost
/// Dominated by drawing: about 5 ms per core for a view of 137 x 137. Memory: the images of one
/// object per thread, of fewer objects where that is more than 16 GB.
pub fn generate(
    config: &GenerateConfig,
    models: &[Model],
    folder: &Path,
    watch: &mut Watch<'_>,
) -> Result<Generated, GenerateError> {
    generate_shard(config, models, Shard::WHOLE, folder, watch)
}

/// [`generate`] for one of several processes, on one machine or more, that make a dataset in one folder together: each makes
/// its share of the objects, and the last to end writes the files of the whole. The bytes are those of one process. One that
/// was stopped or killed is taken up by running it again.
///
/// # Errors
/// As [`generate`]; also if another process is at this share, or at the whole.
pub fn generate_shard(
    config: &GenerateConfig,
    models: &[Model],
    shard: Shard,
    folder: &Path,
    watch: &mut Watch<'_>,
) -> Result<Generated, GenerateError> {
    let wrong = config.check();
    if !wrong.is_empty() {
        return Err(GenerateError::Config(wrong));
    }
    if config.cameras == CameraSet::R2n2 {
        let unfit = models.iter().find_map(|model| Some((model, model.unfit_for_r2n2()?)));
        if let Some((Model { category, name, .. }, reach)) = unfit {
            return Err(GenerateError::Reach { object: format!("{category}/{name}"), reach });
        }
    }
    let begun = Instant::now();
    let store = Store::open(folder, config, models, shard)?;
    let all = jobs(config, models);
    let own = all.iter().enumerate().filter(|(k, _)| shard.has(*k));
    let jobs: Vec<&Job<'_>> = own.map(|(_, job)| job).collect();
    let total = (jobs.len() * config.views) as u64;
    let facts = [("objects", jobs.len() as f64)].into();
    watch.tell(&Event::Started { job: "generate", total, done: 0, facts });
    let cancel = watch.cancel();
    let (failed, skipped) = (AtomicBool::new(false), AtomicUsize::new(0));
    // Counted and told under one lock: whoever hears it hears it in order.
    let told = Mutex::new((0, watch));
    let advance = |views: usize| {
        let mut told = told.lock().unwrap_or_else(PoisonError::into_inner);
        let (done, watch) = &mut *told;
        *done += views as u64;
        watch.tell(&Event::Progress { done: *done, total, text: String::new() });
    };
    let make = |job: &&Job<'_>| -> Result<Option<ObjectInfo>, GenerateError> {
        if failed.load(Ordering::Relaxed) || cancel.is_cancelled() {
            return Ok(None);
        }
        if let Some(info) = store.find(job) {
            skipped.fetch_add(1, Ordering::Relaxed);
            advance(config.views);
            return Ok(Some(info));
        }
        // A fault ends the run: what others would still draw is not wanted.
        let made = job.make(config, &|_, _| advance(1)).map_err(GenerateError::from);
        let put = made.and_then(|made| store.put(made, config));
        if put.is_err() {
            failed.store(true, Ordering::Relaxed);
        }
        put.map(Some)
    };
    // Each thread holds the images of an object: of large ones there may be fewer at a time than threads.
    let batches = jobs.chunks(config.objects_at_once());
    let results = batches.flat_map(|batch| batch.par_iter().map(make).collect::<Vec<_>>());
    let found = results.collect::<Result<Vec<_>, _>>();
    // What was being written when it failed would only take the room.
    let found = found.inspect_err(|_| store.clear())?;
    let objects: Vec<ObjectInfo> = found.into_iter().flatten().collect();
    let skipped = skipped.into_inner();
    let ended = Ended::early(objects.len() < jobs.len());
    let complete = ended == Ended::Completed && finished(&store, config, &all)?;
    store.clear();
    let made = objects.len() - skipped;
    let (done, watch) = told.into_inner().unwrap_or_else(PoisonError::into_inner);
    watch.tell(&Event::Finished { ended, done, seconds: begun.elapsed().as_secs_f64() });
    Ok(Generated { objects, made, skipped, total: jobs.len(), ended, complete })
}

/// Writes the files of the whole dataset if all of its objects are there; whether they are.
fn finished(
    store: &Store,
    config: &GenerateConfig,
    all: &[Job<'_>],
) -> Result<bool, GenerateError> {
    // Of several processes that end at once all may find it whole: they write the same.
    let whole: Option<Vec<ObjectInfo>> = all.iter().map(|job| store.find(job)).collect();
    let Some(whole) = whole else { return Ok(false) };
    let drawn = splits::of(config, &whole).into_iter().zip(all);
    let subsets: Vec<_> = drawn.map(|(drawn, job)| job.of.subset().unwrap_or(drawn)).collect();
    store.finish(&whole, &subsets, &sheet::draw(config, all)?)?;
    Ok(true)
}
