//! `docs/options.md` says what the program says.

use std::fmt::Write as _;
use std::path::Path;

use crate::common::unsphere;
use models::predict::Predictor;
use models::{Registry, register};
use serde_json::Value;

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/options.md");

/// The names of all systems.
#[derive(Default)]
struct Names(Vec<&'static str>);

impl Registry for Names {
    fn register<S: Predictor>(&mut self) {
        self.0.push(S::NAME);
    }
}

/// The table of a list of options, as the program gives it in JSON.
fn table(title: &str, options: &Value) -> String {
    let options = options["options"].as_array().unwrap();
    let published = options.iter().any(|option| option.get("published").is_some());
    let (head, rule) = if published { (" published |", "---|") } else { ("", "") };
    let mut text = format!("\n## {title}\n\n");
    let _ =
        writeln!(text, "| option | default | may be | meaning |{head}\n|---|---|---|---|{rule}");
    for option in options {
        let cell = |name: &str| option[name].as_str().unwrap().replace('|', "\\|");
        let [key, default, expected, meaning] = ["key", "default", "expected", "meaning"].map(cell);
        let _ = write!(text, "| `{key}` | `{default}` | {expected} | {meaning} |");
        if published {
            let found = option.get("published").map(|published| {
                let [value, source] =
                    ["value", "source"].map(|part| published[part].as_str().unwrap());
                format!("`{value}`: {source}")
            });
            let _ = write!(text, " {} |", found.unwrap_or_default());
        }
        text.push('\n');
    }
    text
}

#[test]
fn the_page_of_options_is_the_programs() {
    let folder = tempfile::tempdir().unwrap();
    let list = |system: &str| {
        unsphere(folder.path(), ["check", "--options", "--system", system, "--json"])
    };
    let fit = unsphere(folder.path(), ["check", "--options", "--json"]).ok().json();
    let mut page = String::from(
        "# Options\n\nEverything that `--set KEY=VALUE` and a configuration file can say, as `unsphere check --options` and\n\
         `unsphere check --system NAME --options` list it. Published values are those of the preset `paper`.\n\
         What may be \"none\" is none for 0 too, where 0 is not among its values.\n\
         This page is made by `cli/tests/program/options.rs`, which also holds it to be true.\n",
    );
    page.push_str(&table("fit", &fit));
    let mut systems = Names::default();
    register(&mut systems);
    for system in systems.0 {
        page.push_str(&table(system, &list(system).ok().json()));
    }
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(PAGE, &page).unwrap();
    }
    let found = std::fs::read_to_string(Path::new(PAGE)).unwrap_or_default();
    assert!(
        found == page,
        "docs/options.md is old: UPDATE_DOCS=1 cargo test -p unsphere --test options"
    );
}
