//! The program `unsphere`, and how a system of one's own joins it.
//!
//! This crate knows arguments, progress bars, printing and exit codes, and nothing else; the work
//! is done by the crates below it. Whoever wrote a system gets `train`, `eval`, `predict` and `check` for it,
//! with run folders, reports and all, by one line (`examples/ellipsoid.rs` is a whole one):
//!
//! ```no_run
//! use std::process::ExitCode;
//!
//! use unsphere::Program;
//! # use models::img2mesh::Img2Mesh as MySystem;
//!
//! fn main() -> ExitCode {
//!     Program::new().with::<MySystem>().main()
//! }
//! ```

mod args;
mod began_with;
mod by_category;
mod checkpoint;
mod checkpoint_report;
mod child;
mod colmap;
mod command;
mod configuration;
mod console;
mod event_log;
mod failure;
mod help;
mod interrupt;
mod job_array;
mod masks;
mod memory;
mod mesh_file;
mod model_card;
mod object_list;
mod options;
mod printable;
mod processes;
mod program;
mod progress;
mod provenance;
mod summary;
mod system;
mod terminal;
mod truth;
mod views;
mod weights;

#[cfg(feature = "mpi")]
pub use processes::{Mpi, MpiError};
pub use program::Program;
