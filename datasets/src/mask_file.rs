//! Masks in files: what they may be called, and what they hold.

use std::path::{Component, Path, PathBuf};

use mesh_core::ByteImage;

use crate::assemble::{ImageFile, plain_stem, read_labels, without_extension};
use crate::error::ReadViewsError;
use crate::mask::mask_from_image;
use crate::options::ReadOptions;
use crate::source::{Opened, Source};

/// What a mask may end in.
const EXTENSIONS: [&str; 5] = ["png", "jpg", "jpeg", "PNG", "JPG"];
/// How many folders above an image its mask's name may repeat.
const FOLDERS: usize = 2;

/// The mask of a file, or where one was looked for.
#[derive(Clone, Debug, Default)]
pub(crate) struct MaskFile {
    /// The file, and the mask that it holds.
    pub(crate) found: Option<(PathBuf, ByteImage)>,
    /// Files that would have been taken.
    pub(crate) looked_for: Vec<PathBuf>,
}

impl From<Option<(PathBuf, ByteImage)>> for MaskFile {
    fn from(found: Option<(PathBuf, ByteImage)>) -> Self {
        Self { found, looked_for: Vec::new() }
    }
}

impl MaskFile {
    /// Where it was looked for, in words: the folder, and the names in it.
    pub(crate) fn looked_for(&self) -> Option<String> {
        const MOST: usize = 6;
        let folder = self.looked_for.first()?.parent()?;
        let inside = |path: &PathBuf| match path.strip_prefix(folder) {
            Ok(name) => name.display().to_string(),
            Err(_) => path.display().to_string(),
        };
        // Every name comes with every ending: one of them tells it.
        let plain = |path: &&PathBuf| path.extension().is_some_and(|end| end == EXTENSIONS[0]);
        let mut names: Vec<String> = self.looked_for.iter().filter(plain).map(inside).collect();
        if names.len() > MOST {
            names.truncate(MOST);
            names.push("..".to_owned());
        }
        Some(format!("{} for {} or .jpg", folder.display(), names.join(", ")))
    }
}

/// What the mask of an image may be called in a folder of masks, in the order in which the names are
/// tried: `0.jpg.png` as COLMAP has it, `0.png`, `0_mask.png`, `0_seg.png` and their like, with and
/// without the folders that the image lies in.
pub(crate) fn mask_names(folder: &str, image: &str) -> Vec<String> {
    let slash = if folder.is_empty() { "" } else { "/" };
    let mut names = Vec::new();
    for path in tails(image) {
        let stem = without_extension(path);
        let (above, plain) = stem.rsplit_once('/').map_or(("", stem), |(a, p)| (a, p));
        let above = if above.is_empty() { String::new() } else { format!("{above}/") };
        let bodies = [
            path.to_owned(),
            stem.to_owned(),
            format!("{stem}_mask"),
            format!("{stem}-mask"),
            format!("{stem}.mask"),
            format!("{stem}_seg"),
            format!("{above}mask_{plain}"),
        ];
        for body in bodies {
            names.extend(EXTENSIONS.map(|end| format!("{folder}{slash}{body}.{end}")));
        }
    }
    names
}

/// A name with all of its folders, and with fewer, down to none.
fn tails(name: &str) -> Vec<&str> {
    let clean = name.trim_start_matches("./");
    let mut tails: Vec<&str> = std::iter::once(clean)
        .chain(clean.match_indices('/').map(|(slash, _)| &clean[slash + 1..]))
        .filter(|tail| !tail.is_empty() && !tail.starts_with("../"))
        .collect();
    tails.drain(..tails.len().saturating_sub(FOLDERS + 1));
    tails
}

/// The mask from the first of `names` that exists, where masks of files are wanted.
pub(crate) fn mask_file(
    opened: &mut Opened<'_>,
    names: &[String],
    options: &ReadOptions,
) -> Result<MaskFile, ReadViewsError> {
    if !options.reads_mask_files() {
        return Ok(MaskFile::default());
    }
    let source = opened.source();
    match names.iter().find(|name| source.has(name)) {
        Some(name) => named_mask(opened, name, options),
        None => Ok(MaskFile {
            looked_for: names.iter().map(|name| source.locate(name)).collect(),
            found: None,
        }),
    }
}

