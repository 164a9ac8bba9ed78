//! Which images the release has for training, and which for validation.

use std::collections::BTreeMap;

use crate::content::numbered;
use crate::dataset::Subset;
use crate::error::ReadViewsError;
use crate::source::Source;

/// Where VOC's lists of a class are, from the root of the release.
const VOC: &str = "PASCAL/VOCdevkit/VOC2012/ImageSets/Main";
/// No list is longer: the longest of the release has a thousandth of this.
const MOST_BYTES: u64 = 1 << 26;
/// What a line becomes: the image's name, and its place in a tree.
const LINE: usize = 100;

/// What each listed image of a folder of annotations is for, by the image's name; none where the release's lists are not there.
///
/// What is for validation there is what the literature scores on, and there is nothing else to test with: it is for tests.
pub(super) fn read(
    source: &Source,
    folder: &str,
) -> Result<BTreeMap<String, Subset>, ReadViewsError> {
    let mut images = BTreeMap::new();
    for (part, subset) in [("train", Subset::Train), ("val", Subset::Test)] {
        let list = match folder.rsplit_once('_') {
            Some((class, "pascal")) => format!("{VOC}/{class}_{part}.txt"),
            _ => format!("Image_sets/{folder}_{part}.txt"),
        };
        if !source.has(&list) {
            continue;
        }
        let content = source.open()?.read(&list, "split", MOST_BYTES)?;
        for (_, line) in numbered(&content.text(LINE, &source.locate(&list))?) {
            // Behind the name VOC has whether the class is in the image.
            if let Some(name) = line.split_whitespace().next() {
                images.insert(name.to_owned(), subset);
            }
        }
    }
    Ok(images)
}
