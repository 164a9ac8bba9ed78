//! What ends a job early.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Ends the jobs that it was given to, early. Clones are the same token; it stays pulled.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// Asks the job to end; from any thread, and in a signal's handler too.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it was asked to.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
