//! `unsphere data`: one file for each verb.

mod convert;
mod depth;
mod generate;
mod inspect;
pub(crate) mod mask;
mod validate;

use crate::args::{Data, DataVerb, Global};
use crate::console::Console;
use crate::failure::Failure;

pub(crate) fn run(console: Console, global: Global, arguments: &Data) -> Result<(), Failure> {
    match &arguments.verb {
        DataVerb::Generate(arguments) => generate::run(console, global, arguments),
        DataVerb::Inspect(arguments) => inspect::run(console, arguments),
        DataVerb::Validate(arguments) => validate::run(console, arguments),
        DataVerb::Convert(arguments) => convert::run(console, arguments),
        DataVerb::Depth(arguments) => depth::run(console, arguments),
        DataVerb::Mask(arguments) => mask::run(console, arguments),
    }
}
