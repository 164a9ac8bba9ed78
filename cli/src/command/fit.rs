//! `unsphere fit`: views of one object in, a mesh with its report out.

use std::path::{Path, PathBuf};
use std::time::Instant;

use datasets::{ReadOptions, Views};
use mesh_core::{ByteImage, UpAxis};
use recon::delivery::{DeliverError, Delivery, Metrics, deliver, holes};
use recon::evaluate::ViewScores;
use recon::fit::{
    ColorKind, FitConfig, FitError, Fitted, PhotoConsistency, Quality, RefinedCameras, fit,
    unused_detail,
};
use recon::progress::Event;
use recon::verdict::{Grade, assess};
use serde::Serialize;
use train::output::OutputFolder;
use train::report::counted;
use train::settings;

use crate::args::{Configuration, Fit, Global};
use crate::command::batch;
use crate::command::metrics::describe as describe_comparison;
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::memory;
use crate::progress::Progress;
use crate::provenance::{facts, typed_command};
use crate::truth::{Truth, is_fixed};
use crate::views::{
    add_scored, around_the_object, diagnosis, diagnosis_beside, read_views, up_axis,
};

/// Where the results go when nothing is said.
pub(crate) const FOLDER: &str = "unsphere-fit";

/// The answer to Ctrl-C.
const STOPPING: &str = "stopping: colours and writes what there is; Ctrl-C again drops it";

/// What is printed with `--json`: `metrics.json`, and where and how fast it was made.
#[derive(Debug, Serialize)]
struct Outcome<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    output: &'a Path,
    seconds: f64,
    /// Bytes; none where the system does not tell.
    #[serde(skip_serializing_if = "Option::is_none")]
    peak_memory: Option<u64>,
    metrics: &'a Metrics,
}

/// A fit that is written.
pub(crate) struct Finished {
    pub(crate) output: PathBuf,
    pub(crate) seconds: f64,
    pub(crate) metrics: Metrics,
    /// How many views it was fitted to, of how many.
    fitted: usize,
    views: usize,
    /// What would make it better, if something would.
    finer: Option<String>,
}

/// One fit from its views to its folder; `demo` does the same with views of its own.
pub(crate) struct Job<'a> {
    pub(crate) title: &'a str,
    pub(crate) views: Views,
    /// How they were read.
    pub(crate) reading: &'a ReadOptions,
    pub(crate) config: &'a FitConfig,
    pub(crate) truth: Option<&'a Truth>,
    pub(crate) up: UpAxis,
    pub(crate) folder: OutputFolder,
    pub(crate) interrupt: Interrupt,
    /// Its name, where it is one of a list.
    pub(crate) listed: Option<&'a str>,
    /// Whether a doubtful fit is an error.
    pub(crate) strict: bool,
    /// When the command began.
    pub(crate) start: Instant,
}

pub(crate) fn run(console: Console, global: Global, arguments: &Fit) -> Result<(), Failure> {
    if let Some(list) = &arguments.batch {
        return batch::run(console, global, arguments, list);
    }
    if arguments.shard.is_some() {
        return Err(Failure::Usage("--shard is a part of a list: it goes with --batch".to_owned()));
    }
    let start = Instant::now();
    let path = arguments.views.as_ref().expect("clap wants views or a batch");
    let config = configuration(&arguments.configuration, global)?;
    let folder = arguments.output.create(FOLDER)?;
    let interrupt = Interrupt::listen(Some(folder.unfinished()))?;
    let truth = arguments.truth.as_ref().map(|path| Truth::read(console, path)).transpose()?;
    let reading = around_the_object(&arguments.reading);
    let mut views = read_views(console, path, &reading)?;
    if let Some(others) = &arguments.score {
        if config.hold_out.is_none() {
            let text =
                "--score holds views out, and hold-out = none fits all: leave one of them away";
            return Err(Failure::Usage(text.to_owned()));
        }
        add_scored(console, &mut views, others, &reading)?;
    }
    views.warnings.iter().for_each(|warning| console.warn(warning));
    let name = path.file_stem().unwrap_or(path.as_os_str());
    let title = name.to_string_lossy();
    let truth = truth.as_ref();
    let up = up_axis(console, arguments.up, &views);
    let strict = arguments.strict;
    let (config, title, listed, reading) = (&config, &*title, None, &reading);
    Job { title, views, reading, config, truth, up, folder, interrupt, listed, strict, start }
        .run(console)
}

