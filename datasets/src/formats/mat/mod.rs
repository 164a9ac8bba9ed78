//! MATLAB's `.mat` files, version 5 (what `save -v6` and `-v7` write, and SciPy's `savemat`).
//!
//! Numbers, text, structs and cells come out as a tree of [`Value`]s, read through [`Node`]s that
//! know their place. Sparse matrices, complex numbers, objects and function handles are named and
//! passed over: they are an error only where something asks for them. Version 7.3 is HDF5 and
//! version 4 older than structs; both are refused with the remedy.
//!
//! A file is read as a stream: a compressed variable is never inflated as a whole, so that
//! thousands of masks in one struct array take one bit a pixel (see [`Data`](value::Data)) and no more.
//! Format: The MathWorks, "MAT-File Level 5 File Format".

mod node;
mod parse;
mod stream;
mod value;

use std::path::Path;

use crate::content::Content;
use crate::error::ReadViewsError;

pub(crate) use node::Node;
pub(crate) use value::Value;

/// The variables of a file, in its order.
#[derive(Debug)]
pub(crate) struct Mat {
    variables: Vec<(String, Value)>,
}

impl Mat {
    /// Reads the variables of a file.
    ///
    /// # Errors
    /// The first thing that is not as the format says, with its variable and field; values that
    /// would take more memory than a file of this length may, into whatever they inflate.
    pub(crate) fn read(content: &Content, file: &Path) -> Result<Self, ReadViewsError> {
        Ok(Self { variables: parse::variables(content, file)? })
    }

    /// A variable that must be there.
    pub(crate) fn need<'a>(
        &'a self,
        name: &str,
        file: &'a Path,
    ) -> Result<Node<'a>, ReadViewsError> {
        self.get(name, file).ok_or_else(|| {
            let names: Vec<&str> = self.variables.iter().map(|(name, _)| name.as_str()).collect();
            let found = match names.as_slice() {
                [] => "a file without variables".to_owned(),
                names => format!("variables {}", names[..names.len().min(8)].join(", ")),
            };
            ReadViewsError::field(file, name, found, "a variable of this name")
        })
    }

    /// A variable, where it is there.
    pub(crate) fn get<'a>(&'a self, name: &str, file: &'a Path) -> Option<Node<'a>> {
        let (name, value) = self.variables.iter().find(|(found, _)| found == name)?;
        Some(Node::root(value, file, name))
    }
}

#[cfg(test)]
mod tests;
