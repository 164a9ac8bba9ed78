//! Errors of the libraries as exceptions of Python, with their text.

use std::any::Any;
use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind};

use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::{PyErr, PyResult};

/// A wrong value: `ValueError`.
pub(crate) fn value(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// A file that cannot be had: `OSError`.
pub(crate) fn file(error: impl Display) -> PyErr {
    PyOSError::new_err(error.to_string())
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
