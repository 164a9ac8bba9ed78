//! Why a command ends without success, and with which exit code.

use std::process::ExitCode;

use datasets::{ReadViewsError, ViewsProblem};
use recon::inspect::InspectError;
use train::output::OutputError;
use train::settings::SettingsError;

use crate::terminal::say;

/// Why a command ends without success. The exit codes are part of the interface.
#[derive(Debug)]
pub(crate) enum Failure {
    /// 1: something went wrong that is neither the command line nor the input.
    Other(String),
    /// 2: the command line, or an option that it sets, asks for what cannot be.
    Usage(String),
    /// 3: a file that was given is missing, damaged or senseless.
    Input(String),
    /// 130: stopped by Ctrl-C, after what there was had been written.
    Interrupted(String),
}

impl Failure {
    pub(crate) fn input(error: impl std::fmt::Display) -> Self {
        Self::Input(error.to_string())
    }

    pub(crate) fn other(error: impl std::fmt::Display) -> Self {
        Self::Other(error.to_string())
    }

    pub(crate) fn exit_code(&self) -> ExitCode {
        ExitCode::from(self.code())
    }

    pub(crate) fn code(&self) -> u8 {
        match self {
            Self::Other(_) => 1,
            Self::Usage(_) => 2,
            Self::Input(_) => 3,
            Self::Interrupted(_) => 130,
        }
    }

    /// What went wrong.
    pub(crate) fn text(&self) -> &str {
        match self {
            Self::Other(text) | Self::Usage(text) | Self::Input(text) | Self::Interrupted(text) => {
                text
            }
        }
    }

    /// One line on stderr; errors name file, field and remedy themselves.
    pub(crate) fn print(&self) {
        let word = if matches!(self, Self::Interrupted(_)) { "stopped" } else { "error" };
        say(&format!("{word}: {}", self.text()));
    }
}

impl From<ReadViewsError> for Failure {
    fn from(error: ReadViewsError) -> Self {
        let hint = match &error.problem {
            ViewsProblem::EmptyMasks { .. } => " (--mask, --invert-masks)",
            // Of views together; a single file that is too large stays so.
            ViewsProblem::TooLarge { field, .. } if field.starts_with("all views") => {
                " (--max-memory averages them down to what fits, --max-size to a size)"
            }
            _ => "",
        };
        Self::Input(format!("{error}{hint}"))
    }
}

impl From<SettingsError> for Failure {
    fn from(error: SettingsError) -> Self {
        match error {
            SettingsError::Setting { .. } => Self::Usage(format!("--set: {error}")),
            error => Self::input(error),
        }
    }
}

impl From<InspectError> for Failure {
    fn from(error: InspectError) -> Self {
        match error {
            InspectError::Read(error) => error.into(),
            error => Self::input(error),
        }
    }
}

impl From<OutputError> for Failure {
    fn from(error: OutputError) -> Self {
        Self::other(error)
    }
}
