//! Disks without room, and disks that may only be read: an error with exit code 1, and nothing lost or left over.
//!
//! The disks are mounted for the test, which takes the rights to do so; without them the tests say so and pass.
#![allow(clippy::print_stdout, reason = "tests")]

use std::fs::{self, File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::Duration;

use crate::common::{self, TINY, clock_views, files_in, unsphere_with};

/// What a disk is filled with.
const FILLER: &str = "filler";
/// Left free on a disk that is nearly full, bytes.
const CRUMBS: u64 = 16 << 10;

/// A small disk of its own.
struct Disk(tempfile::TempDir);

impl Disk {
    /// None where it may not be mounted.
    fn new(size: &str) -> Option<Self> {
        let disk = Self(tempfile::tempdir().unwrap());
        let options = format!("size={size}");
        let mounted = run("mount", &["-t", "tmpfs", "-o", &options, "tmpfs", disk.path()]);
        if !mounted {
            println!("no disk can be mounted here: nothing is tested");
        }
        mounted.then_some(disk)
    }

    fn path(&self) -> &str {
        self.0.path().to_str().unwrap()
    }

    fn fill(&self) {
        let mut file =
            OpenOptions::new().create(true).append(true).open(self.0.path().join(FILLER)).unwrap();
        for size in [1 << 20, 4096] {
            let bytes = vec![1; size];
            while file.write_all(&bytes).is_ok() {}
        }
    }

    /// Full but for a little.
    fn fill_nearly(&self) {
        self.fill();
        let file = File::options().write(true).open(self.0.path().join(FILLER)).unwrap();
        file.set_len(file.metadata().unwrap().len() - CRUMBS).unwrap();
    }

    fn free(&self) {
        let filler = self.0.path().join(FILLER);
        // First emptied: a process that another test is starting may hold the file open for a moment, and the room with it.
        File::options().write(true).open(&filler).unwrap().set_len(0).unwrap();
        fs::remove_file(filler).unwrap();
    }

    fn files(&self) -> Vec<PathBuf> {
        files_in(self.0.path())
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        run("umount", &["-l", self.path()]);
    }
}

fn run(program: &str, arguments: &[&str]) -> bool {
    let mut command = Command::new(program);
    let status = command.args(arguments).stdout(Stdio::null()).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success())
}

/// A small training with these settings.
fn training<'a>(out: &'a str, settings: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = vec!["train", "img2mesh", "--preset", "tiny", "-o", out];
    for set in ["level=1", "synthetic-views=8"].iter().chain(settings) {
        arguments.extend(["--set", set]);
    }
    arguments
}

/// Every command that writes, with `OUT` for where to.
const COMMANDS: &[(&str, &[&str])] = &[
    ("out", &["demo", "--views", "6", "--size", "24", "-o", "OUT", "TINY"]),
    ("out", &["fit", "made/views", "-o", "OUT", "TINY"]),
    ("out", &["train", "TRAINING"]),
    ("out", &["predict", "img2mesh", "made/views", "--checkpoint", "run", "-o", "OUT"]),
    ("turn.gif", &["render", "made/mesh.glb", "--size", "128", "-o", "OUT"]),
    ("one.png", &["render", "made/mesh.glb", "--size", "512", "--view", "1", "-o", "OUT"]),
    ("out", &["render", "made/mesh.glb", "--cameras", "made/views", "-o", "OUT"]),
    ("out", &["data", "convert", "made/views", "OUT", "--layout", "transforms"]),
    ("out", &["data", "inspect", "made/views", "-o", "OUT"]),
    (
        "out",
        &["data", "generate", "--objects", "1", "--views", "2", "--families", "table", "-o", "OUT"],
    ),
    ("out", &["reproduce", "img2mesh", "--quick", "-o", "OUT"]),
];

/// Where networks can be run.
const WITH_NETWORKS: &[(&str, &[&str])] =
    &[("out", &["data", "depth", "one.png", "--model", "tiny.onnx", "-o", "OUT"])];

