//! `unsphere fit --batch`: many objects, one after another, in as many processes as there are.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use mesh_core::UpAxis;
use recon::fit::FitConfig;
use recon::verdict::Grade;
use serde::Serialize;
use serde_json::{Map, Value};
use train::output::{
    Lock, LockError, OutputError, OutputFolder, disk, lock_folder, remove_within, write_within,
};
use train::report::counted;
use train::{Shard, settings};

use crate::args::{Fit, Global};
use crate::command::fit::{FOLDER, Job, configuration, refused};
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::job_array;
use crate::object_list::{self, ListedObject};
use crate::summary::{PAGE, State, Summary, TABLE, failure_file};
use crate::truth::Truth;
use crate::views::{around_the_object, read_views, up_axis};

/// How the views of all objects are read; in the folder of the batch.
const READING: &str = "reading.json";

/// How long another process may be at the summary before this one gives up.
const PATIENCE: Duration = Duration::from_secs(60);

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Outcome<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    output: &'a Path,
    shard: String,
    #[serde(flatten)]
    counts: Counts,
    #[serde(flatten)]
    summary: &'a Summary,
}

/// What became of the objects that this process tried.
#[derive(Clone, Copy, Debug, Default, Serialize)]
struct Counts {
    fitted: usize,
    /// Those that could not be.
    failed: usize,
    /// Of those that are done, before too, those whose verdict is an error.
    refused: usize,
}

/// A batch under way.
struct Batch<'a> {
    arguments: &'a Fit,
    config: FitConfig,
    folder: PathBuf,
    list: Vec<ListedObject>,
    interrupt: Interrupt,
}

pub(crate) fn run(
    console: Console,
    global: Global,
    arguments: &Fit,
    list: &Path,
) -> Result<(), Failure> {
    let config = configuration(&arguments.configuration, global)?;
    let shard = match arguments.shard {
        Some(shard) => shard,
        None => job_array::task(|name| std::env::var(name).ok())
            .map_err(Failure::Usage)?
            .unwrap_or(Shard::WHOLE),
    };
    let list = object_list::read(list)?;
    let folder = arguments.output.folder.clone().unwrap_or_else(|| PathBuf::from(FOLDER));
    disk::make_folders(&folder)
        .map_err(|source| OutputError::Io { path: folder.clone(), source })?;
    let interrupt = Interrupt::listen(None)?;
    // What is finished is kept, whenever it ends.
    interrupt.worthwhile();
    let batch = Batch { arguments, config, folder, list, interrupt };
    batch.refuse_others_files()?;
    batch.refuse_other_settings()?;
    batch.refuse_other_entries()?;
    batch.refuse_other_reading(console)?;
    let fitted = batch.fit(console, shard);
    // Of what is finished, also where the rest was stopped.
    let summary = batch.summarise(console)?;
    let counts = fitted?;
    let outcome =
        Outcome { output: &batch.folder, shard: shard.to_string(), counts, summary: &summary };
    console.result(&outcome, describe)?;
    let Counts { failed, refused, .. } = counts;
    let problems = [
        (failed, format!("{} could not be fitted", objects(failed))),
        (refused, format!("the verdict on {} is an error", objects(refused))),
    ];
    let said: Vec<String> = problems.into_iter().filter(|p| p.0 > 0).map(|p| p.1).collect();
    if said.is_empty() {
        return Ok(());
    }
    let place = batch.folder.join(PAGE);
    Err(Failure::Other(format!("{}; {} says why", said.join(", and "), place.display())))
}

/// Whether a folder holds a fit: not a training, say, which has a `config.toml` of its own.
fn is_fit(place: &Path) -> bool {
    let path = place.join("config.toml");
    std::fs::read_to_string(&path)
        .is_ok_and(|text| settings::read_text::<FitConfig>(&path, &text, &[]).is_ok())
}

fn objects(count: usize) -> String {
    counted(count, "object")
}

