//! Of which inputs gradients are wanted: the keyword `wrt`.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::error;

/// All of them, or those of these names.
#[derive(Default)]
pub(crate) enum Wanted {
    #[default]
    All,
    Named(Vec<String>),
}

impl FromPyObject<'_, '_> for Wanted {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, '_, PyAny>) -> PyResult<Self> {
        if object.is_none() {
            return Ok(Self::All);
        }
        if let Ok(name) = object.extract::<String>() {
            return Ok(Self::Named(vec![name]));
        }
        let names = object.extract::<Vec<String>>();
        let text = "wrt: the name of an input, a sequence of such names, or None for all";
        names.map(Self::Named).map_err(|_| PyTypeError::new_err(text))
    }
}

impl Wanted {
    /// Which of these inputs.
    pub(crate) fn among<const N: usize>(
        &self,
        op: &str,
        names: [&'static str; N],
    ) -> PyResult<[bool; N]> {
        let Self::Named(wanted) = self else { return Ok([true; N]) };
        if let Some(other) = wanted.iter().find(|name| !names.contains(&name.as_str())) {
            let known = names.join(", ");
            return Err(error::value(format!("{op}: wrt names {other:?}, expected among {known}")));
        }
        Ok(names.map(|name| wanted.iter().any(|other| other == name)))
    }
}
