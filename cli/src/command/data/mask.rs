//! `unsphere data mask`: what in each view is the object.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use datasets::{Layout, MaskSource, OnInconsistent, ReadOptions, View, ViewsProblem, clean_mask};
use mesh_core::{ByteImage, Camera, encode_png, read_image};
use serde::Serialize;
use train::output::disk;
use train::report::counted;

use crate::args::{Mask, create};
use crate::console::Console;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::masks::{self, Made};

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Masked {
    #[serde(serialize_with = "train::path_text::serialize")]
    output: PathBuf,
    #[serde(flatten)]
    made: Made,
    views: Vec<Share>,
}

#[derive(Debug, Serialize)]
struct Share {
    name: String,
    file: String,
    /// The object's part of the image, 0 to 1.
    covered: f64,
}

pub(crate) fn run(console: Console, arguments: &Mask) -> Result<(), Failure> {
    let asked = &arguments.reading;
    if asked.mask != MaskSource::Auto || asked.masks.is_some() || asked.invert_masks {
        let problem = "masks are made here: leave --mask, --masks and --invert-masks away";
        return Err(Failure::Usage(problem.to_owned()));
    }
    let target = match &arguments.output {
        Some(folder) => folder.clone(),
        None if arguments.path.is_dir() => arguments.path.join("masks"),
        None => {
            let problem = "is no folder that masks could be put into: name one with -o";
            return Err(Failure::Usage(format!("{}: {problem}", arguments.path.display())));
        }
    };
    // Refusals come before the work.
    let folder = create(&target, arguments.force)?;
    // Nothing is kept of what is not finished.
    let _interrupt = Interrupt::listen(Some(folder.unfinished()))?;
    let (mut views, named) = views(console, arguments)?;
    let files = files(&views, named)?;
    let made = masks::make(console, &arguments.source, &mut views, named.is_some())?;
    let options = asked.options();
    for view in &mut views {
        clean_mask(&mut view.mask, &options);
    }
    let mut shares = Vec::new();
    for (view, file) in views.iter().zip(files) {
        let path = folder.path().join(&file);
        disk::make_folders(path.parent().unwrap_or_else(|| folder.path()))
            .map_err(Failure::other)?;
        folder.write(&file, &encode_png(&view.mask))?;
        let covered = view.mask_pixels() as f64 / view.mask.data.len() as f64;
        if covered == 0.0 {
            console.warn(format_args!("{}: no object found", view.name));
        }
        shares.push(Share { name: view.name.clone(), file, covered });
    }
    let output = folder.commit()?;
    console.result(&Masked { output, made, views: shares }, describe)
}

fn describe(masked: &Masked) -> String {
    let mut shares: Vec<f64> = masked.views.iter().map(|view| view.covered).collect();
    shares.sort_by(f64::total_cmp);
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let mut text = format!(
        "{} in {}; the object covers {} to {} of an image\n",
        counted(masked.views.len(), "mask"),
        masked.output.display(),
        percent(shares.first().copied().unwrap_or(0.0)),
        percent(shares.last().copied().unwrap_or(0.0)),
    );
    if masked.made.dropped + masked.made.filled > 0 {
        let Made { dropped, filled } = masked.made;
        let _ = writeln!(
            text,
            "the views put each other right: {} dropped, {filled} filled",
            counted(dropped, "pixel")
        );
    }
    text
}

/// The views with masks of all pixels, and their layout; none where there are images only.
fn views(console: Console, arguments: &Mask) -> Result<(Vec<View>, Option<Layout>), Failure> {
    let options = ReadOptions {
        mask: MaskSource::Whole,
        masks: None,
        // Masks lie beside the images as they are.
        undistort: false,
        on_inconsistent: OnInconsistent::Accept,
        ..arguments.reading.options()
    };
    match datasets::read_views(&arguments.path, &options, &|_, _| ()) {
        Ok(views) => {
            views.warnings.iter().for_each(|warning| console.warn(warning));
            Ok((views.views, Some(views.layout)))
        }
        Err(error) => match error.problem {
            ViewsProblem::UnknownLayout { .. } if arguments.source.model.is_some() => {
                let images = images(&arguments.path)?;
                if images.is_empty() { Err(error.into()) } else { Ok((images, None)) }
            }
            _ => Err(error.into()),
        },
    }
}