impl Batch<'_> {
    fn place(&self, object: &ListedObject) -> PathBuf {
        self.folder.join(&object.name)
    }

    fn is_done(&self, object: &ListedObject) -> bool {
        self.place(object).join("metrics.json").is_file()
    }

    /// What was made of an object.
    fn metrics(&self, object: &ListedObject) -> Option<Value> {
        let text = std::fs::read(self.place(object).join("metrics.json")).ok()?;
        serde_json::from_slice(&text).ok()
    }

    /// What no batch has written stays: the page and the table of something else, and folders in which there is no fit.
    fn refuse_others_files(&self) -> Result<(), Failure> {
        if self.arguments.output.force {
            return Ok(());
        }
        let is_begun = self.folder.join(READING).exists()
            || self.list.iter().any(|object| self.is_done(object));
        let pages = [PAGE, TABLE].map(|name| self.folder.join(name));
        let mut others: Vec<PathBuf> =
            pages.into_iter().filter(|path| !is_begun && path.exists()).collect();
        let is_others = |place: &PathBuf| {
            let is_empty = std::fs::read_dir(place).is_ok_and(|mut files| files.next().is_none());
            place.exists() && !is_empty && !is_fit(place)
        };
        others.extend(self.list.iter().map(|object| self.place(object)).filter(is_others));
        let Some(path) = others.first() else { return Ok(()) };
        Err(Failure::Usage(format!(
            "{} exists already, and no batch has written it; choose another folder, or allow overwriting (--force)",
            path.display()
        )))
    }

    /// What an object that is done was compared with, and what was up, must be what is asked now.
    fn refuse_other_entries(&self) -> Result<(), Failure> {
        for object in self.list.iter().filter(|_| !self.arguments.output.force) {
            let Some(metrics) = self.metrics(object) else { continue };
            let known = |found: bool| if found { "a true mesh" } else { "none" };
            let was = metrics["truth"].as_array().is_some_and(|scores| !scores.is_empty());
            let up = self.arguments.up.map(UpAxis::name);
            let other = if was != object.truth.is_some() {
                format!("compared with {}, now the list has {}", known(was), known(!was))
            } else if let Some(up) = up.filter(|up| metrics["up"] != *up) {
                format!("made with {} up, now it is {up}", metrics["up"])
            } else {
                continue;
            };
            return Err(Failure::Usage(format!(
                "{} was {other}; choose another folder, or make all again (--force)",
                self.place(object).display()
            )));
        }
        Ok(())
    }

    /// Whether the verdict on an object that is done is an error: the same answer however often it is asked.
    fn is_refused(&self, object: &ListedObject) -> bool {
        let Some(metrics) = self.metrics(object) else { return false };
        let grades = [Grade::Good, Grade::Doubtful, Grade::Failed];
        let grade = grades.into_iter().find(|g| metrics["verdict"]["grade"] == g.name());
        grade.is_some_and(|grade| refused(grade, self.arguments.strict).is_some())
    }

    /// What stands there must have been made as it would be now, or the table would mix two kinds of figures.
    fn refuse_other_settings(&self) -> Result<(), Failure> {
        let own = settings::to_toml(&self.config);
        for object in self.list.iter().filter(|object| self.is_done(object)) {
            let path = self.place(object).join("config.toml");
            let other = std::fs::read_to_string(&path).unwrap_or_default();
            if other != own && !self.arguments.output.force {
                return Err(Failure::Usage(format!(
                    "{} has other settings than are asked for now; choose another folder, or make all again (--force)",
                    path.display()
                )));
            }
        }
        Ok(())
    }

    /// The same for how views are read, which the folder keeps beside its objects.
    fn refuse_other_reading(&self, console: Console) -> Result<(), Failure> {
        // The tasks of an array begin at once, and all write it.
        let _lock = self.lock(console)?;
        let asked = around_the_object(&self.arguments.reading);
        // A path that is no text cannot be kept, and is not compared.
        let Ok(mut asked) = serde_json::to_value(&asked) else { return Ok(()) };
        asked["up"] = self.arguments.up.map_or("auto", UpAxis::name).into();
        let asked = format!("{asked:#}");
        // An earlier version did not keep it.
        let found = std::fs::read_to_string(self.folder.join(READING)).unwrap_or_default();
        let is_begun = self.list.iter().any(|object| self.is_done(object));
        if let Some((key, was, is)) = first_difference(&found, &asked)
            && is_begun
            && !self.arguments.output.force
        {
            return Err(Failure::Usage(format!(
                "{}: the views were read with `{key}` {was}, now it is {is}; choose another folder, or make all again (--force)",
                self.folder.join(READING).display()
            )));
        }
        if found == asked { Ok(()) } else { self.note(READING, asked.as_bytes()) }
    }

    /// Fits what is missing of a shard.
    fn fit(&self, console: Console, shard: Shard) -> Result<Counts, Failure> {
        let own: Vec<&ListedObject> =
            self.list.iter().enumerate().filter(|(k, _)| shard.has(*k)).map(|(_, o)| o).collect();
        let mut counts = Counts::default();
        for (k, object) in own.iter().enumerate() {
            let place = format!("{} of {}, {}", k + 1, own.len(), object.name);
            if self.is_done(object) && !self.arguments.output.force {
                // What a process left that was killed at its very end goes when the place is taken and given back.
                drop(OutputFolder::create(&self.place(object), true));
                console.remark(format_args!("{place}: is done"));
                counts.refused += usize::from(self.is_refused(object));
                continue;
            }
            if self.interrupt.is_pressed() {
                return Err(self.interrupted());
            }
            match self.object(console, object, &place) {
                Ok(passes) => {
                    counts.fitted += 1;
                    counts.refused += usize::from(!passes);
                }
                // One that another process is at, is that process's.
                Err(Failed::Busy(text)) => console.remark(format_args!("{place}: {text}")),
                Err(Failed::Whole(failure)) => return Err(failure),
                Err(Failed::Object(text)) => {
                    counts.failed += 1;
                    console.warn(format_args!("{place}: {text}"));
                    self.note(&failure_file(&object.name), text.as_bytes())?;
                }
            }
        }
        Ok(counts)
    }

    fn interrupted(&self) -> Failure {
        let text =
            format!("what is finished is in {}; the same command goes on", self.folder.display());
        Failure::Interrupted(text)
    }

    /// Whether the mesh is one that the verdict lets pass.
    fn object(&self, console: Console, object: &ListedObject, place: &str) -> Result<bool, Failed> {
        let start = Instant::now();
        // What a process that was killed left is swept by the folder.
        let target = self.place(object);
        let folder = match OutputFolder::create(&target, target.exists()) {
            Ok(folder) => folder,
            Err(error @ OutputError::Busy { .. }) => return Err(Failed::Busy(error.to_string())),
            Err(error) => return Err(Failed::Whole(error.into())),
        };
        // What is made again is not done until it is.
        remove_within(&target, &["metrics.json"]).map_err(|(path, error)| {
            Failed::Whole(Failure::Other(format!("{}: {error}", path.display())))
        })?;
        // Each line of an object would drown those of the others.
        let silent = Console { quiet: true, ..console };
        let reading = around_the_object(&self.arguments.reading);
        let read = || -> Result<_, Failure> {
            let truth = object.truth.as_ref().map(|path| Truth::read(silent, path)).transpose()?;
            let views = read_views(silent, &object.views, &reading)?;
            Ok((truth, views))
        };
        let (truth, views) = read().map_err(Failed::of)?;
        let up = up_axis(silent, self.arguments.up, &views);
        let job = Job {
            title: &object.name,
            views,
            reading: &reading,
            config: &self.config,
            truth: truth.as_ref(),
            up,
            folder,
            interrupt: self.interrupt.clone(),
            listed: Some(&object.name),
            strict: self.arguments.strict,
            start,
        };
        let finished = job.finish(silent, true).map_err(|failure| match failure {
            Failure::Interrupted(_) => Failed::Whole(self.interrupted()),
            failure => Failed::of(failure),
        })?;
        // It may have failed before.
        let _ = std::fs::remove_file(self.folder.join(failure_file(&object.name)));
        console.remark(format_args!(
            "{place}: {}, mask IoU {:.4}, {:.1} s",
            finished.metrics.verdict.grade, finished.metrics.views.mask_iou, finished.seconds
        ));
        Ok(refused(finished.metrics.verdict.grade, self.arguments.strict).is_none())
    }

    /// Writes table and page of all that is there, by whichever process it was made: the last one to end writes all of it.
    fn summarise(&self, console: Console) -> Result<Summary, Failure> {
        let lock = self.lock(console)?;
        let summary = Summary::of(&self.list, &self.folder);
        if lock.is_some() {
            self.note(TABLE, summary.csv().as_bytes())?;
            self.note(PAGE, summary.html().as_bytes())?;
        }
        Ok(summary)
    }

    /// The folder's own files for this process alone; nothing where another has them for too long.
    fn lock(&self, console: Console) -> Result<Option<Lock>, Failure> {
        let start = Instant::now();
        loop {
            match lock_folder(&self.folder) {
                Ok(lock) => return Ok(Some(lock)),
                Err(LockError::Io(error)) => {
                    let path = self.folder.display();
                    return Err(Failure::Other(format!("cannot lock {path}: {error}")));
                }
                Err(LockError::Busy(holder)) if start.elapsed() > PATIENCE => {
                    console.warn(format_args!(
                        "{holder} holds the summary; the same command writes it anew"
                    ));
                    return Ok(None);
                }
                Err(LockError::Busy(_)) => std::thread::sleep(Duration::from_millis(50)),
            }
        }
    }

    fn note(&self, name: &str, bytes: &[u8]) -> Result<(), Failure> {
        write_within(&self.folder, name, bytes)
            .map_err(|(path, error)| Failure::Other(format!("{}: {error}", path.display())))
    }
}

