//! Published tables, made again: jobs by seed, kept one by one, and a page that says what holds.
//!
//! A [`Study`] says which models are trained and what rows they give; [`reproduce`](fn@reproduce) does
//! everything else: it goes through the jobs seed by seed, keeps each result as it comes, goes on
//! where it was stopped, and writes the tables with the spread over the seeds.
//!
//! ```
//! use std::ops::ControlFlow;
//! use studies::{Cell, Claim, Order, Plan, Row, Scale, Study, StudyError, Tables, Watch, Work, reproduce};
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
//!         Plan { jobs: vec!["low".into(), "high".into()], settings: "strategies = 2\n".into() }
//!     }
//!     fn run(&self, work: &Work<'_>, watch: Watch<'_>) -> Result<Vec<Row>, StudyError> {
//!         work.tell(watch, 0.5, "half of it")?;
//!         let won = if work.id == "high" { 0.75 } else { 0.5 } + 0.01 * work.seed as f64;
//!         Ok(vec![Row::new("Guesses", &work.id).with(Cell::larger("won", won, 2))])
//!     }
//!     fn claims(&self, tables: &Tables, _: Scale) -> Vec<Claim> {
//!         let [low, high] = ["low", "high"].map(|row| tables.mean("Guesses", row, "won"));
//!         vec![Claim::new("high guesses win more", format!("{high:?} over {low:?}"), high > low)]
//!     }
//! }
//!
//! let out = tempfile::tempdir()?;
//! let order = Order { seeds: vec![0, 1], ..Order::default() };
//! let made = reproduce(&Guessing, out.path(), &order, &mut |_| ControlFlow::Continue(()))?;
//! assert!(made.claims[0].holds);
//! let table = std::fs::read_to_string(out.path().join("table.md"))?;
//! assert!(table.contains("| high | **0.76** (0.01) |"), "{table}"); // the mean and the spread
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Adding a study
//!
//! 1. `impl Study` in the system's module; a job is one model, [`Work::train`] trains it and goes on with
//!    it after an interruption.
//! 2. [`Plan::settings`] holds all that another value of which would make kept results wrong:
//!    the configurations as TOML, sizes and counts.
//! 3. One line in the `STUDIES` of its system's module.
//!
//! # Invariants
//!
//! - What is finished is never computed twice; results appear whole or not at all.
//! - Results of other settings, scale or data are never mixed: they are refused.
//! - A spread is the largest less the smallest value over the seeds.

pub mod depth;
mod digest;
mod error;
pub mod img2mesh;
mod markdown;
pub mod mcmr;
mod order;
mod page;
pub mod pixel2mesh;
pub(crate) mod preset;
mod registry;
mod row;
mod run;
mod store;
mod study;
mod table;
#[cfg(test)]
mod tests;
mod work;

pub use error::{ReproduceError, StudyError};
pub use order::Order;
pub use registry::studies;
pub use row::{Cell, Picture, Row};
pub use run::{Event, Reproduced, reproduce};
pub use study::{Claim, Plan, Scale, Study};
pub use table::{Column, Line, Table, Tables};
pub use work::{Tick, Trained, Watch, Work};
