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
    /// Which of these inputs; all where nothing is said.
    ///
    /// # Errors
    /// If a name is none of theirs.
    pub(crate) fn among(wanted: Option<&Self>, op: &str, names: &[&str]) -> PyResult<Vec<bool>> {
        let Some(Self(wanted)) = wanted else { return Ok(vec![true; names.len()]) };
        if let Some(other) = wanted.iter().find(|name| !names.contains(&name.as_str())) {
            let known = names.join(", ");
            return Err(error::value(format!("{op}: wrt names '{other}', expected among {known}")));
        }
        Ok(names.iter().map(|name| wanted.iter().any(|other| other == name)).collect())
    }
}
