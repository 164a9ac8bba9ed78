//! The weights that a training began with, by the command that began it.

use std::path::Path;

use train::{Checkpoint, CheckpointPath, RunMetadata};

use crate::model_card::BeganWith;

/// Trainings that may have begun with one another; of more the first are not looked at.
const MOST: usize = 16;

/// What `--from` named in a command; none where it is not there. The steps are all that are behind those weights.
pub(crate) fn began_with(command: &str) -> Option<BeganWith> {
    let path = named(command)?;
    let steps = steps_of(Path::new(&path), MOST);
    Some(BeganWith { path, steps })
}

/// Steps behind a checkpoint, with those of what its training began with.
fn steps_of(path: &Path, most: usize) -> Option<u64> {
    let found = CheckpointPath::find(path, false).ok()?;
    let own = Checkpoint::read(&found.file).ok()?.step().ok()?;
    let command = found.run.as_deref().and_then(|run| RunMetadata::of(run).command);
    let Some(before) = command.as_deref().and_then(named) else { return Some(own) };
    let before = (most > 0).then(|| steps_of(Path::new(&before), most - 1))??;
    own.checked_add(before)
}

/// The value of `--from`, as the command line quotes words.
fn named(command: &str) -> Option<String> {
    let at = command.find(" --from")? + " --from".len();
    let value = command[at..].strip_prefix([' ', '='])?.trim_start();
    let end = |value: &str| value.find(' ').unwrap_or(value.len());
    Some(match value.strip_prefix('\'') {
        // What holds quotes itself is of no use here.
        Some(quoted) => quoted.split('\'').next()?.to_owned(),
        None => value[..end(value)].to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weights_are_named_as_they_were_typed() {
        let of = |command: &str| named(command);
        assert_eq!(of("unsphere train mcmr --from first -o run").as_deref(), Some("first"));
        assert_eq!(of("unsphere train mcmr --from=a/b").as_deref(), Some("a/b"));
        assert_eq!(of("unsphere train mcmr --from 'my run' -o x").as_deref(), Some("my run"));
        assert_eq!(of("unsphere train mcmr -o run"), None);
        assert_eq!(of("unsphere train mcmr --from-there x"), None);
        let gone = began_with("unsphere train mcmr --from /nowhere/at-all -o run");
        assert_eq!(gone, Some(BeganWith { path: "/nowhere/at-all".to_owned(), steps: None }));
    }
}
