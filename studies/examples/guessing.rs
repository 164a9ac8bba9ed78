//! A study without a model: does guessing pay? It shows what `reproduce` keeps and writes.
//!
//! `cargo run -p unsphere-studies --example guessing -- [folder]`; without a folder, a temporary one.

use std::io::Write;
use std::path::PathBuf;

use studies::progress::Watch;
use studies::{
    Cell, Claim, Order, Plan, Row, Scale, Score, Seeds, Study, StudyError, Work, reproduce,
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
        Plan::of(["low", "high", "lucky"], "strategies = 3\n")
    }

    /// Twenty games a seed, which are the objects here: the same ones for every strategy.
    fn run(&self, work: &Work<'_>, watch: &mut Watch<'_>) -> Result<Vec<Row>, StudyError> {
        work.tell(watch, 0.5, "half of it")?;
        let skill = if work.id == "high" { 0.75 } else { 0.5 };
        // Luck is large, of either sign, and another one in every seed.
        let luck = if work.id == "lucky" { [0.3, -0.1, 0.02][work.seed as usize % 3] } else { 0.0 };
        let game = |k: u64| skill + luck + 0.02 * ((7 * k + 3 * work.seed) % 5) as f64;
        let games = || (0..20).map(|k| (format!("game {k}"), game(k)));
        let won = games().map(|(_, won)| won).sum::<f64>() / 20.0;
        Ok(vec![Row::new("Guesses", &work.id).with(Cell::larger("won", won, 2).over(games()))])
    }

    fn claims(&self) -> Vec<Claim> {
        let won = |row: &str| Score::new("Guesses", row, "won");
        vec![
            Claim::new("high guesses win more", [won("high").above(won("low"))]),
            Claim::new("lucky ones too", [won("lucky").above(won("low"))]),
        ]
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let place = tempfile::tempdir()?;
    let folder =
        std::env::args().nth(1).map_or_else(|| place.path().join("guessing"), PathBuf::from);
    let order = Order { seeds: Seeds::Listed(vec![0, 1, 2]), ..Order::default() };
    let made = reproduce(&Guessing, &folder, &order, &mut Watch::default())?;
    let table = std::fs::read_to_string(folder.join("table.md"))?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "{table}")?;
    for claim in &made.claims {
        writeln!(out, "{}: {}", claim.verdict, claim.text)?;
    }
    Ok(())
}
