//! What the tests of all systems share.

use train::settings::{read_text, to_toml};
use train::{Configuration, System};

/// Each preset of a system is in range, and is the same when it was written and read.
#[allow(clippy::unwrap_used, reason = "tests")]
pub(crate) fn assert_presets<S: System>() {
    for (name, text) in S::PRESETS {
        let config: Configuration<S::Config> = read_text(name.as_ref(), text, &[]).unwrap();
        assert_eq!(config.train.check(), Vec::<String>::new(), "{name}");
        S::check(&config.system).unwrap();
        let again: Configuration<S::Config> =
            read_text(name.as_ref(), &to_toml(&config), &[]).unwrap();
        assert_eq!(again, config, "{name}");
    }
}
