//! What is killed at any moment goes on to the bits of what is not, and leaves nothing behind.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

mod common;

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use common::TINY;

/// How often a training is killed in the short test.
const KILLS: usize = 4;
/// Chooses where.
const SEED: u64 = 20;
/// Calls that change files, where the system has them.
const CALLS: &str = "?write,?fsync,?ftruncate,?rename,?renameat,?renameat2,?unlink,?unlinkat,?rmdir,?mkdir,?mkdirat";

/// A training that takes moments.
struct Training {
    system: &'static str,
    settings: &'static [&'static str],
}

const IMG2MESH: Training = Training {
    system: "img2mesh",
    settings: &[
        "level=1",
        // Four steps an epoch, a checkpoint at every third step: most fall within an epoch.
        "synthetic-views=20",
        "epochs=20",
        "evaluate-every=4",
        "samples-every=none",
        "checkpoint-steps=3",
        "tensorboard=false",
        // What must be carried over a kill: moments, the moving average of the losses, the place in
        // schedules, and all that is random.
        "optimizer=adamw",
        "skip-spikes=50",
        "schedule=cosine",
        "dropout=0.1",
        "vary-views=true",
    ],
};

/// All systems, each for a second or less.
const ALL: [Training; 6] = [
    Training {
        system: "img2mesh",
        settings: &[
            "level=1",
            "synthetic-views=8",
            "epochs=6",
            "evaluate-every=3",
            "samples-every=3",
            "checkpoint-steps=2",
            "skip-spikes=50",
            "vary-views=true",
        ],
    },
    Training { system: "mcmr", settings: &["epochs=4", "checkpoint-steps=1", "samples-every=4"] },
    Training {
        system: "ode-pixel2mesh",
        settings: &["epochs=6", "checkpoint-steps=3", "samples-every=3"],
    },
    Training {
        system: "pixel2mesh",
        settings: &["epochs=6", "checkpoint-steps=3", "samples-every=3"],
    },
    Training {
        system: "depth-pixel2mesh",
        settings: &["epochs=6", "checkpoint-steps=3", "samples-every=3"],
    },
    Training {
        system: "mesh-rcnn",
        settings: &["epochs=6", "checkpoint-steps=3", "samples-every=3"],
    },
];

impl Training {
    fn begin(&self, run: &str) -> Vec<&str> {
        let mut arguments = vec!["train", self.system, "-q", "--preset", "tiny", "-o"];
        // Leaked, a few bytes a test.
        arguments.push(String::from(run).leak());
        for set in self.settings {
            arguments.extend(["--set", set]);
        }
        arguments
    }

    fn resume(&self, run: &str) -> Vec<&str> {
        vec!["train", self.system, "-q", "--resume", String::from(run).leak()]
    }
}

fn start(place: &Path, arguments: &[&str]) -> Child {
    spawn(Command::new(env!("CARGO_BIN_EXE_unsphere")).args(arguments).current_dir(place))
}

