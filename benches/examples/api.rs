//! The public interface of each crate as text: what `docs/api` keeps, and a change shows.
//!
//! `.ci/run api` gives it the folder of rustdoc's JSON and that of the lists; `UPDATE_DOCS=1 .ci/run api` writes the lists anew.
#![allow(clippy::print_stdout, reason = "a program")]

use std::collections::BTreeSet;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Items, a line each, without what every type has (blanket implementations) and what follows from its fields (auto traits).
fn list(json: &Path) -> Result<String, Box<dyn Error>> {
    let api = public_api::Builder::from_rustdoc_json(json)
        .omit_blanket_impls(true)
        .omit_auto_trait_impls(true)
        .build()?;
    let mut lines: Vec<String> = api.items().map(ToString::to_string).collect();
    lines.dedup();
    Ok(lines.into_iter().map(|line| line + "\n").collect())
}

/// What only one of two texts has, in its order: `-` what is gone, `+` what is new.
fn changes(before: &str, after: &str) -> Vec<String> {
    let [old, new] = [before, after].map(|text| text.lines().collect::<BTreeSet<_>>());
    let gone = before.lines().filter(|line| !new.contains(line)).map(|line| format!("-{line}"));
    let come = after.lines().filter(|line| !old.contains(line)).map(|line| format!("+{line}"));
    gone.chain(come).collect()
}

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let mut folder = || arguments.next().map(PathBuf::from).ok_or("usage: api JSON LISTS CRATE...");
    let (json, lists) = (folder()?, folder()?);
    let update = std::env::var_os("UPDATE_DOCS").is_some();
    let mut same = true;
    for name in arguments {
        let now = list(&json.join(format!("{}.json", name.replace('-', "_"))))?;
        let file = lists.join(format!("{name}.txt"));
        if update {
            fs::create_dir_all(&lists)?;
            fs::write(&file, now)?;
            continue;
        }
        let changes = changes(&fs::read_to_string(&file).unwrap_or_default(), &now);
        if !changes.is_empty() {
            println!("{}:", file.display());
            println!("{}", changes.join("\n"));
            same = false;
        }
    }
    if !same {
        println!("UPDATE_DOCS=1 .ci/run api accepts this; CHANGELOG.md says what breaks whom");
    }
    Ok(if same { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