/// The first option that two texts of [`READING`] both have and have otherwise: its name and both values.
fn first_difference(found: &str, asked: &str) -> Option<(String, Value, Value)> {
    let [found, asked] = [found, asked].map(serde_json::from_str::<Map<String, Value>>);
    let (mut found, asked) = (found.ok()?, asked.ok()?);
    asked.into_iter().find_map(|(key, is)| {
        let was = found.remove(&key)?;
        (was != is).then_some((key, was, is))
    })
}

/// Why an object was not fitted.
enum Failed {
    /// Another process is at it.
    Busy(String),
    /// It cannot be; the others may.
    Object(String),
    /// Nothing can go on.
    Whole(Failure),
}

impl Failed {
    fn of(failure: Failure) -> Self {
        match failure {
            Failure::Input(text) | Failure::Other(text) => Self::Object(text),
            failure => Self::Whole(failure),
        }
    }
}

fn describe(outcome: &Outcome<'_>) -> String {
    let summary = outcome.summary;
    let counts = [State::Done, State::Failed, State::Waiting].map(|state| summary.count(state));
    let [done, failed, waiting] = counts;
    let mut rows = summary.means();
    rows.push(("output", outcome.output.display().to_string()));
    format!(
        "{}: {done} done, {failed} failed, {waiting} waiting; the figures are means over what is done\n{}",
        objects(summary.objects.len()),
        table(rows)
    )
}
