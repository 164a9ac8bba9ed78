//! What `reproduce` says before any work; the work itself takes a minute and is tested in recon.

use crate::common::unsphere;

#[test]
fn studies_are_listed_and_slips_are_named() {
    let place = tempfile::tempdir().unwrap();
    let listed = unsphere(place.path(), ["reproduce", "--list"]).ok().stdout();
    assert!(listed.contains("img2mesh") && listed.contains("CNN"), "{listed}");
    let names = unsphere(place.path(), ["reproduce", "--list", "--json"]).ok().json();
    assert_eq!(names[0]["name"], "img2mesh");
    let slip = unsphere(place.path(), ["reproduce", "img3mesh", "-o", "out"]);
    slip.fails(2, &["img3mesh", "expected one of: img2mesh"]);
    unsphere(place.path(), ["reproduce"]).fails(2, &["no study is named", "img2mesh", "--list"]);
    unsphere(place.path(), ["reproduce", "img2mesh", "--seeds", "0"]).fails(2, &["--seeds"]);
    assert!(!place.path().join("out").exists());
}

#[test]
fn folders_with_something_else_are_left_alone() {
    let place = tempfile::tempdir().unwrap();
    let out = place.path().join("out");
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("thesis.tex"), "mine").unwrap();
    let refused = unsphere(place.path(), ["reproduce", "img2mesh", "--quick", "-o", "out"]);
    refused.fails(1, &["out", "holds no results", "--force"]);
    std::fs::write(out.join("study.txt"), "study = img2mesh\nscale = full\n").unwrap();
    let refused = unsphere(place.path(), ["reproduce", "img2mesh", "--quick", "-o", "out"]);
    refused.fails(1, &["`scale = full`", "`scale = quick`", "--force"]);
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 2);
}

#[test]
fn what_it_takes_is_said_before_it_begins() {
    let place = tempfile::tempdir().unwrap();
    let one = unsphere(place.path(), ["reproduce", "--plan", "img2mesh"]).ok().stdout();
    assert!(
        one.contains("img2mesh cnn-2") && one.contains("3 seeds") && one.contains(" h"),
        "{one}"
    );
    let all = unsphere(place.path(), ["reproduce", "--plan"]).ok().stdout();
    for part in ["depth-table rcnn-rgb", "ode-table2 res-deep", "everything"] {
        assert!(all.contains(part), "{part}: {all}");
    }
    assert!(!all.contains("mcmr-cub"), "needs data: {all}");
    let tenth = unsphere(
        place.path(),
        ["reproduce", "--plan", "img2mesh", "ode-table2", "--scale", "tenth"],
    )
    .ok()
    .stdout();
    assert!(tenth.contains("2 seeds") && !tenth.contains("3 seeds"), "{tenth}");
    let only = unsphere(
        place.path(),
        ["reproduce", "--plan", "img2mesh", "--only", "cnn-2", "--seeds", "5"],
    )
    .ok()
    .stdout();
    assert!(only.contains("5 seeds") && !only.contains("cnn-3"), "{only}");
    assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 0);
}

#[test]
fn what_does_not_go_together_is_said() {
    let place = tempfile::tempdir().unwrap();
    unsphere(place.path(), ["reproduce", "img2mesh", "ode-table2"])
        .fails(2, &["only --plan takes several", "all"]);
    unsphere(place.path(), ["reproduce", "all", "--only", "cnn-2"]).fails(2, &["one study"]);
    unsphere(place.path(), ["reproduce", "img2mesh", "--quick", "--scale", "tenth"])
        .fails(2, &["--scale"]);
    unsphere(place.path(), ["reproduce", "img2mesh", "--scale", "half"])
        .fails(2, &["half", "tenth"]);
    let unknown = unsphere(place.path(), ["reproduce", "img2mesh", "--only", "cnn-9", "-o", "out"]);
    unknown.fails(1, &["cnn-9", "cnn-2"]);
    assert!(!place.path().join("out").exists());
    let missing = unsphere(place.path(), ["reproduce", "img2mesh", "--report", "none.json"]);
    missing.fails(1, &["none.json"]);
    std::fs::write(place.path().join("other.json"), "{\"format\": 3}").unwrap();
    let other = unsphere(place.path(), ["reproduce", "img2mesh", "--report", "other.json"]);
    other.fails(3, &["other.json", "`format`"]);
    let merge =
        unsphere(place.path(), ["reproduce", "img2mesh", "--merge", "nothing", "-o", "out"]);
    merge.fails(1, &["nothing", "holds no results"]);
}

/// A page is made anew beside its own results, and beside no others.
#[test]
fn a_page_stays_beside_its_results() {
    let place = tempfile::tempdir().unwrap();
    let results = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/results/img2mesh.json");
    let report = |from: &str| {
        unsphere(place.path(), ["reproduce", "img2mesh", "--report", from, "-o", "mine"])
    };
    report(results).ok();
    std::fs::copy(results, place.path().join("mine/results.json")).unwrap();
    report(results).fails(1, &["table.md", "--force"]);
    report("mine").ok();
    report("mine/results.json").ok();
}
