//! Programs of others that are run as children: found, watched, stopped, and quoted where they fail.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::failure::Failure;
use crate::interrupt::Interrupt;

/// Between two looks at a child.
const BLINK: Duration = Duration::from_millis(40);
/// Lines of a log that say why.
const QUOTED: usize = 6;
/// Of a log no more than its last bytes are read.
const LOG_BYTES: u64 = 1 << 16;

/// The file that a name stands for, as a shell finds it: as it is where it has folders, else in those of `path`.
pub(crate) fn find(program: &Path, path: Option<&std::ffi::OsStr>) -> Option<PathBuf> {
    if program.components().count() > 1 {
        return is_program(program).then(|| program.to_owned());
    }
    std::env::split_paths(path?)
        .filter(|folder| !folder.as_os_str().is_empty())
        .map(|folder| folder.join(program))
        .flat_map(|file| {
            let ended = std::env::consts::EXE_EXTENSION;
            let with_end = (!ended.is_empty()).then(|| file.with_extension(ended));
            std::iter::once(file).chain(with_end)
        })
        .find(|file| is_program(file))
}

fn is_program(file: &Path) -> bool {
    let Ok(found) = std::fs::metadata(file) else { return false };
    #[cfg(unix)]
    let runs = std::os::unix::fs::PermissionsExt::mode(&found.permissions()) & 0o111 != 0;
    #[cfg(not(unix))]
    let runs = true;
    found.is_file() && runs
}

/// What ends with the command that started it, however that ends.
struct Leashed(Child);

impl Drop for Leashed {
    fn drop(&mut self) {
        // One that has ended cannot be killed, which is no harm.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs a program to its end; what it prints goes to `log`. `watch` is called many times a second.
///
/// # Errors
/// If it cannot be started, fails, or Ctrl-C was pressed: it is killed then.
pub(crate) fn run(
    command: &mut Command,
    log: &Path,
    interrupt: &Interrupt,
    mut watch: impl FnMut(),
) -> Result<(), Failure> {
    let program = command.get_program().to_string_lossy().into_owned();
    let failed = |error: std::io::Error| Failure::Other(format!("{program}: {error}"));
    let out = File::create(log).map_err(failed)?;
    command.stdin(Stdio::null()).stderr(out.try_clone().map_err(failed)?).stdout(out);
    let mut child = Leashed(command.spawn().map_err(failed)?);
    let status = loop {
        if let Some(status) = child.0.try_wait().map_err(failed)? {
            break status;
        }
        if interrupt.is_pressed() {
            drop(child);
            return Err(Failure::Interrupted(format!("{program} was stopped; nothing is written")));
        }
        watch();
        std::thread::sleep(BLINK);
    };
    // The terminal sends Ctrl-C to the child as well.
    if interrupt.is_pressed() {
        return Err(Failure::Interrupted(format!("{program} was stopped; nothing is written")));
    }
    if status.success() {
        return Ok(());
    }
    let verb = command.get_args().next().unwrap_or_default().to_string_lossy().into_owned();
    Err(Failure::Other(format!("{program} {verb} failed ({status}): {}", last_lines(log))))
}

/// What a program prints where it only answers.
pub(crate) fn answer(command: &mut Command) -> Result<String, Failure> {
    let program = command.get_program().to_string_lossy().into_owned();
    let output = command.stdin(Stdio::null()).output();
    let output = output.map_err(|error| Failure::Other(format!("{program}: {error}")))?;
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    Ok(text(&output.stdout) + &text(&output.stderr))
}

/// The end of a log, in one line.
fn last_lines(log: &Path) -> String {
    use std::io::{Read, Seek, SeekFrom};
    let mut bytes = Vec::new();
    let read = File::open(log).and_then(|mut file| {
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(LOG_BYTES)))?;
        file.take(LOG_BYTES).read_to_end(&mut bytes)
    });
    if read.is_err() {
        return "it said nothing".to_owned();
    }
    let text = String::from_utf8_lossy(&bytes);
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    match lines.len() {
        0 => "it said nothing".to_owned(),
        n => lines[n.saturating_sub(QUOTED)..].join(" / "),
    }
}

#[cfg(all(test, unix))]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn script(folder: &Path, name: &str, text: &str) -> PathBuf {
        let path = folder.join(name);
        std::fs::write(&path, format!("#!/bin/sh\n{text}\n")).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        path
    }

    #[test]
    fn programs_are_found_as_a_shell_finds_them() {
        let place = tempfile::tempdir().unwrap();
        let [empty, full] = ["empty", "full"].map(|name| place.path().join(name));
        for folder in [&empty, &full] {
            std::fs::create_dir(folder).unwrap();
        }
        let program = script(&full, "fake", "true");
        // A file of that name that is no program is passed over, and so is a folder.
        std::fs::write(empty.join("fake"), "text").unwrap();
        std::fs::create_dir(empty.join("other")).unwrap();
        let path = std::env::join_paths([&empty, &full]).unwrap();
        assert_eq!(find(Path::new("fake"), Some(&path)), Some(program.clone()));
        assert_eq!(find(Path::new("other"), Some(&path)), None);
        assert_eq!(find(&program, None), Some(program));
        assert_eq!(find(Path::new("fake"), None), None);
    }

    #[test]
    fn what_fails_is_quoted() {
        let place = tempfile::tempdir().unwrap();
        let log = place.path().join("log");
        let interrupt = Interrupt::default();
        let good = script(place.path(), "good", "echo $1; echo twice >&2");
        run(Command::new(&good).arg("word"), &log, &interrupt, || ()).unwrap();
        assert_eq!(std::fs::read_to_string(&log).unwrap(), "word\ntwice\n");
        assert!(answer(Command::new(&good).arg("hello")).unwrap().contains("hello\ntwice"));
        let bad = script(place.path(), "bad", "echo first; echo the reason; exit 7");
        let Err(Failure::Other(text)) =
            run(Command::new(&bad).arg("verb"), &log, &interrupt, || ())
        else {
            panic!("it failed");
        };
        assert!(text.contains("bad verb failed") && text.contains('7'), "{text}");
        assert!(text.ends_with("first / the reason"), "{text}");
        let none = run(&mut Command::new(place.path().join("none")), &log, &interrupt, || ());
        assert!(matches!(none, Err(Failure::Other(_))));
    }

    #[test]
    fn an_interrupt_kills_the_child() {
        let place = tempfile::tempdir().unwrap();
        let sign = place.path().join("ended");
        let slow = script(place.path(), "slow", &format!("sleep 4; touch {}", sign.display()));
        let interrupt = Interrupt::default();
        let start = std::time::Instant::now();
        let result = run(&mut Command::new(&slow), &place.path().join("log"), &interrupt, || {
            interrupt.press();
        });
        assert!(matches!(result, Err(Failure::Interrupted(_))), "{result:?}");
        assert!(start.elapsed() < Duration::from_secs(3));
        std::thread::sleep(Duration::from_millis(200));
        assert!(!sign.exists());
    }
}
