//! JSON whose every value knows its place, so that messages can name file and field.

use std::path::Path;

use serde_json::Value;

use crate::error::ReadViewsError;

/// A value and where it stands.
#[derive(Clone, Debug)]
pub(crate) struct Node<'a> {
    file: &'a Path,
    value: &'a Value,
    /// Like `frames[3].transform_matrix`; empty for the whole file.
    pub(crate) field: String,
}

/// Parses JSON, and also what Python writes for numbers that are none.
///
/// `NaN` and `Infinity` become strings, so that the field that holds them can be named.
pub(crate) fn parse(bytes: &[u8], file: &Path) -> Result<Value, ReadViewsError> {
    serde_json::from_slice(bytes).or_else(|error| {
        let text = String::from_utf8_lossy(bytes);
        if !text.contains("NaN") && !text.contains("Infinity") {
            return Err(ReadViewsError::new(file, error));
        }
        serde_json::from_str(&quote_non_numbers(&text)).map_err(|e| ReadViewsError::new(file, e))
    })
}

fn quote_non_numbers(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let (mut inside, mut rest) = (false, text);
    while let Some(c) = rest.chars().next() {
        let word = ["-Infinity", "Infinity", "NaN"].into_iter().find(|w| rest.starts_with(w));
        match (inside, word, c) {
            (false, Some(word), _) => {
                out.push('"');
                out.push_str(word);
                out.push('"');
                rest = &rest[word.len()..];
                continue;
            }
            (true, _, '\\') => {
                let escaped: String = rest.chars().take(2).collect();
                rest = &rest[escaped.len()..];
                out.push_str(&escaped);
                continue;
            }
            (_, _, '"') => inside = !inside,
            _ => {}
        }
        out.push(c);
        rest = &rest[c.len_utf8()..];
    }
    out
}

impl<'a> Node<'a> {
    pub(crate) fn root(value: &'a Value, file: &'a Path) -> Self {
        Self { file, value, field: String::new() }
    }

