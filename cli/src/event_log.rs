//! `--log-json`: what a command does, as lines of JSON beside what it says to people.

use std::fs::OpenOptions;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use serde::Serialize;
use train::progress::{Event, JsonLines, Observer};

use crate::console::print;
use crate::failure::Failure;
use crate::printable;
use crate::terminal::locked;

/// The log of this process.
#[derive(Debug)]
pub(crate) struct EventLog {
    lines: Mutex<JsonLines<Sink>>,
    /// None where the lines go to stdout.
    file: Option<PathBuf>,
}

/// The last lines, which are the program's own.
#[derive(Serialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
enum Last<T> {
    /// What the command prints with `--json`.
    Result { result: T },
    /// Why there is none.
    Failed { message: String, exit_code: u8 },
}

impl EventLog {
    /// Lines behind those of a file, or on stdout where it is called `-`. It lasts as long as the process.
    pub(crate) fn open(path: &Path) -> Result<&'static Self, Failure> {
        let file = (path.as_os_str() != "-").then(|| path.to_owned());
        let sink = match &file {
            None => Sink::Stdout,
            Some(path) => {
                let opened = OpenOptions::new().create(true).append(true).open(path);
                Sink::File(opened.map_err(|error| failure(path, &error))?)
            }
        };
        let lines = Mutex::new(JsonLines::new(sink));
        Ok(Box::leak(Box::new(Self { lines, file })))
    }

    /// Whether stdout has nothing but its lines.
    pub(crate) fn is_stdout(&self) -> bool {
        self.file.is_none()
    }

    pub(crate) fn tell(&self, event: &Event) {
        locked(&self.lines).event(event);
    }

    pub(crate) fn result(&self, result: &impl Serialize) {
        locked(&self.lines).add(&Last::Result { result });
    }

    /// Ends the log with what failed, if something did, and says if lines are missing.
    pub(crate) fn end(&self, failed: Option<&Failure>) -> Result<(), Failure> {
        let mut lines = locked(&self.lines);
        if let Some(failure) = failed {
            let (message, exit_code) = (failure.text().to_owned(), failure.code());
            lines.add(&Last::<()>::Failed { message, exit_code });
        }
        let path = self.file.as_deref().unwrap_or_else(|| Path::new("stdout"));
        lines.failure().map_or(Ok(()), |error| Err(failure(path, error)))
    }
}

fn failure(path: &Path, error: &io::Error) -> Failure {
    Failure::Other(format!("--log-json {}: {error}", path.display()))
}

impl Observer for &EventLog {
    fn event(&mut self, event: &Event) {
        self.tell(event);
    }
}

/// Where lines go.
#[derive(Debug)]
enum Sink {
    File(std::fs::File),
    Stdout,
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.write(bytes),
            Self::Stdout => {
                // Whole lines come, which are text; a terminal must not be steered by the names in it.
                let text = printable::json(&String::from_utf8_lossy(bytes));
                print(text.as_bytes()).map_err(|failure| io::Error::other(failure.text()))?;
                Ok(bytes.len())
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::File(file) => file.flush(),
            Self::Stdout => Ok(()),
        }
    }
}
