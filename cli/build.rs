//! Which commit this is, for the results that say how they were made.

use std::process::Command;

fn main() {
    println!("cargo::rerun-if-env-changed=UNSPHERE_COMMIT");
    if std::env::var_os("UNSPHERE_COMMIT").is_some() {
        return;
    }
    // Unpacked within somebody else's repository, this crate is not the folder `cli` of it.
    if git(&["rev-parse", "--show-prefix"]).as_deref() != Some("cli/") {
        return;
    }
    for file in ["HEAD", "logs/HEAD"] {
        if let Some(path) = git(&["rev-parse", "--git-path", file]) {
            println!("cargo::rerun-if-changed={path}");
        }
    }
    if let Some(commit) = git(&["rev-parse", "--short=12", "HEAD"]) {
        println!("cargo::rustc-env=UNSPHERE_COMMIT={commit}");
    }
}

/// What git answers, where it is installed and this is a repository.
fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}
