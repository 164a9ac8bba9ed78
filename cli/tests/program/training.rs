//! What `train` promises, with the smallest of systems' presets.

use std::path::Path;

use crate::common::{self, unsphere};

/// Settings that make a training take moments.
const SMALL: [&str; 6] = ["--set", "level=1", "--set", "synthetic-views=10", "--set", "epochs=3"];

fn train(folder: &Path, arguments: [&str; 2]) -> common::Run {
    let [a, b, c, d, e, f] = SMALL;
    let [x, y] = arguments;
    unsphere(folder, ["train", "img2mesh", "--preset", "tiny", "--json", x, y, a, b, c, d, e, f])
}

#[test]
fn a_training_leaves_a_run_that_can_go_on() {
    let place = tempfile::tempdir().unwrap();
    let trained = train(place.path(), ["-o", "run"]).ok().json();
    assert_eq!((&trained["steps"], &trained["interrupted"]), (&6.into(), &false.into()));
    assert!(trained["metrics"]["mask-iou"].as_f64().unwrap() > 0.0);
    for name in [
        "config.toml",
        "provenance.json",
        "metrics.jsonl",
        "metrics.csv",
        "checkpoints/best.safetensors",
        "checkpoints/last.safetensors",
        "samples/epoch-00003.png",
        "report.html",
    ] {
        assert!(
            std::fs::metadata(place.path().join("run").join(name)).unwrap().len() > 50,
            "{name}"
        );
    }
    train(place.path(), ["-o", "run"]).fails(1, &["run", "--resume", "--force"]);
    train(place.path(), ["-o", "again"]).ok();
    let read = |run: &str, name: &str| std::fs::read(place.path().join(run).join(name)).unwrap();
    let last = "checkpoints/last.safetensors";
    assert!(read("run", last) == read("again", last));

    let resume = |set: &str| {
        unsphere(place.path(), ["train", "img2mesh", "--resume", "run", "--json", "--set", set])
    };
    resume("level=2").fails(2, &["level=2", "epochs"]);
    let other = ["train", "pixel2mesh", "--resume", "run"];
    unsphere(place.path(), other).fails(3, &["a run of img2mesh", "train img2mesh --resume run"]);
    assert_eq!(resume("epochs=4").ok().json()["steps"], 8);
    let over = resume("max-steps=3").ok();
    let text = "nothing is trained: the run has taken 8 steps already, beyond the 3";
    assert!(over.stderr().contains(text), "{}", over.stderr());
    assert_eq!(over.json()["steps"], 8);
    std::fs::write(place.path().join("run").join(last), b"nonsense").unwrap();
    resume("epochs=5").fails(3, &["last.safetensors"]);
}

/// A training on other data, or under other options, begins where another ended.
#[test]
fn a_training_begins_with_the_weights_of_another() {
    let place = tempfile::tempdir().unwrap();
    train(place.path(), ["-o", "first"]).ok();
    let from = |arguments: &str| {
        let line = format!("train img2mesh --from first --json --set epochs=1 {arguments}");
        common::unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>())
    };
    let begun = from("-o second --set ema-decay=0.9");
    assert!(begun.ok().json()["metrics"]["mask-iou"].as_f64().unwrap() > 0.0);
    let config = std::fs::read_to_string(place.path().join("second/config.toml")).unwrap();
    // Its options are those of the first, but for what is said.
    for line in ["level = 1", "synthetic-views = 10", "epochs = 1", "ema-decay = 0.9"] {
        assert!(config.contains(line), "{line}: {config}");
    }
    from("-o third --set level=2").fails(3, &["first/checkpoints", "mesh_fc.weight"]);
    from("-o third --preset tiny").fails(2, &["--preset"]);
    let missing = ["train", "img2mesh", "--from", "gone", "-o", "fourth"];
    unsphere(place.path(), missing).fails(3, &["gone", "unsphere train img2mesh"]);
    assert!(!place.path().join("fourth").exists());
}

