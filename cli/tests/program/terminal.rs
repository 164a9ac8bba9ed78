//! What reaches a terminal, and what stands after `-o`.

use crate::common::{files_in, unsphere, unsphere_with};
use mesh_core::{primitives, write_mesh};

/// Nothing in a text that a terminal would obey.
#[track_caller]
fn harmless(text: &str) {
    assert!(!text.chars().any(|c| c.is_control() && c != '\n'), "{text:?}");
}

/// A name that clears the screen, sets the window's title, and claims to be another line.
#[cfg(unix)]
#[test]
fn names_cannot_steer_the_terminal() {
    let place = tempfile::tempdir().unwrap();
    let name = "a\u{1b}[2J\u{1b}]0;title\u{7}\u{9b}1m\rb\nerror: all is well.ply";
    let shown = "a\\u{1b}[2J\\u{1b}]0;title\\u{7}\\u{9b}1m\\rb";
    // In an error, of a file that is not there and of one that is no mesh.
    let gone = unsphere_with(place.path(), &["check", name]).fails(3, &[shown]);
    harmless(&gone.stderr());
    assert!(!gone.stderr().contains("\nerror:"), "{}", gone.stderr());
    std::fs::write(place.path().join(name), "no mesh").unwrap();
    harmless(&unsphere_with(place.path(), &["check", name]).fails(3, &[shown]).stderr());
    // In a result, as text and as JSON, which still says the name.
    write_mesh(place.path().join(name), &primitives::icosphere(1)).unwrap();
    let found = unsphere_with(place.path(), &["check", name]).ok();
    assert!(found.stdout().contains(shown), "{}", found.stdout());
    harmless(&found.stdout());
    let found = unsphere_with(place.path(), &["check", name, "--json"]).ok();
    harmless(&found.stdout());
    assert_eq!(found.json()["mesh"]["path"], name);
    // In what the parser of the command line says, where a pattern of the shell's brings many names.
    harmless(
        &unsphere_with(place.path(), &["check", name, name]).fails(2, &["\\u{9b}1m\\rb"]).stderr(),
    );
}

/// A string from within a file.
#[test]
fn texts_from_files_cannot_either_and_are_cut() {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("bad.toml");
    std::fs::write(&file, "\"\\u001b[2J\" = 1\n").unwrap();
    let run = unsphere(place.path(), ["demo", "-o", "out", "--config", "bad.toml"]);
    harmless(&run.fails(3, &["bad.toml"]).stderr());
    std::fs::write(&file, format!("\"{}\" = 1\n", "n".repeat(65_000))).unwrap();
    let run = unsphere(place.path(), ["demo", "-o", "out", "--config", "bad.toml"]);
    let text = run.fails(3, &["bad.toml", "characters are left out"]).stderr();
    assert!(text.len() < 8_000, "{} bytes", text.len());
    let long = "x".repeat(3_000);
    let run = unsphere_with(place.path(), &["check", &format!("{long}.ply")]);
    let text = run.fails(3, &["characters are left out"]).stderr();
    assert!(text.len() < 1_500, "{} bytes", text.len());
}

/// What is not written is refused before the work, whichever command it is, and leaves nothing.
#[test]
fn names_of_what_is_not_written_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let mesh = primitives::icosphere(1);
    write_mesh(place.path().join("m.ply"), &mesh).unwrap();
    let run = |line: &str| unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>());
    for name in ["a.stl", "a.mp4", "a.jpg", "a.3mf"] {
        run(&format!("render m.ply -o {name}")).fails(2, &[".gif", ".png", "folder"]);
    }
    for line in [
        "demo -o out.glb",
        "fit views -o out.glb",
        "train img2mesh -o out.glb",
        "predict img2mesh views -c run -o out.glb",
        "data generate -o out.glb",
        "data inspect views -o out.glb",
        "data convert views out.glb --layout photos",
        "data depth a.png --model m.onnx -o out.glb",
        "reproduce img2mesh -o out.glb",
    ] {
        run(line).fails(2, &["out.glb", "a folder is written", ".glb"]);
    }
    assert_eq!(files_in(place.path()).len(), 1);
    // What can only be meant as a folder is one.
    run("render m.ply -o v1.0 --frames 2 --size 16").ok();
    run("render m.ply -o b.x/ --frames 2 --size 16").ok();
    run("render m.ply -o b.x --frames 2 --size 16 --force").ok();
    assert_eq!(files_in(&place.path().join("b.x")).len(), 2);
    // The depth beside an image is not written over either.
    run("render m.ply -o one.png --depth --size 16").ok();
    std::fs::remove_file(place.path().join("one.png")).unwrap();
    run("render m.ply -o one.png --depth --size 16").fails(1, &["one.exr", "--force"]);
}

/// A figure of one protocol does not pass for one of another.
#[test]
fn figures_name_their_unit() {
    let place = tempfile::tempdir().unwrap();
    for (name, n) in [("a.ply", 1), ("b.ply", 2)] {
        write_mesh(place.path().join(name), &primitives::icosphere(n)).unwrap();
    }
    let text = unsphere(place.path(), ["metrics", "a.ply", "b.ply"]).ok().stdout();
    let lines: Vec<&str> = text.lines().filter(|line| line.starts_with("  Chamfer ")).collect();
    assert_eq!(lines.len(), 3, "{text}");
    assert!(lines.iter().all(|line| line.contains("distance; ")), "{text}");
    let lines: Vec<&str> = text.lines().filter(|line| line.starts_with("  3D IoU")).collect();
    assert!(lines.len() == 2 && lines[0].contains("as they lie"), "{text}");
    assert!(lines[1].contains("moved and scaled onto each other"), "{text}");
}

/// A terminal of so many columns: one line is drawn over, and it fits.
#[cfg(target_os = "linux")]
#[test]
fn progress_is_one_line_that_fits() {
    use std::process::Command;
    // `script` gives a terminal; where it is missing there is nothing to look at.
    if Command::new("script").arg("--version").output().is_err() {
        return;
    }
    for (columns, seconds) in [(40, 2), (110, 7)] {
        let place = tempfile::tempdir().unwrap();
        let train = "train img2mesh --preset tiny -o run --set level=1 --set synthetic-views=10 --set epochs=100000 \
                     --set validation-every=none";
        let line = format!(
            "stty rows 24 cols {columns}; timeout --foreground -s INT {seconds} {} {train}",
            env!("CARGO_BIN_EXE_unsphere")
        );
        let output = Command::new("script")
            .args(["-qec", &line, "typescript"])
            .current_dir(place.path())
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        // The terminal's own line: what is drawn over stays on it, and what stays is written after it was cleared.
        let mut lines = vec![String::new()];
        for piece in text.replace("\r\n", "\n").split_inclusive(['\n', '\r']) {
            let shown = piece.replace("\u{1b}[2K", "");
            let drawn = shown.trim_end_matches(['\r', '\n']);
            if drawn.starts_with("train [") {
                assert!(drawn.chars().count() <= columns, "{columns}: {drawn:?}");
            }
            let last = lines.last_mut().unwrap();
            if !drawn.is_empty() || piece.contains("\u{1b}[2K") {
                *last = drawn.to_owned();
            }
            if piece.ends_with('\n') {
                lines.push(String::new());
            }
        }
        assert!(text.contains("train ["), "{text:?}");
        assert!(text.contains(" left; loss ") || seconds < 7, "{columns}: {text:?}");
        assert!(!lines.iter().any(|line| line.contains("train [")), "{lines:#?}");
        assert!(text.contains("a step takes") || seconds < 7, "{text:?}");
        assert!(text.contains("input  views"), "{text:?}");
    }
}
