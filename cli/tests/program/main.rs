//! The program, as a person runs it: one test program, so that its tests share the processor's cores.
#![allow(clippy::unwrap_used, reason = "tests")]

mod applied;
mod bad_input;
mod bake;
mod batch;
mod capture;
mod commands;
mod common;
mod data;
mod data_generate;
mod events;
#[cfg(target_os = "linux")]
mod full_disk;
#[cfg(unix)]
mod killed;
mod meshes;
#[cfg(all(feature = "mpi", unix))]
mod mpi;
mod options;
mod pictures;
mod quality_regression;
mod reproduce;
mod single_picture;
mod terminal;
mod training;
