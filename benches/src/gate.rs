//! Figures that travel from machine to machine, and their comparison with those of before.
//!
//! Times do not travel. The figure of a product or a convolution is its share of the peak of as many cores as it has
//! threads; that of other work is how often it is done while the reference of [`yardsticks`](crate::yardsticks) is done once.
//! Both sides come from one process.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde_json::Value;

/// Figures by the id of their bench.
pub type Figures = BTreeMap<String, f64>;

/// Groups whose throughput is floating-point operations.
const PRODUCTS: [&str; 2] = ["gemm", "conv2d"];

/// What cannot be read.
#[derive(Debug)]
pub struct GateError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: String,
}

impl std::fmt::Display for GateError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.path.display(), self.problem)
    }
}

impl std::error::Error for GateError {}

/// A bench as criterion left it: median nanoseconds, and elements of an iteration if it said so.
#[derive(Clone, Copy, Debug)]
struct Measured {
    time: f64,
    elements: Option<f64>,
}

fn read(path: &Path) -> Result<Value, GateError> {
    let problem = |problem: String| GateError { path: path.to_owned(), problem };
    let text = std::fs::read_to_string(path).map_err(|error| problem(error.to_string()))?;
    serde_json::from_str(&text).map_err(|error| problem(error.to_string()))
}

/// All that stands below a folder of criterion's.
fn collect(folder: &Path, found: &mut BTreeMap<String, Measured>) -> Result<(), GateError> {
    let problem = |problem: String| GateError { path: folder.to_owned(), problem };
    let entries = std::fs::read_dir(folder).map_err(|error| problem(error.to_string()))?;
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        if !path.is_dir() {
            continue;
        }
        if path.file_name().is_none_or(|name| name != "new") {
            collect(&path, found)?;
            continue;
        }
        if !path.join("benchmark.json").exists() {
            continue;
        }
        let (bench, estimates) =
            (read(&path.join("benchmark.json"))?, read(&path.join("estimates.json"))?);
        let missing = |field: &str| GateError {
            path: path.clone(),
            problem: format!("no field `{field}` where criterion had one"),
        };
        let id = bench["full_id"].as_str().ok_or_else(|| missing("full_id"))?;
        let median = estimates["median"]["point_estimate"].as_f64();
        let time = median.ok_or_else(|| missing("median.point_estimate"))?;
        let elements = bench["throughput"]["Elements"].as_f64();
        found.insert(id.to_owned(), Measured { time, elements });
    }
    Ok(())
}

/// The figures of what criterion measured last, of benches that have yardsticks.
///
/// # Errors
/// If the folder cannot be read, or a file in it is not criterion's.
pub fn figures(folder: &Path) -> Result<Figures, GateError> {
    let mut found = BTreeMap::new();
    collect(folder, &mut found)?;
    let mut figures = Figures::new();
    for (id, measured) in &found {
        let Some((group, _)) = id.split_once('/') else { continue };
        let yardstick = |kind: &str| found.get(&format!("yardstick/{group}/{kind}/1t"));
        let (Some(peak), Some(reference)) = (yardstick("peak"), yardstick("reference")) else {
            continue;
        };
        let threads = id.rsplit_once('/').and_then(|(_, last)| last.strip_suffix('t'));
        let cores = threads.and_then(|threads| threads.parse::<f64>().ok()).unwrap_or(1.0);
        let figure = match (measured.elements, peak.elements) {
            (Some(flops), Some(most)) if PRODUCTS.contains(&group) => {
                (flops / measured.time) / (most / peak.time * cores)
            }
            _ => reference.time / measured.time,
        };
        figures.insert(id.clone(), figure);
    }
    Ok(figures)
}

/// Reads lines of `id,figure`, after a line of names.
///
/// # Errors
/// If the file cannot be read, or a line is another.
pub fn table(path: &Path) -> Result<Figures, GateError> {
    let problem = |problem: String| GateError { path: path.to_owned(), problem };
    let text = std::fs::read_to_string(path).map_err(|error| problem(error.to_string()))?;
    let row = |(k, line): (usize, &str)| {
        let parsed =
            line.split_once(',').and_then(|(id, x)| Some((id.to_owned(), x.parse().ok()?)));
        parsed
            .ok_or_else(|| problem(format!("line {}: expected `id,figure`, found {line:?}", k + 1)))
    };
    text.lines().enumerate().skip(1).filter(|(_, line)| !line.is_empty()).map(row).collect()
}

/// The lines that [`table`] reads.
pub fn to_table(figures: &Figures) -> String {
    let rows = figures.iter().map(|(id, figure)| format!("{id},{figure:.4}\n"));
    std::iter::once("id,figure\n".to_owned()).chain(rows).collect()
}

/// Those figures that are less than `share` of what they were: id, before, now. Ids that only one side has are none.
pub fn worse(before: &Figures, now: &Figures, share: f64) -> Vec<(String, f64, f64)> {
    let both = before.iter().filter_map(|(id, &was)| now.get(id).map(|&is| (id.clone(), was, is)));
    both.filter(|&(_, was, is)| is < was * share).collect()
}