/// The configuration that the command line asks for, checked.
pub(crate) fn configuration(
    arguments: &Configuration,
    global: Global,
) -> Result<FitConfig, Failure> {
    let mut config: FitConfig = match arguments.quality {
        Some(quality) => {
            let name = format!("quality {}", quality.name());
            settings::read_text(Path::new(&name), quality.toml(), &arguments.set)?
        }
        None => settings::read(arguments.config.as_deref(), &arguments.set)?,
    };
    if let Some(seed) = global.seed {
        config.seed = seed;
    }
    let problems = config.check();
    if problems.is_empty() {
        return Ok(config);
    }
    let text = problems.join("; ");
    Err(match &arguments.config {
        Some(path) if arguments.set.is_empty() => {
            Failure::Input(format!("{}: {text}", path.display()))
        }
        _ => Failure::Usage(text),
    })
}

impl Job<'_> {
    /// Fits, scores, writes and prints. Ctrl-C ends the fit early; what there is is written.
    pub(crate) fn run(self, console: Console) -> Result<(), Failure> {
        self.interrupt.worthwhile_saying(STOPPING);
        let strict = self.strict;
        let Finished { output, seconds, metrics, fitted, views, finer } =
            self.finish(console, false)?;
        let peak_memory = memory::peak();
        let outcome = Outcome { output: &output, seconds, peak_memory, metrics: &metrics };
        console.result(&outcome, |outcome| describe(outcome, [fitted, views]))?;
        if metrics.interrupted {
            let text = format!("the mesh in {} is what there was by then", output.display());
            return Err(Failure::Interrupted(text));
        }
        if let Some(text) = finer {
            console.remark(text);
        }
        refused(metrics.verdict.grade, strict).map_or(Ok(()), |word| {
            let text = format!("the fit is {word}: {}", metrics.verdict.reasons.join("; "));
            Err(Failure::Other(format!("{text}; the mesh is in {}", output.display())))
        })
    }

    /// Fits, scores and writes. What Ctrl-C ended early is written too, unless only what is `whole` counts.
    pub(crate) fn finish(mut self, console: Console, whole: bool) -> Result<Finished, Failure> {
        let mut fitted = self.fit(console)?;
        if whole && fitted.ended.is_cancelled() {
            return Err(Failure::Interrupted("it was not finished".to_owned()));
        }
        tell(console, &fitted);
        let progress = Progress::new(console.unlogged(), "judge");
        let assessment = assess(&self.views, &fitted).map_err(Failure::other)?;
        // Something may be wrong with the input, and then it is looked at whole.
        if assessment.verdict.grade != Grade::Good && !assessment.evidence.is_coherent() {
            for reason in diagnosis_beside(&self.views, self.reading, &assessment.said) {
                console.warn(&reason);
                fitted.warnings.push(reason);
            }
        }
        let fixed = is_fixed(&assessment.evidence);
        let doubt =
            self.truth.and_then(|truth| truth.doubt(&fitted.mesh, fixed, &self.views.source));
        if let Some(doubt) = doubt {
            console.warn(&doubt);
            fitted.warnings.push(doubt);
        }
        let finer = self.finer(&fitted);
        progress.finish();
        if !fitted.held_out_views.is_empty() {
            // Only these are looked at again; the images of the others make room.
            for &i in &fitted.train_views {
                let view = &mut self.views.views[i];
                (view.color, view.mask) = (ByteImage::default(), ByteImage::default());
            }
        }
        let progress = Progress::new(console, "write");
        progress.say("scores, meshes, turntable, report");
        let delivery = Delivery {
            title: self.title,
            command: &typed_command(),
            views: &self.views,
            config: self.config,
            fitted: &fitted,
            assessment: &assessment,
            truth: self.truth.map(|truth| &truth.mesh),
            up: self.up,
            provenance: facts(["unsphere", "threads", "machine"]).into(),
        };
        let metrics = deliver(&delivery, &self.folder).map_err(|error| match error {
            DeliverError::Compare(error) => Failure::Input(format!("the true mesh: {error}")),
            error => Failure::other(error),
        })?;
        let output = self.folder.commit()?;
        progress.finish();
        Ok(Finished {
            output,
            seconds: self.start.elapsed().as_secs_f64(),
            metrics,
            fitted: fitted.train_views.len(),
            views: self.views.len(),
            finer,
        })
    }

    /// Where the images show more than the mesh holds: what would show it.
    fn finer(&self, fitted: &Fitted) -> Option<String> {
        let high = Quality::High.config();
        let is_less = self.config.level < high.level && self.config.color == ColorKind::Vertex;
        let vertices = fitted.mesh.positions.len();
        let pixels = unused_detail(&self.views.views, vertices).filter(|_| is_less)?;
        Some(format!(
            "the images show more than this mesh holds ({pixels:.0} pixels to a vertex): --quality {} fits a finer one, with a texture",
            Quality::High.name()
        ))
    }

    fn fit(&self, console: Console) -> Result<Fitted, Failure> {
        let shown = console.unlogged();
        let progress = Progress::new(shown, "fit");
        let bar = |event: &Event| match event {
            Event::Started { total, facts, .. } => {
                progress.set(0, *total as usize);
                let [views, held_out] =
                    ["views", "held_out"].map(|name| facts.get(name).unwrap_or(0.0));
                if held_out > 0.0 {
                    shown.remark(format_args!(
                        "fitting to {}, {} held out",
                        counted(views as usize, "view"),
                        if held_out == 1.0 { "1 is".to_owned() } else { format!("{held_out} are") }
                    ));
                } else {
                    shown.remark(format_args!(
                        "fitting to all {views} views; none is held out, so scores are on the given views"
                    ));
                }
            }
            Event::Stage { name, facts } => {
                let vertices = facts.get("vertices").unwrap_or(0.0);
                progress.say(&format!("{name}: {vertices} vertices"));
            }
            Event::Step(step) => progress.set(step.step as usize, step.total as usize),
            Event::Evaluated { metrics, .. } => {
                progress.say(&format!("mask IoU {:.4}", metrics[0].value));
            }
            Event::Warned { text } => shown.warn(text),
            _ => {}
        };
        let mut watch = console.watch(&self.interrupt, bar);
        let fitted = match self.listed {
            Some(name) => fit(&self.views, self.config, &mut watch.within(name, None)),
            None => fit(&self.views, self.config, &mut watch),
        };
        fitted.map_err(|error| match error {
            FitError::Config(_) => Failure::Usage(error.to_string()),
            FitError::NotFinite { .. } => Failure::other(error),
            error => {
                let source = self.views.source.display();
                let mut reasons = vec![match error {
                    // None was held out, and none is to be.
                    FitError::TooFewViews { remaining, views, .. } if remaining == views => {
                        format!("found {}, expected at least 2", counted(views, "view"))
                    }
                    _ => error.to_string(),
                }];
                match error {
                    FitError::Placement { .. } => {
                        reasons.extend(diagnosis(&self.views, self.reading));
                    }
                    FitError::TooFewViews { .. } => reasons.push(format!(
                        "one view is enough for a trained system: `unsphere predict img2mesh {source} -o mesh`"
                    )),
                    _ => {}
                }
                Failure::Input(format!("{source}: {}", reasons.join("; ")))
            }
        })
    }
}

