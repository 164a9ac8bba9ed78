//! `gate check`: compares what criterion measured last with `benches/results/table.csv`, and fails where a figure is a
//! quarter worse. `gate record DATE COMMIT`: makes that table of it, and adds it to the history and its plot.

use std::error::Error;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use benches::gate::{Figures, figures, plot, table, to_table, worse};

/// What of a figure has to be left.
const SHARE: f64 = 0.75;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let done = match words[..] {
        ["check"] => check(),
        ["record", date, commit] => record(date, commit).map(|()| true),
        _ => Err("expected `check`, or `record DATE COMMIT`".into()),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "{error}");
            ExitCode::from(2)
        }
    }
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn measured() -> Result<Figures, Box<dyn Error>> {
    let target =
        std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from);
    let figures = figures(&target.join("criterion"))?;
    if figures.is_empty() {
        return Err("criterion has measured nothing that has a yardstick".into());
    }
    Ok(figures)
}

fn check() -> Result<bool, Box<dyn Error>> {
    let (before, now) = (table(&root().join("benches/results/table.csv"))?, measured()?);
    let mut out = std::io::stdout().lock();
    for (id, figure) in &now {
        let was = before.get(id).map_or_else(|| "new".to_owned(), |was| format!("{was:.3}"));
        writeln!(out, "{id}: {figure:.3} ({was})")?;
    }
    let worse = worse(&before, &now, SHARE);
    for (id, was, is) in &worse {
        writeln!(out, "WORSE {id}: {is:.3}, less than {SHARE} of {was:.3}")?;
    }
    Ok(worse.is_empty())
}

fn record(date: &str, commit: &str) -> Result<(), Box<dyn Error>> {
    let (results, now) = (root().join("benches/results"), measured()?);
    let path = results.join("history.csv");
    let mut history = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            "date,commit,processor,id,figure\n".to_owned()
        }
        Err(error) => return Err(error.into()),
    };
    let processor = processor();
    for (id, figure) in &now {
        let line = [date, commit, &processor, id, &format!("{figure:.4}")].join(",");
        history.push_str(&line);
        history.push('\n');
    }
    // Benches that did not run now keep their figures.
    let mut all = table(&results.join("table.csv")).unwrap_or_default();
    all.extend(now);
    std::fs::write(results.join("history.svg"), plot(&history))?;
    std::fs::write(path, history)?;
    std::fs::write(results.join("table.csv"), to_table(&all))?;
    Ok(())
}

/// As Linux names it, without commas.
fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let field = |name: &str| {
        let line = info.lines().find(|line| line.starts_with(name))?;
        Some(line.split_once(':')?.1.trim().replace(',', " "))
    };
    let [name, family, model] = ["model name", "cpu family", "model\t"]
        .map(|name| field(name).unwrap_or_else(|| "unknown".to_owned()));
    format!("{name} family {family} model {model}")
}
