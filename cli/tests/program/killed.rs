//! What is killed at any moment goes on to the bits of what is not, and leaves nothing behind.
#![allow(clippy::print_stdout, reason = "tests")]

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, SystemTime};

use crate::common::{self, TINY};

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
        "validation-every=4",
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

/// Of systems that learn from surfaces.
const SURFACES: &[&str] =
    &["test-objects=1", "synthetic-views=2", "epochs=6", "checkpoint-steps=3", "samples-every=3"];

/// How often one training is killed at most in the long test, before it comes to its end and is compared.
const IN_ONE_RUN: usize = 24;

/// All systems, each for half a second: most of the long test is starting them.
const ALL: [Training; 6] = [
    Training {
        system: "img2mesh",
        settings: &[
            "level=1",
            "synthetic-views=8",
            "epochs=6",
            "validation-every=3",
            "samples-every=3",
            "checkpoint-steps=2",
            "skip-spikes=50",
            "vary-views=true",
        ],
    },
    Training {
        system: "mcmr",
        settings: &[
            "batch=2",
            "objects=4",
            "test-objects=2",
            "epochs=4",
            "checkpoint-steps=3",
            "samples-every=4",
        ],
    },
    Training { system: "ode-pixel2mesh", settings: SURFACES },
    Training { system: "pixel2mesh", settings: SURFACES },
    Training { system: "depth-pixel2mesh", settings: SURFACES },
    Training { system: "mesh-rcnn", settings: SURFACES },
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

/// The program, or the copy of it that `UNSPHERE_PROGRAM` names, which no later build replaces.
fn program() -> PathBuf {
    let copy = std::env::var_os("UNSPHERE_PROGRAM");
    copy.map_or_else(|| env!("CARGO_BIN_EXE_unsphere").into(), PathBuf::from)
}

fn start(place: &Path, arguments: &[&str]) -> Child {
    spawn(Command::new(program()).args(arguments).current_dir(place))
}

fn spawn(command: &mut Command) -> Child {
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// strace, which sees changes alone. Not with --seccomp-bpf: its version 6.1 then kills at the first call or never.
fn tracer() -> Command {
    let mut command = Command::new("strace");
    command.args(["-f", "-qq", "-e", &format!("trace={CALLS}")]);
    command
}

/// The program under strace, which kills it as it makes a call for the `count`-th time. (strace counts each call by
/// itself.)
fn start_until(place: &Path, arguments: &[&str], call: &str, count: usize) -> Child {
    let inject = format!("inject={call}:signal=KILL:when={count}");
    let mut command = tracer();
    command.args(["-o", "/dev/null", "-e", &inject]).arg(program());
    spawn(command.args(arguments).current_dir(place))
}

/// Which calls that change files the program makes, and how often; none where it cannot be traced.
fn changes(place: &Path, arguments: &[&str]) -> Option<Vec<(String, usize)>> {
    let list = place.join("trace.txt");
    let mut command = tracer();
    command.arg("-o").arg(&list).arg(program()).args(arguments).current_dir(place);
    let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status();
    status.ok().filter(std::process::ExitStatus::success)?;
    let text = std::fs::read_to_string(list).unwrap();
    let mut counts = BTreeMap::new();
    // The first thread makes them all.
    let main = text.split_whitespace().next()?;
    for line in text.lines() {
        let (thread, line) = line.split_once(' ')?;
        if let Some((call, _)) = line.trim_start().split_once('(').filter(|_| thread == main) {
            *counts.entry(call.to_owned()).or_default() += 1;
        }
    }
    Some(counts.into_iter().collect())
}

/// The lines of the log.
fn log(run: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(run.join("metrics.jsonl")).unwrap_or_default();
    text.lines().map(str::to_owned).collect()
}

/// Steps in the log.
fn steps(run: &Path) -> usize {
    log(run).iter().filter(|line| line.contains("\"kind\":\"step\"")).count()
}

/// Kills the training once its log says so many steps, as nothing can be caught that does. Whether
/// it was still going.
fn kill_at(mut child: Child, run: &Path, step: usize) -> bool {
    while child.try_wait().unwrap().is_none() {
        if steps(run) >= step {
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

    /// From 1 to `most`, each order of magnitude as likely as the others.
    fn skewed(&mut self, most: usize) -> usize {
        let share = self.below(1 << 20) as f64 / f64::from(1 << 20);
        (most as f64).powf(share) as usize
    }
}

#[test]
fn kills_leave_no_trace() {
    let place = tempfile::tempdir().unwrap();
    let folder = |run: &str| -> PathBuf { place.path().join(run) };
    assert!(start(place.path(), &IMG2MESH.begin("whole")).wait().unwrap().success());
    let total = steps(&folder("whole"));
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

/// A training, and what it comes to if nothing happens to it.
struct Victim<'a> {
    place: PathBuf,
    training: &'a Training,
    /// Changes and time of the whole.
    changes: Option<Vec<(String, usize)>>,
    time: Duration,
    /// How often it was killed so far.
    kills: usize,
    /// In which quarter of the steps.
    quarters: [usize; 4],
}

impl<'a> Victim<'a> {
    /// Trains once to the end.
    fn new(place: PathBuf, training: &'a Training) -> Self {
        let changes = changes(&place, &training.begin("traced"));
        let begun = Instant::now();
        assert!(start(&place, &training.begin("whole")).wait().unwrap().success());
        let time = begun.elapsed();
        if let Some(changes) = &changes {
            assert_same(&place.join("traced"), &place.join("whole"));
            let status = {
                let (call, count) = changes.last().unwrap();
                start_until(&place, &training.begin("probed"), call, *count).wait().unwrap()
            };
            assert_eq!(status.code(), None, "strace does not kill");
        } else {
            println!("no strace here: kills are drawn over time alone");
        }
        println!("{}: {changes:?} changes in {time:?}", training.system);
        Self { place, training, changes, time, kills: 0, quarters: [0; 4] }
    }

    /// Kills one run again and again, at most `limit` times, until it comes to its end, and compares it. How often it
    /// was killed.
    fn killed_to_its_end(&mut self, random: &mut Random, limit: usize) -> usize {
        let run = self.place.join("killed");
        let _ = std::fs::remove_dir_all(&run);
        let (mut kills, mut story) = (0, String::new());
        let total = steps(&self.place.join("whole"));
        loop {
            // What has no folder yet begins again by the command that it began by.
            let resumable = run.join("config.toml").exists();
            let mut arguments = if resumable {
                self.training.resume("killed")
            } else {
                self.training.begin("killed")
            };
            // Their number changes nothing either.
            arguments.extend(["--threads", if random.below(4) == 0 { "2" } else { "1" }]);
            let mut child = if kills < limit {
                self.doomed(&arguments, random, &mut story)
            } else {
                start(&self.place, &arguments)
            };
            let status = child.wait().unwrap();
            if status.success() {
                break;
            }
            assert_eq!(status.code(), None, "{arguments:?} failed, killed{story}");
            kills += 1;
            self.quarters[(4 * steps(&run) / total).min(3)] += 1;
        }
        println!("{}, killed{story}", self.training.system);
        assert_same(&run, &self.place.join("whole"));
        kills
    }

    /// Starts the program and kills it somewhere, unless it ends before. Most come early, counted from where it went on:
    /// a run is killed many times before its end, and as often near it as elsewhere.
    fn doomed(&self, arguments: &[&str], random: &mut Random, story: &mut String) -> Child {
        if let Some(changes) = &self.changes
            && random.below(3) > 0
        {
            let (call, most) = &changes[random.below(changes.len())];
            let count = random.skewed(*most);
            let _ = write!(story, " at {call} {count},");
            return start_until(&self.place, arguments, call, count);
        }
        let time = self.time.as_millis() as usize;
        // From the start it is mostly killed before it changed anything.
        if random.below(4) == 0 {
            let delay = Duration::from_millis(random.below(time) as u64);
            let _ = write!(story, " after {delay:?},");
            return killed_after(start(&self.place, arguments), delay);
        }
        let delay = Duration::from_millis(random.skewed(time) as u64);
        let _ = write!(story, " {delay:?} after it logged,");
        let log = self.place.join("killed/metrics.jsonl");
        let state = || -> Option<(u64, SystemTime)> {
            let facts = std::fs::metadata(&log).ok()?;
            Some((facts.len(), facts.modified().ok()?))
        };
        let before = state();
        let mut child = start(&self.place, arguments);
        while state() == before && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        killed_after(child, delay)
    }
}

fn killed_after(mut child: Child, time: Duration) -> Child {
    std::thread::sleep(time);
    // It may have ended by itself.
    let _ = child.kill();
    child
}

/// What was done so far, in a file if there is one: a line for each run, its system and how often it was killed.
struct Tally(Option<PathBuf>);

impl Tally {
    fn read(&self) -> Vec<(String, usize)> {
        let text = self.0.as_ref().and_then(|file| std::fs::read_to_string(file).ok());
        let text = text.unwrap_or_default();
        let of = |line: &str| {
            let (system, kills) = line.split_once(' ')?;
            Some((system.to_owned(), kills.parse().ok()?))
        };
        text.lines().filter_map(of).collect()
    }

    fn add(&self, system: &str, kills: usize) {
        use std::io::Write as _;
        if let Some(path) = &self.0 {
            let mut file = std::fs::File::options().create(true).append(true).open(path).unwrap();
            writeln!(file, "{system} {kills}").unwrap();
        }
    }
}

/// Kills all systems until there were so many kills, each as often as the others.
fn killed(kills: usize, in_one_run: usize, tally: &Tally) {
    // It stays if something fails.
    let place = tempfile::tempdir().unwrap().keep();
    let folder = |training: &Training| {
        let folder = place.join(training.system);
        std::fs::create_dir(&folder).unwrap();
        folder
    };
    let mut victims = ALL.each_ref().map(|training| Victim::new(folder(training), training));
    let before = tally.read();
    for victim in &mut victims {
        let own = before.iter().filter(|(system, _)| system == victim.training.system);
        victim.kills = own.map(|(_, kills)| kills).sum();
    }
    let begun = Instant::now();
    let mut here = 0;
    for run in before.len() + 1.. {
        let done: usize = victims.iter().map(|victim| victim.kills).sum();
        if done >= kills {
            break;
        }
        let victim = victims.iter_mut().min_by_key(|victim| victim.kills).unwrap();
        let mut random = Random(SEED ^ (run as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let limit = in_one_run.min(kills - done);
        let more = victim.killed_to_its_end(&mut random, limit);
        victim.kills += more;
        tally.add(victim.training.system, more);
        here += more;
        let (done, rate) = (done + more, here as f64 / begun.elapsed().as_secs_f64() * 60.0);
        println!(
            "{done} kills of {kills}, {run} runs: all as if there had been none ({rate:.0} a minute)"
        );
    }
    for victim in &victims {
        let Victim { training, kills, quarters, .. } = victim;
        println!("{}: {kills} kills, in the quarters of its steps {quarters:?}", training.system);
    }
    std::fs::remove_dir_all(place).unwrap();
}

/// Of each system a few; `KILLS=1000` kills so often. With `KILLS_TALLY=FILE` it can be stopped and goes on.
#[test]
#[ignore = "long: KILLS says how many"]
fn every_system_outlasts_many_kills() {
    let kills = std::env::var("KILLS").ok().and_then(|text| text.parse().ok());
    let kills = kills.unwrap_or(18);
    let tally = Tally(std::env::var_os("KILLS_TALLY").map(PathBuf::from));
    killed(kills, (kills / ALL.len()).clamp(1, IN_ONE_RUN), &tally);
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