fn spawn(command: &mut Command) -> Child {
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// The program under strace, which kills it as it makes its `call`-th change.
fn start_until(place: &Path, arguments: &[&str], call: usize) -> Child {
    let inject = format!("inject={CALLS}:signal=KILL:when={call}");
    let trace = format!("trace={CALLS}");
    let mut command = Command::new("strace");
    command.args(["-f", "-qq", "-o", "/dev/null", "-e", &trace, "-e", &inject]);
    spawn(command.arg(env!("CARGO_BIN_EXE_unsphere")).args(arguments).current_dir(place))
}

/// How many changes of files the program makes; none where it cannot be traced.
fn changes(place: &Path, arguments: &[&str]) -> Option<usize> {
    let (list, trace) = (place.join("trace.txt"), format!("trace={CALLS}"));
    let mut command = Command::new("strace");
    command.args(["-f", "-qq", "-o", list.to_str()?, "-e", &trace]);
    let command = command.arg(env!("CARGO_BIN_EXE_unsphere")).args(arguments).current_dir(place);
    let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status();
    status.ok().filter(std::process::ExitStatus::success)?;
    let text = std::fs::read_to_string(list).unwrap();
    // The first thread makes them all.
    let main = text.split_whitespace().next()?;
    Some(text.lines().filter(|line| line.split_whitespace().next() == Some(main)).count())
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

/// The log as it stands in the file, without what may differ: its header, times, and how often it went on.
fn figures(run: &Path) -> Vec<String> {
    let lines = log(run).into_iter().skip(1).filter(|line| !line.contains("\"kind\":\"resumed\""));
    let timeless = |line: String| match line.split_once(",\"seconds\":") {
        Some((start, time)) => format!("{start}{}", time.trim_start_matches(|c| c != '}')),
        None => line,
    };
    lines.map(timeless).collect()
}

/// Both came to the same: every digit of the log and every bit of the checkpoints; and nothing is left over.
#[track_caller]
fn assert_same(killed: &Path, whole: &Path) {
    let (a, b) = (figures(killed), figures(whole));
    assert!(!a.is_empty() && a.len() == b.len(), "{} and {} lines", a.len(), b.len());
    a.iter().zip(&b).for_each(|(a, b)| assert_eq!(a, b));
    for name in ["best", "last"] {
        let read = |run: &Path| {
            std::fs::read(run.join(format!("checkpoints/{name}.safetensors"))).unwrap()
        };
        assert!(read(killed) == read(whole), "{name}");
    }
    let names = |run: &Path| {
        let files = common::files_in(run).into_iter();
        let names = files.map(|file| file.strip_prefix(run).unwrap().to_owned());
        names.filter(|name| !name.starts_with("tensorboard")).collect::<Vec<_>>()
    };
    assert_eq!(names(killed), names(whole));
}

/// Knuth's generator.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % limit.max(1)
    }
}

#[test]
fn kills_leave_no_trace() {
    let place = tempfile::tempdir().unwrap();
    let folder = |run: &str| -> PathBuf { place.path().join(run) };
    assert!(start(place.path(), &IMG2MESH.begin("whole")).wait().unwrap().success());
    let steps = |line: &&String| line.contains("\"kind\":\"step\"");
    let total = figures(&folder("whole")).iter().filter(steps).count();
    assert!(total >= 60, "{total} steps are too few to be killed in");

    let run = folder("killed");
    let mut random = Random(SEED);
    let mut kills = 0;
    let mut child = start(place.path(), &IMG2MESH.begin("killed"));
    for k in 0..KILLS {
        // Somewhere in the k-th part of the run, but for its end.
        let part = total / (KILLS + 1);
        let step = k * part + 4 + random.below(part);
        kills += usize::from(kill_at(child, &run, step));
        child = start(place.path(), &IMG2MESH.resume("killed"));
    }
    assert!(child.wait().unwrap().success());
    assert!(kills >= 2, "only {kills} kills came in time");
    assert_same(&run, &folder("whole"));
}

/// A training that was killed goes on; whether it came to its end is answered before the next kill.
struct Victim<'a> {
    place: &'a Path,
    training: &'a Training,
    /// Changes and time of the whole.
    changes: Option<usize>,
    time: Duration,
}

impl Victim<'_> {
    /// Kills one run again and again, at most `limit` times, until it comes to its end. How often it was killed.
    fn killed_to_its_end(&self, name: &str, random: &mut Random, limit: usize) -> usize {
        let run = self.place.join(name);
        let mut kills = 0;
        loop {
            // What has no folder yet begins again by the command that it began by.
            let resumable = run.join("config.toml").exists();
            let arguments =
                if resumable { self.training.resume(name) } else { self.training.begin(name) };
            let mut child = match self.changes {
                _ if kills >= limit => start(self.place, &arguments),
                Some(changes) if random.below(2) == 0 => {
                    start_until(self.place, &arguments, 1 + random.below(changes / 2))
                }
                _ => {
                    let child = start(self.place, &arguments);
                    let most = self.time.as_micros() as usize;
                    killed_after(child, Duration::from_micros(random.below(most) as u64))
                }
            };
            let status = child.wait().unwrap();
            if status.success() {
                return kills;
            }
            assert_eq!(status.code(), None, "{arguments:?} failed");
            kills += 1;
        }
    }
}

fn killed_after(mut child: Child, time: Duration) -> Child {
    std::thread::sleep(time);
    // It may have ended by itself.
    let _ = child.kill();
    child
}

