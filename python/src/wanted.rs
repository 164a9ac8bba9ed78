//! Of which inputs gradients are wanted: the keyword `wrt`.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::error;

/// Those of these names.
pub(crate) struct Wanted(Vec<String>);

impl FromPyObject<'_, '_> for Wanted {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, '_, PyAny>) -> PyResult<Self> {
        if let Ok(name) = object.extract::<String>() {
            return Ok(Self(vec![name]));
        }
        let names = object.extract::<Vec<String>>();
        let text = "wrt: the name of an input, a sequence of such names, or None for all";
        names.map(Self).map_err(|_| PyTypeError::new_err(text))
    }
}

impl Wanted {
    /// That of one input.
    pub(crate) fn of(name: &str) -> Self {
        Self(vec![name.to_owned()])
    }

    /// Which of these inputs; all where nothing is said.
    ///
    /// # Errors
    /// If a name is none of theirs.
    pub(crate) fn among<const N: usize>(
        wanted: Option<&Self>,
        op: &str,
        names: [&'static str; N],
    ) -> PyResult<[bool; N]> {
        let Some(Self(wanted)) = wanted else { return Ok([true; N]) };
        if let Some(other) = wanted.iter().find(|name| !names.contains(&name.as_str())) {
            let known = names.join(", ");
            return Err(error::value(format!("{op}: wrt names {other:?}, expected among {known}")));
        }
        Ok(names.map(|name| wanted.iter().any(|other| other == name)))
    }
}
