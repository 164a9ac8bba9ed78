//! Weights that come along with the program.

use std::path::{Path, PathBuf};

use models::predict::Predictor;
use train::CheckpointPath;

use crate::failure::Failure;

/// The weights of a system that somebody trained for all: `SYSTEM.safetensors` of `folder`, or of the first place that has it.
///
/// # Errors
/// Where it was looked for, and how one is trained.
pub(crate) fn shipped<S: Predictor>(folder: Option<&Path>) -> Result<CheckpointPath, Failure> {
    let places = folder.map_or_else(places, |folder| vec![folder.to_owned()]);
    let name = format!("{}.safetensors", S::NAME);
    let found = places.iter().map(|place| place.join(&name)).find(|file| file.is_file());
    let missing = || {
        let looked: Vec<String> = places.iter().map(|p| p.display().to_string()).collect();
        let looked = looked.join(", ");
        let how = S::TRAINING;
        let text = format!("no {name} in {looked}; --checkpoint names a trained model: {how}");
        Failure::Usage(text)
    };
    let file = found.ok_or_else(missing)?;
    Ok(CheckpointPath { file, run: None })
}

/// Where weights may lie, the first that has them counts: beside the program, in the share folder of where it is installed,
/// among the user's data, and where it was built.
fn places() -> Vec<PathBuf> {
    let mut places = Vec::new();
    if let Some(folder) = std::env::current_exe().ok().as_deref().and_then(Path::parent) {
        places.push(folder.join("weights"));
        places.extend(folder.parent().map(|prefix| prefix.join("share/unsphere/weights")));
    }
    places.extend(user_data().map(|data| data.join("unsphere/weights")));
    places
        .extend(Path::new(env!("CARGO_MANIFEST_DIR")).parent().map(|clone| clone.join("weights")));
    places
}

/// The folder of a user's data, as each system has it.
fn user_data() -> Option<PathBuf> {
    let variable = |name: &str| {
        let value = std::env::var_os(name).map(PathBuf::from);
        value.filter(|path| path.is_absolute())
    };
    if cfg!(windows) {
        return variable("APPDATA");
    }
    if cfg!(target_os = "macos") {
        return variable("HOME").map(|home| home.join("Library/Application Support"));
    }
    variable("XDG_DATA_HOME").or_else(|| variable("HOME").map(|home| home.join(".local/share")))
}
