//! Configurations as text: a TOML file, single settings over it, errors that name the field.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use toml::{Table, Value};

pub mod optional;

mod options;
mod ranged;
mod tabular;
mod words;

pub(crate) use options::date;
pub use options::{Declared, OptionInfo, Options};
pub use tabular::Tabular;
use tabular::parsed;
// For `options!`, wherever it is used.
#[doc(hidden)]
pub use tabular::or_named;
#[doc(hidden)]
pub use toml;

pub use ranged::{LARGEST, Ranged, above_to, out_of_range, range_of};

/// Why a configuration cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SettingsError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is no TOML, or has a field that does not exist or cannot hold its value.
    #[error("{}: {}", path.display(), message.trim_end())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong and where.
        message: String,
    },
    /// A single setting names a field that does not exist, or a value that it cannot hold.
    #[error("setting {key}={value}: {}", message.trim_end())]
    Setting {
        /// The field.
        key: String,
        /// The value as it was given.
        value: String,
        /// What is wrong.
        message: String,
    },
}

/// Reads a configuration: the defaults, under a file, under single settings.
///
/// A setting's value is TOML (`4`, `0.5`, `true`, `[1, 2]`); what is not, is taken as text, so that
/// `color=texture` needs no quotes. Underscores in keys may stand for dashes.
///
/// ```
/// use train::{TrainConfig, settings};
///
/// let set = [("max_steps".to_string(), "400".to_string())];
/// let config: TrainConfig = settings::read(None, &set)?;
/// assert_eq!(config.max_steps, Some(400));
/// # Ok::<(), settings::SettingsError>(())
/// ```
///
/// # Errors
/// If the file cannot be read, or it or a setting has an unknown field or a wrong value. Ranges are
/// checked by the configuration itself.
pub fn read<T: Tabular>(
    file: Option<&Path>,
    settings: &[(String, String)],
) -> Result<T, SettingsError> {
    let mut text = String::new();
    if let Some(path) = file {
        text = std::fs::read_to_string(path)
            .map_err(|source| SettingsError::Io { path: path.to_owned(), source })?;
    }
    read_text(file.unwrap_or_else(|| Path::new("configuration")), &text, settings)
}

/// [`read`] for a text that is at hand, a preset say; `name` is what errors call it.
///
/// # Errors
/// As [`read`], but for the file.
pub fn read_text<T: Tabular>(
    name: &Path,
    text: &str,
    settings: &[(String, String)],
) -> Result<T, SettingsError> {
    let file = |message| SettingsError::File { path: name.to_owned(), message };
    // The place in a text that is no TOML is said too.
    let table = parsed(text).map_err(|error| file(error.to_string()))?;
    let in_file = |error: toml::de::Error| file(words::plain(error.message()));
    let config = T::from_table(table.clone()).map_err(in_file)?;
    if settings.is_empty() {
        return Ok(config);
    }
    T::from_table(layered(table, settings, &reads::<T>)?).map_err(in_file)
}

/// Why a table does not hold a configuration.
pub(crate) type Reads<'a> = &'a dyn Fn(Table) -> Result<(), toml::de::Error>;

/// [`Reads`] of a type.
pub(crate) fn reads<T: Tabular>(table: Table) -> Result<(), toml::de::Error> {
    T::from_table(table).map(drop)
}

/// A table under single settings.
fn layered(
    mut table: Table,
    settings: &[(String, String)],
    reads: Reads<'_>,
) -> Result<Table, SettingsError> {
    for (key, value) in settings {
        let (name, parsed) = (key.replace('_', "-"), parse(value));
        table.insert(name.clone(), parsed.clone());
        let mut read = reads(table.clone());
        if read.as_ref().is_err_and(says_twice) {
            // The file has it under a name of before.
            table.retain(|other, there| {
                other == name || !is_same_field((other, there), (&name, &parsed), reads)
            });
            read = reads(table.clone());
        }
        // One at a time, so that the error is that of this setting.
        read.map_err(|error| SettingsError::Setting {
            key: key.clone(),
            value: value.clone(),
            message: choices(&name, &error, reads).unwrap_or_else(|| words::plain(error.message())),
        })?;
    }
    Ok(table)
}

/// What is said of a number where one of several words is meant: the words, which the error of a wrong word names.
fn choices(name: &str, error: &toml::de::Error, reads: Reads<'_>) -> Option<String> {
    if !error.message().contains("unit variant") {
        return None;
    }
    let wrong = [(name.to_owned(), Value::String("?".to_owned()))];
    let other = reads(wrong.into_iter().collect()).err()?;
    let (_, expected) = other.message().rsplit_once("expected ")?;
    Some(format!("`{name}`: expected {}", expected.trim_end()))
}