/// The images of a folder as views from nowhere.
fn images(folder: &Path) -> Result<Vec<View>, Failure> {
    let mut views = Vec::new();
    for path in photographs(folder)? {
        let color = read_image(&path).map_err(Failure::input)?.over([0; 3]);
        let (height, width) = (color.height, color.width);
        let mask = ByteImage { height, width, channels: 1, data: vec![255; height * width] };
        let camera =
            Camera::look_at([0.0, 0.0, 1.0], [0.0; 3], [0.0, 1.0, 0.0], 1.0, width, height);
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        views.push(View { name, color, mask, camera, depth: None, crop: None });
    }
    Ok(views)
}

/// The images of a folder, by name.
pub(crate) fn photographs(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let failed = |error| Failure::Input(format!("{}: {error}", folder.display()));
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let end = path.extension().map(|end| end.to_string_lossy().to_lowercase());
        let hidden = path.file_name().is_some_and(|n| n.as_encoded_bytes().starts_with(b"."));
        if !hidden && end.is_some_and(|end| ["png", "jpg", "jpeg"].contains(&end.as_str())) {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

/// The files of the views' masks.
///
/// # Errors
/// If two would be one.
fn files(views: &[View], layout: Option<Layout>) -> Result<Vec<String>, Failure> {
    one_each("mask", views.iter().map(|view| (&*view.name, file_of(&view.name, layout))))
}

/// The files of views, for each of which there are a name and a file.
///
/// # Errors
/// If two views would have one.
pub(crate) fn one_each<'n>(
    what: &str,
    views: impl Iterator<Item = (&'n str, String)>,
) -> Result<Vec<String>, Failure> {
    let mut seen = BTreeMap::new();
    let one = |(name, file): (&'n str, String)| match seen.insert(file.clone(), name) {
        None => Ok(file),
        Some(first) => {
            let both = format!("views {first} and {name}");
            Err(Failure::Input(format!("{both} would both have the {what} {file}")))
        }
    };
    views.map(one).collect()
}

/// The file of a view's mask, as `--masks` looks for it.
fn file_of(name: &str, layout: Option<Layout>) -> String {
    if let Some(Layout::KaolinFolder | Layout::KaolinZip) = layout {
        // The name is the number, and the image's is this.
        return format!("{name}_rgb.png");
    }
    let parts = name.split('/').filter(|part| !part.is_empty() && *part != "..");
    format!("{}.png", parts.collect::<Vec<_>>().join("/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_mask_takes_the_place_of_another() {
        let view = |name: &str| {
            let (color, mask) = (ByteImage::new(2, 2, 3), ByteImage::new(2, 2, 1));
            let camera = Camera::look_at([0.0, 0.0, 1.0], [0.0; 3], [0.0, 1.0, 0.0], 1.0, 2, 2);
            View { name: name.to_owned(), color, mask, camera, depth: None, crop: None }
        };
        let two = [view("a"), view("b/a")];
        assert_eq!(files(&two, None).ok(), Some(vec!["a.png".to_owned(), "b/a.png".to_owned()]));
        // Of cup.png and cup.jpg.
        let Err(Failure::Input(text)) = files(&[view("cup"), view("cup")], None) else {
            panic!("refused");
        };
        assert!(text.contains("the mask cup.png"), "{text}");
    }

    #[test]
    fn masks_are_called_as_fit_looks_for_them() {
        assert_eq!(file_of("7", Some(Layout::KaolinFolder)), "7_rgb.png");
        assert_eq!(file_of("left/0001", Some(Layout::Colmap)), "left/0001.png");
        assert_eq!(file_of("../up/0001", None), "up/0001.png");
    }
}
