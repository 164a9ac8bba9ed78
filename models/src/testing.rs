//! What the tests of all systems share.

use std::collections::BTreeMap;

use autodiff_lite::Param;
use datasets::ReadOptions;
use train::settings::{read_text, settings_of, to_toml};
use train::{Configuration, Source, Subset, System};

use crate::parts::tests::assert_means;

/// Each preset of a system is in range, and is the same when it was written and read.
#[allow(clippy::unwrap_used, reason = "tests")]
pub(crate) fn assert_presets<S: System>() {
    for (name, text) in S::PRESETS {
        let config: Configuration<S::Config> = read_text(name.as_ref(), text, &[]).unwrap();
        assert_eq!(S::problems(&config), Vec::<String>::new(), "{name}");
        let again: Configuration<S::Config> =
            read_text(name.as_ref(), &to_toml(&config), &[]).unwrap();
        assert_eq!(again, config, "{name}");
    }
    assert_sources::<S>();
    assert_tables::<S>();
    assert_repairs::<S>();
}

/// Every value of a published configuration has its source beside it: a part of a paper, a file of a code whose commit the
/// head names, or that it is ours. A table's sources are those of the preset that it is for.
fn assert_sources<S: System>() {
    let published = S::PRESETS.iter().filter(|(name, _)| name.starts_with("paper"));
    for (name, text) in published {
        let values = text.lines().filter(|line| !line.starts_with('#') && line.contains('='));
        let unsaid: Vec<&str> = values
            .filter(|line| !line.split_once(" # ").is_some_and(|(_, source)| is_source(source)))
            .collect();
        assert!(unsaid.is_empty(), "{}, {name}: {unsaid:?}", S::NAME);
        let head = preset_text::<S>(name.strip_suffix(TABLE).unwrap_or(name));
        let head: Vec<&str> = head.lines().map_while(|line| line.strip_prefix("# ")).collect();
        assert!(names_a_commit(&head.join(" ")), "{}, {name}: no commit in its head", S::NAME);
    }
}

/// The data that a system makes for a run of this seed.
#[allow(clippy::unwrap_used, reason = "tests")]
pub(crate) fn made<S: System<ReadOptions = ReadOptions>>(config: &S::Config, seed: u64) -> S::Data {
    let options = ReadOptions::default();
    S::open(config, &Source { path: None, options: &options, seed, progress: &|_, _| () }).unwrap()
}

/// The data that is made follows the run's seed, unless the configuration says another; it has the parts that are asked for,
/// and each is scored object by object. `config` says no seed, and `seeded` is the same with the seed 7.
#[allow(clippy::unwrap_used, reason = "tests")]
pub(crate) fn assert_data<S: System<ReadOptions = ReadOptions>>(
    config: &S::Config,
    seeded: &S::Config,
    sizes: [usize; 3],
) {
    let print = |config: &S::Config, seed| S::fingerprint(&made::<S>(config, seed));
    assert_ne!(print(config, 1), print(config, 2));
    assert_eq!(print(seeded, 1), print(seeded, 2));
    assert_eq!(print(seeded, 1), print(config, 7));
    let data = made::<S>(config, 1);
    let summary = S::data_summary(&data).unwrap();
    assert_eq!((summary.sizes, summary.unit, summary.warnings.len()), (sizes, "objects", 0));
    let mut system = S::new(config, 0);
    system.init_from_data(&data, None).unwrap();
    let mut known = std::collections::BTreeSet::new();
    for subset in Subset::ALL {
        let metrics = system.evaluate(&data, subset).unwrap();
        assert_means(&metrics, summary.size(subset));
        let best = metrics.iter().find(|metric| metric.name == S::BEST).unwrap();
        for (name, _) in &best.by_object {
            // Category, and the number within it.
            let (category, number) = name.split_once('/').unwrap();
            assert!(number.strip_prefix(category).is_some(), "{name}");
            assert!(known.insert(name.clone()), "{name} is in two subsets");
        }
        assert_eq!(system.evaluate(&data, subset).unwrap(), metrics);
    }
}

/// The end of the name of a published form's row of a table.
const TABLE: &str = "-table";

/// Whether a comment says where a value is from.
fn is_source(comment: &str) -> bool {
    const PLACES: [&str; 10] = [
        "section ",
        "equation ",
        "table",
        "footnote ",
        "phase I",
        "future work",
        "dataset and features",
        ".py",
        ".yaml",
        ".md",
    ];
    comment.starts_with("ours") || PLACES.iter().any(|place| comment.contains(place))
}

/// Whether a text has the beginning of a commit's hash behind the word "at".
fn names_a_commit(text: &str) -> bool {
    text.split(" at ").skip(1).any(|rest| {
        rest.bytes().take_while(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(b)).count() >= 7
    })
}

fn preset_text<S: System>(name: &str) -> &'static str {
    let found = S::PRESETS.iter().find(|(other, _)| *other == name);
    found.unwrap_or_else(|| panic!("{} has no preset {name}", S::NAME)).1
}

