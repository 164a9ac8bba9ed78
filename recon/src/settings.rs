//! Configurations as text: a TOML file, single settings over it, errors that name the field.

#[cfg(test)]
mod ranges;

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::{Table, Value};

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
/// use recon::fit::FitConfig;
///
/// let settings = [("level".to_string(), "4".to_string())];
/// let config: FitConfig = recon::settings::read(None, &settings)?;
/// assert_eq!(config.level, 4);
/// # Ok::<(), recon::settings::SettingsError>(())
/// ```
///
/// # Errors
/// If the file cannot be read, or it or a setting has an unknown field or a wrong value. Ranges are
/// checked by the configuration itself.
pub fn read<T: DeserializeOwned>(
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
pub fn read_text<T: DeserializeOwned>(
    name: &Path,
    text: &str,
    settings: &[(String, String)],
) -> Result<T, SettingsError> {
    let in_file = |error: toml::de::Error| SettingsError::File {
        path: name.to_owned(),
        message: error.to_string(),
    };
    let mut config: T = toml::from_str(text).map_err(in_file)?;
    let mut table: Table = toml::from_str(text).map_err(in_file)?;
    for (key, value) in settings {
        table.insert(key.replace('_', "-"), parse(value));
        // One at a time, so that the error is that of this setting.
        config =
            table.clone().try_into().map_err(|error: toml::de::Error| SettingsError::Setting {
                key: key.clone(),
                value: value.clone(),
                message: error.message().to_owned(),
            })?;
    }
    Ok(config)
}

/// The configuration as TOML, which [`read`] takes back.
///
/// # Panics
/// If the type cannot be said in TOML, which no configuration of this crate is.
pub fn to_toml<T: Serialize>(config: &T) -> String {
    toml::to_string_pretty(config).expect("configurations are plain tables")
}

/// Whether a count can be said in TOML, which has no larger integers than 2^63 - 1.
pub(crate) fn in_toml(count: impl TryInto<i64>) -> bool {
    count.try_into().is_ok()
}

fn parse(value: &str) -> Value {
    toml::from_str::<Table>(&format!("value = {value}"))
        .ok()
        .filter(|table| table.len() == 1)
        .and_then(|mut table| table.remove("value"))
        .unwrap_or_else(|| Value::String(value.to_owned()))
}

/// Each preset of a system is in range, and is the same when it was written and read.
#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
pub(crate) fn assert_presets<S: crate::train::System>() {
    for (name, text) in S::PRESETS {
        let config: crate::train::Configuration<S::Config> = toml::from_str(text).unwrap();
        assert_eq!(config.train.check(), Vec::<String>::new(), "{name}");
        S::check(&config.system).unwrap();
        let again = to_toml(&config);
        assert_eq!(
            toml::from_str::<crate::train::Configuration<S::Config>>(&again).unwrap(),
            config,
            "{name}"
        );
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::fit::{ColorKind, FitConfig};

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
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "level = \"x\"").unwrap();
        let error = read::<FitConfig>(Some(file.path()), &[]).unwrap_err().to_string();
        assert!(error.contains("level") && error.contains(file.path().to_str().unwrap()));
        assert!(matches!(
            read::<FitConfig>(Some(Path::new("nowhere.toml")), &[]),
            Err(SettingsError::Io { .. })
        ));
    }
}
