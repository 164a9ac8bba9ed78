#![allow(clippy::unwrap_used, reason = "tests")]

use std::fs;
use std::path::Path;
use std::sync::Mutex;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use mesh_core::ByteImage;
use models::img2mesh::{Img2Mesh, Img2MeshConfig};
use train::report::ViewPair;
use train::{Configuration, Source, System, settings};

use super::*;
use crate::progress::{Ended, Event, Watch};

/// Colours of what the first job shows.
const MODEL: [u8; 3] = [210, 90, 40];
const TRUTH: [u8; 3] = [40, 90, 210];

/// Two jobs, the second of two rows; counts how often each is begun.
struct Toy {
    settings: &'static str,
    begun: Mutex<Vec<String>>,
}

impl Toy {
    fn new() -> Self {
        Self { settings: "width = 3", begun: Mutex::default() }
    }

    fn begun(&self) -> Vec<String> {
        std::mem::take(&mut self.begun.lock().unwrap())
    }
}

impl Study for Toy {
    fn name(&self) -> &'static str {
        "toy"
    }

    fn about(&self) -> &'static str {
        "nothing <much>"
    }

    fn plan(&self, _: Scale) -> Plan {
        Plan::of(["one", "two"], self.settings)
    }

    fn run(&self, work: &Work<'_>, watch: &mut Watch<'_>) -> Result<Vec<Row>, StudyError> {
        self.begun.lock().unwrap().push(format!("{} {}", work.id, work.seed));
        work.tell(watch, 0.25, "thinking")?;
        let seed = work.seed as f64;
        let row = |label: &str, error: f64| {
            Row::new("Errors", label)
                .with(Cell::smaller("error | all", error, 2))
                .with(Cell::plain("size", 7.0, 0))
                .took(2.0)
        };
        if work.id == "one" {
            let plain = |color: [u8; 3]| ByteImage {
                height: 4,
                width: 4,
                channels: 3,
                data: color.repeat(16),
            };
            let pair = ViewPair { caption: "a".into(), model: plain(MODEL), truth: plain(TRUTH) };
            return Ok(vec![row("one", 0.5 + 0.1 * seed).showing("views", &[pair])]);
        }
        let none = Cell { value: None, ..Cell::larger("rare", 0.0, 1) };
        Ok(vec![row("two, a", 0.4 - 0.1 * seed), row("two, b", f64::NAN).with(none)])
    }

    fn claims(&self) -> Vec<Claim> {
        let [one, two] = ["one", "two, a"].map(|row| Score::new("Errors", row, "error | all"));
        vec![Claim::new("two beats one", [two.below(one)])]
    }

    fn caption(&self, _: &str, scale: Scale) -> String {
        format!("Made {}.", scale.name())
    }
}

fn make(toy: &Toy, out: &Path, order: &Order<'_>) -> Result<Reproduced, ReproduceError> {
    reproduce(toy, out, order, &mut Watch::default())
}

fn order(seeds: &[u64]) -> Order<'static> {
    Order { seeds: Seeds::Listed(seeds.to_vec()), ..Order::default() }
}

