//! What the tests of all systems share.

use train::settings::{read_text, to_toml};
use train::{Configuration, System};

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
