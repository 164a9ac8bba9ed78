//! Ctrl-C: the first asks the work to finish what it has, the second ends it at once.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use train::progress::Cancel;

use crate::failure::Failure;

/// Whether Ctrl-C was pressed, and whether there is anything yet that is worth finishing.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interrupt(Arc<State>);

#[derive(Debug, Default)]
struct State {
    pressed: Cancel,
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
            let again = state.pressed.is_cancelled();
            state.pressed.cancel();
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
        self.0.pressed.cancel();
    }

    /// What Ctrl-C pulls.
    pub(crate) fn cancel(&self) -> Cancel {
        self.0.pressed.clone()
    }

    /// Whether the work is to end.
    pub(crate) fn is_pressed(&self) -> bool {
        self.0.pressed.is_cancelled()
    }
}