/// Before the first step: what is trained, from what, and what a prediction will ask for.
#[test]
fn a_training_says_what_it_will_do() {
    let place = tempfile::tempdir().unwrap();
    let said = |line: &str| {
        let line =
            format!("train {line} --preset tiny --set max-steps=1 --set validation-every=none");
        common::unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>()).ok().stderr()
    };
    let deep = said("mesh-rcnn -o runs/deep");
    for part in [
        "training mesh-rcnn, preset tiny: ",
        " numbers, 1 step of 2 samples",
        "measured depth",
        "--depth",
        "data   made by the system, seed 0",
        " objects to train on, ",
        " for validation, ",
        "run    runs/deep",
    ] {
        assert!(deep.contains(part), "{part:?} is not in {deep}");
    }
    let flat = said("mesh-rcnn -o runs/flat --set depth=false --set depth-weight=0");
    assert!(flat.contains("without depth") && !flat.contains("--depth"), "{flat}");
}

#[test]
fn what_cannot_be_trained_is_said_before_the_work() {
    let place = tempfile::tempdir().unwrap();
    let run = |arguments: [&str; 6]| unsphere(place.path(), arguments);
    run(["train", "img2mesh", "-o", "run", "--preset", "huge"]).fails(2, &["huge", "tiny, small"]);
    run(["train", "img2mesh", "-o", "run", "--set", "bath=3"]).fails(2, &["bath", "batch"]);
    run(["train", "img2mesh", "-o", "run", "--set", "heads=3"]).fails(2, &["`heads` is 3"]);
    run(["train", "img3mesh", "-o", "run", "--set", "heads=3"]).fails(2, &["img3mesh", "img2mesh"]);
    unsphere(place.path(), ["train", "img2mesh", "--resume", "gone"]).fails(3, &["gone"]);
    assert!(!place.path().join("run").exists());
    run(["train", "img2mesh", "none.zip", "-o", "run", "-q"]).fails(3, &["none.zip"]);
}

#[test]
fn a_configuration_is_explained() {
    let place = tempfile::tempdir().unwrap();
    let checked = |preset| {
        let arguments = ["check", "--system", "img2mesh", "--preset", preset, "--json"];
        unsphere(place.path(), arguments).ok().json()
    };
    assert_eq!(checked("paper")["system"]["config"]["attention"], "published");
    assert!(checked("small")["system"]["trainable"].as_u64().unwrap() > 1_000_000);
    let text = unsphere(place.path(), ["check", "--system", "img2mesh"]).ok().stdout();
    assert!(text.contains("# numbers") && text.contains("learning-rate = 0.0005"), "{text}");
}

/// Ctrl-C leaves a checkpoint that goes on to the very bits of a run that was not stopped.
#[cfg(unix)]
#[test]
fn ctrl_c_leaves_a_checkpoint() {
    use std::io::BufRead;
    use std::process::{Command, Stdio};
    let place = tempfile::tempdir().unwrap();
    let arguments = ["--preset", "tiny", "--set", "level=1", "--set", "synthetic-views=10"];
    let start = |run: &str, epochs: &str| {
        Command::new(env!("CARGO_BIN_EXE_unsphere"))
            .args([
                "train",
                "img2mesh",
                "-o",
                run,
                "--set",
                epochs,
                "--set",
                "validation-every=none",
            ])
            .args(["--set", "samples-every=none"])
            .args(arguments)
            .current_dir(place.path())
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .unwrap()
    };
    let mut child = start("run", "epochs=100000");
    let mut line = String::new();
    let mut stderr = std::io::BufReader::new(child.stderr.take().unwrap());
    stderr.read_line(&mut line).unwrap();
    assert!(line.contains("training"), "{line}");
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let mut rest = String::new();
    std::io::Read::read_to_string(&mut stderr, &mut rest).unwrap();
    assert!(rest.contains("stopping: after this step"), "{rest}");
    let log = std::fs::read_to_string(place.path().join("run/metrics.jsonl")).unwrap();
    let done = log.lines().filter(|line| line.contains("\"kind\":\"step\"")).count();
    // To the end of the epoch after the next, both ways.
    let epochs = format!("epochs={}", done / 2 + 2);
    let resumed = ["train", "img2mesh", "--resume", "run", "--set", &epochs, "-q"];
    unsphere(place.path(), resumed).ok();
    assert_eq!(start("whole", &epochs).wait().unwrap().code(), Some(0));
    // The configuration in the file has been the same in the end, so the files are.
    let last = |run: &str| {
        std::fs::read(place.path().join(run).join("checkpoints/last.safetensors")).unwrap()
    };
    assert!(last("run") == last("whole"));
}
