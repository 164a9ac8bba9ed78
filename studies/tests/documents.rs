//! What the documents say of the studies is what their results say.
//!
//! `docs/results` has a `results.json` of each study, under its name, and the tables made of it. In the laboratory notebooks,
//! `docs/notebooks/*.md`, stand two kinds of places, each ended by `<!-- end -->`:
//!
//! - `<!-- claims STUDY -->`: how it was run, and every claim with its verdict;
//! - `<!-- table STUDY: TABLE: COLUMN; COLUMN -->`: these columns of a table, with intervals.
//!
//! `UPDATE_DOCS=1 cargo test -p unsphere-studies --test documents` makes all of them again.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::thread;

use studies::{Reproduced, Results, Study, Table, Verdict, remake, studies};

const END: &str = "<!-- end -->";

/// What is known of a study.
struct Made {
    results: Results,
    reproduced: Reproduced,
    /// The tables as Markdown.
    page: String,
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// All studies whose results are committed, made once for all tests: their intervals take most of a minute of one core.
static MADE: LazyLock<BTreeMap<&str, Made>> = LazyLock::new(|| {
    thread::scope(|scope| {
        let at_work: Vec<_> =
            studies().map(|study| (study.name(), scope.spawn(move || made(study)))).collect();
        let all = at_work.into_iter().map(|(name, thread)| (name, thread.join().unwrap()));
        all.filter_map(|(name, made)| Some((name, made?))).collect()
    })
});

/// A study, where its results are committed.
fn made(study: &dyn Study) -> Option<Made> {
    let path = root().join("docs/results").join(format!("{}.json", study.name()));
    if !path.exists() {
        return None;
    }
    let out = tempfile::tempdir().unwrap();
    let reproduced = remake(study, &path, out.path()).unwrap();
    let page = fs::read_to_string(out.path().join("table.md")).unwrap();
    Some(Made { results: Results::read(&path).unwrap(), reproduced, page })
}

/// How a study was run, and what came of its claims.
fn claims(name: &str, made: &Made) -> String {
    let claims = &made.reproduced.claims;
    assert!(!claims.is_empty(), "{name}: results are whole");
    let scale = match made.results.scale.name() {
        "full" => "",
        "tenth" => ", a tenth of the steps",
        other => panic!("{name}: at scale {other} nothing is claimed"),
    };
    let mut seeds: Vec<u64> = made.results.jobs.iter().map(|job| job.seed).collect();
    seeds.sort_unstable();
    seeds.dedup();
    let count = |verdict| claims.iter().filter(|claim| claim.verdict == verdict).count();
    let [holds, reversed, undecided] =
        [Verdict::Holds, Verdict::Reversed, Verdict::Undecided].map(count);
    let mut text = format!(
        "`{}`{scale}, {} seeds: of {} claims {holds} hold, {reversed} are reversed, {undecided} are undecided\n\
         ([all tables, intervals and seeds](../results/{name}.md)).\n\n",
        made.results.command,
        seeds.len(),
        claims.len(),
    );
    for claim in claims {
        let verdict = match claim.verdict {
            Verdict::Holds => "holds",
            Verdict::Reversed => "**reversed**",
            Verdict::Undecided => "undecided",
        };
        let _ = writeln!(text, "- {verdict}: {} ({})", claim.text, claim.found());
    }
    text
}

/// Some columns of a table, means and intervals.
fn columns(table: &Table, wanted: &[&str]) -> String {
    let at = |name: &&str| table.columns.iter().position(|column| column.name == *name);
    let places: Vec<usize> =
        wanted.iter().map(|name| at(name).unwrap_or_else(|| panic!("no column {name}"))).collect();
    let mut text = String::from("| |");
    for &place in &places {
        let _ = write!(text, " {} |", table.columns[place].name);
    }
    let _ = write!(text, "\n|---|{}\n", "---:|".repeat(places.len()));
    for row in &table.rows {
        let _ = write!(text, "| {} |", row.label);
        for &place in &places {
            let decimals = table.columns[place].decimals;
            let values = &row.values[place];
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            match row.intervals[place] {
                _ if values.is_empty() => text.push_str("  |"),
                None => drop(write!(text, " {mean:.decimals$} |")),
                Some(i) => {
                    let _ = write!(
                        text,
                        " {mean:.decimals$} [{:.decimals$}, {:.decimals$}] |",
                        i.low, i.high
                    );
                }
            }
        }
        text.push('\n');
    }
    text
}

/// What stands at a place, by its marker.
fn passage(marker: &str, made: &BTreeMap<&str, Made>) -> Option<String> {
    let find = |name: &str| made.get(name).unwrap_or_else(|| panic!("no results of {name}"));
    if let Some(name) = marker.strip_prefix("claims ") {
        return Some(claims(name, find(name)));
    }
    let mut parts = marker.strip_prefix("table ")?.split(": ");
    let [name, table, wanted] = [(); 3].map(|()| parts.next().expect("a study, a table, columns"));
    let found = find(name).reproduced.tables.table(table);
    let found = found.unwrap_or_else(|| panic!("{name} has no table {table}"));
    Some(columns(found, &wanted.split("; ").collect::<Vec<_>>()))
}

/// A document with all its places filled.
fn filled(document: &str, made: &BTreeMap<&str, Made>) -> String {
    let mut text = String::new();
    let mut rest = document;
    while let Some(at) = rest.find("<!-- ") {
        let close = at + rest[at..].find(" -->").expect("a comment that ends");
        let Some(passage) = passage(&rest[at + 5..close], made) else {
            text.push_str(&rest[..close]);
            rest = &rest[close..];
            continue;
        };
        text.push_str(&rest[..close + 4]);
        let end = close + rest[close..].find(END).expect("an end");
        let _ = write!(text, "\n\n{passage}\n");
        rest = &rest[end..];
    }
    text + rest
}

/// Nothing is said of a study that its results do not say, and there are no tables without results.
#[test]
fn documents_quote_the_results() {
    let made = &*MADE;
    let mut expected: Vec<(PathBuf, String)> = Vec::new();
    for (name, made) in made {
        expected.push((root().join(format!("docs/results/{name}.md")), made.page.clone()));
    }
    for entry in fs::read_dir(root().join("docs/results")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap();
        assert!(made.contains_key(name), "{}: of no study, or without results", path.display());
    }
    for entry in fs::read_dir(root().join("docs/notebooks")).unwrap() {
        let path = entry.unwrap().path();
        let text = filled(&fs::read_to_string(&path).unwrap(), made);
        expected.push((path, text));
    }
    for (path, text) in expected {
        if std::env::var_os("UPDATE_DOCS").is_some() {
            fs::write(&path, &text).unwrap();
        }
        let found = fs::read_to_string(&path).unwrap_or_default();
        assert!(
            found == text,
            "{} is old: UPDATE_DOCS=1 cargo test -p unsphere-studies --test documents",
            path.display()
        );
    }
}

/// A figure that somebody changed by hand is found.
#[test]
fn what_is_changed_by_hand_is_made_again() {
    let made = &*MADE;
    let Some(name) = made.keys().next() else { return };
    let right =
        filled(&format!("Text\n<!-- claims {name} -->{END}\nafter <!-- other --> it"), made);
    assert!(right.ends_with("after <!-- other --> it"));
    assert_eq!(filled(&right, made), right);
    let wrong = right.replacen("undecided", "holds", 1);
    assert!(wrong != right && filled(&wrong, made) == right);
}
