//! JSON whose every value knows its place, so that messages can name file and field.

mod value;

use std::path::Path;

use serde_json::Value;

use crate::content::{Content, over};
use crate::error::ReadViewsError;

use value::Failure;

/// No place is named by a longer key: some come from the file, and stand in the name of every
/// place below them.
const LONGEST_KEY: usize = 60;

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
/// `NaN` and `Infinity` become strings, so that the field that holds them can be named. A byte order mark before the text, as
/// editors of Windows write it, is passed over.
///
/// # Errors
/// Text that is no JSON, or whose values would take more memory than a file of its length may.
pub(crate) fn parse(content: &Content, file: &Path) -> Result<Value, ReadViewsError> {
    let mut budget = content.budget();
    let bytes: &[u8] = content;
    let content = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let failed = |failure| match failure {
        Failure::Json(error) => ReadViewsError::new(file, error),
        Failure::OverLimit(limit) => over(file, "the values of the file", limit),
    };
    value::parse(content, &mut budget.clone()).or_else(|failure| {
        let says = |word: &[u8]| content.windows(word.len()).any(|found| found == word);
        let Failure::Json(_) = failure else { return Err(failed(failure)) };
        if !says(b"NaN") && !says(b"Infinity") {
            return Err(failed(failure));
        }
        // The text, where a byte that is no UTF-8 takes three, and its copy.
        let copies = budget.take((content.len() as u64).saturating_mul(6));
        copies.map_err(|limit| failed(Failure::OverLimit(limit)))?;
        let text = quote_non_numbers(&String::from_utf8_lossy(content));
        value::parse(text.as_bytes(), &mut budget).map_err(failed)
    })
}

fn quote_non_numbers(text: &str) -> String {
    // The words become longer by their quotes, at most by as much as two for three letters.
    let mut out = String::with_capacity(text.len() / 3 * 5 + 2);
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

    /// Where a member is.
    fn place(&self, key: &str) -> String {
        let dot = if self.field.is_empty() { "" } else { "." };
        format!("{}{dot}{key}", self.field)
    }

    /// A member, where it is there and not `null`.
    pub(crate) fn get(&self, key: &str) -> Option<Node<'a>> {
        let value = self.value.get(key).filter(|v| !v.is_null())?;
        Some(Node { file: self.file, value, field: self.place(key) })
    }

    /// A member that must be there.
    pub(crate) fn need(&self, key: &str) -> Result<Node<'a>, ReadViewsError> {
        self.get(key)
            .ok_or_else(|| ReadViewsError::field(self.file, self.place(key), "nothing", "a value"))
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

    /// A whole number from 0 that counts or points at something.
    pub(crate) fn index(&self) -> Result<usize, ReadViewsError> {
        let value = self.value.as_u64().and_then(|value| usize::try_from(value).ok());
        value.ok_or_else(|| self.wrong("a whole number from 0"))
    }

    pub(crate) fn text(&self) -> Result<&'a str, ReadViewsError> {
        self.value.as_str().ok_or_else(|| self.wrong("a string"))
    }

    /// A 4x4 matrix of finite numbers, as an array of rows; three rows get the last of an
    /// affine map.
    pub(crate) fn matrix(&self) -> Result<[[f64; 4]; 4], ReadViewsError> {
        let rows = self.rows()?;
        if rows.len() != 4 && rows.len() != 3 {
            return Err(self.wrong("4 rows of 4 numbers"));
        }
        let mut matrix = [[0.0, 0.0, 0.0, 1.0]; 4];
        matrix[..rows.len()].copy_from_slice(&rows);
        Ok(matrix)
    }

    /// A matrix that maps points in columns without a projection: its last row, if it is there, is 0, 0, 0, 1.
    pub(crate) fn pose(&self) -> Result<[[f64; 4]; 4], ReadViewsError> {
        let matrix = self.matrix()?;
        let mut last = matrix[3].iter().zip([0.0, 0.0, 0.0, 1.0]);
        if last.any(|(found, expected): (&f64, f64)| (found - expected).abs() > 1e-3) {
            return Err(self.wrong("a last row of 0, 0, 0, 1"));
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
        let numbers = self.elements()?.iter().map(Node::number).collect::<Result<Vec<_>, _>>()?;
        numbers.try_into().map_err(|_| self.wrong(format!("{N} numbers")))
    }

    /// Rows of so many finite numbers each.
    pub(crate) fn rows<const N: usize>(&self) -> Result<Vec<[f64; N]>, ReadViewsError> {
        self.elements()?.iter().map(Node::numbers).collect()
    }

    /// A 3x3 matrix of finite numbers, as an array of rows.
    pub(crate) fn matrix3(&self) -> Result<[[f64; 3]; 3], ReadViewsError> {
        self.rows()?.try_into().map_err(|_| self.wrong("3 rows of 3 numbers"))
    }

    /// The members of an object, in the order of their keys' text.
    pub(crate) fn members(&self) -> Result<Vec<(&'a str, Node<'a>)>, ReadViewsError> {
        let object = self.value.as_object().ok_or_else(|| self.wrong("an object"))?;
        Ok(object
            .iter()
            .map(|(key, value)| {
                let end = key.char_indices().nth(LONGEST_KEY).map_or(key.len(), |(end, _)| end);
                (key.as_str(), Node { file: self.file, value, field: self.place(&key[..end]) })
            })
            .collect())
    }

    /// An error about this value.
    pub(crate) fn wrong(&self, expected: impl Into<String>) -> ReadViewsError {
        ReadViewsError::field(self.file, &self.field, short(self.value), expected)
    }
}

