//! libFuzzer around one of the targets, which the variable `FUZZ_TARGET` names.
//!
//! `FUZZ_SEEDS=folder` writes the target's seeds there and ends.
#![no_main]

#[path = "../targets/mod.rs"]
mod targets;

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;

static TARGET: LazyLock<&targets::Target> = LazyLock::new(|| {
    let name = std::env::var("FUZZ_TARGET").unwrap_or_default();
    let names: Vec<&str> = targets::TARGETS.iter().map(|target| target.name).collect();
    let target = targets::TARGETS.iter().find(|target| target.name == name);
    let target = target.unwrap_or_else(|| panic!("FUZZ_TARGET is one of {}", names.join(" ")));
    if let Ok(folder) = std::env::var("FUZZ_SEEDS") {
        std::fs::create_dir_all(&folder).expect("a folder for the seeds");
        for (k, seed) in (target.seeds)().iter().enumerate() {
            std::fs::write(format!("{folder}/seed-{k}"), seed).expect("a seed");
        }
        std::process::exit(0);
    }
    target
});

fuzz_target!(init: { LazyLock::force(&TARGET); }, |bytes: &[u8]| (TARGET.run)(bytes));
