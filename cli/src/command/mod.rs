//! The commands, one file each.

mod bake;
mod batch;
mod capture;
pub(crate) mod check;
mod completions;
mod convert;
mod data;
mod demo;
pub(crate) mod eval;
pub(crate) mod export;
mod fit;
mod man;
mod metrics;
pub(crate) mod predict;
mod render;
mod reproduce;
pub(crate) mod train;

use std::sync::atomic::Ordering;

use ::train::Communicator;

use crate::args::{Arguments, Command, Global};
use crate::console::Console;
use crate::event_log::EventLog;
use crate::failure::Failure;
use crate::processes::{Processes, together};
use crate::system::Systems;
use crate::terminal::QUIET;

/// Does what the command line asks, with one pool of threads around all of it.
pub(crate) fn run(
    arguments: Arguments,
    systems: &Systems,
    processes: &Processes,
) -> Result<(), Failure> {
    let Arguments { global, logging, command } = arguments;
    let communicator = processes.communicator();
    let first = processes.is_first();
    let log = logging.log_json.as_deref().filter(|_| first).map(EventLog::open).transpose();
    let log = together(communicator, log)?;
    let console = Console { json: global.json, quiet: global.quiet || !first, log };
    QUIET.store(console.quiet, Ordering::Relaxed);
    let done = perform(console, global, command, systems, communicator);
    match log {
        None => done,
        // What failed is told before that the log lacks lines.
        Some(log) => {
            let logged = log.end(done.as_ref().err());
            done.and(logged)
        }
    }
}

fn perform(
    console: Console,
    global: Global,
    command: Command,
    systems: &Systems,
    communicator: &dyn Communicator,
) -> Result<(), Failure> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(global.threads.into()).build().map_err(
        |error| Failure::Other(format!("cannot start {} threads: {error}", global.threads)),
    );
    let pool = together(communicator, pool)?;
    pool.install(|| match command {
        Command::Demo(arguments) => demo::run(console, global, &arguments),
        Command::Fit(arguments) => fit::run(console, global, &arguments),
        Command::Train(arguments) => {
            (systems.named(&arguments.system).train)(console, global, &arguments, communicator)
        }
        Command::Eval(arguments) => {
            (systems.named(&arguments.system).eval)(console, global, &arguments)
        }
        Command::Predict(arguments) => {
            (systems.named(&arguments.system).predict)(console, &arguments)
        }
        Command::Export(arguments) => {
            (systems.named(&arguments.system).export)(console, global, &arguments)
        }
        Command::Bake(arguments) => bake::run(console, &arguments),
        Command::Render(arguments) => render::run(console, &arguments),
        Command::Convert(arguments) => convert::run(console, &arguments),
        Command::Metrics(arguments) => metrics::run(console, global, &arguments),
        Command::Check(arguments) => check::run(console, global, &arguments, systems),
        Command::Capture(arguments) => capture::run(console, global, &arguments),
        Command::Data(arguments) => data::run(console, global, &arguments),
        Command::Reproduce(arguments) => reproduce::run(console, global, &arguments),
        Command::Completions(arguments) => completions::run(&arguments, systems),
        Command::Man(arguments) => man::run(console, &arguments, systems),
    })
}
