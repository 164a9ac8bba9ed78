//! Mesh files as people have them, from the command line.
#![allow(clippy::unwrap_used, reason = "tests")]

mod common;

use common::unsphere;

#[test]
fn what_a_mesh_does_not_hold_of_its_file_is_said_in_a_line() {
    let place = tempfile::tempdir().unwrap();
    let solid = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
    std::fs::write(place.path().join("desk.obj"), format!("{solid}f 1 2\nf 2 3\n")).unwrap();
    let run = unsphere(place.path(), ["check", "desk.obj"]).ok();
    let said = run.stderr();
    let expected = "desk.obj: 2 faces of fewer than three corners left out (the first in line 9)";
    assert_eq!(said.matches(expected).count(), 1, "{said}");
    let run = unsphere(place.path(), ["check", "desk.obj", "--quiet"]).ok();
    assert!(!run.stderr().contains("left out"));
}
