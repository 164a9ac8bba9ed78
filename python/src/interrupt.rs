//! Ctrl-C and callbacks while a library works.

use pyo3::prelude::*;

/// What Python had to say while a long job ran: an exception to be raised once the job is over.
#[derive(Default)]
pub(crate) struct Interrupt {
    raised: Option<PyErr>,
}

impl Interrupt {
    /// Tells a callback of a step, if it is one, and looks for signals; whether the job is to end.
    ///
    /// It ends where Ctrl-C was pressed (seen on the main thread alone, as Python's handlers are), where the callback raises, and where
    /// it returns False.
    pub(crate) fn is_due(
        &mut self,
        callback: Option<&Py<PyAny>>,
        step: Option<(u64, u64, f64)>,
    ) -> bool {
        if self.raised.is_some() {
            return true;
        }
        let told = Python::attach(|py| {
            py.check_signals()?;
            match (callback, step) {
                (Some(callback), Some(step)) => {
                    let answer = callback.call1(py, step)?;
                    Ok(answer.extract::<bool>(py).is_ok_and(|go_on| !go_on))
                }
                _ => Ok(false),
            }
        });
        told.unwrap_or_else(|error| {
            self.raised = Some(error);
            true
        })
    }

    /// # Errors
    /// The exception, if there was one.
    pub(crate) fn raised(self) -> PyResult<()> {
        self.raised.map_or(Ok(()), Err)
    }
}
