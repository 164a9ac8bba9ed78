//! What can be set: every option with its range, default, meaning, and the published value.

use std::fmt::Write as _;

use recon::fit::FitConfig;
use serde::Serialize;
use train::settings::{OptionInfo, Options};
use train::{System, TrainConfig};

/// An option, and what the published configuration has.
#[derive(Debug, Serialize)]
pub(crate) struct ListedOption {
    #[serde(flatten)]
    info: OptionInfo,
    #[serde(skip_serializing_if = "Option::is_none")]
    published: Option<Published>,
}

/// A line of the preset `paper`.
#[derive(Debug, Serialize)]
struct Published {
    value: String,
    source: String,
}

/// The options of a fit.
pub(crate) fn of_fit() -> Vec<ListedOption> {
    listed::<FitConfig>("")
}

/// The options of a system, then those of the training loop.
pub(crate) fn of_system<S: System>() -> Vec<ListedOption> {
    let paper = S::PRESETS.iter().find(|(name, _)| *name == "paper").map_or("", |(_, text)| text);
    let mut options = listed::<S::Config>(paper);
    options.extend(listed::<TrainConfig>(paper));
    options
}

/// All of them, for a terminal.
pub(crate) fn text(options: &[ListedOption]) -> String {
    let mut text = String::new();
    for ListedOption { info, published } in options {
        let OptionInfo { key, expected, default, meaning } = info;
        let _ = writeln!(text, "{key} = {default}    # {expected}\n    {meaning}");
        if let Some(Published { value, source }) = published {
            let _ = writeln!(text, "    published: {value} ({source})");
        }
    }
    text
}

fn listed<C: Options>(paper: &str) -> Vec<ListedOption> {
    let line = |info: OptionInfo| {
        let published = published(paper, &info.key);
        ListedOption { info, published }
    };
    C::describe().into_iter().map(line).collect()
}

/// The value of a key in a preset, and the comment beside it.
fn published(preset: &str, key: &str) -> Option<Published> {
    let (value, source) = preset.lines().find_map(|line| {
        let (found, rest) = line.split_once(" = ")?;
        (found == key).then_some(rest)?.split_once(" # ")
    })?;
    Some(Published { value: value.trim().to_owned(), source: source.trim().to_owned() })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use models::img2mesh::Img2Mesh;

    use super::*;

    #[test]
    fn an_option_is_listed_with_its_published_value() {
        let options = of_system::<Img2Mesh>();
        let of = |key: &str| options.iter().find(|option| option.info.key == key).unwrap();
        let encoder = of("encoder");
        assert_eq!(encoder.info.expected, "small, cnn, vgg16, none");
        assert_eq!(encoder.info.default, "\"small\"");
        assert_eq!(encoder.published.as_ref().unwrap().value, "\"cnn\"");
        assert_eq!(of("hold-out").info.expected, "2 to 2^63 - 1, or \"none\"");
        assert_eq!(of("weights").info.expected, "text, or \"none\"");
        assert_eq!(of("normalize").info.expected, "true or false");
        assert_eq!(of("learning-rate").published.as_ref().unwrap().value, "0.00001");
        assert!(options.iter().all(|option| !option.info.expected.is_empty()), "{options:?}");
        assert!(text(&options).contains("published: 7000.0 (kaolin's dibr_rasterization.py"));
    }
}
