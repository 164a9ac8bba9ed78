//! Published tables, made again: jobs by seed, kept one by one, and a page that says what holds.
//!
//! A [`Study`] says which models are trained and what rows they give; [`reproduce`](fn@reproduce) does
//! everything else: it goes through the jobs seed by seed, keeps each result as it comes, goes on
//! where it was stopped, and writes the tables with the values of the seeds and what of the [claims](Claim) holds. All of it is made
//! from one file, `results.json`, from which [`remake`](fn@remake) makes it again; [`merge`](fn@merge) puts together what several
//! processes made.
//!
//! ```
//! use studies::progress::Watch;
//! use studies::{Cell, Claim, Order, Plan, Row, Scale, Score, Seeds, Study, StudyError, Verdict, Work, reproduce};
//!
//! /// Does guessing pay? One job a strategy; a real study trains a model in each.
//! struct Guessing;
//!
//! impl Study for Guessing {
//!     fn name(&self) -> &'static str {
//!         "guessing"
//!     }
//!     fn about(&self) -> &'static str {
//!         "two ways to guess"
//!     }
//!     fn plan(&self, _: Scale) -> Plan {
//!         Plan::of(["low", "high"], "strategies = 2\n")
//!     }
//!     fn run(&self, work: &Work<'_>, watch: &mut Watch<'_>) -> Result<Vec<Row>, StudyError> {
//!         work.tell(watch, 0.5, "half of it")?;
//!         let won = if work.id == "high" { 0.75 } else { 0.5 } + 0.01 * work.seed as f64;
//!         Ok(vec![Row::new("Guesses", &work.id).with(Cell::larger("won", won, 2))])
//!     }
//!     fn claims(&self) -> Vec<Claim> {
//!         let won = |row: &str| Score::new("Guesses", row, "won");
//!         vec![Claim::new("high guesses win more", [won("high").above(won("low"))])]
//!     }
//! }
//!
//! let out = tempfile::tempdir()?;
//! let order = Order { seeds: Seeds::Listed(vec![0, 1]), ..Order::default() };
//! let made = reproduce(&Guessing, out.path(), &order, &mut Watch::default())?;
//! assert_eq!(made.claims[0].verdict, Verdict::Holds);
//! let table = std::fs::read_to_string(out.path().join("table.md"))?;
//! assert!(table.contains("| high | **0.76** (0.75, 0.76) |"), "{table}"); // the mean and each seed
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Adding a study
//!
//! 1. `impl Study` in the system's module; a job is one model, [`Work::train`] trains it and goes on with
//!    it after an interruption.
//! 2. [`Plan::settings`] holds all that another value of which would make kept results wrong:
//!    the configurations as TOML, sizes and counts.
//! 3. Cells have the values by object ([`Cell::over`], [`Cell::of`]): claims are judged by them.
//! 4. [`Study::claims`] states what the tables are to show before they are made, each margin with its reason; [`Study::floors`]
//!    what the quick form reaches, and which rows must not.
//! 5. One line in the `STUDIES` of its system's module.
//!
//! # Invariants
//!
//! - What is finished is never computed twice; results appear whole or not at all.
//! - Results of other settings, scale or data are never mixed: they are refused.
//! - All claims are judged by one rule: see [`judge`].
//! - A table is made by one build of the program.

pub mod bootstrap;
mod charts;
pub mod claim;
mod cost;
mod curves;
pub mod depth;
mod effort;
mod error;
mod floor;
mod gallery;
pub mod img2mesh;
mod layout;
mod markdown;
pub mod mcmr;
mod merge;
mod nearest;
mod order;
mod output;
mod page;
mod pages;
pub mod pixel2mesh;
mod plan;
pub(crate) mod preset;
mod registry;
mod remake;
mod results;
mod row;
mod run;
mod scale;
mod store;
mod strip;
mod study;
mod table;
#[cfg(test)]
mod tests;
pub mod verdict;
mod work;

pub use bootstrap::Interval;
pub use claim::{Claim, Comparison, NOT_BEHIND, Score};
pub use cost::{Cost, costs, measured};
pub use error::{ReproduceError, StudyError};
pub use floor::{Check, Floor};
pub use gallery::drawn;
pub use merge::merge;
pub use order::Order;
pub use plan::{Plan, PlannedJob};
pub use registry::studies;
pub use remake::remake;
pub use results::{CellRecord, ColumnRecord, CurveRecord, JobRecord, Results, RowRecord};
pub use row::{CaptionedImage, Cell, ImageKind, Row};
pub use run::{Reproduced, reproduce};
pub use scale::{Scale, Seeds};
pub use store::KeptImage;
pub use study::Study;
pub use table::{Column, Line, Table, Tables};
/// How [`reproduce`](fn@reproduce) tells what it does, and how it is ended early.
pub use train::progress;
pub use verdict::{Finding, Judged, Verdict, judge};
pub use work::{Trained, Work};
