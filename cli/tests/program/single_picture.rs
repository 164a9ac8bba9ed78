//! What the systems promise that make a mesh from one image.

use crate::common::{clock_views, unsphere, unsphere_with};

/// A network that was trained with depth asks for it, takes it, and makes a coloured mesh; what is given wrong is named,
/// and nothing is written then.
#[test]
fn a_picture_and_its_depth_become_a_colored_mesh() {
    let place = tempfile::tempdir().unwrap();
    let run =
        |line: &str| unsphere_with(place.path(), &line.split_whitespace().collect::<Vec<_>>());
    run("train mesh-rcnn --preset tiny -o run -q --set max-steps=2 --set validation-every=none")
        .ok();
    // Systems that know categories are scored in each, and over all of them.
    let scored = run("eval mesh-rcnn -c run --json").ok().json();
    let (name, part) = scored["by_category"].as_object().unwrap().iter().next().unwrap();
    assert_eq!((name.as_str(), &part["objects"]), ("airplane", &1.into()));
    assert_eq!(part["metrics"]["f-0.3"], scored["mean_over_categories"]["f-0.3"]);
    let text = run("eval mesh-rcnn -c run").ok().stdout();
    assert!(text.contains("validation, 1 object\n"), "{text}");
    run("data generate -o car --families car --objects 1 --views 1 --size 48 --layout kaolin --depth true -q").ok();
    let picture = "car/car/0000/0_rgb.png";
    let predict = |out: &str, rest: &str| {
        run(&format!("predict mesh-rcnn {picture} -c run -o {out} --json -q {rest}"))
    };
    let lens = "--intrinsics 60,60,24,24";
    let found = predict("mesh", &format!("--depth car/car/0000/0_depth.exr {lens}")).ok().json();
    assert!(found["metrics"]["health"]["vertices"].as_u64().unwrap() > 7, "{found}");
    let written = std::fs::read_to_string(place.path().join("mesh/mesh.obj")).unwrap();
    let vertex = written.lines().find(|line| line.starts_with("v ")).unwrap();
    assert_eq!(vertex.split_whitespace().count(), 7, "a place and a colour: {vertex}");

    let page = std::fs::read_to_string(place.path().join("mesh/report.html")).unwrap();
    assert!(page.contains("0_rgb.png (one image)"), "a picture alone has no layout");

    predict("x", &format!("--depth {picture} {lens}")).fails(3, &["0_rgb.png", "in colour"]);
    std::fs::write(place.path().join("no.pfm"), "no depth").unwrap();
    predict("x", lens).fails(3, &["0_rgb.png", "--depth"]);
    predict("x", &format!("--depth no.pfm {lens}")).fails(3, &["no.pfm", "Pf"]);
    predict("x", "--depth no.pfm --intrinsics 60,60").fails(2, &["--intrinsics", "four"]);
    assert!(!place.path().join("x").exists());
}

/// A shape needs two outlines at least, but a trained system does not.
#[test]
fn a_fit_of_one_view_names_what_takes_one() {
    let place = tempfile::tempdir().unwrap();
    clock_views(place.path());
    std::fs::write(place.path().join("one.txt"), "3\n").unwrap();
    unsphere(place.path(), ["fit", "made/views", "--only", "one.txt", "-o", "x"]).fails(
        3,
        &[
            "made/views: found 1 view, ",
            "at least 2",
            "`unsphere predict img2mesh made/views -o mesh`",
        ],
    );
    std::fs::write(place.path().join("none.txt"), "33\n").unwrap();
    unsphere(place.path(), ["fit", "made/views", "--only", "none.txt", "-o", "x"])
        .fails(3, &["none called 33", "there are 0, 1, 2, 3,"]);
}
