//! The configuration of a system that the command line asks for.

use std::path::Path;

use train::{Configuration, System, settings};

use crate::args::{Global, SystemSettings};
use crate::failure::Failure;

/// The configuration that the command line asks for, read but not yet checked as a whole.
pub(crate) fn configuration<S: System>(
    asked: &SystemSettings,
    global: Global,
) -> Result<Configuration<S::Config>, Failure> {
    let mut config: Configuration<S::Config> = match &asked.config {
        // `-` stands for no file at all: the defaults.
        Some(path) if path.as_os_str() == "-" => settings::read(None, &asked.set),
        Some(path) => settings::read(Some(path), &asked.set),
        None => {
            let presets = S::PRESETS;
            let Some((name, text)) = presets.iter().find(|(name, _)| *name == asked.preset) else {
                let names = presets.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
                let text = format!("--preset {}: expected one of {names}", asked.preset);
                return Err(Failure::Usage(text));
            };
            let name = format!("preset {name}");
            settings::read_text(Path::new(&name), text, &asked.set)
        }
    }?;
    if let Some(seed) = global.seed {
        config.train.seed = seed;
    }
    let problems = S::problems(&config);
    match (problems.is_empty(), &asked.config) {
        (true, _) => Ok(config),
        (false, Some(path)) if asked.set.is_empty() => {
            Err(Failure::Input(format!("{}: {}", path.display(), problems.join("; "))))
        }
        (false, _) => Err(Failure::Usage(problems.join("; "))),
    }
}
