//! `metrics.jsonl`: one object a line, the first of them the run's header; and the table made of it.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::error::RunError;
use super::progress::Communication;
use crate::output::disk::{Growing, write_whole};

/// A line after the header.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub(super) enum Line {
    /// A step.
    Step {
        step: u64,
        epoch: u64,
        loss: f64,
        #[serde(with = "named")]
        terms: Vec<(String, f64)>,
        learning_rate: f64,
        gradient_norm: f64,
        seconds: f64,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        communication: Option<Communication>,
    },
    /// A step that was left out.
    Skipped { step: u64, epoch: u64, loss: f64, average: f64 },
    /// Scores of validation after so many steps.
    #[serde(alias = "evaluation")]
    Validation {
        step: u64,
        epoch: u64,
        #[serde(with = "named")]
        metrics: Vec<(String, f64)>,
        best: bool,
    },
    /// The run went on here.
    Resumed {
        step: u64,
        unix_seconds: u64,
        threads: usize,
        #[serde(default = "alone")]
        processes: usize,
    },
}

/// What logs of before mean.
fn alone() -> usize {
    1
}

impl Line {
    fn step(&self) -> u64 {
        match self {
            Self::Step { step, .. }
            | Self::Skipped { step, .. }
            | Self::Validation { step, .. }
            | Self::Resumed { step, .. } => *step,
        }
    }

    /// Whether it was written after the checkpoint of a step, where a validation may be pending.
    fn comes_after(&self, step: u64, pending: bool) -> bool {
        let again = pending && matches!(self, Self::Validation { .. }) && self.step() == step;
        self.step() > step || again
    }
}

/// Named numbers as an object that keeps their order. What is not finite is null.
mod named {
    use std::fmt;

    use serde::de::{MapAccess, Visitor};
    use serde::{Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(
        pairs: &[(String, f64)],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.collect_map(pairs.iter().map(|(name, value)| (name, value)))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<(String, f64)>, D::Error> {
        struct Pairs;
        impl<'de> Visitor<'de> for Pairs {
            type Value = Vec<(String, f64)>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object of numbers")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut pairs = Vec::new();
                while let Some((name, value)) = map.next_entry::<String, Option<f64>>()? {
                    pairs.push((name, value.unwrap_or(f64::NAN)));
                }
                Ok(pairs)
            }
        }
        deserializer.deserialize_map(Pairs)
    }
}

/// How a training went, by step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curves {
    /// The loss of each step.
    pub losses: Vec<(u64, f64)>,
    /// The scores of each validation, by name.
    pub scores: Vec<(u64, Vec<(String, f64)>)>,
}

/// Columns of the table that every run has, in their order.
const FIXED: [&str; 5] = ["epoch", "loss", "learning_rate", "gradient_norm", "seconds"];

/// Everything that a run has logged so far.
#[derive(Clone, Debug, Default)]
pub(super) struct History {
    pub(super) header: Value,
    pub(super) lines: Vec<Line>,
}

impl History {
    /// Reads the log of a run. A last line that was cut off when the run was killed is left out.
    pub(super) fn read(path: &Path) -> Result<Self, RunError> {
        let text = std::fs::read_to_string(path).map_err(RunError::io(path))?;
        let complete = text.rfind('\n').map_or("", |end| &text[..end]);
        let mut history = Self::default();
        for (k, line) in complete.lines().enumerate() {
            if k == 0 {
                history.header = serde_json::from_str(line).map_err(wrong(path, k))?;
            } else {
                history.lines.push(serde_json::from_str(line).map_err(wrong(path, k))?);
            }
        }
        Ok(history)
    }

    /// The header of a run's log, and how many of its bytes stay when it goes on from a checkpoint: those before later
    /// steps, and before validations that are still to be done.
    pub(super) fn kept(path: &Path, step: u64, pending: bool) -> Result<(Value, u64), RunError> {
        let text = std::fs::read(path).map_err(RunError::io(path))?;
        let (mut header, mut kept, mut reached) = (None, 0, 0);
        for (k, line) in text.split_inclusive(|&byte| byte == b'\n').enumerate() {
            if !line.ends_with(b"\n") {
                break;
            }
            if k == 0 {
                header = Some(serde_json::from_slice(line).map_err(wrong(path, k))?);
            } else {
                match serde_json::from_slice::<Line>(line) {
                    Ok(line) if line.comes_after(step, pending) => break,
                    Ok(line) => reached = line.step(),
                    // Behind the checkpoint, a power cut may have left anything.
                    Err(_) if reached >= step => break,
                    Err(error) => return Err(wrong(path, k)(error)),
                }
            }
            kept += line.len() as u64;
        }
        Ok((header.unwrap_or_default(), kept))
    }

    /// Seconds of computing in the steps.
    pub(super) fn seconds(&self) -> f64 {
        let of = |line: &Line| if let Line::Step { seconds, .. } = line { *seconds } else { 0.0 };
        self.lines.iter().map(of).sum()
    }

