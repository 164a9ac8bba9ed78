#![allow(clippy::unwrap_used, reason = "tests")]

use super::*;
use crate::progress::Watch;
use crate::{
    Cell, Claim, Plan, Row, Scale, Score, Seeds, StudyError, Verdict, Work, remake, reproduce,
};

/// Two rows of ten objects each.
struct Toy {
    settings: &'static str,
}

const TOY: Toy = Toy { settings: "width = 3" };

impl Study for Toy {
    fn name(&self) -> &'static str {
        "toy"
    }

    fn about(&self) -> &'static str {
        "two rows"
    }

    fn plan(&self, _: Scale) -> Plan {
        Plan::of(["one", "two", "other"], self.settings)
    }

    fn run(&self, work: &Work<'_>, _: &mut Watch<'_>) -> Result<Vec<Row>, StudyError> {
        let of =
            |k: u64| if work.id == "two" { 1.0 } else { 2.0 } + 0.1 * ((k + work.seed) % 3) as f64;
        let objects = (0..10).map(|k| (format!("car/{k}"), of(k)));
        let mean = (0..10).map(of).sum::<f64>() / 10.0;
        let cell = Cell::smaller("error", mean, 3).over(objects);
        let pixels = vec![work.seed as u8; 4 * 4 * 3];
        let image = mesh_core::ByteImage { height: 4, width: 4, channels: 3, data: pixels };
        let pair =
            train::report::ViewPair { caption: "a".into(), model: image.clone(), truth: image };
        Ok(vec![Row::new("Errors", &work.id).with(cell).took(1.5).showing("views", &[pair])])
    }

    fn claims(&self) -> Vec<Claim> {
        let error = |row: &str| Score::new("Errors", row, "error");
        vec![Claim::new("two beats one", [error("two").below(error("one"))])]
    }
}

fn order(seeds: &[u64], only: &[&str]) -> Order<'static> {
    let only = only.iter().map(|&job| job.to_owned()).collect();
    Order { seeds: Seeds::Listed(seeds.to_vec()), only, ..Order::default() }
}

fn make(toy: &Toy, out: &Path, order: &Order<'_>) -> Reproduced {
    reproduce(toy, out, order, &mut Watch::default()).unwrap()
}

fn text(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).unwrap()
}

/// Each job and seed is in one share, whatever is there already, and the shares make the whole.
#[test]
fn shares_make_the_whole() {
    let place = tempfile::tempdir().unwrap();
    let at = |name: &str| place.path().join(name);
    let whole = make(&TOY, &at("whole"), &order(&[0, 1, 2], &[]));
    let mut kept = 0;
    for index in 1..=4 {
        let shard = train::Shard::new(index, 4).unwrap();
        let share = Order { shard, ..order(&[0, 1, 2], &[]) };
        let out = at(&index.to_string());
        let made = make(&TOY, &out, &share);
        assert_eq!((made.claims.len(), made.ended), (0, crate::progress::Ended::Completed));
        let results = || fs::read_dir(out.join("results")).unwrap().count();
        kept += results();
        // Again, as after a kill: what is there is kept, and nothing of another share is done.
        let before = results();
        make(&TOY, &out, &share);
        assert_eq!(results(), before);
    }
    assert_eq!(kept, 3 * 3);
    let folders: Vec<PathBuf> = (1..=4).map(|index: u64| at(&index.to_string())).collect();
    let merged = merge(&TOY, &folders, &at("merged"), &order(&[0, 1, 2], &[])).unwrap();
    assert_eq!((merged.claims, merged.tables, merged.left), (whole.claims, whole.tables, 0));
    let merged = merge(&TOY, &folders[1..], &at("three"), &order(&[0, 1, 2], &[])).unwrap();
    assert!(merged.left > 0 && merged.claims.is_empty());
}

