//! From the command line to an exit code.

use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches};
use models::predict::Predictor;
use models::{Registry, register};

use crate::args::Arguments;
use crate::processes::Processes;
use crate::system::Systems;
use crate::{command, printable, terminal};

/// The program, with the systems that its commands can be told.
#[derive(Debug)]
pub struct Program {
    systems: Systems,
}

impl Default for Program {
    fn default() -> Self {
        Self::new()
    }
}

impl Program {
    /// With the systems of `models`.
    pub fn new() -> Self {
        let mut systems = Systems::default();
        register(&mut systems);
        Self { systems }
    }

    /// With one more system.
    #[must_use]
    pub fn with<S: Predictor>(mut self) -> Self {
        self.systems.register::<S>();
        self
    }

    /// Does what the arguments of this process ask.
    pub fn main(self) -> ExitCode {
        let command = self.systems.named_in(Arguments::command());
        let parsed = command.try_get_matches();
        let arguments = match parsed.and_then(|found| Arguments::from_arg_matches(&found)) {
            Ok(arguments) => arguments,
            Err(error) => return refused(&error),
        };
        let processes = match Processes::join(&arguments.command) {
            Ok(processes) => processes,
            Err(failure) => {
                failure.print();
                return failure.exit_code();
            }
        };
        match command::run(arguments, &self.systems, &processes) {
            Ok(()) => ExitCode::SUCCESS,
            Err(failure) => {
                if processes.is_first() {
                    failure.print();
                }
                failure.exit_code()
            }
        }
    }
}

/// Says what is wrong with the command line, or gives the help that was asked for.
fn refused(error: &clap::Error) -> ExitCode {
    let asked = matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion);
    // A pattern of the shell's can bring any name here, and clap prints it as it is.
    if !asked && !std::env::args_os().all(|word| printable::is_plain(&word.to_string_lossy())) {
        terminal::say(&error.render().to_string());
        return ExitCode::from(2);
    }
    error.exit()
}
