//! `unsphere data`: one file for each verb.

mod generate;

use crate::args::{Data, DataVerb, Global};
use crate::console::Console;
use crate::failure::Failure;

pub(crate) fn run(console: Console, global: Global, arguments: &Data) -> Result<(), Failure> {
    match &arguments.verb {
        DataVerb::Generate(arguments) => generate::run(console, global, arguments),
    }
}
