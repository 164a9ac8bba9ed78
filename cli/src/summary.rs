//! What a batch has made so far: one table, and one page.

use std::fmt::Write as _;
use std::path::Path;

use losses::metrics::Preset;
use mesh_core::Examination;
use serde::Serialize;
use serde_json::Value;
use train::report::{counted, escape, page};

use crate::object_list::ListedObject;

/// Names of the files beside the objects' folders.
pub(crate) const TABLE: &str = "summary.csv";
pub(crate) const PAGE: &str = "index.html";

/// An object of the list and what there is of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Row {
    name: String,
    views: String,
    state: State,
    /// How far the mesh can be trusted, in a word; empty where there is none.
    verdict: String,
    /// By name, in the order of [`FIGURES`]; none of an object that is not done, or where the figure is not known.
    figures: Vec<Option<f64>>,
    /// What is wrong with the mesh or why there is none, in words.
    remark: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum State {
    Done,
    Failed,
    Waiting,
}

impl State {
    fn name(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Waiting => "waiting",
        }
    }
}

/// The figures of a row: name, and decimals on the page.
const FIGURES: [(&str, usize); 9] = [
    ("mask IoU", 4),
    ("PSNR", 2),
    ("image L1", 4),
    ("SSIM", 4),
    ("vertices", 0),
    ("self-intersections", 0),
    ("Chamfer", 5),
    ("F-score", 3),
    ("3D IoU", 4),
];

/// All rows, in the order of the list.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Summary {
    pub(crate) objects: Vec<Row>,
}

impl Summary {
    /// Reads what is in the folder of each object. Nothing of it depends on who made it, or when.
    pub(crate) fn of(list: &[ListedObject], folder: &Path) -> Self {
        Self { objects: list.iter().map(|object| Row::of(object, folder)).collect() }
    }

    pub(crate) fn count(&self, state: State) -> usize {
        self.objects.iter().filter(|row| row.state == state).count()
    }

