//! What `reproduce` says before any work; the work itself takes a minute and is tested in recon.
#![allow(clippy::unwrap_used, reason = "tests")]

mod common;

use common::unsphere;

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
