//! How a fit or a system is configured.

use std::path::PathBuf;

use clap::Args;
use recon::fit::Quality;

use super::values::{Choices, one_of};

const QUALITIES: &Choices<Quality> = &[
    ("draft", "A look in about a second: 2,562 vertices", Quality::Draft),
    ("normal", "10,242 vertices with a colour each", Quality::Normal),
    (
        "high",
        "40,962 vertices, a texture and larger images of it, for pictures of 512 pixels and more",
        Quality::High,
    ),
];

/// How a fit is configured.
#[derive(Args, Clone, Debug)]
pub(crate) struct Configuration {
    /// How fine, and in how much time [default: normal].
    #[arg(long, value_parser = one_of(QUALITIES), conflicts_with = "config")]
    pub(crate) quality: Option<Quality>,
    /// A configuration file instead; what it leaves out has its default. `config.toml` of an earlier
    /// result is one.
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// One setting, over quality or configuration file; can be given many times.
    ///
    /// For example `--set level=4 --set color=texture`. `unsphere check --options` lists them all.
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = key_value)]
    pub(crate) set: Vec<(String, String)>,
}

/// How a dataset that is made is configured.
#[derive(Args, Clone, Debug)]
pub(crate) struct DataSettings {
    /// A configuration file; what it leaves out has its default. `dataset.toml` of an earlier dataset is one.
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// One setting, over the configuration file; can be given many times.
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = key_value)]
    pub(crate) set: Vec<(String, String)>,
}

/// How a system is configured.
#[derive(Args, Clone, Debug)]
pub(crate) struct SystemSettings {
    /// A configuration that comes with the system: tiny, small, paper, and more with some; a name that is none lists them.
    #[arg(long, value_name = "NAME", default_value = "small", conflicts_with = "config")]
    pub(crate) preset: String,
    /// A configuration file instead of a preset, `config.toml` of an earlier run for example.
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// One setting, over the preset or file; can be given many times.
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = key_value)]
    pub(crate) set: Vec<(String, String)>,
}

pub(crate) fn key_value(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => {
            Ok((key.trim().to_owned(), value.trim().to_owned()))
        }
        _ => Err("expected KEY=VALUE, for example level=4".to_owned()),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn settings_have_a_key_and_a_value() {
        assert_eq!(key_value("level = 4").unwrap(), ("level".into(), "4".into()));
        assert_eq!(key_value("a=b=c").unwrap().1, "b=c");
        assert!(key_value("level").is_err() && key_value("=4").is_err());
    }
}
