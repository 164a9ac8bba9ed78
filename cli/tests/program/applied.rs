//! What `eval` and `predict` promise of a trained system.

use std::path::Path;
use std::sync::OnceLock;

use crate::common::{self, Run, unsphere};
use serde_json::Value;
use synth::shapes::AlarmClock;
use synth::{Orbit, RenderOptions, render_views};

/// Views of a clock, `width` by `height`.
fn clock(count: usize, width: usize, height: usize) -> Vec<datasets::View> {
    let orbit = Orbit { count, width, height, ..Orbit::default() };
    let clock = AlarmClock::default().build();
    render_views(&clock, &orbit.cameras(), &RenderOptions::default(), &|_, _| ()).unwrap()
}

/// A folder with views and with a small training on them, made once for all tests.
fn place() -> &'static Path {
    static PLACE: OnceLock<tempfile::TempDir> = OnceLock::new();
    let place = PLACE.get_or_init(|| {
        let place = tempfile::tempdir().unwrap();
        datasets::write_kaolin(&clock(10, 40, 40), &place.path().join("views")).unwrap();
        let mut arguments = vec!["train", "img2mesh", "views", "-o", "run", "--preset", "tiny"];
        for set in ["level=1", "epochs=3", "hold-out=3"] {
            arguments.extend(["--set", set]);
        }
        common::unsphere_with(place.path(), &arguments).ok();
        place
    });
    place.path()
}

fn eval<const N: usize>(arguments: [&str; N]) -> Run {
    let mut all = vec!["eval", "img2mesh", "--json"];
    all.extend(arguments);
    run(&all)
}

fn predict<const N: usize>(out: &str, arguments: [&str; N]) -> Run {
    let mut all = vec!["predict", "img2mesh", "--json", "-o", out];
    all.extend(arguments);
    run(&all)
}

fn run(arguments: &[&str]) -> Run {
    common::unsphere_with(place(), arguments)
}

#[test]
fn eval_says_what_the_training_said() {
    let log = std::fs::read_to_string(place().join("run/metrics.jsonl")).unwrap();
    let lines = log.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let evaluations: Vec<Value> = lines.filter(|line| line["kind"] == "validation").collect();
    let (last, best) =
        (evaluations.last().unwrap(), evaluations.iter().rfind(|e| e["best"] == true));
    let found = eval(["--checkpoint", "run", "--last"]).ok().json();
    assert_eq!(found["metrics"], last["metrics"]);
    assert_eq!(found["data"], "views");
    let found = eval(["-c", "run"]).ok().json();
    assert_eq!(found["metrics"], best.unwrap()["metrics"]);
    // The file by itself does not know its data; then it is said.
    std::fs::copy(
        place().join("run/checkpoints/last.safetensors"),
        place().join("alone.safetensors"),
    )
    .unwrap();
    let found = eval(["-c", "alone.safetensors", "views"]).ok().json();
    assert_eq!(found["metrics"], last["metrics"]);
    let text = unsphere(place(), ["eval", "img2mesh", "-c", "run"]).ok().stdout();
    assert!(text.contains("mask-iou") && text.contains("best.safetensors, step"), "{text}");
}

