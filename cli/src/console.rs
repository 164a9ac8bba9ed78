//! Results on stdout, for people or as JSON; words for people on stderr.

use std::fmt::Display;
use std::io::Write;

use serde::Serialize;
use train::progress::{Event, Observer, Watch};

use crate::event_log::EventLog;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::printable;
use crate::terminal::{aside, say};

/// How a command speaks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Console {
    /// Results as one JSON value.
    pub(crate) json: bool,
    /// Nothing on stderr but errors.
    pub(crate) quiet: bool,
    /// Events as lines of JSON.
    pub(crate) log: Option<&'static EventLog>,
}

impl Console {
    /// Prints a result: the value as JSON, or the text that `text` makes of it.
    pub(crate) fn result<T: Serialize>(
        self,
        value: &T,
        text: impl FnOnce(&T) -> String,
    ) -> Result<(), Failure> {
        if let Some(log) = self.log {
            log.result(value);
            if log.is_stdout() {
                return Ok(());
            }
        }
        let out = if self.json {
            printable::json(&serde_json::to_string_pretty(value).map_err(Failure::other)?) + "\n"
        } else {
            printable::result(&text(value))
        };
        print(out.as_bytes())
    }

    /// A remark for people, on stderr.
    pub(crate) fn remark(self, text: impl Display) {
        if !self.quiet {
            say(&text.to_string());
        }
    }

    /// A warning, on stderr.
    pub(crate) fn warn(self, text: impl Display) {
        self.log(|| Event::Warned { text: text.to_string() });
        self.remark(format_args!("warning: {text}"));
    }

    /// An event, where they are logged.
    pub(crate) fn log(self, event: impl FnOnce() -> Event) {
        if let Some(log) = self.log {
            log.tell(&event());
        }
    }

    /// For what is told by events, which the log hears by itself.
    pub(crate) fn unlogged(self) -> Self {
        Self { log: None, ..self }
    }

    /// Who hears of a job: the log, and then what shows it to people. Ctrl-C ends it.
    pub(crate) fn watch<'a>(
        self,
        interrupt: &Interrupt,
        shown: impl Observer + Send + 'a,
    ) -> Watch<'a> {
        let watch = Watch::default().until(interrupt.cancel());
        match self.log {
            Some(log) => watch.and(log).and(shown),
            None => watch.and(shown),
        }
    }
}

/// Bytes on stdout; a reader that has gone away (`| head`) is no failure.
pub(crate) fn print(bytes: &[u8]) -> Result<(), Failure> {
    let written = aside(|| {
        let mut out = std::io::stdout().lock();
        out.write_all(bytes).and_then(|()| out.flush())
    });
    match written {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::Other(format!("stdout: {error}")))
        }
        _ => Ok(()),
    }
}

/// Lines of a name and a value, the values below each other.
pub(crate) fn table<N: AsRef<str>>(rows: impl IntoIterator<Item = (N, String)>) -> String {
    let rows: Vec<_> = rows.into_iter().collect();
    let width = rows.iter().map(|(name, _)| name.as_ref().chars().count()).max().unwrap_or(0);
    rows.iter().fold(String::new(), |text, (name, value)| {
        text + &format!("{:width$}  {value}\n", name.as_ref())
    })
}
