//! `metrics.jsonl`: one object a line, the first of them the run's header; and the table made of it.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::error::RunError;

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
    },
    /// A step that was left out.
    Skipped { step: u64, epoch: u64, loss: f64, average: f64 },
    /// An evaluation after so many steps.
    Evaluation {
        step: u64,
        epoch: u64,
        #[serde(with = "named")]
        metrics: Vec<(String, f64)>,
        best: bool,
    },
    /// The run went on here.
    Resumed { step: u64, unix_seconds: u64, threads: usize },
}

impl Line {
    fn step(&self) -> u64 {
        match self {
            Self::Step { step, .. }
            | Self::Skipped { step, .. }
            | Self::Evaluation { step, .. }
            | Self::Resumed { step, .. } => *step,
        }
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

/// Everything that a run has logged so far.
#[derive(Clone, Debug, Default)]
pub(super) struct History {
    pub(super) header: Value,
    pub(super) lines: Vec<Line>,
}

impl History {
    /// Reads the log of a run. A last line that was cut off when the run was killed is left out.
    pub(super) fn read(path: &Path) -> Result<Self, RunError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| RunError::Io { path: path.to_owned(), source })?;
        let wrong = |line: usize, problem: serde_json::Error| RunError::Log {
            path: path.to_owned(),
            line: line + 1,
            problem: problem.to_string(),
        };
        let complete = text.rfind('\n').map_or("", |end| &text[..end]);
        let mut history = Self::default();
        for (k, line) in complete.lines().enumerate() {
            if k == 0 {
                history.header = serde_json::from_str(line).map_err(|e| wrong(k, e))?;
            } else {
                history.lines.push(serde_json::from_str(line).map_err(|e| wrong(k, e))?);
            }
        }
        Ok(history)
    }

    /// Forgets what came after a checkpoint: later steps, and evaluations that are still to be done.
    pub(super) fn rewind(&mut self, step: u64, pending: bool) {
        self.lines.retain(|line| {
            let again = pending && matches!(line, Line::Evaluation { .. }) && line.step() == step;
            line.step() <= step && !again
        });
    }

    /// Seconds of computing in the steps.
    pub(super) fn seconds(&self) -> f64 {
        let of = |line: &Line| if let Line::Step { seconds, .. } = line { *seconds } else { 0.0 };
        self.lines.iter().map(of).sum()
    }

    /// A weighted term of the loss, step by step.
    pub(super) fn term(&self, wanted: &str) -> Vec<f64> {
        let steps = self.lines.iter().filter_map(|line| match line {
            Line::Step { terms, .. } => terms.iter().find(|(name, _)| name == wanted),
            _ => None,
        });
        steps.map(|(_, value)| *value).collect()
    }

    /// The text of the log.
    pub(super) fn to_jsonl(&self) -> String {
        let mut text = json(&self.header);
        for line in &self.lines {
            text += &json(line);
        }
        text
    }

    /// All steps and evaluations as a table, one row a step; what a row has not is empty.
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
                    row.push(("epoch".to_owned(), *epoch as f64));
                    row.push(("loss".to_owned(), *loss));
                    row.push(("learning_rate".to_owned(), *learning_rate));
                    row.push(("gradient_norm".to_owned(), *gradient_norm));
                    row.push(("seconds".to_owned(), *seconds));
                    for (name, value) in terms {
                        note(&mut columns, name);
                        row.push((format!("term/{name}"), *value));
                    }
                }
                Line::Skipped { epoch, loss, .. } => {
                    row.push(("epoch".to_owned(), *epoch as f64));
                    row.push(("loss".to_owned(), *loss));
                }
                Line::Evaluation { metrics, .. } => {
                    for (name, value) in metrics {
                        note(&mut scores, name);
                        row.push((format!("score/{name}"), *value));
                    }
                }
                Line::Resumed { .. } => {}
            }
        }
        let fixed = ["epoch", "loss", "learning_rate", "gradient_norm", "seconds"];
        let names: Vec<String> = fixed
            .iter()
            .map(|&name| name.to_owned())
            .chain(columns.iter().map(|name| format!("term/{name}")))
            .chain(scores.iter().map(|name| format!("score/{name}")))
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

