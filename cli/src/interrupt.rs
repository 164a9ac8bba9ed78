//! Ctrl-C: the first asks the work to finish what it has, the second ends it at once. On Unix a SIGTERM counts as one, which is how
//! schedulers, containers and service managers ask.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use train::progress::Cancel;

use crate::failure::Failure;
use crate::terminal::remark;

/// What the first press is answered with where nobody says it better.
const ANSWER: &str = "stopping: what is worth keeping is finished first; Ctrl-C again ends at once";

/// Whether Ctrl-C was pressed, and whether there is anything yet that is worth finishing.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interrupt(Arc<State>);

#[derive(Debug, Default)]
struct State {
    pressed: Cancel,
    worthwhile: AtomicBool,
    answer: OnceLock<&'static str>,
}

impl Interrupt {
    /// Listens from now on; for commands that can stop halfway and keep what they have.
    ///
    /// When there is nothing to keep, or at the second press, `unfinished`, the folder under
    /// construction if there is one, is removed and the program ends.
    pub(crate) fn listen(unfinished: Option<&Path>) -> Result<Self, Failure> {
        let interrupt = Self::listen_among(unfinished)?;
        #[cfg(unix)]
        terminated(interrupt.pressed(unfinished))
            .map_err(|error| Failure::Other(format!("cannot listen for SIGTERM: {error}")))?;
        Ok(interrupt)
    }

    /// The same of one of several processes, to which a SIGTERM says that another has failed: it ends them.
    pub(crate) fn listen_among(unfinished: Option<&Path>) -> Result<Self, Failure> {
        let interrupt = Self::default();
        ctrlc::set_handler(interrupt.pressed(unfinished))
            .map_err(|error| Failure::Other(format!("cannot listen for Ctrl-C: {error}")))?;
        Ok(interrupt)
    }

    /// What a press does.
    fn pressed(&self, unfinished: Option<&Path>) -> impl Fn() + Send + 'static {
        let state = Arc::clone(&self.0);
        let unfinished = unfinished.map(Path::to_owned);
        move || {
            let again = state.pressed.is_cancelled();
            state.pressed.cancel();
            if again || !state.worthwhile.load(Ordering::Relaxed) {
                if let Some(unfinished) = &unfinished {
                    // The program ends either way; a folder that resists is left.
                    let _ = std::fs::remove_dir_all(unfinished);
                }
                remark("stopped");
                std::process::exit(130);
            }
            // At once: what is finished first may take a while.
            remark(state.answer.get().unwrap_or(&ANSWER));
        }
    }

    /// From now on there is something to finish.
    pub(crate) fn worthwhile(&self) {
        self.0.worthwhile.store(true, Ordering::Relaxed);
    }

    /// From now on there is something to finish, and the first press is answered with what that is.
    pub(crate) fn worthwhile_saying(&self, answer: &'static str) {
        // The first answer stays.
        let _ = self.0.answer.set(answer);
        self.worthwhile();
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

/// Listens for SIGTERM. Not for SIGHUP, which `nohup` has ignored.
#[cfg(unix)]
fn terminated(pressed: impl Fn() + Send + 'static) -> std::io::Result<()> {
    use signal_hook::consts::SIGTERM;
    use signal_hook::iterator::Signals;

    let mut signals = Signals::new([SIGTERM])?;
    let listen = move || signals.forever().for_each(|_| pressed());
    std::thread::Builder::new().name("sigterm".to_owned()).spawn(listen)?;
    Ok(())
}
