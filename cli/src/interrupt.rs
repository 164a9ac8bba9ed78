//! Ctrl-C: the first asks the work to finish what it has, the second ends it at once.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::failure::Failure;

/// Whether Ctrl-C was pressed, and whether there is anything yet that is worth finishing.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interrupt(Arc<State>);

#[derive(Debug, Default)]
struct State {
    pressed: AtomicBool,
    worthwhile: AtomicBool,
}

impl Interrupt {
    /// Listens from now on; for commands that can stop halfway and keep what they have.
    ///
    /// When there is nothing to keep, or at the second press, `unfinished`, the folder under
    /// construction if there is one, is removed and the program ends.
    pub(crate) fn listen(unfinished: Option<&Path>) -> Result<Self, Failure> {
        let interrupt = Self::default();
        let state = Arc::clone(&interrupt.0);
        let unfinished = unfinished.map(Path::to_owned);
        ctrlc::set_handler(move || {
            let again = state.pressed.swap(true, Ordering::Relaxed);
            if again || !state.worthwhile.load(Ordering::Relaxed) {
                if let Some(unfinished) = &unfinished {
                    // The program ends either way; a folder that resists is left.
                    let _ = std::fs::remove_dir_all(unfinished);
                }
                std::process::exit(130);
            }
        })
        .map_err(|error| Failure::Other(format!("cannot listen for Ctrl-C: {error}")))?;
        Ok(interrupt)
    }

    /// From now on there is something to finish.
    pub(crate) fn worthwhile(&self) {
        self.0.worthwhile.store(true, Ordering::Relaxed);
    }

    /// As if Ctrl-C was pressed.
    #[cfg(test)]
    pub(crate) fn press(&self) {
        self.0.pressed.store(true, Ordering::Relaxed);
    }

    /// Whether the work goes on.
    pub(crate) fn flow(&self) -> ControlFlow<()> {
        if self.0.pressed.load(Ordering::Relaxed) {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }
}