/// The value's text, cut: only as much of it is written as is shown.
fn short(value: &Value) -> String {
    const MOST: usize = 400;
    let mut text = [0; MOST];
    let mut rest = &mut text[..];
    // Where the text is longer, writing ends with an error that says nothing new.
    let _ = serde_json::to_writer(&mut rest, value);
    let left = rest.len();
    let text = String::from_utf8_lossy(&text[..MOST - left]);
    if text.chars().count() > 60 {
        text.chars().take(57).chain("...".chars()).collect()
    } else {
        text.into_owned()
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
        let value = parse(&Content::from(&text[..]), file).unwrap();
        let root = Node::root(&value, file);
        assert_eq!(root.need("say").unwrap().text().unwrap(), "NaN \" -Infinity");
        let error = root.need("m").unwrap().matrix().unwrap_err();
        assert_eq!(error.field_name(), Some("m[0][1]"));
        assert!(error.to_string().contains("NaN"), "{error}");
    }

    #[test]
    fn what_is_missing_or_of_another_kind_is_named() {
        let file = Path::new("a.json");
        let value = parse(&Content::from(&br#"{"a": {"b": "x"}}"#[..]), file).unwrap();
        let a = Node::root(&value, file).need("a").unwrap();
        assert_eq!(a.need("c").unwrap_err().field_name(), Some("a.c"));
        let b = a.need("b").unwrap();
        assert_eq!(b.number().unwrap_err().field_name(), Some("a.b"));
        assert!(b.matrix().is_err() && b.pixels().is_err());
        assert!(parse(&Content::from(&b"{"[..]), file).is_err());
    }

    #[test]
    fn a_byte_order_mark_says_nothing() {
        let file = Path::new("a.json");
        for text in ["\u{feff}{\"a\": 7}", "\u{feff}{\"a\": 7, \"b\": NaN}"] {
            let value = parse(&Content::from(text.as_bytes()), file).unwrap();
            assert_eq!(Node::root(&value, file).need("a").unwrap().number().unwrap(), 7.0);
        }
        for text in ["\u{feff}", "\u{feff}\u{feff}1", "1\u{feff}"] {
            assert!(parse(&Content::from(text.as_bytes()), file).is_err(), "{text:?}");
        }
    }
}