    /// Losses and scores.
    pub(super) fn curves(self) -> Curves {
        let mut curves = Curves::default();
        for line in self.lines {
            match line {
                Line::Step { step, loss, .. } => curves.losses.push((step, loss)),
                Line::Validation { step, metrics, .. } => curves.scores.push((step, metrics)),
                Line::Skipped { .. } | Line::Resumed { .. } => {}
            }
        }
        curves
    }

    /// All steps and validations as a table, one row a step; what a row has not is empty.
    pub(super) fn to_csv(&self) -> String {
        let mut columns: Vec<&str> = Vec::new();
        let mut scores: Vec<&str> = Vec::new();
        let mut rows: BTreeMap<u64, Vec<(String, f64)>> = BTreeMap::new();
        for line in &self.lines {
            let row = rows.entry(line.step()).or_default();
            match line {
                Line::Step {
                    epoch, loss, terms, learning_rate, gradient_norm, seconds, ..
                } => {
                    let values = [*epoch as f64, *loss, *learning_rate, *gradient_norm, *seconds];
                    row.extend(FIXED.map(str::to_owned).into_iter().zip(values));
                    for (name, value) in terms {
                        note(&mut columns, name);
                        row.push((format!("term/{name}"), *value));
                    }
                }
                Line::Skipped { epoch, loss, .. } => {
                    row.extend(FIXED.map(str::to_owned).into_iter().zip([*epoch as f64, *loss]));
                }
                Line::Validation { metrics, .. } => {
                    for (name, value) in metrics {
                        note(&mut scores, name);
                        row.push((format!("validation/{name}"), *value));
                    }
                }
                Line::Resumed { .. } => {}
            }
        }
        let names: Vec<String> = FIXED
            .map(str::to_owned)
            .into_iter()
            .chain(columns.iter().map(|name| format!("term/{name}")))
            .chain(scores.iter().map(|name| format!("validation/{name}")))
            .collect();
        let mut text =
            format!("step,{}\n", names.iter().map(|n| quoted(n)).collect::<Vec<_>>().join(","));
        for (step, row) in rows.into_iter().filter(|(_, row)| !row.is_empty()) {
            let _ = write!(text, "{step}");
            for name in &names {
                text.push(',');
                if let Some((_, value)) = row.iter().find(|(other, _)| other == name) {
                    let _ = write!(text, "{value}");
                }
            }
            text.push('\n');
        }
        text
    }
}

/// What is wrong with a line, counted from 0.
fn wrong(path: &Path, line: usize) -> impl FnOnce(serde_json::Error) -> RunError {
    let path = path.to_owned();
    move |problem| RunError::Log { path, line: line + 1, problem: problem.to_string() }
}

fn note<'a>(names: &mut Vec<&'a str>, name: &'a str) {
    if !names.contains(&name) {
        names.push(name);
    }
}

fn quoted(name: &str) -> String {
    if name.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", name.replace('"', "\"\""))
    } else {
        name.to_owned()
    }
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("names and numbers serialise") + "\n"
}

/// The log of a run under way, appended line by line; what was written once is never rewritten.
#[derive(Debug)]
pub(super) struct Log {
    file: Growing,
    /// Lines for which there was no room.
    waiting: Vec<u8>,
}

impl Log {
    /// Begins a log.
    pub(super) fn begin(path: PathBuf, header: &Value) -> Result<Self, RunError> {
        let text = json(header);
        write_whole(&path, text.as_bytes()).map_err(RunError::io(&path))?;
        Self::resume(path, text.len() as u64)
    }

    /// Goes on behind the bytes that stay.
    pub(super) fn resume(path: PathBuf, kept: u64) -> Result<Self, RunError> {
        let file = Growing::open(path.clone(), kept).map_err(RunError::io(path))?;
        Ok(Self { file, waiting: Vec::new() })
    }

    /// One line, in one write, so that a kill cuts off at most the last. If there is no room it waits for the next one,
    /// or for [`sync`](Self::sync).
    pub(super) fn append(&mut self, line: &Line) -> Result<(), RunError> {
        self.waiting.extend(json(line).bytes());
        self.write()
    }

    /// Brings all lines to the disk.
    pub(super) fn sync(&mut self) -> Result<(), RunError> {
        self.write()?;
        self.file.sync().map_err(RunError::io(self.file.path()))
    }