    /// The file that the value stands in.
    pub(crate) fn file(&self) -> &'a Path {
        self.file
    }

    /// A member, where it is there and not `null`.
    pub(crate) fn get(&self, key: &str) -> Option<Node<'a>> {
        let value = self.value.get(key).filter(|v| !v.is_null())?;
        let dot = if self.field.is_empty() { "" } else { "." };
        Some(Node { file: self.file, value, field: format!("{}{dot}{key}", self.field) })
    }

    /// A member that must be there.
    pub(crate) fn need(&self, key: &str) -> Result<Node<'a>, ReadViewsError> {
        self.get(key).ok_or_else(|| {
            let dot = if self.field.is_empty() { "" } else { "." };
            ReadViewsError::field(
                self.file,
                format!("{}{dot}{key}", self.field),
                "nothing",
                "a value",
            )
        })
    }

    /// The elements of an array.
    pub(crate) fn elements(&self) -> Result<Vec<Node<'a>>, ReadViewsError> {
        let array = self.value.as_array().ok_or_else(|| self.wrong("an array"))?;
        Ok(array
            .iter()
            .enumerate()
            .map(|(i, value)| Node {
                file: self.file,
                value,
                field: format!("{}[{i}]", self.field),
            })
            .collect())
    }

    /// A finite number.
    pub(crate) fn number(&self) -> Result<f64, ReadViewsError> {
        self.value.as_f64().filter(|v| v.is_finite()).ok_or_else(|| self.wrong("a finite number"))
    }

    /// A finite number above zero.
    pub(crate) fn positive(&self) -> Result<f64, ReadViewsError> {
        let value = self.number()?;
        if value > 0.0 { Ok(value) } else { Err(self.wrong("a number above 0")) }
    }

    /// A whole number of pixels, which some tools write as a float.
    pub(crate) fn pixels(&self) -> Result<usize, ReadViewsError> {
        let value = self.positive()?;
        if value.fract() == 0.0 && value < 1e9 {
            Ok(value as usize)
        } else {
            Err(self.wrong("a whole number of pixels"))
        }
    }

    pub(crate) fn text(&self) -> Result<&'a str, ReadViewsError> {
        self.value.as_str().ok_or_else(|| self.wrong("a string"))
    }

    /// A 4x4 matrix of finite numbers, as an array of rows; three rows get the last of an
    /// affine map.
    pub(crate) fn matrix(&self) -> Result<[[f64; 4]; 4], ReadViewsError> {
        let rows = self.elements()?;
        if rows.len() != 4 && rows.len() != 3 {
            return Err(self.wrong("4 rows of 4 numbers"));
        }
        let mut matrix = [[0.0, 0.0, 0.0, 1.0]; 4];
        for (out, row) in matrix.iter_mut().zip(&rows) {
            let row = row.elements()?;
            if row.len() != 4 {
                return Err(self.wrong("4 rows of 4 numbers"));
            }
            for (out, value) in out.iter_mut().zip(&row) {
                *out = value.number()?;
            }
        }
        Ok(matrix)
    }

    /// Yes or no, also as 0 or 1.
    pub(crate) fn flag(&self) -> Result<bool, ReadViewsError> {
        match self.value.as_bool() {
            Some(flag) => Ok(flag),
            None => match self.value.as_f64() {
                Some(0.0) => Ok(false),
                Some(1.0) => Ok(true),
                _ => Err(self.wrong("true or false")),
            },
        }
    }

    /// Exactly so many finite numbers.
    pub(crate) fn numbers<const N: usize>(&self) -> Result<[f64; N], ReadViewsError> {
        let elements = self.elements()?;
        if elements.len() != N {
            return Err(self.wrong(format!("{N} numbers")));
        }
        let mut out = [0.0; N];
        for (out, element) in out.iter_mut().zip(&elements) {
            *out = element.number()?;
        }
        Ok(out)
    }

    /// A 3x3 matrix of finite numbers, as an array of rows.
    pub(crate) fn matrix3(&self) -> Result<[[f64; 3]; 3], ReadViewsError> {
        let rows = self.elements()?;
        if rows.len() != 3 {
            return Err(self.wrong("3 rows of 3 numbers"));
        }
        let mut out = [[0.0; 3]; 3];
        for (out, row) in out.iter_mut().zip(&rows) {
            *out = row.numbers()?;
        }
        Ok(out)
    }

    /// The members of an object, in the order of their keys' text.
    pub(crate) fn members(&self) -> Result<Vec<(&'a str, Node<'a>)>, ReadViewsError> {
        let object = self.value.as_object().ok_or_else(|| self.wrong("an object"))?;
        let dot = if self.field.is_empty() { "" } else { "." };
        Ok(object
            .iter()
            .map(|(key, value)| {
                let field = format!("{}{dot}{key}", self.field);
                (key.as_str(), Node { file: self.file, value, field })
            })
            .collect())
    }

    /// An error about this value.
    pub(crate) fn wrong(&self, expected: impl Into<String>) -> ReadViewsError {
        let mut found = self.value.to_string();
        if found.chars().count() > 60 {
            found = found.chars().take(57).chain("...".chars()).collect();
        }
        ReadViewsError::field(self.file, &self.field, found, expected)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn a_number_that_is_none_is_named_by_its_field() {
        let file = Path::new("a.json");
        let text = br#"{"say": "NaN \" -Infinity", "m": [[1, NaN, 0, 0], [0, 1, 0, 0], [-Infinity, 0, 1, 0]]}"#;
        let value = parse(text, file).unwrap();
        let root = Node::root(&value, file);
        assert_eq!(root.need("say").unwrap().text().unwrap(), "NaN \" -Infinity");
        let error = root.need("m").unwrap().matrix().unwrap_err();
        assert_eq!(error.field_name(), Some("m[0][1]"));
        assert!(error.to_string().contains("NaN"), "{error}");
    }

    #[test]
    fn what_is_missing_or_of_another_kind_is_named() {
        let file = Path::new("a.json");
        let value = parse(br#"{"a": {"b": "x"}}"#, file).unwrap();
        let a = Node::root(&value, file).need("a").unwrap();
        assert_eq!(a.need("c").unwrap_err().field_name(), Some("a.c"));
        let b = a.need("b").unwrap();
        assert_eq!(b.number().unwrap_err().field_name(), Some("a.b"));
        assert!(b.matrix().is_err() && b.pixels().is_err());
        assert!(parse(b"{", file).is_err());
    }
}
