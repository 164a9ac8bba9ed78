//! Several processes at one training, as `mpirun` starts them.
//!
//! The processes share one machine here: `UNSPHERE_MPIRUN` has other words to start them with, for two machines say.
#![allow(clippy::print_stdout, reason = "tests")]

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common;
use serde_json::Value;

/// A training of moments whose batch falls into four shards, in the middle of whose epochs checkpoints come.
const TRAINING: &[&str] = &[
    "train",
    "img2mesh",
    "--preset",
    "tiny",
    "--threads",
    "1",
    "--set",
    "level=1",
    "--set",
    "synthetic-views=20",
    "--set",
    "batch=4",
    "--set",
    "shards=4",
    "--set",
    "epochs=40",
    "--set",
    "validation-every=5",
    "--set",
    "samples-every=none",
    "--set",
    "checkpoint-steps=3",
    "--set",
    "tensorboard=false",
    "--set",
    "dropout=0.1",
    "--set",
    "ema-decay=0.9",
];

/// How long one waits for what must come.
const PATIENCE: Duration = Duration::from_secs(120);

/// Whether processes can be started here.
fn has_mpirun() -> bool {
    let found = Command::new("mpirun").arg("--version").output().is_ok();
    if !found {
        println!("no mpirun here: nothing is tried");
    }
    found
}

/// So many processes with these arguments.
fn mpirun(place: &Path, processes: usize, arguments: &[&str]) -> Command {
    let words = std::env::var("UNSPHERE_MPIRUN")
        .unwrap_or_else(|_| "--oversubscribe --bind-to none --quiet".to_owned());
    let mut command = Command::new("mpirun");
    command.args(words.split_whitespace()).args(["-n", &processes.to_string()]);
    command.arg(env!("CARGO_BIN_EXE_unsphere")).args(arguments).current_dir(place);
    // Where root runs tests, as in containers.
    command
        .envs(["OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"].map(|name| (name, "1")));
    command
}

fn output(mut command: Command) -> Output {
    command.stdin(Stdio::null()).output().unwrap()
}

#[track_caller]
fn succeeds(command: Command) -> Output {
    let output = output(command);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output
}

/// The training into a folder.
fn training<'a>(run: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [TRAINING, &["-o", run], more].concat()
}

/// What is logged, without times and what communication cost.
fn figures(run: &Path) -> Vec<Value> {
    let text = std::fs::read_to_string(run.join("metrics.jsonl")).unwrap_or_default();
    let complete = text.lines().skip(1).filter_map(|line| serde_json::from_str(line).ok());
    let timeless = complete.map(|mut line: Value| {
        let object = line.as_object_mut().unwrap();
        object.remove("seconds");
        object.remove("communication");
        line
    });
    timeless.filter(|line| line["kind"] != "resumed").collect()
}

/// Both came to the same, bit by bit.
#[track_caller]
fn assert_same(run: &Path, whole: &Path) {
    let (a, b) = (figures(run), figures(whole));
    assert_eq!(a.len(), b.len());
    a.iter().zip(&b).for_each(|(a, b)| assert_eq!(a, b));
    for name in ["best", "last"] {
        let read = |run: &Path| {
            std::fs::read(run.join(format!("checkpoints/{name}.safetensors"))).unwrap()
        };
        assert!(read(run) == read(whole), "{name} of {}", run.display());
    }
}