    fn write(&mut self) -> Result<(), RunError> {
        self.file.append(&self.waiting).map_err(RunError::io(self.file.path()))?;
        self.waiting.clear();
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    fn step(step: u64) -> Line {
        let terms = vec![("mask".to_owned(), 0.1), ("edge, long".to_owned(), 1.0 / 3.0)];
        let (loss, learning_rate, gradient_norm) = (0.1 + 1.0 / 3.0, 1e-4, 2.5);
        let (seconds, communication) = (0.5, None);
        Line::Step {
            step,
            epoch: 0,
            loss,
            terms,
            learning_rate,
            gradient_norm,
            seconds,
            communication,
        }
    }

    fn validation(step: u64) -> Line {
        let metrics = vec![("mask-iou".to_owned(), 0.75), ("psnr".to_owned(), f64::NAN)];
        Line::Validation { step, epoch: 1, metrics, best: true }
    }

    /// Logs of before call a validation an evaluation.
    #[test]
    fn former_logs_are_read() {
        let now = serde_json::to_string(&validation(4)).unwrap();
        assert!(now.contains("\"kind\":\"validation\""), "{now}");
        let former = now.replace("\"validation\"", "\"evaluation\"");
        let read: Line = serde_json::from_str(&former).unwrap();
        assert!(matches!(read, Line::Validation { step: 4, best: true, .. }));
    }

    #[test]
    fn a_log_is_read_back_without_its_cut_off_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.jsonl");
        let header = serde_json::json!({"kind": "run", "system": "test"});
        let mut log = Log::begin(path.clone(), &header).unwrap();
        for line in [step(1), step(2), validation(2), step(3)] {
            log.append(&line).unwrap();
        }
        let mut text = std::fs::read_to_string(&path).unwrap();
        text.push_str("{\"kind\":\"step\",\"st");
        std::fs::write(&path, text).unwrap();
        let history = History::read(&path).unwrap();
        assert_eq!((history.header.clone(), history.lines.len()), (header.clone(), 4));
        assert_eq!(history.lines[0], step(1));
        assert!(
            matches!(&history.lines[2], Line::Validation { metrics, .. } if metrics[1].1.is_nan())
        );
        let (mut lengths, whole) = (Vec::new(), std::fs::read(&path).unwrap());
        for (at, pending, lines) in [(3, false, 4), (2, false, 3), (2, true, 2), (0, false, 0)] {
            let (found, kept) = History::kept(&path, at, pending).unwrap();
            lengths.push(kept);
            drop(Log::resume(path.clone(), kept).unwrap());
            assert!(whole.starts_with(&std::fs::read(&path).unwrap()));
            assert_eq!((found, History::read(&path).unwrap().lines.len()), (header.clone(), lines));
        }
        assert!(lengths.is_sorted_by(|a, b| a > b));
        std::fs::write(&path, "{}\nnonsense\n{}\n").unwrap();
        let error = History::read(&path).unwrap_err().to_string();
        assert!(error.contains("metrics.jsonl: line 2"), "{error}");
        assert!(History::kept(&path, 1, false).is_err());
        // Before the first step nothing is lost with it.
        assert_eq!(History::kept(&path, 0, false).unwrap().1, 3);
    }

    /// Numbers that a reader in a hurry gets wrong in the last place.
    #[test]
    fn numbers_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.jsonl");
        let mut log = Log::begin(path.clone(), &Value::Null).unwrap();
        let mut written = Vec::new();
        for k in 1..500_u64 {
            let seconds = 1.0 / (k as f64 * 7.3e3 + 0.1);
            written.push(seconds);
            let (terms, learning_rate, gradient_norm) = (vec![], 1e-4, 1.0);
            let line = Line::Step {
                step: k,
                epoch: 0,
                loss: 0.1,
                terms,
                learning_rate,
                gradient_norm,
                seconds,
                communication: None,
            };
            log.append(&line).unwrap();
        }
        let read = History::read(&path).unwrap().lines;
        for (line, expected) in read.iter().zip(written) {
            assert!(
                matches!(line, Line::Step { seconds, .. } if *seconds == expected),
                "{expected}"
            );
        }
    }

    #[test]
    fn the_table_has_a_row_a_step() {
        let history = History { header: Value::Null, lines: vec![step(1), step(2), validation(2)] };
        let csv = history.to_csv();
        let lines: Vec<&str> = csv.lines().collect();
        assert_eq!(
            lines[0],
            "step,epoch,loss,learning_rate,gradient_norm,seconds,term/mask,\"term/edge, long\",\
             validation/mask-iou,validation/psnr"
        );
        let third = 1.0 / 3.0;
        assert_eq!(lines[1], format!("1,0,{},0.0001,2.5,0.5,0.1,{third},,", 0.1 + third));
        assert_eq!(lines[2], format!("2,0,{},0.0001,2.5,0.5,0.1,{third},0.75,NaN", 0.1 + third));
    }

    /// A carriage return alone ends a line for many readers.
    #[test]
    fn names_that_would_end_a_field_are_quoted() {
        let quotes = [
            ("a,b", "\"a,b\""),
            ("a\"b", "\"a\"\"b\""),
            ("a\nb", "\"a\nb\""),
            ("a\rb", "\"a\rb\""),
        ];
        for (name, expected) in quotes {
            assert_eq!(quoted(name), expected);
        }
        assert_eq!(quoted("mask iou"), "mask iou");
    }
}