/// What several processes made is what one would have made.
#[test]
fn parts_make_the_whole() {
    let place = tempfile::tempdir().unwrap();
    let at = |name: &str| place.path().join(name);
    make(&TOY, &at("a"), &order(&[0, 1], &["one", "other"]));
    make(&TOY, &at("b"), &order(&[0, 1], &["two"]));
    make(&TOY, &at("c"), &order(&[1, 2], &[]));
    let whole = make(&TOY, &at("whole"), &order(&[0, 1, 2], &[]));
    let folders = ["a", "b", "c"].map(at);
    let merged = merge(&TOY, &folders, &at("merged"), &order(&[0, 1, 2], &[])).unwrap();
    assert_eq!(
        (&merged.tables.0[0].rows[0].seeds[..], merged.claims[0].verdict),
        (&[0, 1, 2][..], Verdict::Holds)
    );
    assert_eq!(merged.claims, whole.claims);
    // Times differ from run to run; nothing else does.
    let without_times = |name: &str| {
        let text = text(&at(name), "results.json");
        let lines = text.lines().filter(|line| !line.contains("\"threads\""));
        lines.map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(without_times("merged"), without_times("whole"));
    assert!(at("merged/pictures/two-seed-2-0.png").exists());
    // Once more, into what is there.
    let again = merge(&TOY, &[at("b")], &at("merged"), &order(&[0, 1, 2], &[])).unwrap();
    assert_eq!(again.tables, merged.tables);
}

#[test]
fn parts_of_something_else_are_refused_by_name() {
    let place = tempfile::tempdir().unwrap();
    let at = |name: &str| place.path().join(name);
    let refused = |folders: &[&str], order: &Order<'_>| {
        let folders: Vec<PathBuf> = folders.iter().map(|name| at(name)).collect();
        let error = merge(&TOY, &folders, &at("out"), order).unwrap_err();
        assert!(!at("out").exists(), "{error}");
        error
    };
    make(&TOY, &at("a"), &order(&[0], &["one"]));
    make(&Toy { settings: "width = 4" }, &at("wider"), &order(&[0], &["two"]));
    let error = refused(&["a", "wider"], &order(&[0], &[])).to_string();
    for part in ["wider", "`width = 4`", "`width = 3`"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let tenth = Order { scale: Scale::Tenth, ..order(&[0], &["two"]) };
    make(&TOY, &at("tenth"), &tenth);
    let error = refused(&["a", "tenth"], &order(&[0], &[])).to_string();
    assert!(error.contains("tenth") && error.contains("`scale = full`"), "{error}");
    assert!(error.contains("repeat the options") && !error.contains("--force"), "{error}");
    let mut later = order(&[0], &["two"]);
    later.provenance.commit = "abc1234".into();
    make(&TOY, &at("later"), &later);
    let error = refused(&["a", "later"], &order(&[0], &[]));
    assert!(matches!(&error, ReproduceError::OtherBuild { field: "commit", .. }), "{error}");
    assert!(error.to_string().contains("two-seed-0.json"), "{error}");
    // The same job and seed, with another result.
    make(&TOY, &at("b"), &order(&[0], &["one", "two"]));
    let path = at("b").join("results/one-seed-0.json");
    let changed = fs::read_to_string(&path).unwrap().replace("2.1", "2.2");
    fs::write(&path, changed).unwrap();
    let error = refused(&["a", "b"], &order(&[0], &[]));
    assert!(matches!(&error, ReproduceError::Twice { .. }), "{error}");
    let error = refused(&["nothing"], &order(&[0], &[]));
    assert!(matches!(&error, ReproduceError::Taken { .. }), "{error}");
}

/// A folder whose results another build made is not gone on with.
#[test]
fn a_table_is_made_by_one_build() {
    let place = tempfile::tempdir().unwrap();
    make(&TOY, place.path(), &order(&[0], &["one"]));
    let mut later = order(&[0], &[]);
    later.provenance.commit = "abc1234".into();
    let go_on = |order: &Order<'_>| reproduce(&TOY, place.path(), order, &mut Watch::default());
    let error = go_on(&later).unwrap_err();
    assert!(matches!(&error, ReproduceError::OtherBuild { field: "commit", .. }), "{error}");
    go_on(&order(&[0], &[])).unwrap();
}

/// Tables, claims and page follow from the results alone.
#[test]
fn pages_are_remade_from_results_alone() {
    let place = tempfile::tempdir().unwrap();
    let at = |name: &str| place.path().join(name);
    let made = make(&TOY, &at("a"), &order(&[0, 1, 2], &[]));
    let again = remake(&TOY, &at("a"), &at("again")).unwrap();
    assert_eq!((&again.tables, &again.claims), (&made.tables, &made.claims));
    for name in ["table.md", "report.html"] {
        assert!(text(&at("again"), name) == text(&at("a"), name), "{name}");
    }
    // The file alone, as it is committed: the same but for the images.
    fs::copy(at("a/results.json"), at("toy.json")).unwrap();
    remake(&TOY, &at("toy.json"), &at("alone")).unwrap();
    assert!(text(&at("alone"), "table.md") == text(&at("a"), "table.md"));
    let page = text(&at("alone"), "report.html");
    assert!(!page.contains("data:image/png") && page.contains("class=\"strip\""));
    assert!(text(&at("a"), "report.html").contains("data:image/png"));
    // Of another study, or cut off.
    let damage = |from: &str, to: &str| {
        fs::write(at("toy.json"), text(&at("a"), "results.json").replace(from, to)).unwrap();
        remake(&TOY, &at("toy.json"), &at("alone")).unwrap_err().to_string()
    };
    assert!(damage("\"toy\"", "\"joy\"").contains("it is of joy, expected toy"));
    assert!(damage("\"car/9\"]", "\"car/8\",\"car/9\"]").contains("one for each of its 11"));
    assert!(damage("unsphere results 1", "unsphere results 9").contains("`format`"));
    assert!(damage("{", "").contains("expected a results.json"));
}

/// Three seeds where a claim rests on the row, or one; with others named, these.
#[test]
fn rows_that_a_claim_needs_have_three_seeds() {
    let place = tempfile::tempdir().unwrap();
    let seeds = |made: &Reproduced| {
        made.tables.0[0].rows.iter().map(|row| row.seeds.len()).collect::<Vec<_>>()
    };
    let made = make(&TOY, place.path(), &Order::default());
    assert_eq!((seeds(&made), made.claims.len()), (vec![3, 3, 1], 1));
    // Five of one job, after that; the others stay as they are.
    let made = make(&TOY, place.path(), &order(&[0, 1, 2, 3, 4], &["one"]));
    assert_eq!((seeds(&made), made.claims.len()), (vec![5, 3, 1], 1));
    let tenth = tempfile::tempdir().unwrap();
    let made = make(&TOY, tenth.path(), &Order { scale: Scale::Tenth, ..Order::default() });
    assert_eq!(seeds(&made), [2, 2, 2]);
    let error = reproduce(&TOY, tenth.path(), &order(&[0], &["three"]), &mut Watch::default());
    assert!(
        error
            .unwrap_err()
            .to_string()
            .contains("three: no such job, expected one of: one, two, other")
    );
}
