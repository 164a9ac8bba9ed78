//! `unsphere completions`: a script that lets a shell complete commands and options.

use clap::CommandFactory;

use crate::args::{Arguments, Completions};
use crate::console::print;
use crate::failure::Failure;

pub(crate) fn run(arguments: &Completions) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut Arguments::command(), "unsphere", &mut script);
    print(&script)
}
