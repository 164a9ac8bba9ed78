//! `unsphere`: images of an object in, a triangle mesh out.
//!
//! This crate knows arguments, progress bars, printing and exit codes, and nothing else; the work
//! is done by the crate `recon` and those below it.

mod args;
mod checkpoint;
mod command;
mod console;
mod failure;
mod interrupt;
mod mesh_file;
mod progress;
mod provenance;
mod study;
mod system;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let arguments = args::Arguments::parse();
    match command::run(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            failure.print();
            failure.exit_code()
        }
    }
}
