//! Values that know their place, so that messages can name file and field.

use std::path::Path;

use super::value::{Array, StructArray, Value, sizes};
use crate::error::ReadViewsError;

/// A value and where it stands.
#[derive(Clone, Debug)]
pub(crate) struct Node<'a> {
    file: &'a Path,
    place: Place<'a>,
    /// Like `images(3).bbox.x1`, counted from 1 as MATLAB does.
    pub(crate) field: String,
}

#[derive(Clone, Copy, Debug)]
enum Place<'a> {
    Value(&'a Value),
    /// One struct of an array.
    Row(&'a StructArray, usize),
}

impl<'a> Node<'a> {
    pub(super) fn root(value: &'a Value, file: &'a Path, name: &str) -> Self {
        Self { file, place: Place::Value(value), field: name.to_owned() }
    }

    /// The file that the value stands in.
    pub(crate) fn file(&self) -> &'a Path {
        self.file
    }

    /// An error about this value.
    pub(crate) fn wrong(&self, expected: impl Into<String>) -> ReadViewsError {
        let found = match self.place {
            Place::Value(value) => value.describe(),
            Place::Row(..) => "a struct".to_owned(),
        };
        self.found(found, expected)
    }

    /// An error about this value, of which it is known what it says.
    pub(crate) fn found(
        &self,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> ReadViewsError {
        ReadViewsError::field(self.file, &self.field, found, expected)
    }

    /// A field, where this is one struct that has it.
    pub(crate) fn get(&self, key: &str) -> Option<Node<'a>> {
        let value = match self.place {
            Place::Row(array, index) => array.get(index, key)?,
            Place::Value(Value::Struct(array)) if array.len() == 1 => array.get(0, key)?,
            Place::Value(_) => return None,
        };
        Some(self.at(value, format!("{}.{key}", self.field)))
    }

    /// A field that must be there.
    pub(crate) fn need(&self, key: &str) -> Result<Node<'a>, ReadViewsError> {
        self.get(key).ok_or_else(|| self.wrong(format!("a struct with the field {key}")))
    }

    /// The names of the fields, where this is a struct.
    pub(crate) fn keys(&self) -> &'a [String] {
        match self.place {
            Place::Row(array, _) => &array.fields,
            Place::Value(Value::Struct(array)) => &array.fields,
            Place::Value(_) => &[],
        }
    }

    /// The structs of an array, or the cells: as `squeeze_me` of SciPy sees them.
    pub(crate) fn elements(&self) -> Result<Vec<Node<'a>>, ReadViewsError> {
        let name = |i: usize| format!("{}({})", self.field, i + 1);
        match self.place {
            Place::Row(..) => Ok(vec![self.clone()]),
            Place::Value(Value::Struct(array)) => {
                let row = |i| Node { place: Place::Row(array, i), field: name(i), ..self.clone() };
                Ok((0..array.len()).map(row).collect())
            }
            Place::Value(Value::Cells(cells)) => {
                Ok(cells.iter().enumerate().map(|(i, cell)| self.at(cell, name(i))).collect())
            }
            // What MATLAB's [] is where there are no structs.
            Place::Value(Value::Numbers(array)) if array.len() == 0 => Ok(Vec::new()),
            Place::Value(_) => Err(self.wrong("structs")),
        }
    }

    /// One struct of an array; the same as that of [`Self::elements`], without naming the others.
    pub(crate) fn element(&self, index: usize) -> Result<Node<'a>, ReadViewsError> {
        let field = format!("{}({})", self.field, index + 1);
        match self.place {
            Place::Value(Value::Struct(array)) if index < array.len() => {
                Ok(Node { place: Place::Row(array, index), field, ..self.clone() })
            }
            Place::Value(Value::Cells(cells)) if index < cells.len() => {
                Ok(self.at(&cells[index], field))
            }
            _ => Err(self.wrong(format!("at least {} structs", index + 1))),
        }
    }

    /// Numbers of any shape.
    pub(crate) fn numbers(&self) -> Result<&'a Array, ReadViewsError> {
        match self.place {
            Place::Value(Value::Numbers(array)) => Ok(array),
            _ => Err(self.wrong("numbers")),
        }
    }

    /// Numbers in rows and columns.
    pub(crate) fn table(&self) -> Result<(&'a Array, usize, usize), ReadViewsError> {
        let array = self.numbers()?;
        match array.dims[..] {
            [rows, columns] => Ok((array, rows, columns)),
            _ => Err(self.found(sizes(&array.dims), "rows and columns")),
        }
    }

    /// Whether this is an array without a value.
    pub(crate) fn is_empty(&self) -> bool {
        matches!(self.place, Place::Value(Value::Numbers(array)) if array.len() == 0)
    }

    /// A finite number.
    pub(crate) fn number(&self) -> Result<f64, ReadViewsError> {
        let [value] = self.vector()?;
        Ok(value)
    }

    /// Exactly so many finite numbers, in a row or a column.
    pub(crate) fn vector<const N: usize>(&self) -> Result<[f64; N], ReadViewsError> {
        let array = self.numbers()?;
        let expected =
            || if N == 1 { "a finite number".into() } else { format!("{N} finite numbers") };
        if array.len() != N {
            return Err(self.found(format!("{} numbers", sizes(&array.dims)), expected()));
        }
        let values: [f64; N] = std::array::from_fn(|i| array.at(i));
        match values.iter().find(|v| !v.is_finite()) {
            Some(found) => Err(self.found(found.to_string(), expected())),
            None => Ok(values),
        }
    }

    /// A 3x3 matrix of finite numbers, by rows.
    pub(crate) fn matrix3(&self) -> Result<[[f64; 3]; 3], ReadViewsError> {
        let (array, 3, 3) = self.table()? else { return Err(self.wrong("3x3 finite numbers")) };
        let matrix = std::array::from_fn(|i| std::array::from_fn(|j| array.at(3 * j + i)));
        if matrix.iter().flatten().all(|v: &f64| v.is_finite()) {
            Ok(matrix)
        } else {
            Err(self.found(format!("{matrix:?}"), "3x3 finite numbers"))
        }
    }

    /// Rows of three indices, from 1 in the file and from 0 here, of so many things.
    pub(crate) fn triangles(&self, count: usize) -> Result<Vec<[u32; 3]>, ReadViewsError> {
        let (array, rows, 3) = self.table()? else {
            return Err(self.wrong("rows of three indices"));
        };
        let triangle = |i: usize| {
            let corners: [f64; 3] = std::array::from_fn(|k| array.at(k * rows + i));
            if corners.iter().all(|&c| c >= 1.0 && c <= count as f64) {
                return Ok(corners.map(|c| c as u32 - 1));
            }
            Err(self.found(format!("{corners:?}"), format!("indices from 1 to {count}")))
        };
        (0..rows).map(triangle).collect()
    }

    /// Text; an empty array is the empty text, as MATLAB's `''` often arrives.
    pub(crate) fn text(&self) -> Result<&'a str, ReadViewsError> {
        match self.place {
            Place::Value(Value::Text(text)) => Ok(text.trim_end_matches('\n')),
            _ if self.is_empty() => Ok(""),
            _ => Err(self.wrong("text")),
        }
    }

    fn at(&self, value: &'a Value, field: String) -> Node<'a> {
        Node { file: self.file, place: Place::Value(value), field }
    }
}