fn note<'a>(names: &mut Vec<&'a str>, name: &'a str) {
    if !names.contains(&name) {
        names.push(name);
    }
}

fn quoted(name: &str) -> String {
    if name.contains([',', '"', '\n']) {
        format!("\"{}\"", name.replace('"', "\"\""))
    } else {
        name.to_owned()
    }
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("names and numbers serialise") + "\n"
}

/// The log of a run under way, appended line by line.
#[derive(Debug)]
pub(super) struct Log {
    path: PathBuf,
    file: File,
}

impl Log {
    /// Writes what was logged so far, whole or not at all, and goes on behind it.
    pub(super) fn open(path: PathBuf, history: &History) -> Result<Self, RunError> {
        let text = history.to_jsonl();
        let io = |source| RunError::Io { path: path.clone(), source };
        mesh_core::io::write_atomic(&path, |out| out.write_all(text.as_bytes()))
            .map_err(|error| io(std::io::Error::other(error.to_string())))?;
        let file = OpenOptions::new().append(true).open(&path).map_err(io)?;
        Ok(Self { path, file })
    }

    /// One line, in one write, so that a kill cuts off at most the last.
    pub(super) fn append(&mut self, line: &Line) -> Result<(), RunError> {
        let io = |source| RunError::Io { path: self.path.clone(), source };
        self.file.write_all(json(line).as_bytes()).map_err(io)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    fn step(step: u64) -> Line {
        let terms = vec![("mask".to_owned(), 0.1), ("edge, long".to_owned(), 1.0 / 3.0)];
        let (loss, learning_rate, gradient_norm) = (0.1 + 1.0 / 3.0, 1e-4, 2.5);
        Line::Step { step, epoch: 0, loss, terms, learning_rate, gradient_norm, seconds: 0.5 }
    }

    fn evaluation(step: u64) -> Line {
        let metrics = vec![("mask-iou".to_owned(), 0.75), ("psnr".to_owned(), f64::NAN)];
        Line::Evaluation { step, epoch: 1, metrics, best: true }
    }

    #[test]
    fn a_log_is_read_back_without_its_cut_off_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.jsonl");
        let header = serde_json::json!({"kind": "run", "system": "test"});
        let start = History { header: header.clone(), lines: vec![] };
        let mut log = Log::open(path.clone(), &start).unwrap();
        for line in [step(1), step(2), evaluation(2), step(3)] {
            log.append(&line).unwrap();
        }
        let mut text = std::fs::read_to_string(&path).unwrap();
        text.push_str("{\"kind\":\"step\",\"st");
        std::fs::write(&path, text).unwrap();
        let mut history = History::read(&path).unwrap();
        assert_eq!((history.header.clone(), history.lines.len()), (header, 4));
        assert_eq!(history.lines[0], step(1));
        assert!(
            matches!(&history.lines[2], Line::Evaluation { metrics, .. } if metrics[1].1.is_nan())
        );
        history.rewind(2, false);
        assert_eq!(history.lines.len(), 3);
        history.rewind(2, true);
        assert_eq!(history.lines, [step(1), step(2)]);
        std::fs::write(&path, "{}\nnonsense\n{}\n").unwrap();
        let error = History::read(&path).unwrap_err().to_string();
        assert!(error.contains("metrics.jsonl: line 2"), "{error}");
    }

    #[test]
    fn the_table_has_a_row_a_step() {
        let history = History { header: Value::Null, lines: vec![step(1), step(2), evaluation(2)] };
        let csv = history.to_csv();
        let lines: Vec<&str> = csv.lines().collect();
        assert_eq!(
            lines[0],
            "step,epoch,loss,learning_rate,gradient_norm,seconds,term/mask,\"term/edge, long\",\
             score/mask-iou,score/psnr"
        );
        let third = 1.0 / 3.0;
        assert_eq!(lines[1], format!("1,0,{},0.0001,2.5,0.5,0.1,{third},,", 0.1 + third));
        assert_eq!(lines[2], format!("2,0,{},0.0001,2.5,0.5,0.1,{third},0.75,NaN", 0.1 + third));
    }
}
