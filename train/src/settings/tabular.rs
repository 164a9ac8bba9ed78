//! What a table of TOML holds, compiled where it is declared.

use serde::de::Error as _;
use toml::Table;
use toml::de::Error;

/// A configuration as a table. [`options!`](crate::options) implements it.
///
/// It is what `serde` is asked for with `toml` as the format, in functions that are not generic: reading a struct of fifty
/// fields is a great deal of code, which is so compiled with the struct, and not once more in every crate that reads one.
/// For the same reason it is read from tables and written as text, and the other two ways lead over these.
pub trait Tabular: Sized {
    /// Reads it from a table.
    ///
    /// # Errors
    /// If it has an unknown field or a wrong value.
    fn from_table(table: Table) -> Result<Self, Error>;

    /// The text that [`from_text`](Self::from_text) takes back.
    fn to_text(&self) -> String;

    /// Reads it from a text.
    ///
    /// # Errors
    /// If the text is no TOML, or has an unknown field or a wrong value.
    fn from_text(text: &str) -> Result<Self, Error> {
        Self::from_table(parsed(text)?)
    }

    /// The table that [`from_table`](Self::from_table) takes back.
    fn to_table(&self) -> Table {
        parsed(&self.to_text()).expect("what was written")
    }
}

/// A text as a table.
pub(super) fn parsed(text: &str) -> Result<Table, Error> {
    toml::from_str(text)
}

/// What a table holds; of several values that do not fit the first is named, which `toml` alone does not do.
///
/// # Errors
/// Those of `read`.
// For `options!`, wherever it is used.
#[doc(hidden)]
pub fn or_named<T>(table: Table, read: Reading<'_, T>) -> Result<T, Error> {
    read(table.clone()).map_err(|error| {
        let alone = |(key, value)| {
            let error = read([(String::clone(&key), value)].into_iter().collect()).err()?;
            Some((key, error))
        };
        match table.into_iter().find_map(alone) {
            Some((_, error)) if error.message().contains("unknown field") => error,
            Some((key, error)) => Error::custom(format!("`{key}`: {}", error.message())),
            None => error,
        }
    })
}

type Reading<'a, T> = &'a dyn Fn(Table) -> Result<T, Error>;