/// The configuration as TOML, which [`read`] takes back.
pub fn to_toml<T: Tabular>(config: &T) -> String {
    config.to_text()
}

/// Every value of a configuration as text, under its full name (`table.key`); nothing of what is no TOML.
pub fn settings_of(text: &str) -> BTreeMap<String, String> {
    let mut settings = BTreeMap::new();
    let mut pending: Vec<(String, Table)> =
        parsed(text).map(|table| vec![(String::new(), table)]).unwrap_or_default();
    while let Some((prefix, table)) = pending.pop() {
        for (name, value) in table {
            let name = format!("{prefix}{name}");
            match value {
                Value::Table(inner) => pending.push((format!("{name}."), inner)),
                value => {
                    settings.insert(name, value.to_string());
                }
            }
        }
    }
    settings
}

/// Whether two keys name one field, which had another name before.
fn is_same_field(a: (&str, &Value), b: (&str, &Value), reads: Reads<'_>) -> bool {
    let both = [a, b].into_iter().map(|(key, value)| (key.to_owned(), value.clone()));
    reads(both.collect()).as_ref().is_err_and(says_twice)
}

/// Whether a table has a field by two names.
fn says_twice(error: &toml::de::Error) -> bool {
    error.message().contains("duplicate field")
}

fn parse(value: &str) -> Value {
    parsed(&format!("value = {value}"))
        .ok()
        .filter(|table| table.len() == 1)
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(value.to_owned()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use serde::{Deserialize, Serialize};

    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum ColorKind {
        #[default]
        Vertex,
        Texture,
    }

    crate::options! {
        /// Options of a fit.
        #[serde(deny_unknown_fields)]
        struct FitConfig {
            /// Subdivision level.
            level: u32 = 5;
            /// How many steps.
            steps: usize = 200;
            /// Of what is random.
            seed: u64 = 0;
            /// Every so many-th view.
            hold_out: usize = 10;
            /// Where colours are.
            color: ColorKind = ColorKind::Vertex;
        }
    }

    fn set(settings: &[(&str, &str)]) -> Result<FitConfig, SettingsError> {
        let settings: Vec<_> =
            settings.iter().map(|&(k, v)| (k.to_owned(), v.to_owned())).collect();
        read(None, &settings)
    }

    #[test]
    fn settings_go_over_the_file_over_the_defaults() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "level = 4\nsteps = 7\n").unwrap();
        let settings = [("steps".to_owned(), "9".to_owned())];
        let config: FitConfig = read(Some(file.path()), &settings).unwrap();
        assert_eq!((config.level, config.steps, config.seed), (4, 9, 0));
        std::fs::write(file.path(), to_toml(&config)).unwrap();
        assert_eq!(read::<FitConfig>(Some(file.path()), &[]).unwrap(), config);
    }

    #[test]
    fn words_need_no_quotes_and_underscores_are_dashes() {
        let config = set(&[("color", "texture"), ("hold_out", "0")]).unwrap();
        assert_eq!((config.color, config.hold_out), (ColorKind::Texture, 0));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let text = |settings: &[(&str, &str)]| set(settings).unwrap_err().to_string();
        assert!(text(&[("levle", "4")]).contains("levle=4"));
        assert!(text(&[("level", "high")]).contains("level=high"));
        assert!(text(&[("level", "4\nsteps = 2")]).contains("level=4"));
        for (key, value, expected) in [
            ("level", "high", "`level`: found \"high\", expected a whole number from 0"),
            ("level", "2.5", "`level`: found 2.5, expected a whole number from 0"),
            ("seed", "-1", "`seed`: found -1, expected a whole number from 0"),
            ("color", "5", "`color`: expected `vertex` or `texture`"),
        ] {
            let text = text(&[(key, value)]);
            assert_eq!(text, format!("setting {key}={value}: {expected}"));
        }
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "level = \"x\"").unwrap();
        let error = read::<FitConfig>(Some(file.path()), &[]).unwrap_err().to_string();
        assert!(error.contains("`level`: found \"x\", expected a whole number from 0"), "{error}");
        assert!(error.contains(file.path().to_str().unwrap()), "{error}");
        assert!(matches!(
            read::<FitConfig>(Some(Path::new("nowhere.toml")), &[]),
            Err(SettingsError::Io { .. })
        ));
    }
}
