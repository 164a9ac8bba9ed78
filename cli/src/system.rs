//! The systems that the commands can be told.

use std::fmt::Debug;
use std::marker::PhantomData;

use clap::builder::{PossibleValue, PossibleValuesParser};
use models::Registry;
use models::predict::Predictor;
use train::System;

use crate::args::{Eval, Global, Predict, SystemSettings, Train};
use crate::command::check::SystemReport;
use crate::command::{check, eval, predict, train as training};
use crate::console::Console;
use crate::failure::Failure;
use crate::options::{self, ListedOption};

/// The commands that every system has.
pub(crate) trait SystemCommands: Debug + Sync {
    fn name(&self) -> &'static str;
    fn about(&self) -> &'static str;
    fn train(&self, console: Console, global: Global, asked: &Train) -> Result<(), Failure>;
    fn eval(&self, console: Console, global: Global, asked: &Eval) -> Result<(), Failure>;
    fn predict(&self, console: Console, asked: &Predict) -> Result<(), Failure>;
    fn check(&self, asked: &SystemSettings, global: Global) -> Result<SystemReport, Failure>;
    fn options(&self) -> Vec<ListedOption>;
}

/// A system by its type alone.
struct Of<S>(PhantomData<fn() -> S>);

impl<S: System> Debug for Of<S> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(S::NAME)
    }
}

impl<S: Predictor> SystemCommands for Of<S> {
    fn name(&self) -> &'static str {
        S::NAME
    }

    fn about(&self) -> &'static str {
        S::ABOUT
    }

    fn train(&self, console: Console, global: Global, asked: &Train) -> Result<(), Failure> {
        training::run::<S>(console, global, asked)
    }

    fn eval(&self, console: Console, global: Global, asked: &Eval) -> Result<(), Failure> {
        eval::run::<S>(console, global, asked)
    }

    fn predict(&self, console: Console, asked: &Predict) -> Result<(), Failure> {
        predict::run::<S>(console, asked)
    }

    fn check(&self, asked: &SystemSettings, global: Global) -> Result<SystemReport, Failure> {
        check::system_report::<S>(asked, global)
    }

    fn options(&self) -> Vec<ListedOption> {
        options::of_system::<S>()
    }
}

/// The systems that there are, in the order of lists.
#[derive(Debug, Default)]
pub(crate) struct Systems(Vec<Box<dyn SystemCommands>>);

impl Registry for Systems {
    fn register<S: Predictor>(&mut self) {
        self.0.push(Box::new(Of::<S>(PhantomData)));
    }
}

impl Systems {
    /// The system of a name that clap let pass.
    pub(crate) fn named(&self, name: &str) -> &dyn SystemCommands {
        let found = self.0.iter().find(|system| system.name() == name);
        &**found.expect("the command line takes no other name")
    }

    /// A command line that takes their names wherever a system is asked for.
    pub(crate) fn named_in(&self, command: clap::Command) -> clap::Command {
        let values = self.0.iter();
        let values: Vec<_> =
            values.map(|system| PossibleValue::new(system.name()).help(system.about())).collect();
        let names = || PossibleValuesParser::new(values.clone());
        ["train", "eval", "predict", "check"].into_iter().fold(command, |command, verb| {
            command.mut_subcommand(verb, |verb| {
                verb.mut_arg("system", |argument| argument.value_parser(names()))
            })
        })
    }
}
