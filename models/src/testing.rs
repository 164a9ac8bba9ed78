//! What the tests of all systems share.

use datasets::ReadOptions;
use train::settings::{read_text, to_toml};
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
}

/// Every value of a published configuration has its source beside it.
fn assert_sources<S: System>() {
    let published = S::PRESETS.iter().filter(|(name, _)| name.starts_with("paper"));
    for (name, text) in published {
        let values = text.lines().filter(|line| !line.starts_with('#') && line.contains('='));
        let unsaid: Vec<&str> = values.filter(|line| !line.contains(" # ")).collect();
        assert!(unsaid.is_empty(), "{}, {name}: {unsaid:?}", S::NAME);
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
    system.init_from_data(&data).unwrap();
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