/// Validation unless another part is asked for; tests are scored with a word about what they are for.
#[test]
fn eval_scores_the_part_that_is_asked_for() {
    let [validation, test, train] = ["validation", "test", "train"].map(|split| {
        let run = eval(["-c", "run", "--split", split]).ok();
        let said = run.stderr().contains("it is for the end");
        assert_eq!(said, split == "test", "{}", run.stderr());
        let found = run.json();
        assert_eq!(found["split"], split);
        assert_eq!(found["subsets"]["sizes"], serde_json::json!([7, 2, 1]));
        found["metrics"].clone()
    });
    assert_eq!(eval(["-c", "run"]).ok().json()["metrics"], validation);
    assert!(validation != test && test != train && train != validation);
    eval(["-c", "run", "--split", "held"]).fails(2, &["held", "validation"]);
    let text = unsphere(place(), ["eval", "img2mesh", "-c", "run"]).ok().stdout();
    for part in ["validation, 2 views", "7 views to train on, 2 for validation, 1 to test"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn eval_takes_settings_that_leave_the_model_as_it_is() {
    let one = eval(["-c", "run", "--set", "views=1"]).ok().json();
    let two = eval(["-c", "run"]).ok().json();
    assert_ne!(one["metrics"], two["metrics"]);
    let changed = "--set changes the model";
    eval(["-c", "run", "--set", "level=2"]).fails(2, &[changed, "mesh_fc.weight"]);
    eval(["-c", "run", "--set", "attention=mean"]).fails(2, &[changed, "layers.0."]);
    eval(["-c", "run", "--set", "heads=3"]).fails(2, &["`heads` is 3"]);
    eval(["-c", "run", "--set", "levle=3"]).fails(2, &["levle"]);
    eval(["-c", "nowhere"]).fails(3, &["nowhere", "unsphere train img2mesh"]);
    eval(["-c", "views"]).fails(3, &["views: a folder without one", "unsphere train img2mesh"]);
    std::fs::write(place().join("noise.safetensors"), b"noise").unwrap();
    eval(["-c", "noise.safetensors"]).fails(3, &["noise.safetensors"]);
    // Other data under the same path is noticed.
    let other = place().join("elsewhere");
    std::fs::create_dir_all(other.join("run/checkpoints")).unwrap();
    for name in ["provenance.json", "checkpoints/last.safetensors"] {
        std::fs::copy(place().join("run").join(name), other.join("run").join(name)).unwrap();
    }
    datasets::write_kaolin(&clock(10, 36, 36), &other.join("views")).unwrap();
    let found = unsphere(&other, ["eval", "img2mesh", "-c", "run", "--json"]).ok();
    assert!(found.stderr().contains("gives other data"), "{}", found.stderr());
}

#[test]
fn one_view_or_eight_make_a_mesh() {
    let given = |out: &str, arguments: [&str; 2]| {
        let [a, b] = arguments;
        predict(out, ["views", "-c", "run", a, b]).ok().json()["metrics"].clone()
    };
    let count = |scores: &Value| scores["views"].as_array().map(Vec::len);
    let one = given("one", ["--views", "3"]);
    assert_eq!((count(&one["given"]), count(&one["held_out"])), (Some(1), Some(9)));
    assert_eq!(one["given"]["views"][0]["name"], "3");
    let eight = given("eight", ["--first", "8"]);
    assert_eq!((count(&eight["given"]), count(&eight["held_out"])), (Some(8), Some(2)));
    assert_ne!(one["held_out"]["mask_iou"], eight["held_out"]["mask_iou"]);
    assert!(eight["held_out"]["mask_iou"].as_f64().unwrap() > 0.3, "{eight}");
    assert!(eight["milliseconds"].is_null(), "it is measured where that is asked for");
    let files =
        ["mesh.glb", "mesh.obj", "mesh.ply", "turntable.gif", "report.html", "metrics.json"];
    for name in files {
        assert!(std::fs::metadata(place().join("eight").join(name)).unwrap().len() > 50, "{name}");
    }
    let kept: Value =
        serde_json::from_slice(&std::fs::read(place().join("one/metrics.json")).unwrap()).unwrap();
    assert_eq!(kept, one);
    // All are given; others judge it where they are named.
    let all = predict("all", ["views", "-c", "run"]).ok().json()["metrics"].clone();
    assert_eq!((count(&all["given"]), &all["held_out"]), (Some(10), &Value::Null));
    predict("none", ["views", "-c", "run", "--score", "views"])
        .fails(3, &["views: the cameras of all its views are given"]);
    let arguments = ["views", "-c", "run", "--score", "views", "--last", "--first", "2"];
    let scored = predict("scored", arguments).ok();
    assert!(scored.stderr().contains("2 of 10 views have cameras that are given: left out"));
    // Those that judge already do not count twice.
    assert_eq!(count(&scored.json()["metrics"]["held_out"]), Some(8));
    assert!(scored.json()["seconds"].as_f64().unwrap() > 0.0);
    predict("all", ["views", "-c", "run"]).fails(1, &["all", "--force"]);
}

/// Two runs of one command leave the same bytes; what changes is there only for who asks.
#[cfg(unix)]
#[test]
fn a_prediction_is_the_same_each_time() {
    let made = |folder: &str, more: &[&str]| {
        let place = place().join(folder);
        std::fs::create_dir(&place).unwrap();
        for name in ["views", "run"] {
            std::os::unix::fs::symlink(place.parent().unwrap().join(name), place.join(name))
                .unwrap();
        }
        let line = ["predict", "img2mesh", "views", "-c", "run", "--first", "3", "-o", "out"];
        common::unsphere_with(&place, &[&line, more].concat()).ok();
        let files = common::files_in(&place.join("out")).into_iter();
        let read = |file: std::path::PathBuf| {
            (file.file_name().unwrap().to_owned(), std::fs::read(&file).unwrap())
        };
        files.map(read).collect::<std::collections::BTreeMap<_, _>>()
    };
    let (first, second) = (made("first", &[]), made("second", &[]));
    assert_eq!(first.keys().collect::<Vec<_>>(), second.keys().collect::<Vec<_>>());
    for (name, bytes) in &first {
        assert!(second[name] == *bytes, "{}", name.display());
    }
    let timed = made("timed", &["--time"]);
    let metrics: Value =
        serde_json::from_slice(&timed["metrics.json".as_ref() as &std::ffi::OsStr]).unwrap();
    assert!(metrics["milliseconds"].as_f64().unwrap() > 0.0);
    assert!(
        timed["mesh.ply".as_ref() as &std::ffi::OsStr]
            == first["mesh.ply".as_ref() as &std::ffi::OsStr]
    );
}

#[test]
fn pictures_may_be_of_any_size_and_shape() {
    // The same cameras through a wider and a taller window, and in more pixels.
    let judged = |name: &str, width: usize, height: usize| {
        let views = clock(10, width, height);
        datasets::write_transforms(&views, &place().join(name)).unwrap();
        let out = format!("{name}-mesh");
        let found = predict(&out, [name, "-c", "run", "--first", "3"]).ok().json();
        found["metrics"]["held_out"]["mask_iou"].as_f64().unwrap()
    };
    let same = judged("square", 40, 40);
    let large = judged("large", 120, 120);
    assert!((same - large).abs() < 0.05, "{same} {large}");
    let wide = judged("wide", 80, 48);
    assert!(wide > 0.3, "{wide}");
}

#[test]
fn a_missing_view_is_left_out() {
    let copy = |name: &str, gone: &[&str]| {
        common::copied(&place().join("views"), &place().join(name));
        for file in gone {
            std::fs::remove_file(place().join(name).join(file)).unwrap();
        }
    };
    copy("gap", &["3_rgb.png"]);
    let found = predict("gap-mesh", ["gap", "-c", "run", "--views", "1,3,5"]).ok();
    let warned = found.stderr();
    assert!(
        warned.contains("3_rgb.png is missing") && warned.contains("view 3 was asked for"),
        "{warned}"
    );
    let metrics = found.json()["metrics"].clone();
    assert_eq!(metrics["given"]["views"].as_array().unwrap().len(), 2);
    assert_eq!(metrics["warnings"].as_array().unwrap().len(), 2);
    let page = std::fs::read_to_string(place().join("gap-mesh/report.html")).unwrap();
    assert!(page.contains("3_rgb.png is missing"));
    // None is left.
    let refused = predict("no-mesh", ["gap", "-c", "run", "--views", "3"]);
    refused.fails(3, &["gap", "no view 3", "3_rgb.png is missing"]);
    // Nothing is missing: a slip.
    predict("no-mesh", ["views", "-c", "run", "--views", "1,33"])
        .fails(3, &["no view 33", "0, 1, 2"]);
    predict("no-mesh", ["none", "-c", "run"]).fails(3, &["none"]);
    assert!(!place().join("no-mesh").exists());
}

/// By the last part of a name, or by number, as the help has it; one that is named twice is said.
#[test]
fn views_are_named_by_base_or_number() {
    datasets::write_transforms(&clock(4, 40, 40), &place().join("transforms")).unwrap();
    let given = |out: &str, names: &str| {
        let run = predict(out, ["transforms", "-c", "run", "--refine", "0", "--views", names]).ok();
        let given = run.json()["metrics"]["given"]["views"].clone();
        let names = given.as_array().unwrap().iter().map(|view| view["name"].clone()).collect();
        (names, run.stderr())
    };
    let (base, _): (Vec<Value>, _) = given("by-base", "0003,0001");
    let (number, said) = given("by-number", "3,1,3");
    assert_eq!((base.len(), &base), (2, &number));
    assert!(said.contains("was asked for twice"), "{said}");
    predict("x", ["transforms", "-c", "run", "--views", "4"]).fails(3, &["no view 4", "0000"]);
}

/// One figure for each system: what a page says of its training the program says too.
#[test]
fn pages_and_program_agree_on_how_long_a_training_takes() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    for (system, page) in [("img2mesh", "img2mesh"), ("mcmr", "mcmr"), ("mesh-rcnn", "depth")] {
        let none = run(&["predict", system, "views", "--weights-dir", "views"]);
        let text = none.fails(2, &["minutes of one core"]).stderr();
        let before = text.split(" minutes of one core").next().unwrap();
        let figure = before.rsplit(' ').next().unwrap();
        let page = std::fs::read_to_string(docs.join(format!("{page}.md"))).unwrap();
        let figure = format!("{figure} minutes of one core");
        assert!(page.contains(&figure), "{system}: {figure}");
    }
}

/// A checkpoint and weights that were given away are described, and a damaged file is an error.
#[test]
fn weights_are_checked() {
    let of_run = run(&["check", "run", "--json"]).ok().json()["checkpoint"].clone();
    assert_eq!((&of_run["system"], &of_run["trained_on"]), (&"img2mesh".into(), &"views".into()));
    assert_eq!((&of_run["format"], &of_run["config"]["level"]), (&"2".into(), &1.into()));
    assert!(of_run["trainable"].as_u64().unwrap() > 1000 && of_run["best"].is_string());
    let last = "run/checkpoints/last.safetensors";
    let text = run(&["check", last]).ok().stdout();
    for part in [last, "img2mesh: ", "format 2", "level = 1", "unsphere train img2mesh views"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    run(&["export", "img2mesh", "-c", "run", "-o", "checked/w.safetensors"]).ok();
    let given = run(&["check", "checked/w.safetensors", "--json"]).ok().json();
    let given = &given["checkpoint"];
    assert_eq!(given["trained_on"], "views");
    assert!(given["scores"]["validation"]["mask-iou"].as_f64().unwrap() > 0.0, "{given}");
    let mut bytes = std::fs::read(place().join("checked/w.safetensors")).unwrap();
    let end = bytes.len() - 3;
    bytes[end] ^= 1;
    std::fs::write(place().join("checked/damaged.safetensors"), bytes).unwrap();
    run(&["check", "checked/damaged.safetensors"]).fails(3, &["checked/damaged.safetensors"]);
    run(&["check", "checked/none.safetensors"]).fails(3, &["checked/none.safetensors"]);
}

/// What was only scored is not what was trained on.
#[test]
fn a_card_says_what_was_trained_on_and_what_was_scored() {
    datasets::write_kaolin(&clock(8, 36, 36), &place().join("elsewhere-views")).unwrap();
    let card = |data: &[&str], out: &str| {
        let line = ["export", "img2mesh", "-c", "run", "-o", out];
        run(&[&line, data].concat()).ok();
        std::fs::read_to_string(place().join(out).with_extension("md")).unwrap()
    };
    let other = card(&["elsewhere-views"], "card/other.safetensors");
    assert!(other.contains("| trained on | views |"), "{other}");
    assert!(other.contains("| scored on | elsewhere-views |"), "{other}");
    // The same data by another name are the same.
    common::copied(&place().join("views"), &place().join("views-again"));
    let same = card(&["views-again"], "card/same.safetensors");
    assert!(same.contains("| trained on | views |") && !same.contains("| scored on"), "{same}");
}

#[test]
fn without_a_checkpoint_it_says_how_one_is_had() {
    let none = predict("x", ["views", "--weights-dir", "views"]);
    none.fails(2, &["--checkpoint", "unsphere train img2mesh VIEWS", "minutes"]);
    predict("x", ["views", "-c", "gone"]).fails(3, &["gone", "unsphere train img2mesh VIEWS"]);
    assert!(!place().join("x").exists());
}

/// Weights that are given away: small, scored as they are, with a card, and found without being named.
#[test]
fn weights_are_exported_found_and_predict() {
    let exported = run(&[
        "export",
        "img2mesh",
        "--json",
        "-c",
        "run",
        "-o",
        "given/img2mesh.safetensors",
        "--test",
    ]);
    let exported = exported.ok().json();
    let about = &exported["about"];
    assert_eq!((&about["system"], &about["data"]), (&"img2mesh".into(), &"views".into()));
    let file = place().join("given/img2mesh.safetensors");
    let whole = std::fs::metadata(place().join("run/checkpoints/best.safetensors")).unwrap().len();
    assert!(std::fs::metadata(&file).unwrap().len() < whole / 4);
    let card = std::fs::read_to_string(place().join("given/img2mesh.md")).unwrap();
    for part in ["# img2mesh", "scored once", "unsphere train img2mesh views", "mask-iou"] {
        assert!(card.contains(part), "{part}: {card}");
    }
    // The scores are those of the file.
    let found = eval(["-c", "given/img2mesh.safetensors", "views"]).ok().json();
    assert_eq!(about["scores"][0][0], "validation");
    assert_eq!(about["scores"][0][1], found["metrics"]);
    let again = ["export", "img2mesh", "-c", "run", "-o", "given/img2mesh.safetensors"];
    run(&again).fails(1, &["given/img2mesh.safetensors", "--force"]);
    run(&["export", "img2mesh", "-c", "run", "-o", "given"]).fails(2, &[".safetensors"]);

    let made =
        predict("by-given", ["views", "--weights-dir", "given", "--refine", "0"]).ok().json();
    assert!(made["metrics"]["checkpoint"].as_str().unwrap().ends_with("img2mesh.safetensors"));
    let missing = predict("by-none", ["views", "--weights-dir", "views"]);
    missing.fails(2, &["no img2mesh.safetensors in views", "unsphere train img2mesh"]);
    assert!(!place().join("by-none").exists());
}

/// Networks for other programs; that their numbers are right, `benches/tests/exported.rs` sees.
#[test]
fn networks_are_exported_and_described() {
    let arguments = ["export", "img2mesh", "--json", "-c", "run", "--onnx", "given/net.onnx"];
    let networks = run(&arguments).ok().json();
    let file = std::fs::read(place().join("given/net.onnx")).unwrap();
    assert_eq!(networks["bytes"].as_u64(), Some(file.len() as u64));
    // The first field is the version of the format.
    assert_eq!(file[..2], [8, 8]);
    let side = networks["inputs"]["image"][1].clone();
    assert_eq!(networks["inputs"]["image"], serde_json::json!([3, side, side]));
    assert_eq!(networks["outputs"]["positions"][1], 3);
    let weights = networks["numbers"].as_u64().unwrap() * 4;
    assert!(weights > 100_000 && weights < file.len() as u64, "{networks}");
    run(&arguments).fails(1, &["given/net.onnx", "--force"]);
    run(&["export", "img2mesh", "-c", "run", "--onnx", "given/net.bin"]).fails(2, &[".onnx"]);
    run(&["export", "img2mesh", "-c", "run"]).fails(2, &["--output"]);
    // What would be scored is not, without the weights.
    let scored = ["export", "img2mesh", "views", "-c", "run", "--onnx", "given/other.onnx"];
    run(&scored).fails(2, &["--output"]);
    assert!(!place().join("given/other.onnx").exists());
}
