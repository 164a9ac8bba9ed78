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
    pages.push(Man::new(command));
}
