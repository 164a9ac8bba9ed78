//! MATLAB's `.mat` files, version 5 (what `save -v6` and `-v7` write, and SciPy's `savemat`).
//!
//! Numbers, text, structs and cells come out as a tree of [`Value`]s, read through [`Node`]s that
//! know their place. Sparse matrices, complex numbers, objects and function handles are named and
//! passed over: they are an error only where something asks for them. Version 7.3 is HDF5 and
//! version 4 older than structs; both are refused with the remedy.
//!
//! A file is read as a stream: a compressed variable is never inflated as a whole, so that
//! thousands of masks in one struct array take one bit a pixel (see [`Data`]) and no more.
//! Format: The MathWorks, "MAT-File Level 5 File Format".

mod node;
mod parse;
mod stream;

use std::path::Path;

use crate::content::Content;
use crate::error::ReadViewsError;

pub(crate) use node::Node;

/// The variables of a file, in its order.
#[derive(Debug)]
pub(crate) struct Mat {
    variables: Vec<(String, Value)>,
}

/// What a variable, a field or a cell holds.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    /// Numbers, column-major.
    Numbers(Array),
    /// Text; the rows of a character matrix end in line feeds, without their trailing blanks.
    Text(String),
    /// A struct array.
    Struct(Box<StructArray>),
    /// Cells, column-major.
    Cells(Vec<Value>),
    /// Something that is not read, in words.
    Unread(&'static str),
}

/// Numbers with their shape.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Array {
    /// Lengths of the axes, at least two.
    pub(crate) dims: Vec<usize>,
    /// As many values as the product of the axes, the first axis fastest.
    pub(crate) data: Data,
}

/// Numbers in the narrowest of three forms that holds them all.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Data {
    /// Nothing but 0 and 1: how many, and one bit for each.
    Bits(usize, Vec<u8>),
    /// Whole numbers from 0 to 255.
    Bytes(Vec<u8>),
    /// Anything else.
    Floats(Vec<f64>),
}

/// Structs of the same fields.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct StructArray {
    pub(crate) fields: Vec<String>,
    /// The fields of the first struct in their order, then those of the next.
    pub(crate) values: Vec<Value>,
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

impl Array {
    /// The value at a column-major index.
    ///
    /// # Panics
    /// If the index is not below the number of values.
    pub(crate) fn at(&self, index: usize) -> f64 {
        match &self.data {
            Data::Bits(count, bits) => {
                assert!(index < *count, "index {index} of {count}");
                f64::from(bits[index / 8] >> (index % 8) & 1)
            }
            Data::Bytes(bytes) => f64::from(bytes[index]),
            Data::Floats(floats) => floats[index],
        }
    }

    /// How many values there are.
    pub(crate) fn len(&self) -> usize {
        match &self.data {
            Data::Bits(count, _) => *count,
            Data::Bytes(bytes) => bytes.len(),
            Data::Floats(floats) => floats.len(),
        }
    }
}

impl StructArray {
    /// How many structs there are; none where they have no fields.
    pub(crate) fn len(&self) -> usize {
        if self.fields.is_empty() { 0 } else { self.values.len() / self.fields.len() }
    }

    /// A field of one struct.
    pub(crate) fn get(&self, index: usize, field: &str) -> Option<&Value> {
        let at = self.fields.iter().position(|name| name == field)?;
        self.values.get(index * self.fields.len() + at)
    }
}

impl Value {
    /// What it is, for messages.
    pub(crate) fn describe(&self) -> String {
        match self {
            Self::Numbers(array) => format!("{} numbers", sizes(&array.dims)),
            Self::Text(text) => {
                let short: String = text.chars().take(60).collect();
                format!("the text {short:?}")
            }
            Self::Struct(array) => format!("{} structs", array.len()),
            Self::Cells(cells) => format!("{} cells", cells.len()),
            Self::Unread(what) => (*what).to_owned(),
        }
    }
}

/// Axes as MATLAB writes them: `3x4`.
fn sizes(dims: &[usize]) -> String {
    dims.iter().map(usize::to_string).collect::<Vec<_>>().join("x")
}

#[cfg(test)]
mod tests;
