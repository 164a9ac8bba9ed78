//! A study without a model: does guessing pay? It shows what `reproduce` keeps and writes.
//!
//! `cargo run -p unsphere-studies --example guessing -- [folder]`; without a folder, a temporary one.

use std::io::Write;
use std::ops::ControlFlow;
use std::path::PathBuf;

use studies::{
    Cell, Claim, Order, Plan, Row, Scale, Study, StudyError, Tables, Watch, Work, reproduce,
};

struct Guessing;

impl Study for Guessing {
    fn name(&self) -> &'static str {
        "guessing"
    }

    fn about(&self) -> &'static str {
        "two ways to guess"
    }

    fn plan(&self, _: Scale) -> Plan {
        Plan { jobs: vec!["low".into(), "high".into()], settings: "strategies = 2\n".into() }
    }

    fn run(&self, work: &Work<'_>, watch: Watch<'_>) -> Result<Vec<Row>, StudyError> {
        work.tell(watch, 0.5, "half of it")?;
        let won = if work.id == "high" { 0.75 } else { 0.5 } + 0.01 * work.seed as f64;
        Ok(vec![Row::new("Guesses", &work.id).with(Cell::larger("won", won, 2))])
    }

    fn claims(&self, tables: &Tables, _: Scale) -> Vec<Claim> {
        let [low, high] = ["low", "high"].map(|row| tables.mean("Guesses", row, "won"));
        vec![Claim::new("high guesses win more", format!("{high:?} over {low:?}"), high > low)]
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let place = tempfile::tempdir()?;
    let folder =
        std::env::args().nth(1).map_or_else(|| place.path().join("guessing"), PathBuf::from);
    let order = Order { seeds: vec![0, 1, 2], ..Order::default() };
    let made = reproduce(&Guessing, &folder, &order, &mut |_| ControlFlow::Continue(()))?;
    let table = std::fs::read_to_string(folder.join("table.md"))?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "{table}")?;
    writeln!(
        out,
        "{} of {} claims hold",
        made.claims.iter().filter(|c| c.holds).count(),
        made.claims.len()
    )?;
    Ok(())
}