/// A network in ONNX's form that adds up the colours of each pixel.
fn tiny_network() -> Vec<u8> {
    // Messages of protocol buffers, shorter than 2^14 bytes.
    let part = |field: u8, value: &[u8]| {
        let length = value.len();
        let length = [length as u8 & 127 | if length > 127 { 128 } else { 0 }, (length >> 7) as u8];
        let length = &length[..=usize::from(length[1] > 0)];
        [&[field << 3 | 2], length, value].concat()
    };
    let int = |field: u8, value: u8| vec![field << 3, value];
    // Floats of a shape; 0 stands for an axis of any length.
    let info = |name: &str, shape: &[u8]| {
        let axis = |&n: &u8| part(1, &if n > 0 { int(1, n) } else { part(2, b"any") });
        let axes = shape.iter().flat_map(axis).collect::<Vec<_>>();
        let tensor = [int(1, 1), part(2, &axes)].concat();
        [part(1, name.as_bytes()), part(2, &part(1, &tensor))].concat()
    };
    let weights: Vec<u8> = [1.0_f32; 3].iter().flat_map(|weight| weight.to_le_bytes()).collect();
    let sizes = [1, 3, 1, 1].map(|n| int(1, n)).concat();
    let weights = [sizes, int(2, 1), part(8, b"weights"), part(9, &weights)].concat();
    // Its type, integers, is in field 20.
    let ones = |name: &str| {
        part(5, &[part(1, name.as_bytes()), int(8, 1), int(8, 1), vec![0xa0, 1, 7]].concat())
    };
    let shape = ["kernel_shape", "strides", "dilations"].map(ones).concat();
    let (from, to) = ([part(1, b"picture"), part(1, b"weights")].concat(), part(2, b"depth"));
    let graph = [
        part(1, &[from, to, part(4, b"Conv"), shape].concat()),
        part(2, b"tiny"),
        part(5, &weights),
        part(11, &info("picture", &[1, 3, 0, 0])),
        part(12, &info("depth", &[])),
    ];
    let operators = [part(1, b""), int(2, 12)].concat();
    [int(1, 7), part(7, &graph.concat()), part(8, &operators)].concat()
}

/// A folder with views, a mesh and a trained run; and the commands for a disk.
fn prepared(disk: &Disk) -> (tempfile::TempDir, Vec<(Vec<String>, PathBuf)>) {
    let place = tempfile::tempdir().unwrap();
    clock_views(place.path());
    unsphere_with(place.path(), &training("run", &["epochs=1"])).ok();
    let picture = ["render", "made/mesh.glb", "--size", "128", "--view", "1", "-o", "one.png"];
    unsphere_with(place.path(), &picture).ok();
    fs::write(place.path().join("tiny.onnx"), tiny_network()).unwrap();
    let of = |(name, words): &(&str, &[&str])| {
        let out = disk.0.path().join(name);
        let mut arguments = Vec::new();
        for word in *words {
            let text = out.to_str().unwrap();
            match *word {
                "OUT" => arguments.push(text.to_owned()),
                "TINY" => arguments.extend(TINY.map(str::to_owned)),
                "TRAINING" => {
                    let all = training(text, &["epochs=2"]);
                    arguments.extend(all[1..].iter().map(|word| (*word).to_owned()));
                }
                word => arguments.push(word.to_owned()),
            }
        }
        arguments.push("-q".into());
        (arguments, out)
    };
    let networks = if cfg!(feature = "onnx") { WITH_NETWORKS } else { &[] };
    (place, COMMANDS.iter().chain(networks).map(of).collect())
}

/// Runs a command that cannot write.
fn refused(place: &Path, arguments: &[String], words: &[&str]) {
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let run = unsphere_with(place, &arguments);
    let text = run.stderr();
    assert!(!text.contains("panicked"), "{arguments:?}: {text}");
    assert!(text.lines().count() <= 3, "{arguments:?}: {text}");
    run.fails(1, words);
}

#[test]
fn a_full_disk_is_an_error_and_nothing_else() {
    let Some(disk) = Disk::new("64m") else { return };
    let (place, commands) = prepared(&disk);
    for (arguments, out) in &commands {
        // A study would be at work for minutes where there is room for its first words.
        let study = arguments[0] == "reproduce";
        for nearly in [false, true] {
            if study && nearly {
                continue;
            }
            if nearly {
                disk.fill_nearly();
            } else {
                disk.fill();
            }
            let before = disk.files();
            refused(place.path(), arguments, &["No space left"]);
            let left: Vec<_> = disk.files().into_iter().filter(|f| !before.contains(f)).collect();
            let unfinished = |file: &PathBuf| file.to_str().unwrap().contains("/.un");
            assert!(!left.iter().any(unfinished), "{arguments:?}: {left:?}");
            disk.free();
            // Trainings and datasets go on from what is whole; everything else is whole or not there.
            let goes_on = ["train", "data"].contains(&arguments[0].as_str());
            assert!(goes_on || left.is_empty(), "{arguments:?}: {left:?}");
        }
        if !study {
            // Where there is room, the same command works, whatever was left.
            let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
            unsphere_with(place.path(), &arguments).ok();
            assert!(out.exists());
        }
        let _ = fs::remove_dir_all(out).or_else(|_| fs::remove_file(out));
    }
}