    /// The mean of each figure over the objects that have it.
    pub(crate) fn means(&self) -> Vec<(&'static str, String)> {
        let mean = |k: usize| {
            let values: Vec<f64> = self.objects.iter().filter_map(|row| row.figures[k]).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        let figures = FIGURES.iter().enumerate();
        figures
            .filter_map(|(k, &(name, digits))| Some((name, format!("{:.digits$}", mean(k)?))))
            .collect()
    }

    /// Comma-separated values, one line an object, numbers in full.
    pub(crate) fn csv(&self) -> String {
        let quoted = |text: &str| {
            if text.contains([',', '"', '\n', '\r']) {
                format!("\"{}\"", text.replace('"', "\"\""))
            } else {
                text.to_owned()
            }
        };
        let names: Vec<&str> = FIGURES.iter().map(|(name, _)| *name).collect();
        let mut text = format!("object,views,state,verdict,{},remark\n", names.join(","));
        for row in &self.objects {
            let _ = write!(
                text,
                "{},{},{},{}",
                quoted(&row.name),
                quoted(&row.views),
                row.state.name(),
                row.verdict
            );
            for figure in &row.figures {
                let _ = write!(text, ",{}", figure.map_or_else(String::new, |x| x.to_string()));
            }
            let _ = writeln!(text, ",{}", quoted(&row.remark));
        }
        text
    }

    /// A page with each object's turntable, figures and report. It stands beside the objects' folders, whose images it shows.
    pub(crate) fn html(&self) -> String {
        let [done, failed, waiting] =
            [State::Done, State::Failed, State::Waiting].map(|state| self.count(state));
        let mut body = format!(
            "<h1>{}</h1><p class=\"lead\">{done} done, {failed} failed, {waiting} waiting.</p><table><tr><th></th><th>object</th><th>verdict</th>",
            counted(self.objects.len(), "object")
        );
        for (name, _) in FIGURES {
            let _ = write!(body, "<th>{name}</th>");
        }
        body.push_str("<th></th></tr>");
        for row in &self.objects {
            let name = escape(&row.name);
            if row.state == State::Done {
                let _ = write!(
                    body,
                    "<tr><td><img src=\"{name}/turntable.gif\" width=\"96\" height=\"96\" loading=\"lazy\" alt=\"\"></td>\
                     <td><a href=\"{name}/report.html\">{name}</a></td>"
                );
            } else {
                let _ = write!(body, "<tr><td>{}</td><td>{name}</td>", row.state.name());
            }
            let _ = write!(body, "<td>{}</td>", escape(&row.verdict));
            for (figure, (_, digits)) in row.figures.iter().zip(FIGURES) {
                let text = figure.map_or_else(String::new, |x| format!("{x:.digits$}"));
                let _ = write!(body, "<td>{text}</td>");
            }
            let _ = write!(body, "<td>{}</td></tr>", escape(&row.remark));
        }
        body.push_str("</table>");
        let means: Vec<String> =
            self.means().iter().map(|(name, value)| format!("{name} {value}")).collect();
        if !means.is_empty() {
            let _ = write!(body, "<p>Means over what is done: {}.</p>", means.join(", "));
        }
        page("Objects", &body)
    }
}

impl Row {
    fn of(object: &ListedObject, folder: &Path) -> Self {
        let text = |name: String| std::fs::read_to_string(folder.join(name)).ok();
        let metrics: Option<Value> = text(format!("{}/metrics.json", object.name))
            .and_then(|text| serde_json::from_str(&text).ok());
        let failed = text(failure_file(&object.name));
        let state = match (&metrics, &failed) {
            (Some(_), _) => State::Done,
            (None, Some(_)) => State::Failed,
            (None, None) => State::Waiting,
        };
        let remark = match &metrics {
            Some(metrics) => remark(metrics),
            None => failed.unwrap_or_default().trim().to_owned(),
        };
        let verdict = metrics
            .as_ref()
            .and_then(|metrics| metrics["verdict"]["grade"].as_str())
            .unwrap_or_default()
            .to_owned();
        let figures = metrics.map_or_else(|| vec![None; FIGURES.len()], |found| figures(&found));
        Self {
            name: object.name.clone(),
            views: object.entry.clone(),
            state,
            verdict,
            figures,
            remark,
        }
    }
}

/// The file that says why an object has no mesh.
pub(crate) fn failure_file(name: &str) -> String {
    format!("{name}.failed.txt")
}

fn figures(metrics: &Value) -> Vec<Option<f64>> {
    let views = &metrics["views"];
    let occnet = metrics["truth"]
        .as_array()
        .and_then(|all| all.iter().find(|one| one["protocol"]["name"] == Preset::OccNet.name()));
    let of = |key: &str| occnet.and_then(|found| found[key].as_f64());
    vec![
        views["mask_iou"].as_f64(),
        views["psnr"].as_f64(),
        views["image_l1"].as_f64(),
        views["ssim"].as_f64(),
        metrics["health"]["vertices"].as_f64(),
        metrics["self_intersections"].as_f64(),
        of("chamfer"),
        occnet.and_then(|found| found["f_scores"][0]["f_score"].as_f64()),
        of("iou"),
    ]
}

/// What a reader must not overlook: why the verdict is not better, or, where there is none, what the figures say.
fn remark(metrics: &Value) -> String {
    if let Some(reasons) = metrics["verdict"]["reasons"].as_array() {
        return reasons.iter().filter_map(Value::as_str).collect::<Vec<_>>().join("; ");
    }
    let count = metrics["self_intersections"].as_u64().unwrap_or_default();
    Examination::crossings_of(count as usize).unwrap_or_default()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn what_is_there_is_in_the_table() {
        let place = tempfile::tempdir().unwrap();
        let object = |name: &str| ListedObject {
            name: name.to_owned(),
            entry: format!("views of, {name}"),
            views: name.into(),
            truth: None,
        };
        let list = ["mug", "<cup>", "jug", "a\rb"].map(object);
        std::fs::create_dir(place.path().join("mug")).unwrap();
        let metrics = serde_json::json!({
            "views": { "mask_iou": 0.975, "psnr": null, "image_l1": 0.5, "ssim": 0.25 },
            "health": { "vertices": 642 }, "self_intersections": 3, "truth": [],
            "verdict": { "grade": "doubtful", "reasons": ["one", "two"] },
        });
        std::fs::write(place.path().join("mug/metrics.json"), metrics.to_string()).unwrap();
        std::fs::write(place.path().join("<cup>.failed.txt"), "no \"views\"\n").unwrap();
        let summary = Summary::of(&list, place.path());
        assert_eq!(
            [State::Done, State::Failed, State::Waiting].map(|s| summary.count(s)),
            [1, 1, 2]
        );
        let csv = summary.csv();
        let lines: Vec<&str> = csv.lines().collect();
        assert!(lines[0].starts_with("object,views,state,verdict,mask IoU,PSNR,"));
        assert_eq!(
            lines[1],
            "mug,\"views of, mug\",done,doubtful,0.975,,0.5,0.25,642,3,,,,one; two"
        );
        assert_eq!(lines[2], "<cup>,\"views of, <cup>\",failed,,,,,,,,,,,\"no \"\"views\"\"\"");
        assert_eq!(lines[3], "jug,\"views of, jug\",waiting,,,,,,,,,,,");
        assert!(lines[4].starts_with("\"a\rb\",\"views of, a\rb\",waiting,"), "{}", lines[4]);
        let html = summary.html();
        assert!(
            html.contains("mug/turntable.gif")
                && html.contains("&lt;cup&gt;")
                && !html.contains("<cup>")
        );
        assert!(html.contains("1 done, 1 failed, 2 waiting") && html.contains("mask IoU 0.9750"));
    }
}