/// Kills all systems in turn until there were so many kills.
fn killed(kills: usize, in_one_run: usize) {
    let mut random = Random(SEED);
    let mut done = 0;
    let places: Vec<_> = ALL.iter().map(|_| tempfile::tempdir().unwrap()).collect();
    let victims: Vec<Victim<'_>> = ALL
        .iter()
        .zip(&places)
        .map(|(training, place)| {
            let place = place.path();
            let changes = changes(place, &training.begin("traced"));
            let begun = Instant::now();
            assert!(start(place, &training.begin("whole")).wait().unwrap().success());
            let time = begun.elapsed();
            if changes.is_some() {
                assert_same(&place.join("traced"), &place.join("whole"));
            } else {
                println!("no strace here: kills are drawn over time alone");
            }
            println!("{}: {changes:?} changes in {time:?}", training.system);
            Victim { place, training, changes, time }
        })
        .collect();
    for round in 0.. {
        let victim = &victims[round % victims.len()];
        let name = format!("killed-{round}");
        done += victim.killed_to_its_end(&name, &mut random, in_one_run.min(kills - done));
        assert_same(&victim.place.join(&name), &victim.place.join("whole"));
        std::fs::remove_dir_all(victim.place.join(&name)).unwrap();
        println!("{done} kills of {kills}, {} runs: all as if there had been none", round + 1);
        if done >= kills {
            return;
        }
    }
}

/// Of each system a few; `KILLS=1000` kills so often.
#[test]
#[ignore = "long: KILLS says how many"]
fn every_system_outlasts_many_kills() {
    let kills = std::env::var("KILLS").ok().and_then(|text| text.parse().ok());
    let kills = kills.unwrap_or(18);
    killed(kills, (kills / ALL.len()).clamp(1, 8));
}

/// What a killed demo leaves is gone after the next one, and never stands in its way.
#[test]
fn killed_demos_leave_nothing() {
    let place = tempfile::tempdir().unwrap();
    let [a, b, c, d] = TINY;
    let arguments =
        ["demo", "--views", "6", "--size", "24", "--keep-views", "-q", "-o", "made", a, b, c, d];
    let begun = Instant::now();
    let mut whole = arguments;
    whole[8] = "whole";
    assert!(start(place.path(), &whole).wait().unwrap().success());
    let time = begun.elapsed();
    let mut random = Random(SEED);
    for _ in 0..4 {
        let time = Duration::from_micros(random.below(time.as_micros() as usize) as u64);
        killed_after(start(place.path(), &arguments), time).wait().unwrap();
        assert!(!place.path().join("made").exists() || place.path().join("made/mesh.ply").exists());
        let _ = std::fs::remove_dir_all(place.path().join("made"));
    }
    assert!(start(place.path(), &arguments).wait().unwrap().success());
    let entries = std::fs::read_dir(place.path()).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["made", "whole"]);
    let made = |name: &str| std::fs::read(place.path().join(name).join("mesh.ply")).unwrap();
    assert!(made("made") == made("whole"));
}

/// The second to write into a folder is told who is first.
#[test]
fn two_at_once_are_told_apart() {
    let place = tempfile::tempdir().unwrap();
    let run = place.path().join("run");
    let mut first = start(place.path(), &IMG2MESH.begin("run"));
    while log(&run).len() < 4 {
        std::thread::sleep(Duration::from_millis(1));
    }
    let stop = |signal: &str| {
        let id = first.id().to_string();
        assert!(Command::new("kill").args([signal, &id]).status().unwrap().success());
    };
    // It holds still meanwhile.
    stop("-STOP");
    let holder = format!("process {} on ", first.id());
    let again = common::unsphere(place.path(), ["train", "img2mesh", "--resume", "run"]);
    let over = ["train", "img2mesh", "-o", "run", "--force", "--preset", "tiny"];
    let over = common::unsphere(place.path(), over);
    stop("-CONT");
    again.fails(1, &["run", "in use", &holder]);
    over.fails(1, &["run", "in use", &holder]);
    assert!(first.wait().unwrap().success());
    assert!(!run.join(".lock").exists());
}
