#![allow(clippy::unwrap_used, reason = "tests")]

use datasets::{MaskSource, ReadOptions, View, Views};
use recon::fit::RefineConfig;
use synth::{Orbit, RenderOptions, render_views};
use train::output::OutputFolder;

use super::*;

fn views(names: &[&str], warnings: &[&str]) -> Views {
    let orbit = Orbit { count: names.len(), width: 12, height: 12, ..Orbit::default() };
    let ball = mesh_core::primitives::icosphere(1);
    let options = RenderOptions::default();
    let mut views = render_views(&ball, &orbit.cameras(), &options, &|_, _| ()).unwrap();
    views.iter_mut().zip(names).for_each(|(view, name)| view.name = (*name).to_owned());
    let warnings = warnings.iter().map(|&w| w.to_owned()).collect();
    Views { source: "scan".into(), warnings, ..Views::in_memory(views) }
}

fn names(views: &[View]) -> Vec<&str> {
    views.iter().map(|view| view.name.as_str()).collect()
}

#[test]
fn views_are_chosen_by_number_stem_or_name() {
    let asked = ["7", "a.png", "b", "07"].map(str::to_owned);
    let all = || views(&["00", "07", "a.png", "b.png"], &[]);
    let input = PredictInput::part(all(), Choice::Named(&asked)).unwrap();
    assert_eq!(names(&input.given), ["07", "a.png", "b.png"]);
    assert_eq!(names(&input.others), ["00"]);
    let first = PredictInput::part(all(), Choice::First(3)).unwrap();
    assert_eq!((first.given.len(), names(&first.others)), (3, vec!["b.png"]));
    let many = PredictInput::part(all(), Choice::First(9)).unwrap();
    assert_eq!((many.given.len(), many.others.len()), (4, 0));
    assert!(PredictInput::part(all(), Choice::First(0)).is_err());
}

#[test]
fn a_slip_is_an_error_and_a_missing_file_a_warning() {
    let asked = ["0", "3"].map(str::to_owned);
    let whole = views(&["0", "1"], &[]);
    let error = PredictInput::part(whole, Choice::Named(&asked)).unwrap_err().to_string();
    assert_eq!(error, "scan: no view 3, expected some of 0, 1");
    let reason = "view 3 is left out: 3_rgb.png is missing";
    let some = views(&["0", "1"], &[reason]);
    let input = PredictInput::part(some, Choice::Named(&asked)).unwrap();
    assert_eq!(names(&input.given), ["0"]);
    assert_eq!(input.warnings.len(), 2);
    assert!(input.warnings[1].contains("view 3 "), "{:?}", input.warnings);
    let none = views(&["1"], &[reason]);
    let error = PredictInput::part(none, Choice::Named(&asked[1..])).unwrap_err().to_string();
    assert!(error.contains("no view 3") && error.contains("3_rgb.png is missing"), "{error}");
}

#[test]
fn a_view_with_an_empty_mask_is_not_given() {
    let mut all = views(&["0", "1", "2"], &[]);
    all.views[1].mask.data.fill(0);
    let input = PredictInput::part(all.clone(), Choice::First(2)).unwrap();
    assert_eq!((names(&input.given), names(&input.others)), (vec!["0"], vec!["2"]));
    assert_eq!(input.warnings, ["of 1 the mask is empty: left out"]);
    let error = PredictInput::part(all, Choice::Named(&["1".to_owned()])).unwrap_err().to_string();
    assert_eq!(error, "scan: the masks of the given views are empty: 1");
}

/// A dark ball before a bright wall, as a file.
fn photograph(folder: &tempfile::TempDir) -> std::path::PathBuf {
    let ball = mesh_core::primitives::icosphere(2).colored([0.1; 3]);
    let orbit = Orbit { count: 1, width: 32, height: 32, ..Orbit::default() };
    let options = RenderOptions { background: [0.9; 3], ..RenderOptions::default() };
    let view = render_views(&ball, &orbit.cameras(), &options, &|_, _| ()).unwrap().remove(0);
    let path = folder.path().join("ball.png");
    mesh_core::write_png(&path, &view.color).unwrap();
    path
}

