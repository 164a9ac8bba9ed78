//! `unsphere man`: the manual's pages, which say what `--help` says.

use std::path::PathBuf;

use clap::CommandFactory;
use clap_mangen::Man;
use serde::Serialize;

use crate::args::{Arguments, Manual};
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::system::Systems;

/// Where the pages go when nothing is said.
const FOLDER: &str = "unsphere-man";

/// What is printed with `--json`.
#[derive(Serialize)]
struct Outcome {
    #[serde(serialize_with = "train::path_text::serialize")]
    output: PathBuf,
    pages: usize,
}

pub(crate) fn run(console: Console, arguments: &Manual, systems: &Systems) -> Result<(), Failure> {
    let folder = arguments.output.create(FOLDER)?;
    let mut command = systems.named_in(Arguments::command()).disable_help_subcommand(true);
    // Names commands after those that they belong to.
    command.build();
    let mut pages = Vec::new();
    collect(command, &mut pages);
    for page in &pages {
        let mut text = Vec::new();
        page.render(&mut text).expect("writing to memory cannot fail");
        folder.write(&page.get_filename(), &text)?;
    }
    let outcome = Outcome { output: folder.commit()?, pages: pages.len() };
    console.result(&outcome, |outcome| {
        let look = format!("man {}", outcome.output.join("unsphere.1").display());
        table([("pages", outcome.pages.to_string()), ("look", look)])
    })
}

/// A page for the command, behind those of its subcommands.
fn collect(command: clap::Command, pages: &mut Vec<Man>) {
    for below in command.get_subcommands().filter(|below| !below.is_hide_set()) {
        collect(below.clone(), pages);
    }
    let usage = usage(&command);
    let source = concat!("unsphere ", env!("CARGO_PKG_VERSION"));
    pages.push(Man::new(command.override_usage(usage)).source(source).manual("Unsphere's manual"));
}

/// How a command is called, its options with their values; what is left to choose stands in brackets.
fn usage(command: &clap::Command) -> String {
    let name = command.get_bin_name().unwrap_or_else(|| command.get_name());
    let shown = || command.get_arguments().filter(|argument| !argument.is_hide_set());
    let options = shown().filter(|argument| !argument.is_positional());
    let words = options.chain(command.get_positionals().filter(|one| !one.is_hide_set()));
    let mut text = name.to_owned();
    for argument in words {
        let word = word(argument);
        let word = if argument.is_required_set() { word } else { format!("[{word}]") };
        text = text + " " + &word;
    }
    if command.has_subcommands() {
        text += " COMMAND";
    }
    text
}

/// An option, by both of its names and with its value, or the name of what stands without one.
fn word(argument: &clap::Arg) -> String {
    let value = argument
        .get_value_names()
        .map_or_else(|| argument.get_id().as_str().to_uppercase(), |names| names.join(" "));
    let short = argument.get_short().map(|short| format!("-{short}"));
    let long = argument.get_long().map(|long| format!("--{long}"));
    let names: Vec<String> = short.into_iter().chain(long).collect();
    match (names.is_empty(), argument.get_action().takes_values()) {
        (true, _) => value,
        (false, true) => format!("{} {value}", names.join("|")),
        (false, false) => names.join("|"),
    }
}
