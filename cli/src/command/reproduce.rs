//! `unsphere reproduce`: a published table, made again.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::Serialize;
use studies::progress::{Event, Step};
use studies::{
    Cost, Order, ReproduceError, Reproduced, Scale, Seeds, Study, StudyError, Verdict, costs,
    measured, merge, remake, reproduce, studies,
};
use train::TrainError;
use train::report::counted;

use crate::args::{Global, Reproduce, refuse_existing};
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
    #[serde(serialize_with = "train::path_text::serialize")]
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

/// What is printed of a study by `--plan --json`.
#[derive(Debug, Serialize)]
struct Planned {
    study: &'static str,
    rows: Vec<Cost>,
}

/// The name of all studies together.
const ALL: &str = "all";

pub(crate) fn run(console: Console, global: Global, arguments: &Reproduce) -> Result<(), Failure> {
    if arguments.list {
        return list(console);
    }
    let known = studies().map(Study::name).collect::<Vec<_>>().join(", ");
    let names: Vec<&str> = match &arguments.names[..] {
        [] if arguments.plan => vec![ALL],
        [] => {
            let text =
                format!("no study is named, expected one of: {known} (--list says what they show)");
            return Err(Failure::Usage(text));
        }
        names => names.iter().map(String::as_str).collect(),
    };
    let mut chosen: Vec<&'static dyn Study> = Vec::new();
    for name in &names {
        let before = chosen.len();
        let wanted =
            |study: &&dyn Study| study.name() == *name || (*name == ALL && !study.needs_data());
        chosen.extend(studies().filter(wanted));
        if chosen.len() == before {
            let text = format!("{name}: no such study, expected one of: {known}, {ALL}");
            return Err(Failure::Usage(text));
        }
    }
    let order = order(global, arguments);
    if arguments.plan {
        return plan(console, &chosen, &order);
    }
    if let [name] = names[..]
        && name != ALL
    {
        let out = arguments.output.clone().unwrap_or_else(|| folder_of(name, order.scale));
        return one(console, arguments, chosen[0], &order, &out);
    }
    if names.len() > 1 {
        let text = format!(
            "several studies are named; only --plan takes several, and `{ALL}` makes every one"
        );
        return Err(Failure::Usage(text));
    }
    if !arguments.merge.is_empty() || arguments.report.is_some() || !arguments.only.is_empty() {
        let text = "--merge, --report and --only are of one study; name it".to_owned();
        return Err(Failure::Usage(text));
    }
    all(console, arguments, &chosen, &order)
}

