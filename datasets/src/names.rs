//! Which view is meant by a name that somebody wrote.

use std::collections::{BTreeMap, BTreeSet};

/// What may stand behind the name of an image; any other dot is part of the name.
const EXTENSIONS: [&str; 4] = ["png", "jpg", "jpeg", "exr"];

/// The longest end of a name that is looked at, beside the whole: a name in an archive may have any number of folders.
const FOLDERS: usize = 16;

/// Whether a view is meant by a name: by its own, or by that of its image's file.
///
/// The shorter of both is the end of the longer, folder by folder: `0001`, `left/0001` and `images/left/0001.png` are the
/// view `left/0001`, `right/0001` is not. Extensions of images may be left away, where both are there they must agree.
/// Leading zeros of a number do not count: `7` is `0007.png`. It does not matter which of the two is the view.
pub fn is_called(view: &str, name: &str) -> bool {
    Names::of([name]).has(view)
}

/// Names that views are looked up by, in the time that it takes to look at one.
#[derive(Debug, Default)]
pub(crate) struct Names {
    /// The names without extension, each with those that it has; "" where it has none.
    whole: BTreeMap<String, BTreeSet<String>>,
    /// The same of all ends of names, folder by folder.
    ends: BTreeMap<String, BTreeSet<String>>,
}

impl Names {
    pub(crate) fn of<'n>(names: impl IntoIterator<Item = &'n str>) -> Self {
        let mut all = Self::default();
        for name in names {
            let (stem, extension) = parts(name);
            for end in ends(&stem).skip(1) {
                all.ends.entry(end.to_owned()).or_default().insert(extension.to_owned());
            }
            all.whole.entry(stem).or_default().insert(extension.to_owned());
        }
        all
    }

    /// Whether one of them means this view, or this view's name one of them: see [`is_called`].
    pub(crate) fn has(&self, view: &str) -> bool {
        let (stem, extension) = parts(view);
        let agrees = |known: &BTreeSet<String>| {
            extension.is_empty() || known.contains("") || known.contains(extension)
        };
        self.ends.get(&stem).is_some_and(agrees)
            || ends(&stem).any(|end| self.whole.get(end).is_some_and(agrees))
    }
}

/// The name without its extension, in one spelling, and the extension, where it is an image's.
fn parts(name: &str) -> (String, &str) {
    let (stem, extension) = match name.rsplit_once('.') {
        Some((stem, end)) if EXTENSIONS.iter().any(|known| known.eq_ignore_ascii_case(end)) => {
            (stem, end)
        }
        _ => (name, ""),
    };
    let mut stem = stem.replace('\\', "/");
    while let Some(rest) = stem.strip_prefix("./") {
        stem = rest.to_owned();
    }
    let start = stem.rfind('/').map_or(0, |slash| slash + 1);
    if stem[start..].bytes().all(|b| b.is_ascii_digit()) {
        let zeros = stem[start..].bytes().take_while(|&b| b == b'0').count();
        // The last digit of 000 stays.
        let zeros = zeros.min((stem.len() - start).saturating_sub(1));
        stem.replace_range(start..start + zeros, "");
    }
    (stem, extension)
}

/// A name with all of its folders, and with fewer, down to none.
fn ends(name: &str) -> impl Iterator<Item = &str> {
    let fewer = name.rmatch_indices('/').take(FOLDERS).map(|(slash, _)| &name[slash + 1..]);
    std::iter::once(name).chain(fewer)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_mean_views_by_as_many_folders_as_they_have() {
        for (view, name) in [
            ("0001", "0001"),
            ("left/0001", "0001.png"),
            ("left/0001", "left/0001"),
            ("left/0001", "images/left/0001.png"),
            ("images/left/0001", "left\\0001.PNG"),
            ("images/0001", "./images/0001.jpg"),
            ("/data/cup/images/0001.png", "0001"),
            ("IMG.1", "IMG.1.jpg"),
            ("7", "0007.png"),
            ("left/0007", "left/7"),
            ("000", "0"),
        ] {
            assert!(is_called(view, name) && is_called(name, view), "{view}, {name}");
        }
        for (view, name) in [
            ("right/0001", "left/0001"),
            ("left/0001", "t/0001"),
            ("IMG.1", "IMG"),
            ("IMG.1", "IMG.2"),
            ("a.png", "a.jpg"),
            ("0001", "0002"),
            ("0001", ""),
            ("0001", "left"),
            ("1", "+1"),
        ] {
            assert!(!is_called(view, name) && !is_called(name, view), "{view}, {name}");
        }
    }

    #[test]
    fn many_names_are_looked_up_at_once() {
        let many: Vec<String> = (0..100_000).map(|k| format!("images/{k:06}.png")).collect();
        let names = Names::of(many.iter().map(String::as_str));
        // One by one this took minutes.
        assert!((0..100_000).all(|k| names.has(&format!("{k:06}"))));
        assert!(!names.has("100000"));
    }
}
