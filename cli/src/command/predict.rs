//! `unsphere predict`: views in, a mesh by a trained system out.

use std::path::Path;
use std::time::Instant;

use models::predict::{
    Choice, Delivery, Familiarity, Metrics, Predictor, Request, deliver, milliseconds, refined,
    solidified,
};
use recon::delivery::holes;
use serde::Serialize;
use train::Checkpoint;
use train::report::counted;

use crate::args::Predict;
use crate::checkpoint::checkpoint_path;
use crate::command::fit::score_rows;
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::memory;
use crate::progress::Progress;
use crate::provenance::{facts, typed_command};
use crate::weights;

/// Where the results go when nothing is said.
const FOLDER: &str = "unsphere-predict";

/// How often a prediction is timed where somebody asks.
const TIMED: usize = 5;

/// What is printed with `--json`: `metrics.json`, and where it is.
#[derive(Debug, Serialize)]
struct Outcome<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    output: &'a Path,
    /// Of the whole command.
    seconds: f64,
    /// Bytes; none where the system does not tell.
    #[serde(skip_serializing_if = "Option::is_none")]
    peak_memory: Option<u64>,
    metrics: &'a Metrics,
}

pub(crate) fn run<S: Predictor>(console: Console, arguments: &Predict) -> Result<(), Failure> {
    let start = Instant::now();
    let found = match &arguments.checkpoint {
        Some(path) => checkpoint_path::<S>(path, arguments.last)?,
        None => weights::shipped::<S>(arguments.weights_dir.as_deref())?,
    };
    if arguments.checkpoint.is_none() {
        console.remark(format_args!("with the weights of {}", found.file.display()));
    }
    let folder = arguments.output.create(FOLDER)?;
    let _interrupt = Interrupt::listen(Some(folder.unfinished()))?;
    let checkpoint = Checkpoint::read(&found.file).map_err(Failure::input)?;
    let (system, _) = checkpoint.load::<S>().map_err(Failure::input)?;
    let familiarity = Familiarity::of(&checkpoint).map_err(Failure::input)?;
    let progress = Progress::new(console, "read");
    let request = Request {
        path: &arguments.views,
        options: arguments.reading.options(),
        choice: choice(arguments),
        score: arguments.score.as_deref(),
        depth: arguments.depth.as_deref(),
        intrinsics: intrinsics(&arguments.intrinsics)?,
        progress: &|done, all| progress.set(done, all),
    };
    let input = system.load(&request).map_err(Failure::input)?;
    progress.finish();
    input.warnings.iter().for_each(|warning| console.warn(warning));
    let progress = Progress::new(console, "predict");
    let refused = |error| Failure::Input(format!("{}: {error}", input.source.display()));
    let steps = arguments.refine.map_or(S::REFINE, |steps| steps as usize);
    let prediction = system.apply(&input).map_err(refused)?;
    let judged = familiarity.map(|known| known.judge(&prediction.features)).transpose();
    let mut prediction = refined(prediction, &input, &S::refinement(steps)).map_err(refused)?;
    if arguments.solid {
        prediction = solidified(prediction).map_err(refused)?;
    }
    let time = || milliseconds(&system, &input, TIMED).map_err(refused);
    let milliseconds = arguments.time.then(time).transpose()?;
    progress.say("scores, meshes, turntable, report");
    let delivery = Delivery {
        checkpoint: found.file.display().to_string(),
        steps: checkpoint.step().map_err(Failure::input)?,
        familiarity: judged.map_err(Failure::input)?,
        milliseconds,
        command: typed_command(),
        provenance: facts(["unsphere", "threads", "processor", "machine"]).into(),
        ..Delivery::new(S::NAME, &input, &prediction)
    };
    let metrics = deliver(&delivery, &folder).map_err(Failure::other)?;
    let output = folder.commit()?;
    progress.finish();
    let said = input.warnings.len();
    metrics.warnings.iter().skip(said).for_each(|warning| console.warn(warning));
    let (seconds, peak_memory) = (start.elapsed().as_secs_f64(), memory::peak());
    console.result(&Outcome { output: &output, seconds, peak_memory, metrics: &metrics }, describe)
}

fn intrinsics(numbers: &[f64]) -> Result<Option<[f64; 4]>, Failure> {
    match *numbers {
        [] => Ok(None),
        [fx, fy, cx, cy] => Ok(Some([fx, fy, cx, cy])),
        _ => {
            let found = numbers.len();
            Err(Failure::Usage(format!(
                "--intrinsics: found {}, expected four",
                counted(found, "number")
            )))
        }
    }
}

fn choice(arguments: &Predict) -> Choice<'_> {
    match (arguments.first, arguments.given.as_slice()) {
        (Some(count), _) => Choice::First(count as usize),
        (None, []) => Choice::All,
        (None, names) => Choice::Named(names),
    }
}

fn describe(outcome: &Outcome<'_>) -> String {
    let metrics = outcome.metrics;
    let given = metrics.given.views.len();
    let (scores, judged) = match &metrics.held_out {
        Some(scores) => (scores, "cameras that were not given"),
        None if metrics.one_pass.is_some() => {
            (&metrics.given, "cameras that were given, to whose views the mesh was moved")
        }
        None => (&metrics.given, "cameras that were given, for want of others"),
    };
    let parts = holes(&metrics.health).map_or_else(String::new, |parts| format!(", {parts}"));
    let mesh = format!("{} vertices, {}{parts}", metrics.health.vertices, metrics.examination());
    let mut rows = score_rows(scores);
    rows.extend(metrics.one_pass.as_ref().map(|before| {
        let scores = before.held_out.as_ref().unwrap_or(&before.given);
        let psnr = scores.psnr.map_or_else(String::new, |psnr| format!(", {psnr:.2} dB"));
        let crossings = counted(before.self_intersections, "self-intersection");
        let iou = scores.mask_iou;
        let text = format!("mask IoU {iou:.4}{psnr}, {crossings}");
        ("unrefined", text)
    }));
    rows.push(("mesh", mesh));
    rows.extend(metrics.familiarity.map(|known| ("does it know?", known.to_string())));
    rows.push(("checkpoint", format!("{}, step {}", metrics.checkpoint, metrics.steps)));
    rows.extend(metrics.milliseconds.map(|time| ("prediction", format!("{time:.1} ms"))));
    let memory = memory::said(outcome.peak_memory);
    rows.push(("time", format!("{:.1} s{memory}", outcome.seconds)));
    rows.push(("output", outcome.output.display().to_string()));
    let rows = table(rows);
    let count = scores.views.len();
    let judged = if count == 1 {
        judged.replacen("cameras that were", "camera that was", 1)
    } else {
        judged.to_owned()
    };
    let given = counted(given, "view");
    format!("{given} given; the scores are means over {count} {judged}\n{rows}")
}
