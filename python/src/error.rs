//! Errors of the libraries as exceptions of Python, with their text.

use std::any::Any;
use std::error::Error;
use std::fmt::Display;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};

use pyo3::exceptions::{PyFileNotFoundError, PyOSError, PyPermissionError, PyValueError};
use pyo3::{PyErr, PyResult};

/// A wrong value: `ValueError`.
pub(crate) fn value(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// A file that cannot be had: `OSError`, and of these the one that says so where it is missing or forbidden.
pub(crate) fn file(error: impl Error + 'static) -> PyErr {
    let text = error.to_string();
    let mut next: Option<&(dyn Error + 'static)> = Some(&error);
    while let Some(cause) = next {
        match cause.downcast_ref::<io::Error>().map(io::Error::kind) {
            Some(io::ErrorKind::NotFound) => return PyFileNotFoundError::new_err(text),
            Some(io::ErrorKind::PermissionDenied) => return PyPermissionError::new_err(text),
            _ => next = cause.source(),
        }
    }
    PyOSError::new_err(text)
}

/// The last door: what a library refuses by a panic becomes a `ValueError` with its text.
///
/// Shapes are checked before, so that this is not how mistakes are found; nothing that a panic left half done is used again.
pub(crate) fn caught<R>(compute: impl FnOnce() -> R) -> PyResult<R> {
    catch_unwind(AssertUnwindSafe(compute)).map_err(|panic| value(text(&*panic)))
}

fn text(panic: &(dyn Any + Send)) -> String {
    let told = panic.downcast_ref::<String>().map(String::as_str);
    let told = told.or_else(|| panic.downcast_ref::<&str>().copied());
    told.unwrap_or("the computation was given up").to_owned()
}
