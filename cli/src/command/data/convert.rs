//! `unsphere data convert`: a dataset in another layout.

use std::fmt::Write as _;
use std::path::{Component, Path, PathBuf};

use datasets::r2n2::{Rendering, Splits, write_object, write_splits};
use datasets::{ColmapForm, Entry, ReadOptions, Truth, View, Views, WriteViewsError};
use datasets::{write_colmap, write_kaolin, write_photos, write_transforms_split};
use serde::Serialize;
use train::output::OutputFolder;
use train::report::counted;

use crate::args::{Convert, WrittenLayout, create};
use crate::console::Console;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::progress::Progress;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Converted<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    output: &'a Path,
    objects: usize,
    views: usize,
    /// What the new layout has no place for.
    lost: Vec<String>,
}

pub(crate) fn run(console: Console, arguments: &Convert) -> Result<(), Failure> {
    // Refusals come before the work.
    let folder = create(&arguments.to, arguments.force)?;
    // Nothing is kept of what is not finished.
    let _interrupt = Interrupt::listen(Some(folder.unfinished()))?;
    let options = ReadOptions { depth: true, ..arguments.reading.options() };
    let dataset = datasets::open_with(&arguments.from, &options)?;
    let entries = dataset.entries();
    // Those of one object come with its views.
    let warnings = if entries.len() > 1 { dataset.warnings() } else { &[] };
    for warning in warnings {
        console.warn(warning);
    }
    let chosen: Vec<usize> = match &options.object {
        Some(name) => vec![datasets::choose(&arguments.from, entries, Some(name))?],
        None => (0..entries.len()).collect(),
    };
    let progress = Progress::new(console, "convert");
    let (mut views_count, mut lost) = (0, Vec::new());
    let mut splits = Splits::default();
    for (done, &object) in chosen.iter().enumerate() {
        progress.set(done, chosen.len());
        let views = dataset.views(object, None, &options, &|_, _| {})?;
        views.warnings.iter().for_each(|warning| console.warn(warning));
        views_count += views.len();
        let truth = dataset.truth(object)?;
        let entry = &entries[object];
        lost.extend(lost_split(&views, entry, arguments.layout));
        if arguments.layout == WrittenLayout::R2n2 {
            write_r2n2(&views.views, entry, &truth, folder.path())?;
            if let Some(subset) = entry.subset {
                let all = (0..views.len()).collect();
                splits.insert(synset_of(entry), &entry.name, subset, all);
            }
            continue;
        }
        if truth != Truth::default() {
            lost.push(format!("the true shape of {}", entry.name));
        }
        let place = if chosen.len() == 1 {
            folder.path().to_owned()
        } else {
            place_of(entry, folder.path())?
        };
        write(&views, &place, arguments.layout)
            .map_err(|error| refusal(&error, &folder, &arguments.to))?;
    }
    progress.finish();
    if !splits.is_empty() {
        write_splits(folder.path(), &splits).map_err(Failure::other)?;
    }
    let output = folder.commit()?;
    let converted = Converted { output: &output, objects: chosen.len(), views: views_count, lost };
    console.result(&converted, |converted| {
        let mut text = format!(
            "{}, {} in {}\n",
            counted(converted.objects, "object"),
            counted(converted.views, "view"),
            converted.output.display()
        );
        for lost in &converted.lost {
            let _ = writeln!(text, "  the layout has no place for {lost}");
        }
        text
    })
}

/// Which views are kept for tests, where the layout cannot say it: a fit would take them too.
fn lost_split(views: &Views, entry: &Entry, layout: WrittenLayout) -> Option<String> {
    let says = layout == WrittenLayout::Transforms || views.test.is_empty();
    let name = if entry.name.is_empty() { "the object" } else { &entry.name };
    let kept = counted(views.test.len(), "view");
    (!says).then(|| format!("which views of {name} are kept for tests ({kept}): transforms has"))
}

fn write(views: &Views, folder: &Path, layout: WrittenLayout) -> Result<(), WriteViewsError> {
    let Views { views, test, .. } = views;
    match layout {
        WrittenLayout::Kaolin => write_kaolin(views, folder),
        WrittenLayout::Transforms => write_transforms_split(views, test, folder),
        WrittenLayout::Colmap => write_colmap(views, folder, ColmapForm::Binary),
        WrittenLayout::ColmapText => write_colmap(views, folder, ColmapForm::Text),
        WrittenLayout::Photos => write_photos(views, folder),
        WrittenLayout::R2n2 => unreachable!("written with its true shape, above"),
    }
}

/// The folder of one object of many: below the root, whatever the files of a dataset call it.
fn place_of(entry: &Entry, root: &Path) -> Result<PathBuf, Failure> {
    let name = entry.full_name();
    let is_below = Path::new(&name).components().all(|part| matches!(part, Component::Normal(_)));
    if is_below {
        return Ok(root.join(name));
    }
    Err(Failure::Input(format!("object {name:?}: no name of a folder")))
}

/// The category as a folder's name, of which an object alone has none.
fn synset_of(entry: &Entry) -> &str {
    if entry.category.is_empty() { "00000000" } else { &entry.category }
}

fn write_r2n2(views: &[View], entry: &Entry, truth: &Truth, root: &Path) -> Result<(), Failure> {
    let renderings: Vec<Rendering> = views
        .iter()
        .map(|view| {
            let refused = |e| Failure::Other(format!("{}, view {}: {e}", entry.name, view.name));
            Rendering::from_view(view).map_err(refused)
        })
        .collect::<Result<_, _>>()?;
    write_object(root, synset_of(entry), &entry.name, &renderings, truth).map_err(Failure::other)
}

/// The refusal with the place that was asked for, not the one under construction.
fn refusal(error: &WriteViewsError, folder: &OutputFolder, target: &Path) -> Failure {
    let path = error
        .path
        .strip_prefix(folder.path())
        .map_or_else(|_| error.path.clone(), |rest| target.join(rest));
    Failure::Other(format!("{}: cannot be written: {}", path.display(), error.source))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_stay_below_the_folder_whatever_they_are_called() {
        let place = |category: &str, name: &str| {
            let (category, name) = (category.to_owned(), name.to_owned());
            place_of(&Entry { category, name, ..Entry::default() }, Path::new("out"))
        };
        for (category, name, wanted) in [
            ("chair", "a/b", "out/chair/a/b"),
            ("", "a", "out/a"),
            ("chair", "/etc", "out/chair/etc"),
        ] {
            assert_eq!(place(category, name).ok().as_deref(), Some(Path::new(wanted)));
        }
        for (category, name) in [("/etc", "a"), ("chair", "../../a"), ("..", "a"), ("", "/a")] {
            assert!(place(category, name).is_err(), "{category}, {name}");
        }
    }
}