#[test]
fn the_table_has_means_seeds_and_claims() {
    let place = tempfile::tempdir().unwrap();
    let made = make(&Toy::new(), place.path(), &order(&[0, 1, 2])).unwrap();
    // Lower in all three seeds, but by 0.1, 0.3 and 0.5: Student's interval of that reaches beyond 0.
    assert!(made.ended == Ended::Completed && made.claims[0].verdict == Verdict::Undecided);
    let text = fs::read_to_string(place.path().join("table.md")).unwrap();
    let lines: Vec<&str> = text.lines().filter(|line| line.starts_with('|')).collect();
    assert_eq!(
        lines,
        [
            "| | error \\| all ↓ | size | rare ↑ | time |",
            "|---|---:|---:|---:|---:|",
            "| one | 0.60 (0.50, 0.60, 0.70) | 7 | none | 2.0 s |",
            "| two, a | **0.30** (0.40, 0.30, 0.20) | 7 | none | 2.0 s |",
            "| two, b | none | 7 | none | 2.0 s |",
        ]
    );
    let verdict = "- **undecided**: two beats one (0.3000 against 0.6000, difference -0.3000 [-0.7969, 0.1969])";
    for part in [verdict, "Made full.", "- seeds: 0, 1, 2"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let page = fs::read_to_string(place.path().join("report.html")).unwrap();
    assert!(page.contains("nothing &lt;much&gt;") && page.contains("data:image/png;base64,iVB"));
    assert!(!page.contains("http://") && !page.contains("https://"));
    // The one image that is shown is the one that is kept: the model above the truth, in their colours.
    let kept = fs::read(place.path().join("pictures/one-seed-0-0.png")).unwrap();
    assert!(page.contains(&BASE64.encode(&kept)) && page.matches("<img ").count() == 1);
    let sheet = mesh_core::decode_image(&kept, "kept").unwrap();
    assert_eq!((sheet.height, sheet.width, sheet.channels), (8, 4, 3));
    let (above, below) = sheet.data.split_at(4 * 4 * 3);
    assert!(above.chunks(3).all(|p| p == MODEL) && below.chunks(3).all(|p| p == TRUTH));
    let json: serde_json::Value =
        serde_json::from_slice(&fs::read(place.path().join("results.json")).unwrap()).unwrap();
    assert_eq!(json["rows"].as_array().map(Vec::len), Some(9));
    // A single seed has nothing beside it.
    let alone = tempfile::tempdir().unwrap();
    make(&Toy::new(), alone.path(), &order(&[4])).unwrap();
    let text = fs::read_to_string(alone.path().join("table.md")).unwrap();
    assert!(text.contains("| one | 0.90 | 7 |"), "{text}");
}

#[test]
fn what_is_finished_is_not_done_again() {
    let place = tempfile::tempdir().unwrap();
    let toy = Toy::new();
    // Stopped in the middle of the third of four jobs.
    let mut told = 0;
    let mut watch = Watch::default().until_event(|event| {
        told += u64::from(matches!(event, Event::Within { .. }));
        told == 3
    });
    let stopped = reproduce(&toy, place.path(), &order(&[0, 1]), &mut watch).unwrap();
    assert!(stopped.ended == Ended::Cancelled && stopped.claims.is_empty());
    assert_eq!(toy.begun(), ["one 0", "two 0", "one 1"]);
    let read = |name: &str| fs::read_to_string(place.path().join(name)).unwrap();
    assert!(
        read("table.md").contains("2 are left") && read("report.html").contains("Not finished")
    );
    let made = make(&toy, place.path(), &order(&[0, 1])).unwrap();
    assert_eq!(toy.begun(), ["one 1", "two 1"]);
    // As if it had not been stopped.
    let whole = tempfile::tempdir().unwrap();
    let again = make(&toy, whole.path(), &order(&[0, 1])).unwrap();
    assert_eq!((made.tables, made.claims), (again.tables, again.claims));
    toy.begun();
    // Another seed is added to what is there.
    let more = make(&toy, place.path(), &order(&[0, 1, 2])).unwrap();
    assert_eq!(toy.begun(), ["one 2", "two 2"]);
    assert_eq!(more.tables.values("Errors", "one", "size").len(), 3);
    // A result that was removed is made again.
    fs::remove_file(place.path().join("results/two-seed-1.json")).unwrap();
    make(&toy, place.path(), &order(&[0, 1, 2])).unwrap();
    assert_eq!(toy.begun(), ["two 1"]);
}

#[test]
fn results_of_something_else_are_refused() {
    let place = tempfile::tempdir().unwrap();
    make(&Toy::new(), place.path(), &order(&[0])).unwrap();
    let wider = Toy { settings: "width = 4", ..Toy::new() };
    let error = make(&wider, place.path(), &order(&[0])).unwrap_err().to_string();
    for part in ["`width = 3`", "`width = 4`", "--force"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let quick = Order { scale: Scale::Quick, ..order(&[0]) };
    let error = make(&Toy::new(), place.path(), &quick).unwrap_err().to_string();
    assert!(error.contains("`scale = full`"), "{error}");
    let longer = Toy { settings: "width = 3\ndepth = 1", ..Toy::new() };
    let error = make(&longer, place.path(), &order(&[0])).unwrap_err().to_string();
    assert!(error.contains("of `nothing`, now it is `depth = 1`"), "{error}");
    assert!(wider.begun().is_empty());
    fs::write(place.path().join("notes.txt"), "mine").unwrap();
    make(&wider, place.path(), &Order { force: true, ..order(&[0]) }).unwrap();
    assert_eq!(wider.begun().len(), 2);
    assert!(place.path().join("notes.txt").exists());

    let result = place.path().join("results/one-seed-0.json");
    fs::write(&result, "{\"job\": \"one\"").unwrap();
    let error = make(&wider, place.path(), &order(&[0])).unwrap_err().to_string();
    assert!(error.contains("one-seed-0.json") && error.contains("remove it"), "{error}");
    let other = tempfile::tempdir().unwrap();
    fs::write(other.path().join("thesis.tex"), "").unwrap();
    let error = make(&wider, other.path(), &order(&[0])).unwrap_err();
    assert!(matches!(error, ReproduceError::Taken { .. }), "{error}");
}

/// A claim or a floor about a row that no job makes would never be judged.
#[test]
fn claims_and_floors_are_about_rows_that_are_made() {
    for study in studies() {
        let (name, claims) = (study.name(), study.claims());
        for scale in [Scale::Full, Scale::Tenth] {
            let jobs = study.plan(scale).jobs;
            for claim in &claims {
                assert!(!claim.comparisons.is_empty(), "{name}: {}", claim.text);
                for row in claim.rows() {
                    assert!(jobs.iter().any(|job| job.makes(row)), "{name}, {scale:?}: {row}");
                }
                assert!(claim.reasons().iter().all(|why| why.len() > 10), "{name}: {}", claim.text);
            }
        }
        let jobs = study.plan(Scale::Quick).jobs;
        for floor in study.floors() {
            assert!(floor.rows().len() > 1, "{name}: nothing has to miss {floor:?}");
            for row in floor.rows() {
                assert!(jobs.iter().any(|job| job.makes(row)), "{name}: {row}");
            }
        }
    }
}

/// One training, scored.
struct Training;

fn configuration() -> Configuration<Img2MeshConfig> {
    let set = [("level", "1"), ("synthetic-views", "8"), ("epochs", "3"), ("hold-out", "4")];
    let set = set.map(|(key, value)| (key.to_owned(), value.to_owned()));
    settings::read_text(Path::new("tiny"), Img2Mesh::PRESETS[0].1, &set).unwrap()
}

impl Study for Training {
    fn name(&self) -> &'static str {
        "training"
    }

    fn about(&self) -> &'static str {
        "one model"
    }

    fn plan(&self, _: Scale) -> Plan {
        Plan::of(["model"], settings::to_toml(&configuration()))
    }

    fn run(&self, work: &Work<'_>, watch: &mut Watch<'_>) -> Result<Vec<Row>, StudyError> {
        let config = configuration();
        let source = Source {
            path: work.data,
            options: &datasets::ReadOptions::default(),
            seed: work.seed,
            progress: &|_, _| (),
        };
        let data = Img2Mesh::open(&config.system, &source)?;
        let trained = work.train::<Img2Mesh>(&config, &data, watch)?;
        let metrics = trained.system.evaluate(&data, train::Subset::Test)?;
        let row = Row::new("Scores", "model").took(trained.seconds);
        Ok(vec![metrics.iter().fold(row, |row, metric| row.with(Cell::of(metric, 6)))])
    }
}

