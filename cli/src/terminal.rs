//! The terminal: words and the line that is drawn over make room for each other.

use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use indicatif::ProgressBar;

use crate::printable;

/// The line on the terminal, if there is one: what else is printed must make room for it.
pub(crate) static DRAWN: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// Whether nothing but errors is wanted, for who speaks from beside the commands, as the thread of signals does.
pub(crate) static QUIET: AtomicBool = AtomicBool::new(false);

/// Words on stderr for people, where they are wanted.
pub(crate) fn remark(text: &str) {
    if !QUIET.load(Ordering::Relaxed) {
        say(text);
    }
}

/// Writes to the terminal beside the line that is drawn over.
pub(crate) fn aside<T>(write: impl FnOnce() -> T) -> T {
    let bar = locked(&DRAWN).clone();
    match bar {
        Some(bar) => bar.suspend(write),
        None => write(),
    }
}

/// Words on stderr, whatever names are in them.
pub(crate) fn say(text: &str) {
    let text = printable::message(text);
    // A closed stderr is no reason to stop the work.
    let _ = aside(|| writeln!(std::io::stderr(), "{text}"));
}

/// What a thread that panicked left is still worth showing.
pub(crate) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
