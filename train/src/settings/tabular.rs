//! What a table of TOML holds, compiled where it is declared.

use toml::Table;
use toml::de::Error;

/// A configuration as a table. [`options!`](crate::options) implements it.
///
/// It is what `serde` is asked for with `toml` as the format, in functions that are not generic: reading a struct of fifty
/// fields is a great deal of code, which is so compiled with the struct, and not once more in every crate that reads one.
pub trait Tabular: Sized {
    /// Reads it from a text.
    ///
    /// # Errors
    /// If the text is no TOML, or has an unknown field or a wrong value.
    fn from_text(text: &str) -> Result<Self, Error>;

    /// Reads it from a table.
    ///
    /// # Errors
    /// If it has an unknown field or a wrong value.
    fn from_table(table: Table) -> Result<Self, Error>;

    /// The table that [`from_table`](Self::from_table) takes back.
    fn to_table(&self) -> Table;

    /// The text that [`from_text`](Self::from_text) takes back.
    fn to_text(&self) -> String;
}
