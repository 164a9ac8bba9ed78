//! `unsphere data validate`: every fault of every object.

use std::fmt::Write as _;
use std::path::Path;

use datasets::{Fault, validate};
use serde::Serialize;

use crate::args::Validate;
use crate::console::Console;
use crate::failure::Failure;
use crate::progress::Progress;
use train::report::counted;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Validated<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    path: &'a Path,
    layout: Option<String>,
    objects: usize,
    views: usize,
    faults: Vec<Fault>,
    warnings: Vec<Fault>,
}

pub(crate) fn run(console: Console, arguments: &Validate) -> Result<(), Failure> {
    let (path, options) = (arguments.path.as_path(), arguments.reading.options());
    let progress = Progress::new(console, "read");
    let validated = match datasets::open_with(path, &options) {
        Err(error) => {
            let fault = Fault::of_dataset(&error);
            let (faults, warnings) = (vec![fault], Vec::new());
            Validated { path, layout: None, objects: 0, views: 0, faults, warnings }
        }
        Ok(dataset) => {
            let found = validate(dataset.as_ref(), &options, &|done, all| progress.set(done, all))?;
            Validated {
                path,
                layout: Some(dataset.layout().to_string()),
                objects: found.objects,
                views: found.views,
                faults: found.faults,
                warnings: found.warnings,
            }
        }
    };
    progress.finish();
    console.result(&validated, describe)?;
    match validated.faults.len() {
        0 => Ok(()),
        n => Err(Failure::Input(format!("{}: {}", path.display(), counted(n, "fault")))),
    }
}

fn describe(validated: &Validated<'_>) -> String {
    let layout = validated.layout.as_deref().unwrap_or("unknown layout");
    let mut text = format!(
        "{}: {layout}, {}, {} read, {}\n",
        validated.path.display(),
        counted(validated.objects, "object"),
        counted(validated.views, "view"),
        counted(validated.faults.len(), "fault")
    );
    for (word, list) in [("fault", &validated.faults), ("warning", &validated.warnings)] {
        for fault in list {
            let of =
                if fault.object.is_empty() { String::new() } else { format!("{}: ", fault.object) };
            let _ = writeln!(text, "  {word}: {of}{}", fault.message);
        }
    }
    text
}
