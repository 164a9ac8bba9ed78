//! The systems that the commands can be told.

use ::train::{Checkpoint, CheckpointPath, Communicator};
use clap::builder::{PossibleValue, PossibleValuesParser};
use models::Registry;
use models::predict::Predictor;

use crate::args::{Eval, Export, Global, Predict, SystemSettings, Train, taking_negative_numbers};
use crate::checkpoint_report::{CheckpointReport, checkpoint_report};
use crate::command::check::SystemReport;
use crate::command::{check, eval, export, predict, train as training};
use crate::console::Console;
use crate::failure::Failure;
use crate::help::flowing;
use crate::options::{self, ListedOption};

/// The commands that every system has.
#[derive(Debug)]
pub(crate) struct SystemCommands {
    name: &'static str,
    about: &'static str,
    pub(crate) train: fn(Console, Global, &Train, &dyn Communicator) -> Result<(), Failure>,
    pub(crate) eval: fn(Console, Global, &Eval) -> Result<(), Failure>,
    pub(crate) export: fn(Console, Global, &Export) -> Result<(), Failure>,
    pub(crate) predict: fn(Console, &Predict) -> Result<(), Failure>,
    pub(crate) checkpoint:
        fn(&Checkpoint<'_>, &CheckpointPath) -> Result<CheckpointReport, Failure>,
    pub(crate) check: fn(&SystemSettings, Global) -> Result<SystemReport, Failure>,
    pub(crate) options: fn() -> Vec<ListedOption>,
}

/// The systems that there are, in the order of lists.
#[derive(Debug, Default)]
pub(crate) struct Systems(Vec<SystemCommands>);

impl Registry for Systems {
    fn register<S: Predictor>(&mut self) {
        self.0.push(SystemCommands {
            name: S::NAME,
            about: S::ABOUT,
            train: training::run::<S>,
            eval: eval::run::<S>,
            export: export::run::<S>,
            predict: predict::run::<S>,
            checkpoint: checkpoint_report::<S>,
            check: check::system_report::<S>,
            options: options::of_system::<S>,
        });
    }
}

impl Systems {
    /// The system of a name that clap let pass.
    pub(crate) fn named(&self, name: &str) -> &SystemCommands {
        let found = self.0.iter().find(|system| system.name == name);
        found.expect("the command line takes no other name")
    }

    /// The system of a name that stands in a file, where it is one of these.
    pub(crate) fn find(&self, name: &str) -> Option<&SystemCommands> {
        self.0.iter().find(|system| system.name == name)
    }

    /// All their names.
    pub(crate) fn names(&self) -> String {
        self.0.iter().map(|system| system.name).collect::<Vec<_>>().join(", ")
    }

    /// A command line that takes their names wherever a system is asked for.
    pub(crate) fn named_in(&self, command: clap::Command) -> clap::Command {
        let value = |system: &SystemCommands| PossibleValue::new(system.name).help(system.about);
        let values: Vec<_> = self.0.iter().map(value).collect();
        let names = || PossibleValuesParser::new(values.clone());
        ["train", "eval", "predict", "export", "check"].into_iter().fold(
            taking_negative_numbers(flowing(command)),
            |command, verb| {
                command.mut_subcommand(verb, |verb| {
                    verb.mut_arg("system", |argument| argument.value_parser(names()))
                })
            },
        )
    }
}
