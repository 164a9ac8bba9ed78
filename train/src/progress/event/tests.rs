#![allow(clippy::unwrap_used, reason = "tests")]

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

use super::*;
use crate::progress::{JsonLines, Observer};

fn training_step() -> Step {
    let training = TrainingStep {
        epoch: 1,
        learning_rate: 0.1,
        gradient_norm: 2.0,
        seconds: 0.5,
        communication: None,
    };
    Step { training: Some(training), ..Step::of(3, 9, vec![("mask", 0.5), ("edge", f64::NAN)]) }
}

fn shared_step() -> Step {
    let mut step = training_step();
    let training = step.training.as_mut().unwrap();
    training.communication = Some(Communication { bytes: 64, seconds: 0.1, waiting: 0.2 });
    step
}

/// Each event, with and without what it may lack, and how the table calls it.
fn all() -> Vec<(&'static str, Event)> {
    let facts = Facts::from([("vertices", 42.0)]);
    let inherited = Inherited { taken: 2, fresh: vec!["head".into()], ..Inherited::default() };
    let metrics = vec![Metric::larger("mask_iou", 0.75).of_objects(vec![("a".into(), 0.75)])];
    let told = Box::new(Event::Warned { text: "inside".into() });
    let saved = Event::Saved { step: 3, path: "run/last.safetensors".into() };
    vec![
        ("started", Event::Started { job: "fit", total: 9, done: 0, facts: facts.clone() }),
        ("stage", Event::Stage { name: "level 3".into(), facts }),
        ("progress", Event::Progress { done: 1, total: 2, text: "on".into() }),
        ("step", Event::Step(Step::of(3, 9, vec![("silhouette", 0.5)]))),
        ("step of a training", Event::Step(training_step())),
        ("inherited", Event::Inherited(inherited)),
        ("skipped", Event::Skipped { step: 3, loss: 9.0, average: 1.0 }),
        (
            "evaluated",
            Event::Evaluated { step: 3, epoch: None, metrics: metrics.clone(), best: None },
        ),
        (
            "evaluated of a training",
            Event::Evaluated { step: 3, epoch: Some(1), metrics, best: Some(true) },
        ),
        ("saved", saved),
        ("warned", Event::Warned { text: "a sentence".into() }),
        ("within", Event::Within { job: "chair".into(), seed: None, told: told.clone() }),
        ("within of a study", Event::Within { job: "chair".into(), seed: Some(7), told }),
        ("finished", Event::Finished { ended: Ended::Cancelled, done: 3, seconds: 1.5 }),
        ("step of several processes", Event::Step(shared_step())),
    ]
}

/// The table of `events.md`: kind and fields.
fn documented() -> BTreeMap<String, BTreeSet<String>> {
    let rows = include_str!("../events.md").lines().filter(|line| line.starts_with("| `"));
    let rows = rows.skip(1).map(|row| {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let fields = cells[2].split(", ").map(|field| field.trim_matches('`').to_owned());
        (cells[1].replace('`', ""), fields.collect())
    });
    rows.collect()
}

#[test]
fn lines_have_the_fields_that_are_documented() {
    let mut lines = Vec::new();
    let mut log = JsonLines::new(&mut lines);
    for (_, event) in all() {
        log.event(&event);
    }
    let text = String::from_utf8(lines).unwrap();
    let mut written = BTreeMap::new();
    for (line, (name, _)) in text.lines().zip(all()) {
        let Value::Object(mut line) = serde_json::from_str(line).unwrap() else { panic!("{line}") };
        assert!(line.remove("time").unwrap().is_f64());
        let kind = line.remove("event").unwrap();
        assert!(name.split(' ').next() == kind.as_str(), "{name}: {kind}");
        written.insert(name.to_owned(), line.keys().cloned().collect::<BTreeSet<_>>());
    }
    assert_eq!(text.lines().count(), all().len());
    assert_eq!(written, documented());
}

#[test]
fn what_is_said_of_numbers_holds() {
    let line = serde_json::to_value(Event::Step(training_step())).unwrap();
    assert_eq!(line["terms"], serde_json::json!({"mask": 0.5, "edge": null}));
    assert_eq!((&line["loss"], &line["step"]), (&Value::Null, &3.into()));
    let line = serde_json::to_value(&all()[8].1).unwrap();
    assert_eq!(line["metrics"], serde_json::json!({"mask_iou": 0.75}));
    let line = serde_json::to_value(&all()[11].1).unwrap();
    assert_eq!(line["told"], serde_json::json!({"event": "warned", "text": "inside"}));
}
