//! Which view a user means by a name or a number.

use datasets::View;

/// What a name leads to.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Named {
    /// The view at this place.
    One(usize),
    /// None.
    Absent,
    /// So many that it says too little: the places of two of them.
    Several(usize, usize),
}

/// The view that is called so: whole, or by the last part of its name, without the extension too; or of this number.
///
/// The number of a view is what the last part of its name is, or ends in: `images/0003` and `r_3` have 3. Only where names do not
/// end in numbers it is the place in the order of the source, from 0 on: a number is never another view's than its name says.
pub(super) fn view_called(views: &[View], name: &str) -> Named {
    let called = |is: &dyn Fn(&str) -> bool| {
        let mut found = (0..views.len()).filter(|&at| is(&views[at].name));
        match (found.next(), found.next()) {
            (None, _) => None,
            (Some(at), None) => Some(Named::One(at)),
            (Some(first), Some(second)) => Some(Named::Several(first, second)),
        }
    };
    // A source may call two views the same; the first has been taken ever since.
    let whole = views.iter().position(|view| is_stem_or_whole(&view.name, name));
    if let Some(at) = whole {
        return Named::One(at);
    }
    if let Some(found) = called(&|view| is_stem_or_whole(last_part(view), last_part(name))) {
        return found;
    }
    let Ok(number) = name.parse::<u64>() else { return Named::Absent };
    let whole_number = |view: &str| stem(last_part(view)).parse::<u64>().ok();
    if views.iter().any(|view| whole_number(&view.name).is_some()) {
        return called(&|view| whole_number(view) == Some(number)).unwrap_or(Named::Absent);
    }
    if views.iter().all(|view| number_behind(&view.name).is_some()) {
        return called(&|view| number_behind(view) == Some(number)).unwrap_or(Named::Absent);
    }
    let place = usize::try_from(number).ok().filter(|&at| at < views.len());
    place.map_or(Named::Absent, Named::One)
}

/// Whether both are the same but for an extension, which either may have.
fn is_stem_or_whole(view: &str, name: &str) -> bool {
    view == name || stem(view) == name || view == stem(name)
}

fn stem(file: &str) -> &str {
    file.rsplit_once('.').map_or(file, |(stem, _)| stem)
}

fn last_part(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or(name)
}

/// The number that a name ends in.
fn number_behind(name: &str) -> Option<u64> {
    let stem = stem(last_part(name));
    let text = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    stem[text.len()..].parse().ok()
}

#[cfg(test)]
mod tests {
    use mesh_core::{ByteImage, Camera};

    use super::*;

    fn views(names: &[&str]) -> Vec<View> {
        let view = |name: &&str| View {
            name: (*name).to_owned(),
            color: ByteImage::new(4, 4, 3),
            mask: ByteImage::new(4, 4, 1),
            camera: Camera::from_r2n2(0.0, 30.0, 1.0, 4, 4),
            depth: None,
            crop: None,
        };
        names.iter().map(view).collect()
    }

    #[test]
    fn names_bases_and_numbers_lead_to_views() {
        use Named::{Absent, One, Several};
        let folder = views(&["images/0001", "images/0002", "images/0003"]);
        for name in ["images/0002", "images/0002.png", "0002", "0002.jpg", "2"] {
            assert_eq!(view_called(&folder, name), One(1), "{name}");
        }
        // Of what is numbered from 1 on nothing is 0.
        assert_eq!(view_called(&folder, "0"), Absent);
        let rendered = views(&["train/r_0", "train/r_1", "train/r_2"]);
        assert_eq!(view_called(&rendered, "r_1"), One(1));
        assert_eq!(view_called(&rendered, "2"), One(2));
        assert_eq!(view_called(&rendered, "3"), Absent);
        let words = views(&["front", "left", "top"]);
        assert_eq!(view_called(&words, "2"), One(2));
        assert_eq!(view_called(&words, "3"), Absent);
        let twice = views(&["left/0001", "right/0001"]);
        assert_eq!(view_called(&twice, "0001"), Several(0, 1));
        assert_eq!(view_called(&twice, "1"), Several(0, 1));
        assert_eq!(view_called(&twice, "right/0001"), One(1));
    }
}