/// The mask of a file that has to be there, where masks come from files.
pub(crate) fn named_mask(
    opened: &mut Opened<'_>,
    name: &str,
    options: &ReadOptions,
) -> Result<MaskFile, ReadViewsError> {
    if !options.reads_mask_files() {
        return Ok(MaskFile::default());
    }
    let (path, image) = read_labels(opened, name, "mask")?;
    Ok(Some((path, mask_from_image(&image))).into())
}

/// The mask of an image from a folder that the user named.
pub(crate) fn mask_of_folder(
    folder: &Path,
    image: &ImageFile,
    options: &ReadOptions,
) -> Result<MaskFile, ReadViewsError> {
    let path = image.path.as_path();
    if !folder.exists() {
        let expected = "a folder with a mask for each image";
        return Err(ReadViewsError::field(folder, "masks", "nothing at this path", expected));
    }
    let parts = path.components().filter_map(|part| match part {
        Component::Normal(name) => name.to_str(),
        _ => None,
    });
    let parts: Vec<&str> = parts.collect();
    let names = mask_names("", &parts.join("/"));
    let source = Source::folder(folder).within(options.limits).noting(image.brightest.clone());
    let source = if image.is_stored { source.with_stored_pixels() } else { source };
    let mut opened = source.open()?;
    if let Some(name) = names.iter().find(|name| source.has(name)) {
        let (path, image) = read_labels(&mut opened, name, "mask")?;
        return Ok(Some((path, mask_from_image(&image))).into());
    }
    let stem = path.to_string_lossy();
    let stem = plain_stem(&stem);
    let plain = |name: &&String| !name.contains('/') && name.contains(stem);
    let looked_for = names.iter().filter(plain).map(|name| folder.join(name)).collect();
    Ok(MaskFile { found: None, looked_for })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_masks_that_is_not_there_is_named() {
        let error = mask_of_folder(
            Path::new("no/such/folder"),
            &ImageFile::new("0.png".into(), ByteImage::default()),
            &ReadOptions::default(),
        );
        let text = error.err().map(|error| error.to_string()).unwrap_or_default();
        assert!(
            text.starts_with("no/such/folder") && text.contains("nothing at this path"),
            "{text}"
        );
    }

    #[test]
    fn masks_are_looked_for_under_the_names_that_people_use() {
        let names = mask_names("masks", "images/left/0001.jpg");
        for wanted in [
            "masks/0001.jpg.png",
            "masks/0001.png",
            "masks/left/0001.png",
            "masks/left/mask_0001.png",
            "masks/0001_mask.png",
            "masks/0001_seg.jpg",
            "masks/images/left/0001.png",
        ] {
            assert!(names.iter().any(|name| name == wanted), "{wanted}: {names:?}");
        }
        // The whole name before the stem: `0001.jpg` and `0001.png` may lie side by side.
        let at = |wanted: &str| names.iter().position(|name| name == wanted).unwrap();
        assert!(at("masks/0001.jpg.png") < at("masks/0001.png"));
        assert_eq!(mask_names("", "a.png")[0], "a.png.png");
        assert_eq!(tails("../images/0.png"), ["images/0.png", "0.png"]);
        assert_eq!(tails("a/b/c/d.png"), ["b/c/d.png", "c/d.png", "d.png"]);
    }

    #[test]
    fn a_folder_is_named_with_what_was_looked_for() {
        let folder = tempfile::tempdir().unwrap();
        let options = ReadOptions::default();
        let path = "/somewhere/images/view 7.jpg".into();
        let image = ImageFile::new(path, ByteImage::default());
        let missing = mask_of_folder(folder.path(), &image, &options).unwrap();
        assert!(missing.found.is_none());
        let words = missing.looked_for().unwrap();
        let place = folder.path().display().to_string();
        assert!(words.starts_with(&place) && words.contains("view 7.png"), "{words}");
        let mask = ByteImage { height: 1, width: 2, channels: 1, data: vec![0, 200] };
        mesh_core::write_png(folder.path().join("view 7_mask.png"), &mask).unwrap();
        let (found, mask) = mask_of_folder(folder.path(), &image, &options).unwrap().found.unwrap();
        assert!(found.ends_with("view 7_mask.png") && mask.data == [0, 255]);
    }
}
