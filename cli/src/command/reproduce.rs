//! `unsphere reproduce`: a published table, made again.

use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;
use studies::{
    Event, Order, ReproduceError, Reproduced, Scale, Study, StudyError, reproduce, studies,
};
use train::TrainError;

use crate::args::{Global, Reproduce};
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::progress::Progress;
use crate::provenance::provenance;

/// Steps of the progress bar in a job.
const TICKS: usize = 1000;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Outcome<'a> {
    study: &'static str,
    scale: Scale,
    output: &'a Path,
    #[serde(flatten)]
    made: &'a Reproduced,
}

/// What is printed of a study by `--list --json`.
#[derive(Debug, Serialize)]
struct Known {
    name: &'static str,
    about: &'static str,
}

pub(crate) fn run(console: Console, global: Global, arguments: &Reproduce) -> Result<(), Failure> {
    if arguments.list {
        return list(console);
    }
    let names = studies().map(Study::name).collect::<Vec<_>>().join(", ");
    let Some(name) = &arguments.name else {
        let text =
            format!("no study is named, expected one of: {names} (--list says what they show)");
        return Err(Failure::Usage(text));
    };
    let Some(study) = studies().find(|study| study.name() == name) else {
        return Err(Failure::Usage(format!("{name}: no such study, expected one of: {names}")));
    };
    make(console, global, arguments, study)
}

fn list(console: Console) -> Result<(), Failure> {
    let known: Vec<Known> = studies().map(|s| Known { name: s.name(), about: s.about() }).collect();
    console.result(&known, |known| table(known.iter().map(|s| (s.name, s.about.to_owned()))))
}

fn make(
    console: Console,
    global: Global,
    arguments: &Reproduce,
    study: &'static dyn Study,
) -> Result<(), Failure> {
    let scale = if arguments.quick { Scale::Quick } else { Scale::Full };
    let out = arguments.output.clone().unwrap_or_else(|| {
        let quick = if arguments.quick { "-quick" } else { "" };
        format!("reproduce-{}{quick}", study.name()).into()
    });
    let base = global.seed.unwrap_or(0);
    let order = Order {
        scale,
        seeds: (0..u64::from(arguments.seeds)).map(|k| base.saturating_add(k)).collect(),
        data: arguments.data.as_deref(),
        force: arguments.force,
        provenance: provenance(arguments.data.as_deref()),
    };
    let interrupt = Interrupt::listen(None)?;
    interrupt.worthwhile();
    let progress = Progress::in_shares(console, study.name());
    let mut watch = |event: Event| {
        match event {
            Event::Started { jobs, kept } => {
                progress.set(kept * TICKS, jobs * TICKS);
                if kept > 0 {
                    console.remark(format_args!("{kept} of {jobs} jobs were finished before"));
                }
            }
            Event::Working { finished, jobs, job, seed, tick } => {
                let done = (tick.done.clamp(0.0, 1.0) * TICKS as f64) as usize;
                progress.set(finished * TICKS + done, jobs * TICKS);
                let text =
                    format!("job {} of {jobs}, {job}, seed {seed}: {}", finished + 1, tick.text);
                progress.say(&text);
            }
            Event::Finished { job, seed, seconds, .. } => {
                console.remark(format_args!("{job}, seed {seed}: done in {seconds:.1} s"));
            }
            _ => {}
        }
        interrupt.flow()
    };
    let made = reproduce(study, &out, &order, &mut watch).map_err(failed)?;
    progress.finish();
    let outcome = Outcome { study: study.name(), scale, output: &out, made: &made };
    console.result(&outcome, describe)?;
    if made.interrupted {
        let text = format!("what is finished is in {}; the same command goes on", out.display());
        return Err(Failure::Interrupted(text));
    }
    let broken: Vec<&str> =
        made.claims.iter().filter(|claim| !claim.holds).map(|claim| claim.text.as_str()).collect();
    if scale == Scale::Quick && !broken.is_empty() {
        return Err(Failure::Other(format!("does not hold: {}", broken.join("; "))));
    }
    Ok(())
}

fn failed(error: ReproduceError) -> Failure {
    let bad_input = match &error {
        ReproduceError::Damaged { .. } => true,
        ReproduceError::Job { error, .. } => match error {
            StudyError::Data(_) | StudyError::Checkpoint(_) => true,
            StudyError::Train(error) => matches!(**error, TrainError::Data(_)),
            _ => false,
        },
        _ => false,
    };
    if bad_input { Failure::input(error) } else { Failure::other(error) }
}

fn describe(outcome: &Outcome<'_>) -> String {
    let tables = outcome.made.tables.0.iter();
    let mut text: String = tables.map(|table| table.to_text() + "\n").collect();
    for claim in &outcome.made.claims {
        let verdict = if claim.holds { "holds" } else { "DOES NOT HOLD" };
        let _ = writeln!(text, "{verdict}: {} ({})", claim.text, claim.found);
    }
    text + &format!("output: {}\n", outcome.output.display())
}