/// A preset with settings over it.
#[allow(clippy::unwrap_used, reason = "tests")]
pub(crate) fn preset_with<S: System>(
    name: &str,
    settings: &[(&str, &str)],
) -> Configuration<S::Config> {
    let settings: Vec<(String, String)> =
        settings.iter().map(|&(key, value)| (key.to_owned(), value.to_owned())).collect();
    read_text(name.as_ref(), preset_text::<S>(name), &settings).unwrap()
}

/// A row of a table differs from its published form in the size of images, the number of vertices, steps and batch alone,
/// and what happens after a share of the steps happens after the same share.
fn assert_tables<S: System>() {
    const DIFFERS: [&str; 11] = [
        // Sizes of images.
        "image-size",
        "render-size",
        // Vertices.
        "level",
        "cells",
        // Batch.
        "batch",
        "accumulate",
        "shards",
        // Steps, with those of `CHANGEABLE`.
        "epochs",
        "milestones",
        "drop-every",
        "subdivide-at",
    ];
    for (name, _) in S::PRESETS {
        let Some(paper) = name.strip_suffix(TABLE) else { continue };
        let [paper, table] = [paper, name].map(|name| preset_with::<S>(name, &[]));
        let [paper, table] = [&paper, &table].map(|config| settings_of(&to_toml(config)));
        assert!(paper.keys().eq(table.keys()), "{name}");
        for (key, value) in &paper {
            let free = DIFFERS.contains(&&**key) || train::CHANGEABLE.contains(&&**key);
            assert!(free || *value == table[key], "{name}: {key} is {} for {value}", table[key]);
        }
        let shares = |of: &BTreeMap<String, String>| -> Vec<f64> {
            let numbers = |key: &str| -> Vec<f64> {
                let text = of.get(key).map_or("", String::as_str);
                text.trim_matches(['[', ']']).split(", ").filter_map(|x| x.parse().ok()).collect()
            };
            let epochs = numbers("epochs")[0];
            // What no schedule looks at may stay at its default.
            let rate: &[&str] = match of["schedule"].trim_matches('"') {
                "step" => &["drop-every"],
                "milestones" => &["milestones"],
                _ => &[],
            };
            let when = rate.iter().chain(&["subdivide-at"]).flat_map(|key| numbers(key));
            when.map(|epoch| epoch / epochs).collect()
        };
        let (there, here) = (shares(&paper), shares(&table));
        let far = there.iter().zip(&here).find(|(a, b)| (*a - *b).abs() > 0.03 * a.max(1.0));
        assert!(there.len() == here.len() && far.is_none(), "{name}: {there:?} {here:?}");
    }
}

/// Each repair of a published form is sound alone, and changes what it says.
fn assert_repairs<S: System>() {
    for (name, text) in S::PRESETS {
        if !name.starts_with("paper") || name.ends_with(TABLE) {
            continue;
        }
        let paper = preset_with::<S>(name, &[]);
        let repairs = crate::repairs(text);
        assert!(!repairs.is_empty(), "{}, {name}: no repair", S::NAME);
        for repair in repairs {
            let config = preset_with::<S>(name, &repair.settings);
            assert_eq!(S::problems(&config), Vec::<String>::new(), "{name}: {repair:?}");
            let [before, after] = [&paper, &config].map(|config| settings_of(&to_toml(config)));
            let changed: Vec<&str> = before
                .iter()
                .filter(|(key, value)| after[*key] != **value)
                .map(|(key, _)| key.as_str())
                .collect();
            let mut said: Vec<&str> = repair.settings.iter().map(|(key, _)| *key).collect();
            said.sort_unstable();
            assert_eq!(changed, said, "{name}: {repair:?}");
        }
    }
}

/// Trained numbers of a system's parts: of parameters whose paths begin so.
pub(crate) fn trained<S: System>(system: &S, parts: &[&str]) -> Vec<usize> {
    let mut counts = vec![0; parts.len()];
    system.visit("", &mut |path: &str, param: &Param| {
        if param.trainable {
            let part = parts.iter().position(|part| path.starts_with(part));
            counts[part.unwrap_or_else(|| panic!("{path} is in no part"))] += param.len();
        }
    });
    counts
}

#[test]
fn a_source_names_a_place_and_a_head_a_commit() {
    for vague in ["published", "code", "paper", "main", "the authors", "paper, implementation"] {
        assert!(!is_source(vague), "{vague}");
    }
    for exact in ["ours", "paper, section 3.4", "code, train.py: lr", "README.md: cam_loss_wt"] {
        assert!(is_source(exact), "{exact}");
    }
    assert!(names_a_commit("# the code (github.com/a/b at 1d85b49, MIT)"));
    assert!(!names_a_commit("# the code at github.com/a/b") && !names_a_commit("# at 12345"));
}