/// Every study, one after the other, each in its folder.
fn all(
    console: Console,
    arguments: &Reproduce,
    chosen: &[&'static dyn Study],
    order: &Order<'_>,
) -> Result<(), Failure> {
    console.remark(format_args!("{}", planned(&plans(chosen, order))));
    let root = arguments.output.clone().unwrap_or_else(|| folder_of(ALL, order.scale));
    let interrupt = listen()?;
    let mut failed = Vec::new();
    for study in chosen {
        match make(console, &interrupt, *study, order, &root.join(study.name())) {
            Err(Failure::Other(text)) => failed.push(format!("{}: {text}", study.name())),
            other => other?,
        }
    }
    if failed.is_empty() { Ok(()) } else { Err(Failure::Other(failed.join("\n"))) }
}

fn one(
    console: Console,
    arguments: &Reproduce,
    study: &'static dyn Study,
    order: &Order<'_>,
    out: &Path,
) -> Result<(), Failure> {
    if let Some(from) = &arguments.report {
        remade(console, study, from, out, arguments.force)
    } else if arguments.merge.is_empty() {
        make(console, &listen()?, study, order, out)
    } else {
        merged(console, study, &arguments.merge, order, out)
    }
}

/// Table and page of results that are there.
fn remade(
    console: Console,
    study: &'static dyn Study,
    from: &Path,
    out: &Path,
    force: bool,
) -> Result<(), Failure> {
    // Other results that are there would no longer be those of the page beside them.
    if !is_of(from, out) {
        refuse_existing(&["table.md", "report.html"].map(|name| out.join(name)), force)?;
    }
    let made = remake(study, from, out).map_err(failed)?;
    // Nothing is there that five seeds could be added to.
    tell(console, study, out, &Reproduced { close: Vec::new(), ..made })
}

/// Table and page of what several processes made.
fn merged(
    console: Console,
    study: &'static dyn Study,
    folders: &[PathBuf],
    order: &Order<'_>,
    out: &Path,
) -> Result<(), Failure> {
    let made = merge(study, folders, out, order).map_err(failed)?;
    tell(console, study, out, &made)?;
    if made.left == 0 {
        return Ok(());
    }
    let left = format!(
        "{} missing, and nothing is judged: merge the other shares too, and say --seeds and --seed as they did",
        counted(made.left, "job")
    );
    // An answer that can stand in CI.
    if made.scale == Scale::Quick {
        return Err(Failure::Other(left));
    }
    console.warn(left);
    Ok(())
}

/// Whether results are those in this folder.
fn is_of(from: &Path, out: &Path) -> bool {
    let results = if from.is_dir() { from.join("results.json") } else { from.to_owned() };
    let place = |path: &Path| path.canonicalize().ok();
    place(&results).is_some_and(|path| Some(path) == place(&out.join("results.json")))
}

/// Where results go if nobody says where.
fn folder_of(name: &str, scale: Scale) -> PathBuf {
    let scale = if scale == Scale::Full { String::new() } else { format!("-{}", scale.name()) };
    format!("reproduce-{name}{scale}").into()
}

fn order(global: Global, arguments: &Reproduce) -> Order<'_> {
    let base = global.seed.unwrap_or(0);
    let listed = |count: u16| (0..u64::from(count)).map(|k| base.saturating_add(k)).collect();
    Order {
        scale: arguments.scale(),
        seeds: arguments.seeds.map_or(Seeds::From(base), |count| Seeds::Listed(listed(count))),
        only: arguments.only.clone(),
        shard: arguments.shard.unwrap_or_default(),
        data: arguments.data.as_deref(),
        force: arguments.force,
        provenance: provenance(arguments.data.as_deref()),
    }
}