#[test]
fn a_disk_that_may_only_be_read_is_an_error_before_the_work() {
    let Some(disk) = Disk::new("64m") else { return };
    let (place, commands) = prepared(&disk);
    fs::write(disk.0.path().join("mine"), "keep").unwrap();
    assert!(run("mount", &["-o", "remount,ro", disk.path()]));
    for (arguments, _) in &commands {
        refused(place.path(), arguments, &["Read-only file system"]);
    }
    assert_eq!(disk.files().len(), 1);
    // A run there can be used, but not gone on with.
    assert!(run("mount", &["-o", "remount,rw", disk.path()]));
    common::copied(&place.path().join("run/checkpoints"), &disk.0.path().join("run/checkpoints"));
    for name in ["config.toml", "metrics.jsonl", "provenance.json"] {
        fs::copy(place.path().join("run").join(name), disk.0.path().join("run").join(name))
            .unwrap();
    }
    assert!(run("mount", &["-o", "remount,ro", disk.path()]));
    let there = format!("{}/run", disk.path());
    let predict = ["predict", "img2mesh", "made/views", "--checkpoint", &there, "-o", "out", "-q"];
    unsphere_with(place.path(), &predict).ok();
    unsphere_with(place.path(), &["train", "img2mesh", "--resume", &there])
        .fails(1, &["run", "Read-only file system"]);
}

/// `eval` writes nothing but what it prints.
#[test]
fn scores_need_room_only_where_they_are_printed() {
    let Some(disk) = Disk::new("64m") else { return };
    let place = tempfile::tempdir().unwrap();
    let there = format!("{}/run", disk.path());
    unsphere_with(place.path(), &training(&there, &["epochs=1"])).ok();
    let eval = ["eval", "img2mesh", "--checkpoint", &there, "-q"];
    for form in [&[][..], &["--json"]] {
        disk.fill();
        let scores = disk.0.path().join("scores.txt");
        let output = Command::new(env!("CARGO_BIN_EXE_unsphere"))
            .args(eval.iter().chain(form))
            .stdout(File::create(&scores).unwrap())
            .output()
            .unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert!(text.contains("stdout: No space left") && text.lines().count() <= 3, "{text}");
        fs::remove_file(scores).unwrap();
        // Elsewhere there is room.
        unsphere_with(place.path(), &eval).ok();
        disk.free();
    }
    let before = disk.files();
    assert!(run("mount", &["-o", "remount,ro", disk.path()]));
    unsphere_with(place.path(), &eval).ok();
    assert_eq!(disk.files(), before);
}

/// The disk runs full in the middle of a training, and there is room again before its next checkpoint.
#[test]
fn a_training_goes_on_while_the_disk_is_full() {
    let Some(disk) = Disk::new("64m") else { return };
    let place = tempfile::tempdir().unwrap();
    let settings =
        ["epochs=150", "validation-every=none", "samples-every=none", "checkpoint-minutes=none"];
    unsphere_with(place.path(), &training("whole", &settings)).ok();
    let out = format!("{}/run", disk.path());
    let mut child = Command::new(env!("CARGO_BIN_EXE_unsphere"))
        .args(training(&out, &settings))
        .current_dir(place.path())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let (sender, said) = mpsc::channel();
    let listener = std::thread::spawn(move || {
        let mut all = Vec::new();
        for line in lines.map_while(Result::ok).filter(|line| line.contains("cannot be written")) {
            let _ = sender.send(());
            all.push(line);
        }
        all
    });
    let log = Path::new(&out).join("metrics.jsonl");
    let logged = |log: &Path| -> Vec<String> {
        let text = fs::read_to_string(log).unwrap_or_default();
        text.lines()
            .skip(1)
            .filter_map(|line| Some(line.split_once(",\"seconds\"")?.0.into()))
            .collect()
    };
    while logged(&log).len() < 5 {
        std::thread::sleep(Duration::from_millis(1));
    }
    let id = child.id().to_string();
    assert!(run("kill", &["-STOP", &id]));
    disk.fill();
    assert!(run("kill", &["-CONT", &id]));
    // TensorBoard's file, and the log.
    for _ in 0..2 {
        said.recv_timeout(Duration::from_secs(120)).unwrap();
    }
    disk.free();
    assert!(child.wait().unwrap().success());
    let warnings = listener.join().unwrap();
    assert_eq!(warnings.len(), 2, "{warnings:?}");
    assert!(warnings.iter().all(|line| line.contains("the training goes on")), "{warnings:?}");
    let whole = place.path().join("whole");
    assert_eq!(logged(&log), logged(&whole.join("metrics.jsonl")));
    let last = |run: &Path| fs::read(run.join("checkpoints/last.safetensors")).unwrap();
    assert!(last(Path::new(&out)) == last(&whole));
}
