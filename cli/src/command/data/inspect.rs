//! `unsphere data inspect`: what is there, and what looks wrong with it.

use std::fmt::Write as _;
use std::path::PathBuf;

use recon::inspect::{Inspection, inspect, write_report};
use serde::Serialize;
use train::output::OutputFolder;
use train::report::counted;

use crate::args::{Inspect, create};
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::progress::Progress;
use crate::provenance::typed_command;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Inspected<'a> {
    /// The folder of the report, where one was asked for.
    #[serde(serialize_with = "train::path_text::serialize_optional")]
    output: Option<PathBuf>,
    #[serde(flatten)]
    inspection: &'a Inspection,
}

pub(crate) fn run(console: Console, arguments: &Inspect) -> Result<(), Failure> {
    let wanted = arguments.output.folder.as_ref();
    if wanted.is_none() && arguments.output.force {
        let text = "--force replaces a folder: it goes with -o, without which none is written";
        return Err(Failure::Usage(text.to_owned()));
    }
    let folder = wanted.map(|path| create(path, arguments.output.force)).transpose()?;
    // Nothing is kept of what is not finished.
    let _interrupt = Interrupt::listen(folder.as_ref().map(OutputFolder::unfinished))?;
    let options = arguments.reading.options();
    let dataset = datasets::open_with(&arguments.path, &options)?;
    let progress = Progress::new(console, "inspect");
    let inspection =
        inspect(dataset.as_ref(), arguments.objects as usize, &options, &|done, all| {
            progress.set(done, all);
        })?;
    progress.finish();
    let mut output = None;
    if let Some(folder) = folder {
        write_report(&inspection, &typed_command(), &folder)?;
        output = Some(folder.commit()?);
    }
    let inspected = Inspected { output, inspection: &inspection };
    console.result(&inspected, describe)
}

fn describe(inspected: &Inspected<'_>) -> String {
    let Inspected { output, inspection } = inspected;
    let mut text = format!("{}: {}\n", inspection.path.display(), inspection.summary());
    let count = |c: &recon::inspect::Count| {
        format!("  {}: {}, {}\n", c.name, counted(c.objects, "object"), counted(c.views, "view"))
    };
    if inspection.categories.len() > 1 {
        text.extend(inspection.categories.iter().map(count));
    }
    text.extend(inspection.subsets.iter().map(count));
    for warning in &inspection.warnings {
        let _ = writeln!(text, "  warning: {warning}");
    }
    for object in &inspection.looked_at {
        let _ = writeln!(text, "{}", object.title());
        for line in table(object.rows()).lines() {
            let _ = writeln!(text, "  {line}");
        }
        for warning in &object.warnings {
            let _ = writeln!(text, "  warning: {warning}");
        }
        for problem in &object.problems {
            let _ = writeln!(text, "  problem: {}", problem.message);
        }
    }
    match output {
        Some(folder) => text + &format!("{}\n", folder.join("report.html").display()),
        None => text + "-o FOLDER writes a page with the views and the cameras\n",
    }
}