fn plans(chosen: &[&'static dyn Study], order: &Order<'_>) -> Vec<Planned> {
    let plan =
        |study: &&'static dyn Study| Planned { study: study.name(), rows: costs(*study, order) };
    chosen.iter().map(plan).collect()
}

fn plan(console: Console, chosen: &[&'static dyn Study], order: &Order<'_>) -> Result<(), Failure> {
    console.result(&plans(chosen, order), |plans| planned(plans))
}

/// Hours of each row, each study and all together.
fn planned(plans: &[Planned]) -> String {
    let hours = |seconds: f64| format!("{:.2} h", seconds / 3600.0);
    // The sum of no numbers is -0, and nobody takes less than no time.
    let sum = |rows: &[Cost]| 0.0 + rows.iter().filter_map(|row| row.seconds).sum::<f64>();
    let mut lines = Vec::new();
    let (mut total, mut unknown) = (0.0, 0);
    for Planned { study, rows } in plans {
        for row in rows {
            let seeds = counted(row.seeds, "seed");
            let time = row.seconds.map_or_else(|| "not known".to_owned(), hours);
            lines.push((format!("{study} {}", row.job), format!("{seeds:8} {time}")));
        }
        lines.push((format!("{study}, all rows"), hours(sum(rows))));
        total += sum(rows);
        unknown += rows.iter().filter(|row| row.seconds.is_none()).count();
    }
    let missing = match unknown {
        0 => String::new(),
        1 => " and one row that was never made".to_owned(),
        _ => format!(" and {unknown} rows that were never made"),
    };
    lines.push(("everything".to_owned(), hours(total) + &missing));
    table(lines.iter().map(|(name, value)| (name.as_str(), value.clone())))
}

fn list(console: Console) -> Result<(), Failure> {
    let known: Vec<Known> = studies().map(|s| Known { name: s.name(), about: s.about() }).collect();
    console.result(&known, |known| table(known.iter().map(|s| (s.name, s.about.to_owned()))))
}

/// Whatever is finished is kept, from the first job on.
fn listen() -> Result<Interrupt, Failure> {
    let interrupt = Interrupt::listen(None)?;
    interrupt.worthwhile_saying(
        "stopping: what is finished is kept, and the job that goes on ends first; Ctrl-C again ends at once",
    );
    Ok(interrupt)
}

fn make(
    console: Console,
    interrupt: &Interrupt,
    study: &'static dyn Study,
    order: &Order<'_>,
    out: &Path,
) -> Result<(), Failure> {
    let shown = console.unlogged();
    let progress = Progress::in_shares(shown, study.name());
    let (mut jobs, mut finished) = (0, 0);
    let bar = |event: &Event| match event {
        Event::Started { total, done, .. } => {
            (jobs, finished) = (*total as usize, *done as usize);
            progress.set(finished * TICKS, jobs * TICKS);
            if finished > 0 {
                shown.remark(format_args!("{finished} of {jobs} jobs were finished before"));
            }
        }
        Event::Within { job, seed, told } => {
            if let Some((share, text)) = working(told) {
                progress.set(finished * TICKS + (share * TICKS as f64) as usize, jobs * TICKS);
                let seed = seed.unwrap_or_default();
                let at = finished + 1;
                progress.say(&format!("job {at} of {jobs}, {job}, seed {seed}: {text}"));
            }
        }
        Event::Progress { done, text, .. } => {
            finished = *done as usize;
            shown.remark(text);
        }
        _ => {}
    };
    let mut watch = console.watch(interrupt, bar);
    let made = reproduce(study, out, order, &mut watch).map_err(failed)?;
    drop(watch);
    progress.finish();
    if !made.ended.is_cancelled() && order.scale != Scale::Quick {
        note_costs(study, out);
    }
    tell(console, study, out, &made)
}

/// How far a job is by what it tells, from 0 to 1, and what goes on.
fn working(told: &Event) -> Option<(f64, String)> {
    let share = |done: u64, total: u64| (done as f64 / total.max(1) as f64).min(1.0);
    match told {
        Event::Started { total, done, .. } => Some((share(*done, *total), "starting".to_owned())),
        Event::Step(Step { step, total, loss, .. }) => {
            Some((share(*step, *total), format!("step {step} of {total}, loss {loss:.4}")))
        }
        Event::Progress { done, total, text } => Some((share(*done, *total), text.clone())),
        _ => None,
    }
}

/// What each row took, in the form of the table that `--plan` reads.
fn note_costs(study: &dyn Study, out: &Path) {
    if let Ok(results) = studies::Results::read(&out.join("results.json")) {
        // It can be made again from the results, and is in nobody's way.
        let _ = std::fs::write(out.join("costs.txt"), measured(study, &results));
    }
}

/// Prints what came of it, and fails where a floor of the quick form does.
fn tell(
    console: Console,
    study: &'static dyn Study,
    out: &Path,
    made: &Reproduced,
) -> Result<(), Failure> {
    let outcome = Outcome { study: study.name(), output: out, made };
    console.result(&outcome, describe)?;
    if made.ended.is_cancelled() {
        let text = format!("what is finished is in {}; the same command goes on", out.display());
        return Err(Failure::Interrupted(text));
    }
    let broken: Vec<String> = made
        .checks
        .iter()
        .filter(|check| !check.passed)
        .map(|check| format!("{} (it is {})", check.text, check.found))
        .collect();
    if broken.is_empty() {
        Ok(())
    } else {
        Err(Failure::Other(format!("not so: {}", broken.join("; "))))
    }
}

fn failed(error: ReproduceError) -> Failure {
    let bad_input = match &error {
        ReproduceError::Damaged { .. } | ReproduceError::NoResults { .. } => true,
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
    let made = outcome.made;
    let mut text: String = made.tables.0.iter().map(|table| table.to_text() + "\n").collect();
    for claim in &made.claims {
        let verdict = match claim.verdict {
            Verdict::Holds => "holds",
            Verdict::Reversed => "REVERSED",
            Verdict::Undecided => "UNDECIDED",
        };
        let _ = writeln!(text, "{verdict}: {} ({})", claim.text, claim.found());
    }
    for check in &made.checks {
        let passed = if check.passed { "passed" } else { "FAILED" };
        let _ = writeln!(text, "{passed}: {} ({})", check.text, check.found);
    }
    let output = outcome.output.display();
    if !made.close.is_empty() && made.scale == Scale::Full {
        let (study, jobs) = (outcome.study, made.close.join(","));
        let _ = writeln!(
            text,
            "undecided and close, five seeds may tell: unsphere reproduce {study} -o {output} --seeds 5 --only {jobs}"
        );
    }
    text + &format!("output: {output}\n")
}
