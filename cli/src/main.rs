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
mod printable;
mod progress;
mod provenance;
mod study;
mod system;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let arguments = match args::Arguments::try_parse() {
        Ok(arguments) => arguments,
        // A pattern of the shell's can bring any name here, and clap prints it as it is.
        Err(error)
            if error.use_stderr()
                && !std::env::args_os()
                    .all(|word| printable::is_plain(&word.to_string_lossy())) =>
        {
            console::say(&error.render().to_string());
            return ExitCode::from(2);
        }
        Err(error) => error.exit(),
    };
    match command::run(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            failure.print();
            failure.exit_code()
        }
    }
}
