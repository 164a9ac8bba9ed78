//! `--log-json`: each line is an object, and all of them together say what happened.

use std::path::Path;

use crate::common::{TINY, clock_views, unsphere, unsphere_with};
use serde_json::Value;

/// The lines of a log, whose times never fall.
fn lines(text: &str) -> Vec<Value> {
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let times: Vec<f64> = lines.iter().map(|line| line["time"].as_f64().unwrap()).collect();
    assert!(times.is_sorted(), "{times:?}");
    lines
}

/// How often an event is in them.
fn count(lines: &[Value], event: &str) -> usize {
    lines.iter().filter(|line| line["event"] == event).count()
}

fn log(folder: &Path, name: &str) -> Vec<Value> {
    lines(&std::fs::read_to_string(folder.join(name)).unwrap())
}

#[test]
fn a_fit_tells_what_it_does_and_what_came_of_it() {
    let place = tempfile::tempdir().unwrap();
    clock_views(place.path());
    let [a, b, c, d] = TINY;
    let fit = ["fit", "made/views", "-o", "one", "--json", "--log-json", "log.jsonl", a, b, c, d];
    let printed = unsphere(place.path(), fit).ok().json();
    let told = log(place.path(), "log.jsonl");
    let started = told.iter().find(|line| line["event"] == "started").unwrap();
    assert_eq!((&started["job"], &started["facts"]["views"]), (&"fit".into(), &8.into()));
    let steps = told.iter().filter(|line| line["event"] == "step");
    let steps: Vec<u64> = steps.map(|line| line["step"].as_u64().unwrap()).collect();
    assert_eq!(steps, (1..=steps.len() as u64).collect::<Vec<_>>());
    let scored = told.iter().rfind(|line| line["event"] == "evaluated").unwrap();
    assert!(scored["metrics"]["mask_iou"].as_f64().unwrap() > 0.5, "{scored}");
    let finished = told.iter().find(|line| line["event"] == "finished").unwrap();
    assert_eq!(
        (&finished["ended"], finished["done"].as_u64()),
        (&"completed".into(), steps.last().copied())
    );
    // What commands do beside, and what they print.
    assert!(told.iter().any(|line| line["event"] == "stage" && line["name"] == "read"));
    let last = told.last().unwrap();
    assert_eq!((&last["event"], &last["result"]), (&"result".into(), &printed));

    // A second command goes on behind it, and says why it failed.
    let missing = ["fit", "nowhere", "-o", "two", "--log-json", "log.jsonl"];
    let said = unsphere(place.path(), missing).fails(3, &["nowhere"]).stderr();
    let more: Vec<String> = std::fs::read_to_string(place.path().join("log.jsonl"))
        .unwrap()
        .lines()
        .skip(told.len())
        .map(str::to_owned)
        .collect();
    let failed = lines(&more.join("\n")).pop().unwrap();
    assert_eq!((&failed["event"], &failed["exit_code"]), (&"failed".into(), &3.into()));
    assert!(said.contains(failed["message"].as_str().unwrap()), "{said}: {failed}");
}

#[test]
fn stdout_has_nothing_but_lines_where_they_go_there() {
    let place = tempfile::tempdir().unwrap();
    let line = "data generate -o set --families table --objects 2 --views 3 --size 24 --log-json -";
    let run = unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>()).ok();
    let told = lines(&run.stdout());
    assert_eq!((count(&told, "started"), count(&told, "finished")), (1, 1));
    let done = told.iter().filter(|line| line["event"] == "progress");
    let done: Vec<u64> = done.map(|line| line["done"].as_u64().unwrap()).collect();
    assert_eq!(done, [1, 2, 3, 4, 5, 6]);
    assert_eq!(told.last().unwrap()["result"]["objects"], 2);
}

#[test]
fn trainings_tell_their_steps() {
    let place = tempfile::tempdir().unwrap();
    let small = "--set level=1 --set synthetic-views=10 --set epochs=2";
    let line = format!("train img2mesh --preset tiny -o run -q --log-json train.jsonl {small}");
    unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>()).ok();
    let told = log(place.path(), "train.jsonl");
    let steps: Vec<&Value> = told.iter().filter(|line| line["event"] == "step").collect();
    assert_eq!((steps.len(), count(&told, "evaluated")), (4, 2));
    let terms = steps[0]["terms"].as_object().unwrap().values();
    let sum: f64 = terms.map(|value| value.as_f64().unwrap()).sum();
    assert!((sum - steps[0]["loss"].as_f64().unwrap()).abs() < 1e-12, "{}", steps[0]);
    let saved = told.iter().rfind(|line| line["event"] == "saved").unwrap();
    assert!(place.path().join(saved["path"].as_str().unwrap()).is_file());
}

/// Where lines cannot be written, the work is done and the command says so.
#[cfg(target_os = "linux")]
#[test]
fn a_log_that_is_full_fails_the_command_at_its_end() {
    let place = tempfile::tempdir().unwrap();
    let line = "data generate -o set --families table --objects 1 --views 1 --size 24 --log-json /dev/full";
    let run = unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>());
    assert_eq!(run.code(), Some(1));
    assert!(run.stderr().contains("--log-json /dev/full"), "{}", run.stderr());
    assert!(place.path().join("set/objects.json").is_file());
    let folder = ["check", "--config", "-", "--log-json", "."];
    unsphere(place.path(), folder).fails(1, &["--log-json ."]);
}
