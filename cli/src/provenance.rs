//! What results say about their making.

use std::path::Path;

use train::Provenance;

/// Program, machine and command.
pub(crate) fn provenance(data: Option<&Path>) -> Provenance {
    Provenance {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        // Known in a clone, or where whoever builds says so; see build.rs.
        commit: option_env!("UNSPHERE_COMMIT").unwrap_or_default().to_owned(),
        cpu: cpu(),
        machine: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        command: typed_command(),
        data: data.map(|path| path.display().to_string()).unwrap_or_default(),
    }
}

/// These facts of the making, by name, as results list them.
pub(crate) fn facts<const N: usize>(names: [&str; N]) -> [(String, String); N] {
    let made = provenance(None);
    names.map(|name| {
        let fact = match name {
            "unsphere" => made.version.clone(),
            "threads" => rayon::current_num_threads().to_string(),
            "processor" => made.cpu.clone(),
            _ => made.machine.clone(),
        };
        (name.to_owned(), fact)
    })
}

/// The processor's name, where the system tells it as Linux does.
fn cpu() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let line = text.lines().find(|line| line.starts_with("model name"));
    line.and_then(|line| line.split_once(": "))
        .map_or_else(String::new, |(_, name)| name.to_owned())
}

/// The command line, quoted where a shell needs it.
pub(crate) fn typed_command() -> String {
    let quoted = |text: &str| {
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+%@".contains(c);
        if !text.is_empty() && text.chars().all(plain) {
            text.to_owned()
        } else {
            format!("'{}'", text.replace('\'', "'\\''"))
        }
    };
    let mut words = vec!["unsphere".to_owned()];
    words.extend(std::env::args_os().skip(1).map(|word| quoted(&word.to_string_lossy())));
    words.join(" ")
}