/// The history's lines, `date,commit,processor,id,figure`, as a plot: one line of points for each id, each divided by its
/// own first figure.
pub fn plot(history: &str) -> String {
    const LEFT: f64 = 420.0;
    const TOP: f64 = 30.0;
    const WIDE: f64 = 420.0;
    const STEP: f64 = 26.0;
    let mut moments: Vec<&str> = Vec::new();
    let mut lines: BTreeMap<&str, Vec<(usize, f64)>> = BTreeMap::new();
    for line in history.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let [date, commit, _, id, figure] = fields[..] else { continue };
        let Ok(figure) = figure.parse() else { continue };
        let moment = &line[..date.len() + 1 + commit.len()];
        if moments.last() != Some(&moment) {
            moments.push(moment);
        }
        lines.entry(id).or_default().push((moments.len() - 1, figure));
    }
    let high = TOP + STEP * lines.len() as f64 + 10.0;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"960\" height=\"{high:.0}\" font-family=\"sans-serif\" \
         font-size=\"11\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n<text x=\"10\" y=\"18\">share of the \
         peak, or of the reference, over {} moments; at the right the last figure</text>\n",
        moments.len()
    );
    let last = moments.len().saturating_sub(1).max(1) as f64;
    for (k, (id, points)) in lines.iter().enumerate() {
        let y = TOP + STEP * k as f64 + STEP / 2.0;
        let place = |&(moment, figure): &(usize, f64)| {
            let ratio = (figure / points[0].1).clamp(0.5, 1.5);
            (LEFT + WIDE * moment as f64 / last, y - (ratio - 1.0) * STEP)
        };
        let path: Vec<String> =
            points.iter().map(place).map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let end = points.last().map_or(0.0, |point| point.1);
        let _ = writeln!(
            svg,
            "<text x=\"10\" y=\"{:.1}\">{id}</text><line x1=\"{LEFT}\" y1=\"{y}\" x2=\"{}\" y2=\"{y}\" stroke=\"#ddd\"/>\
             <polyline points=\"{}\" fill=\"none\" stroke=\"#1f6feb\" stroke-width=\"1.5\" marker-end=\"none\"/>\
             <text x=\"{}\" y=\"{:.1}\">{end:.3}</text>",
            y + 4.0,
            LEFT + WIDE,
            path.join(" "),
            LEFT + WIDE + 12.0,
            y + 4.0,
        );
    }
    svg + "</svg>\n"
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    fn leave(folder: &Path, id: &str, time: f64, elements: Option<u64>) {
        let place = folder.join(id.replace('/', "_")).join("new");
        std::fs::create_dir_all(&place).unwrap();
        let throughput = elements.map(|n| serde_json::json!({ "Elements": n }));
        let bench = serde_json::json!({ "full_id": id, "throughput": throughput });
        let estimates = serde_json::json!({ "median": { "point_estimate": time } });
        std::fs::write(place.join("benchmark.json"), bench.to_string()).unwrap();
        std::fs::write(place.join("estimates.json"), estimates.to_string()).unwrap();
    }

    #[test]
    fn shares_of_the_peak_and_of_the_reference() {
        let folder = tempfile::tempdir().unwrap();
        for group in ["gemm", "nets"] {
            leave(folder.path(), &format!("yardstick/{group}/peak/1t"), 100.0, Some(10_000));
            leave(folder.path(), &format!("yardstick/{group}/reference/1t"), 50.0, Some(7));
        }
        leave(folder.path(), "gemm/8x8x8/nn/1t", 10.0, Some(900));
        leave(folder.path(), "gemm/8x8x8/nn/2t", 5.0, Some(900));
        leave(folder.path(), "nets/layer/2t", 200.0, None);
        leave(folder.path(), "other/without-yardsticks", 1.0, None);
        let found = figures(folder.path()).unwrap();
        assert_eq!(found["gemm/8x8x8/nn/1t"], 0.9);
        assert_eq!(found["gemm/8x8x8/nn/2t"], 0.9);
        assert_eq!(found["nets/layer/2t"], 0.25);
        assert!(!found.contains_key("other/without-yardsticks"));
        let path = folder.path().join("table.csv");
        std::fs::write(&path, to_table(&found)).unwrap();
        assert_eq!(table(&path).unwrap(), found);
    }

    #[test]
    fn a_quarter_less_is_worse() {
        let of = |pairs: &[(&str, f64)]| -> Figures {
            pairs.iter().map(|&(id, x)| (id.to_owned(), x)).collect()
        };
        let before = of(&[("a", 0.8), ("b", 0.8), ("gone", 1.0)]);
        let now = of(&[("a", 0.61), ("b", 0.59), ("new", 0.1)]);
        assert_eq!(worse(&before, &now, 0.75), [("b".to_owned(), 0.8, 0.59)]);
    }

    #[test]
    fn what_is_no_table_is_refused_by_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        std::fs::write(&path, "id,figure\na/b,0.5\nnonsense\n").unwrap();
        let error = table(&path).unwrap_err().to_string();
        assert!(error.contains("line 3: expected `id,figure`, found \"nonsense\""), "{error}");
        assert!(table(&folder.path().join("none.csv")).is_err());
    }

    #[test]
    fn the_plot_has_a_line_of_points_for_each_id() {
        let history =
            "date,commit,processor,id,figure\nd1,c1,p,a,0.5\nd1,c1,p,b,2\nd2,c2,p,a,0.25\n";
        let svg = plot(history);
        assert_eq!(svg.matches("<polyline").count(), 2);
        // At the left as it began, at the right half of that.
        assert!(svg.contains("points=\"420.0,43.0 840.0,56.0\""), "{svg}");
        assert!(svg.contains("over 2 moments"));
    }
}