/// Waits until the log says so many steps. False if all ended before.
fn reaches(mpirun: &mut Child, run: &Path, steps: usize) -> bool {
    while mpirun.try_wait().unwrap().is_none() {
        if figures(run).iter().filter(|line| line["kind"] == "step").count() >= steps {
            return true;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    false
}

/// The process of a rank, among the children of `mpirun`, which tells each its rank by its environment.
fn process(mpirun: &Child, rank: usize) -> u32 {
    let wanted = format!("OMPI_COMM_WORLD_RANK={rank}");
    let is_wanted = |pid: &u32| {
        let environment = std::fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
        environment.split(|&byte| byte == 0).any(|variable| variable == wanted.as_bytes())
    };
    let children = format!("/proc/{0}/task/{0}/children", mpirun.id());
    let children = std::fs::read_to_string(children).unwrap();
    let mut pids = children.split_whitespace().map(|pid| pid.parse().unwrap());
    pids.find(is_wanted).expect("mpirun has a child of that rank")
}

fn signal(name: &str, pid: u32) {
    let sent = Command::new("kill").args(["-s", name, &pid.to_string()]).status().unwrap();
    assert!(sent.success());
}

/// Waits for the end of all: no process may be left waiting for another.
fn end(mut mpirun: Child) -> Output {
    let begun = Instant::now();
    while mpirun.try_wait().unwrap().is_none() {
        if begun.elapsed() > PATIENCE {
            mpirun.kill().unwrap();
            panic!("some process waits for ever");
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    mpirun.wait_with_output().unwrap()
}

fn begin(mut command: Command) -> Child {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn any_number_of_processes_gives_the_same_bits() {
    if !has_mpirun() {
        return;
    }
    let place = tempfile::tempdir().unwrap();
    let [place, whole] = [place.path(), &place.path().join("whole")];
    common::unsphere_with(place, &training("whole", &["-q"])).ok();
    for processes in [1, 2, 4] {
        let name = format!("of-{processes}");
        let arguments = training(&name, &["-q", "--json", "--log-json", "events.jsonl"]);
        let output = succeeds(mpirun(place, processes, &arguments));
        assert_same(&place.join(&name), whole);
        // One speaks for all.
        let said: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(said["processes"], processes);
        assert_eq!(said["communication"].is_object(), processes > 1, "{said}");
        let events = std::fs::read_to_string(place.join("events.jsonl")).unwrap();
        std::fs::remove_file(place.join("events.jsonl")).unwrap();
        assert_eq!(events.matches("\"event\":\"finished\"").count(), 1);
        assert_eq!(events.matches("\"event\":\"result\"").count(), 1);
    }
}

#[test]
fn a_killed_process_ends_all_and_any_number_goes_on() {
    if !has_mpirun() {
        return;
    }
    let place = tempfile::tempdir().unwrap();
    let [place, whole] = [place.path(), &place.path().join("whole")];
    common::unsphere_with(place, &training("whole", &["-q"])).ok();
    for (rank, then) in [(3, 2), (0, 4), (1, 1)] {
        let name = format!("killed-{rank}");
        let run = place.join(&name);
        let mut all = begin(mpirun(place, 4, &training(&name, &["-q"])));
        assert!(reaches(&mut all, &run, 20), "it ended before it was killed");
        signal("KILL", process(&all, rank));
        assert!(!end(all).status.success());
        let logged = figures(&run).len();
        assert!(logged < figures(whole).len(), "{logged}: nothing is left to be done");
        train::Checkpoint::read(&run.join("checkpoints/last.safetensors")).unwrap();
        succeeds(mpirun(
            place,
            then,
            &["train", "img2mesh", "-q", "--threads", "1", "--resume", &name],
        ));
        assert_same(&run, whole);
    }
}

/// Ctrl-C reaches one of them, as a batch system may have it: all stop after the same step.
#[test]
fn one_that_is_told_to_stop_stops_all() {
    if !has_mpirun() {
        return;
    }
    let place = tempfile::tempdir().unwrap();
    let [place, whole] = [place.path(), &place.path().join("whole")];
    common::unsphere_with(place, &training("whole", &["-q"])).ok();
    for rank in [0, 1] {
        let name = format!("stopped-{rank}");
        let run = place.join(&name);
        let mut all = begin(mpirun(place, 2, &training(&name, &["-q"])));
        assert!(reaches(&mut all, &run, 10), "it ended before it was stopped");
        signal("INT", process(&all, rank));
        let output = end(all);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(130), "{said}");
        assert_eq!(said.matches("stopped: after").count(), 1, "{said}");
        assert!(figures(&run).len() < figures(whole).len());
        // In one process, without MPI.
        common::unsphere_with(place, &["train", "img2mesh", "-q", "--resume", &name]).ok();
        assert_same(&run, whole);
    }
}

#[test]
fn what_cannot_be_shared_is_refused_by_one_voice() {
    if !has_mpirun() {
        return;
    }
    let place = tempfile::tempdir().unwrap();
    let refused = |processes: usize, arguments: &[&str], words: &[&str]| {
        let output = end(begin(mpirun(place.path(), processes, arguments)));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{said}");
        assert_eq!(said.matches("error: ").count(), 1, "{said}");
        for word in words {
            assert!(said.contains(word), "{word}: {said}");
        }
    };
    let mcmr = ["train", "mcmr", "-q", "--preset", "tiny", "-o", "mcmr"];
    refused(2, &mcmr, &["2 processes, expected 1", "norm = \"group\""]);
    let norm =
        ["train", "mesh-rcnn", "-q", "--preset", "tiny", "--set", "norm=batch", "-o", "norm"];
    refused(2, &norm, &["2 processes, expected 1", "and `\"frozen\"`"]);
    let few = training("few", &["-q", "--set", "shards=2"]);
    refused(4, &few, &["4 processes, expected at most 2", "`shards` = 2"]);
    refused(2, &training("no", &["-q", "nowhere"]), &["nowhere"]);
    refused(2, &["train", "img2mesh", "-q", "--resume", "nowhere"], &["nowhere"]);
}
