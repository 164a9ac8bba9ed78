//! `unsphere completions`: a script that lets a shell complete commands and options.

use clap::CommandFactory;

use crate::args::{Arguments, Completions};
use crate::console::print;
use crate::failure::Failure;
use crate::system::Systems;

pub(crate) fn run(arguments: &Completions, systems: &Systems) -> Result<(), Failure> {
    let mut script = Vec::new();
    let mut command = systems.named_in(Arguments::command());
    clap_complete::generate(arguments.shell, &mut command, "unsphere", &mut script);
    print(&script)
}