/// What was done beside moving the mesh.
fn tell(console: Console, fitted: &Fitted) {
    if let Some(refined) = &fitted.cameras {
        console.remark(format_args!("{}", refined_words(refined)));
    }
    if let Some([least, most]) = fitted.exposure_range() {
        console.remark(format_args!(
            "photographs differ in exposure or white balance, {least:.2} to {most:.2} times the mean: the mesh's colours are \
             those of the mean, and scores of images compare it with each photograph as it is (--set balance-colors=false \
             mixes them as they are)"
        ));
    }
    if let Some(text) = fitted.photo_consistency.map(photo_consistency_words) {
        console.remark(text);
    }
}

/// The word for a verdict that is an error; none where it is not one.
pub(crate) fn refused(grade: Grade, strict: bool) -> Option<&'static str> {
    (grade == Grade::Failed || strict && grade == Grade::Doubtful).then(|| grade.name())
}

/// What photographs say about hollows.
fn photo_consistency_words(found: PhotoConsistency) -> String {
    let PhotoConsistency { before, after, kept } = found;
    if kept {
        format!(
            "the surface was moved to where photographs agree: their correlation is {after:.3} instead of {before:.3}"
        )
    } else {
        format!(
            "the surface stays as outlines made it: moved to where photographs agree, their correlation was {after:.3}, \
             before {before:.3}, which is not enough, or the outlines suffered"
        )
    }
}

