//! A training that is killed again and again comes to the bits of one that is not.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "tests")]

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use serde_json::Value;

/// How often it is killed.
const KILLS: usize = 4;
/// Chooses where.
const SEED: u64 = 20;

const SETTINGS: &[&str] = &[
    "level=1",
    // Four steps an epoch, a checkpoint at every third step: most fall within an epoch.
    "synthetic-views=20",
    "epochs=20",
    "evaluate-every=4",
    "samples-every=0",
    "checkpoint-steps=3",
    "tensorboard=false",
    // What must be carried over a kill: moments, the moving average of the losses, the place in
    // schedules, and all that is random.
    "optimizer=adamw",
    "skip-spikes=50",
    "schedule=cosine",
    "dropout=0.1",
    "vary-views=true",
];

fn begin(place: &Path, run: &str) -> Child {
    let mut arguments = vec!["train", "img2mesh", "-q", "--preset", "tiny", "-o", run];
    for set in SETTINGS {
        arguments.extend(["--set", set]);
    }
    start(place, &arguments)
}

fn start(place: &Path, arguments: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_unsphere"))
        .args(arguments)
        .current_dir(place)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// The lines of the log.
fn log(run: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(run.join("metrics.jsonl")).unwrap_or_default();
    text.lines().map(str::to_owned).collect()
}

/// Kills the training once its log says so many steps, as nothing can be caught that does. Whether
/// it was still going.
fn kill_at(mut child: Child, run: &Path, step: usize) -> bool {
    let reached = || log(run).iter().filter(|line| line.contains("\"kind\":\"step\"")).count();
    while child.try_wait().unwrap().is_none() {
        if reached() >= step {
            child.kill().unwrap();
            return child.wait().unwrap().code().is_none();
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    false
}

/// The log without what may differ: times, where it is, and how often it went on.
fn figures(run: &Path) -> Vec<Value> {
    let lines = log(run).into_iter().map(|line| serde_json::from_str::<Value>(&line).unwrap());
    lines
        .filter(|line| line["kind"] != "resumed")
        .map(|mut line| {
            let fields = line.as_object_mut().unwrap();
            fields.retain(|name, _| !["seconds", "unix_seconds", "command"].contains(&&**name));
            line
        })
        .collect()
}

#[test]
fn kills_leave_no_trace() {
    let place = tempfile::tempdir().unwrap();
    let folder = |run: &str| -> PathBuf { place.path().join(run) };
    assert!(begin(place.path(), "whole").wait().unwrap().success());
    let total = figures(&folder("whole")).iter().filter(|line| line["kind"] == "step").count();
    assert!(total >= 60, "{total} steps are too few to be killed in");

    let run = folder("killed");
    let mut random = SEED;
    let mut kills = 0;
    let mut child = begin(place.path(), "killed");
    for k in 0..KILLS {
        // Knuth's generator: somewhere in the k-th part of the run, but for its end.
        random =
            random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let part = total / (KILLS + 1);
        let step = k * part + 4 + (random >> 33) as usize % part;
        kills += usize::from(kill_at(child, &run, step));
        child = start(place.path(), &["train", "img2mesh", "-q", "--resume", "killed"]);
    }
    assert!(child.wait().unwrap().success());
    assert!(kills >= 2, "only {kills} kills came in time");

    let (killed, whole) = (figures(&run), figures(&folder("whole")));
    assert_eq!(killed.len(), whole.len());
    for (a, b) in killed.iter().zip(&whole) {
        assert_eq!(a, b);
    }
    for name in ["best", "last"] {
        let read = |run: &str| {
            std::fs::read(folder(run).join(format!("checkpoints/{name}.safetensors"))).unwrap()
        };
        assert!(read("killed") == read("whole"), "{name}");
    }
}
