//! Runs the binary and looks at what it did.

pub(crate) mod pixels;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The binary with these arguments, in this folder.
pub(crate) fn unsphere<const N: usize>(folder: &Path, arguments: [&str; N]) -> Run {
    unsphere_with(folder, &arguments)
}

/// The same for arguments that were put together.
pub(crate) fn unsphere_with(folder: &Path, arguments: &[&str]) -> Run {
    let output = Command::new(env!("CARGO_BIN_EXE_unsphere"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap();
    Run(output)
}

/// What a run of the binary left.
#[derive(Debug)]
pub(crate) struct Run(Output);

impl Run {
    pub(crate) fn stdout(&self) -> String {
        String::from_utf8(self.0.stdout.clone()).unwrap()
    }

    pub(crate) fn stderr(&self) -> String {
        String::from_utf8(self.0.stderr.clone()).unwrap()
    }

    /// Its exit code.
    pub(crate) fn code(&self) -> Option<i32> {
        self.0.status.code()
    }

    /// The result, as JSON.
    pub(crate) fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.stdout()).unwrap()
    }

    /// It succeeded.
    #[track_caller]
    pub(crate) fn ok(self) -> Self {
        assert_eq!(self.0.status.code(), Some(0), "{}", self.stderr());
        self
    }

    /// It failed with this exit code, said all these words on stderr, and nothing on stdout.
    #[track_caller]
    pub(crate) fn fails(self, code: i32, words: &[&str]) -> Self {
        let text = self.stderr();
        assert_eq!(self.0.status.code(), Some(code), "{text}");
        for word in words {
            assert!(text.contains(word), "{word:?} is not in {text:?}");
        }
        assert_eq!(self.stdout(), "");
        self
    }
}

/// Settings that make a fit small.
pub(crate) const TINY: [&str; 4] = ["--set", "level=3", "--set", "steps=12"];

/// A folder with a few views of a clock, in kaolin's layout, made by the demo.
pub(crate) fn clock_views(folder: &Path) -> PathBuf {
    let [a, b, c, d] = TINY;
    unsphere(
        folder,
        ["demo", "--views", "10", "--size", "48", "--keep-views", "-o", "made", a, b, c, d],
    )
    .ok();
    folder.join("made/views")
}

/// Everything under a folder, sorted.
pub(crate) fn files_in(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files.sort();
    files
}

/// A copy of a folder of files.
pub(crate) fn copied(from: &Path, to: &Path) -> PathBuf {
    std::fs::create_dir_all(to).unwrap();
    for file in files_in(from) {
        std::fs::copy(&file, to.join(file.file_name().unwrap())).unwrap();
    }
    to.to_owned()
}