#[test]
fn a_photograph_has_the_mask_that_is_asked_for_and_no_use_for_the_options_of_many() {
    let folder = tempfile::tempdir().unwrap();
    let path = photograph(&folder);
    let plain = PredictInput::single(&Request::new(&path)).unwrap();
    let area = plain.given[0].mask_pixels();
    assert!(plain.warnings[1].contains("nothing says what the object is"), "{:?}", plain.warnings);
    let options = ReadOptions { dilate: 1, ..ReadOptions::default() };
    let wide = PredictInput::single(&Request { options, ..Request::new(&path) }).unwrap();
    assert!(wide.given[0].mask_pixels() > area);
    let options = ReadOptions { mask: MaskSource::Alpha, ..ReadOptions::default() };
    let error = PredictInput::single(&Request { options, ..Request::new(&path) }).unwrap_err();
    assert!(error.to_string().contains("field `mask`"), "{error}");
    for (choice, options, option) in [
        (Choice::First(3), ReadOptions::default(), "--first"),
        (
            Choice::All,
            ReadOptions { focal_scale: Some(2.0), ..ReadOptions::default() },
            "--focal-scale",
        ),
        (
            Choice::All,
            ReadOptions { object: Some("a".to_owned()), ..ReadOptions::default() },
            "--object",
        ),
    ] {
        let error =
            PredictInput::single(&Request { options, choice, ..Request::new(&path) }).unwrap_err();
        assert!(error.to_string().contains(option), "{error}");
    }
    // Not even one that is not there is passed over.
    let score = Some(std::path::Path::new("nowhere"));
    let error = PredictInput::single(&Request { score, ..Request::new(&path) }).unwrap_err();
    assert!(error.to_string().contains("--score is of no use to a single image"), "{error}");
    let own = ["ball".to_owned()];
    assert!(
        PredictInput::single(&Request { choice: Choice::Named(&own), ..Request::new(&path) })
            .is_ok()
    );
}

/// A ball too large and too dark, from two views of a small red one.
#[test]
fn a_prediction_is_refined_by_the_given_views_alone() {
    let orbit = Orbit { count: 4, width: 48, height: 48, ..Orbit::default() };
    let ball = mesh_core::primitives::icosphere(3).colored([0.8, 0.2, 0.1]);
    let options = RenderOptions::default();
    let all = render_views(&ball, &orbit.cameras(), &options, &|_, _| ()).unwrap();
    let input = PredictInput::part(Views::in_memory(all), Choice::First(2)).unwrap();
    let guess = ball.clone().scaled([1.2; 3]).colored([0.3; 3]);
    let steps = |steps| RefineConfig { steps, ..RefineConfig::default() };
    let prediction = || Prediction { mesh: guess.clone(), ..Prediction::default() };
    assert_eq!(refined(prediction(), &input, &steps(0)).unwrap(), prediction());
    let found = refined(prediction(), &input, &steps(50)).unwrap();
    assert_eq!(found.before.as_ref(), Some(&guess));
    assert!(found.mesh.health().is_watertight());
    // From 1.73 times the volume: two outlines are two circles on it, and what lies between follows them.
    let volume = found.mesh.volume() / ball.volume();
    assert!(volume > 0.9 && volume < 1.3, "{volume}");
    let color = |mesh: &mesh_core::TriMesh| {
        let colors = mesh.colors.as_ref().unwrap();
        [0, 1, 2].map(|k| colors.iter().map(|c| c[k]).sum::<f32>() / colors.len() as f32)
    };
    let [red, green, _] = color(&found.mesh);
    assert!((red - 0.8).abs() < 0.1 && (green - 0.2).abs() < 0.1, "{red} {green}");
    // What was not given is not looked at.
    let others = PredictInput { others: Vec::new(), ..input };
    assert_eq!(refined(prediction(), &others, &steps(50)).unwrap(), found);
}

/// What is known stands in the figures and on the page; what is not is in neither.
#[test]
fn how_familiar_an_input_is_is_delivered() {
    let input = PredictInput::part(views(&["00", "01"], &[]), Choice::First(1)).unwrap();
    let mesh = mesh_core::primitives::icosphere(1);
    let prediction = Prediction { mesh, ..Prediction::default() };
    let place = tempfile::tempdir().unwrap();
    let delivered = |name: &str, familiarity: Option<Judgement>| {
        let folder = OutputFolder::create(&place.path().join(name), false).unwrap();
        let delivery = Delivery { familiarity, ..Delivery::new("ball", &input, &prediction) };
        let metrics = deliver(&delivery, &folder).unwrap();
        assert_eq!(metrics.familiarity, familiarity);
        let folder = folder.commit().unwrap();
        let text = |file: &str| std::fs::read_to_string(folder.join(file)).unwrap();
        (text("metrics.json"), text("report.html"), metrics.warnings.join("; "))
    };
    let (json, page, warnings) = delivered("unknown", None);
    assert!(!json.contains("familiarity") && !page.contains("does it know"), "{warnings}");
    let strange = Judgement { distance: 12.5, quantile: 1.0, of: 20 };
    let (json, page, warnings) = delivered("strange", Some(strange));
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["familiarity"]["quantile"], 1.0);
    assert_eq!(
        (&json["familiarity"]["distance"], &json["familiarity"]["of"]),
        (&12.5.into(), &20.into())
    );
    assert!(page.contains("does it know this?") && page.contains("unlike what it was trained on"));
    assert!(warnings.contains("do not trust the sides"), "{warnings}");
    let usual = Judgement { distance: -3.0, quantile: 0.5, of: 20 };
    let (_, page, warnings) = delivered("usual", Some(usual));
    assert!(page.contains("farther from it (-3.0) than 50 %") && warnings.is_empty(), "{warnings}");
}