/// The step of a job's training that an event is about.
fn step(event: &Event) -> Option<u64> {
    match event {
        Event::Within { told, .. } => match &**told {
            Event::Step(step) => Some(step.step),
            _ => None,
        },
        _ => None,
    }
}

#[test]
fn a_training_that_was_stopped_goes_on_to_the_same_bits() {
    let [stopped, whole] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let run = |out: &Path, most: usize| {
        let mut steps = 0;
        let mut watch = Watch::default().until_event(|event| {
            steps += usize::from(step(event).is_some());
            steps >= most
        });
        let made = reproduce(&Training, out, &order(&[3]), &mut watch).unwrap();
        drop(watch);
        (made, steps)
    };
    let (first, steps) = run(stopped.path(), 2);
    assert!(first.ended == Ended::Cancelled && steps == 2);
    let (second, rest) = run(stopped.path(), usize::MAX);
    let (all, total) = run(whole.path(), usize::MAX);
    assert_eq!(steps + rest, total);
    let values = |made: &Reproduced| made.tables.0[0].rows[0].values.clone();
    assert_eq!(values(&second), values(&all));
    // Its course is kept beside its scores, and is that of a training in one part.
    let curves = |out: &Path| Results::read(&out.join("results.json")).unwrap().curves;
    let kept = curves(stopped.path());
    assert_eq!(kept, curves(whole.path()));
    assert!(kept[0].name == "loss" && kept[0].points.len() == total, "{kept:?}");
    let last =
        |out: &Path| fs::read(out.join("work/model-seed-3/checkpoints/last.safetensors")).unwrap();
    assert!(last(stopped.path()) == last(whole.path()));
}

/// A training that lost a file is not begun anew over what is left of it.
#[test]
fn a_training_that_cannot_go_on_is_left_alone() {
    let place = tempfile::tempdir().unwrap();
    let stop = &mut Watch::default().until_event(|event| step(event) == Some(3));
    let made = reproduce(&Training, place.path(), &order(&[3]), stop).unwrap();
    assert_eq!(made.ended, Ended::Cancelled);
    let named = |name: &str| {
        let mut pending = vec![place.path().to_owned()];
        while let Some(folder) = pending.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.ends_with(name) {
                    return path;
                }
                pending.extend(path.is_dir().then_some(path));
            }
        }
        panic!("{name} is nowhere")
    };
    let (log, last) = (named("metrics.jsonl"), named("last.safetensors"));
    let before = fs::read(&log).unwrap();
    fs::remove_file(last).unwrap();
    let on = &mut Watch::default();
    let error = reproduce(&Training, place.path(), &order(&[3]), on).unwrap_err().to_string();
    assert!(error.contains("last.safetensors"), "{error}");
    assert!(fs::read(&log).unwrap() == before);
}