/// What was done to the cameras.
fn refined_words(refined: &RefinedCameras) -> String {
    let RefinedCameras { focal, motion, distance: [before, after], .. } = refined;
    let lens = if (focal - 1.0).abs() < 0.002 {
        String::new()
    } else {
        format!(", the focal length is {focal:.3} times the one given")
    };
    format!(
        "cameras were refined: outlines moved by {motion:.2} pixels{lens}; they miss the masks by {after:.2} pixels \
         instead of {before:.2} (--set refine-cameras=false leaves cameras as they are)"
    )
}

/// Mean scores over views.
pub(crate) fn score_rows(scores: &ViewScores) -> Vec<(&'static str, String)> {
    let mut rows = vec![("mask IoU", format!("{:.4}", scores.mask_iou))];
    // Without colours of its own a mesh has no score of them.
    if let Some(psnr) = scores.psnr {
        rows.extend([
            ("PSNR", format!("{psnr:.2} dB")),
            ("image L1", format!("{:.4}", scores.image_l1)),
            ("SSIM", format!("{:.4}", scores.ssim)),
        ]);
    }
    rows
}

fn describe(outcome: &Outcome<'_>, [fitted, views]: [usize; 2]) -> String {
    let metrics = outcome.metrics;
    let scores = &metrics.views;
    let health = &metrics.health;
    let count = scores.views.len();
    let found = metrics.examination();
    let holes = holes(health).map_or_else(String::new, |holes| format!(", {holes}"));
    let mesh = format!("{} vertices, {found}{holes}", health.vertices);
    let mut rows = vec![("verdict", metrics.verdict.grade.name().to_owned())];
    rows.extend(metrics.verdict.reasons.iter().map(|reason| ("", reason.clone())));
    rows.extend(score_rows(scores));
    let located = metrics.cameras.as_ref().and_then(|cameras| cameras.located.as_ref());
    if let Some(located) = located {
        let text =
            format!("mask IoU {:.4} where held-out poses are found anew too", located.mask_iou);
        rows.push(("", text));
    }
    rows.push(("mesh", mesh));
    let (steps, memory) = (counted(metrics.steps, "step"), memory::said(outcome.peak_memory));
    rows.push(("time", format!("{:.1} s, {steps}{memory}", outcome.seconds)));
    rows.push(("output", outcome.output.display().to_string()));
    let (was, count) = (if count == 1 { "was" } else { "were" }, counted(count, "view"));
    let scored = if metrics.scored_on == "fitted" { "fitted" } else { "held out" };
    let mut text = format!(
        "{fitted} of {} fitted; the scores are means over {count} that {was} {scored}\n{}",
        counted(views, "view"),
        table(rows)
    );
    if !metrics.truth.is_empty() {
        text += "\nAgainst the true mesh, as `unsphere metrics` has it:\n";
        text.extend(metrics.truth.iter().map(describe_comparison));
    }
    text
}
