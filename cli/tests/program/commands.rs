//! What each command promises.

use crate::common::{TINY, clock_views, copied, files_in, unsphere, unsphere_with};

#[test]
fn the_demo_writes_what_it_promises() {
    let place = tempfile::tempdir().unwrap();
    let views = clock_views(place.path());
    let made = place.path().join("made");
    for name in [
        "mesh.glb",
        "mesh.obj",
        "mesh.ply",
        "turntable.gif",
        "report.html",
        "metrics.json",
        "config.toml",
    ] {
        assert!(std::fs::metadata(made.join(name)).unwrap().len() > 100, "{name}");
    }
    assert_eq!(files_in(&views).len(), 10 * 4 + 1);
    let check = unsphere(place.path(), ["check", "made/mesh.ply", "--json"]).ok().json();
    assert_eq!(check["mesh"]["watertight"], true);
    assert_eq!(check["mesh"]["health"]["euler"], 2);
    let metrics: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(made.join("metrics.json")).unwrap()).unwrap();
    assert!(metrics["views"]["mask_iou"].as_f64().unwrap() > 0.6);

    // An existing folder is left as it is without --force, and its other files with it.
    let before = std::fs::read(made.join("mesh.ply")).unwrap();
    let [a, b, c, d] = TINY;
    unsphere(place.path(), ["demo", "-o", "made", a, b, c, d]).fails(1, &["made", "--force"]);
    assert_eq!(std::fs::read(made.join("mesh.ply")).unwrap(), before);
    std::fs::write(made.join("notes.txt"), "mine").unwrap();
    let size = ["--views", "10", "--size", "48"];
    let [v, w, x, y] = size;
    unsphere(place.path(), ["demo", "-o", "made", "--force", v, w, x, y, a, b, c, d]).ok();
    assert_eq!(std::fs::read(made.join("mesh.ply")).unwrap(), before);
    assert_eq!(std::fs::read_to_string(made.join("notes.txt")).unwrap(), "mine");
}

#[test]
fn threads_change_no_byte() {
    let place = tempfile::tempdir().unwrap();
    clock_views(place.path());
    let fit = |threads: &str| {
        let out = format!("out{threads}");
        let [a, b, c, d] = TINY;
        let run = unsphere(
            place.path(),
            ["fit", "made/views", "-o", &out, "--threads", threads, "--json", a, b, c, d],
        )
        .ok();
        assert!(run.json()["metrics"]["views"]["mask_iou"].as_f64().unwrap() > 0.6);
        ["mesh.ply", "metrics.json", "mesh.glb", "turntable.gif", "config.toml"]
            .map(|name| std::fs::read(place.path().join(&out).join(name)).unwrap())
    };
    let one = fit("1");
    assert!(one == fit("2") && one == fit("3"));
}

#[test]
fn a_mesh_is_like_itself_under_every_protocol() {
    let place = tempfile::tempdir().unwrap();
    clock_views(place.path());
    let mesh = "made/mesh.ply";
    let result = unsphere(place.path(), ["metrics", mesh, mesh, "--json"]).ok().json();
    let reports = result["reports"].as_array().unwrap();
    assert_eq!(reports.len(), 4);
    for report in reports {
        assert!(report["protocol"]["formula"].as_str().unwrap().len() > 10);
        for (field, value) in [("chamfer", 0.0), ("accuracy", 0.0), ("iou", 1.0)] {
            if !report[field].is_null() {
                assert_eq!(report[field].as_f64().unwrap(), value, "{field}");
            }
        }
        for score in report["f_scores"].as_array().unwrap() {
            assert_eq!(score["f_score"].as_f64().unwrap(), 1.0);
        }
    }
    let text = unsphere(place.path(), ["metrics", mesh, mesh, "--preset", "occnet"]).ok().stdout();
    assert!(text.contains("occnet") && !text.contains("p2m"));
    unsphere(place.path(), ["metrics", mesh, mesh, "--preset", "x"]).fails(2, &["x", "occnet"]);
}

#[test]
fn pictures_are_rendered_in_every_form() {
    let place = tempfile::tempdir().unwrap();
    clock_views(place.path());
    let run = |arguments| unsphere::<8>(place.path(), arguments);
    let mesh = "made/mesh.glb";
    run(["render", mesh, "-o", "turn.gif", "--frames", "4", "--size", "32"]).ok();
    run(["render", mesh, "-o", "turn.gif", "--frames", "4", "--size", "32"])
        .fails(1, &["turn.gif", "--force"]);
    run(["render", mesh, "-o", "one.png", "--view", "2", "--size", "32"]).ok();
    run(["render", mesh, "-o", "one.jpg", "--view", "2", "--size", "32"]).fails(2, &[".png"]);
    run(["render", mesh, "-o", "two.png", "--view", "99", "--size", "32"]).fails(2, &["99", "47"]);
    run(["render", mesh, "-o", "two.png", "--view", "1", "--view", "2"]).fails(2, &["folder"]);
    run(["render", mesh, "-o", "all", "--cameras", "made/views", "--size", "32"])
        .fails(2, &["--cameras", "--size"]);
    run(["render", mesh, "-o", "all", "--cameras", "made/views", "--depth", "-q"]).ok();
    assert_eq!(files_in(&place.path().join("all")).len(), 20);
    let gif = std::fs::read(place.path().join("turn.gif")).unwrap();
    assert_eq!(&gif[..6], b"GIF89a");
    let picture = mesh_core::read_image(place.path().join("all/7.png")).unwrap();
    assert_eq!((picture.width, picture.height), (48, 48));
}

#[test]
fn no_picture_takes_the_place_of_another() {
    let place = tempfile::tempdir().unwrap();
    mesh_core::write_mesh(place.path().join("a.ply"), &mesh_core::primitives::icosphere(1))
        .unwrap();
    let twice = ["render", "a.ply", "-o", "two", "--view", "3", "--view", "3"];
    unsphere(place.path(), twice).fails(3, &["views 3 and 3", "3.png"]);
    assert!(!place.path().join("two").exists());
    let huge = ["render", "a.ply", "-o", "t.gif", "--size", "8192", "--frames", "30"];
    unsphere(place.path(), huge).fails(2, &["6.0 GB", "--frames", "--size"]);
}

#[test]
fn what_cannot_be_written_is_said_before_the_work() {
    let place = tempfile::tempdir().unwrap();
    std::fs::write(place.path().join("file"), "in the way").unwrap();
    unsphere(place.path(), ["demo", "-o", "file/out"]).fails(1, &["file/out"]);
    unsphere(place.path(), ["demo", "-o", "file", "--force"]).fails(1, &["file", "folder"]);
    assert_eq!(std::fs::read_to_string(place.path().join("file")).unwrap(), "in the way");
    assert_eq!(files_in(place.path()).len(), 1);
}

#[test]
fn views_with_gaps_are_read_when_allowed() {
    let place = tempfile::tempdir().unwrap();
    let views = copied(&clock_views(place.path()), &place.path().join("gaps"));
    std::fs::remove_file(views.join("3_rgb.png")).unwrap();
    let run = unsphere(place.path(), ["check", "--views", "gaps", "--allow-missing", "--json"]);
    let result = run.ok().json();
    assert_eq!(result["views"]["views"], 9);
    assert!(result["views"]["warnings"][0].as_str().unwrap().contains("view 3"));
}

#[test]
fn settings_and_completions_are_printed() {
    let place = tempfile::tempdir().unwrap();
    let run = unsphere(place.path(), ["check", "--config", "-", "--set", "level=4"]).ok();
    assert!(run.stdout().contains("level = 4") && run.stdout().contains("hold-out = 5"));
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = unsphere(place.path(), ["completions", shell]).ok().stdout();
        assert!(script.contains("unsphere") && script.contains("metrics"));
    }
    unsphere(place.path(), ["nonsense"]).fails(2, &["nonsense"]);
}

#[test]
fn the_manual_has_a_page_for_each_command() {
    let place = tempfile::tempdir().unwrap();
    let run = unsphere(place.path(), ["man", "-o", "pages", "--json"]).ok().json();
    let names: Vec<_> = std::fs::read_dir(place.path().join("pages"))
        .unwrap()
        .map(|file| file.unwrap().file_name().into_string().unwrap())
        .collect();
    assert_eq!(run["pages"], names.len());
    for page in ["unsphere.1", "unsphere-fit.1", "unsphere-data-generate.1"] {
        assert!(names.iter().any(|name| name == page), "{page} among {names:?}");
    }
    let page = std::fs::read_to_string(place.path().join("pages/unsphere-fit.1")).unwrap();
    assert!(page.starts_with(".ie") && page.contains(".TH") && page.contains("max\\-memory"));
    // Who made it, and options with what they take.
    let title = page.lines().find(|line| line.starts_with(".TH")).unwrap();
    assert!(title.contains(concat!("unsphere ", env!("CARGO_PKG_VERSION"))), "{title}");
    assert!(page.contains("[\\-o|\\-\\-output FOLDER]"), "{page}");
    unsphere(place.path(), ["man", "-o", "pages"]).fails(1, &["pages", "--force"]);
    // An empty folder has nothing to lose.
    std::fs::create_dir(place.path().join("empty")).unwrap();
    unsphere(place.path(), ["man", "-o", "empty"]).ok();
    assert!(place.path().join("empty/unsphere.1").is_file());
}

/// A number below 0 is told what is allowed, and not that it is no option.
#[test]
fn numbers_below_0_are_told_their_range() {
    let place = tempfile::tempdir().unwrap();
    let run = |line: &str| unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>());
    for (line, range) in [
        ("convert a.ply -o b.ply --scale -1", "a number above 0"),
        ("convert a.ply -o b.ply --height -5mm", "a length with its unit"),
        ("convert a.ply -o b.ply --faces -5", "4..=4294967295"),
        ("check a.ply --threads -1", "0..=1024"),
        ("fit views --max-size -8", "8..=4294967295"),
        ("fit views --max-memory -2GB", "100MB to"),
        ("fit views --focal-scale -1", "a number above 0"),
        ("predict img2mesh views --first -1", "1..=4294967295"),
    ] {
        let said = run(line).fails(2, &[range]).stderr();
        assert!(!said.contains("tip:"), "{line}: {said}");
    }
}

#[test]
fn an_open_mesh_fails_the_check() {
    let place = tempfile::tempdir().unwrap();
    std::fs::write(place.path().join("open.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let run = unsphere(place.path(), ["check", "open.obj", "--json"]);
    assert_eq!(run.json()["mesh"]["watertight"], false);
    assert!(run.stderr().contains("open.obj") && run.stderr().contains("holes"));
}

/// Ctrl-C ends a fit early, with what there is written and the exit code saying so.
#[cfg(unix)]
#[test]
fn ctrl_c_keeps_what_there_is() {
    an_interrupt_keeps_what_there_is("-INT");
}

/// So does the signal by which schedulers and containers end a program.
#[cfg(unix)]
#[test]
fn a_termination_keeps_what_there_is() {
    an_interrupt_keeps_what_there_is("-TERM");
}

#[cfg(unix)]
fn an_interrupt_keeps_what_there_is(signal: &str) {
    use std::process::{Command, Stdio};
    let place = tempfile::tempdir().unwrap();
    clock_views(place.path());
    let mut child = Command::new(env!("CARGO_BIN_EXE_unsphere"))
        .args(["fit", "made/views", "-o", "long", "--set", "steps=100000", "--set", "tolerance=0"])
        .args(["--set", "level=3"])
        .current_dir(place.path())
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    // The remark on stderr says that the fit has begun.
    let mut line = String::new();
    let mut stderr = std::io::BufReader::new(child.stderr.take().unwrap());
    std::io::BufRead::read_line(&mut stderr, &mut line).unwrap();
    assert!(line.contains("fitting"), "{line}");
    let killed = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let json = std::fs::read_to_string(place.path().join("long/metrics.json")).unwrap();
    let metrics: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(metrics["interrupted"], true);
    // It is answered at once, and whatever the mesh agrees with, it is not said to be good.
    let mut rest = String::new();
    std::io::Read::read_to_string(&mut stderr, &mut rest).unwrap();
    assert!(rest.contains("stopping: colours and writes what there is"), "{rest}");
    let verdict = &metrics["verdict"];
    assert_ne!(verdict["grade"], "good");
    assert!(verdict["reasons"].to_string().contains("the fit was interrupted after"), "{verdict}");
}

#[test]
fn a_truth_in_another_frame_is_found_out() {
    let place = tempfile::tempdir().unwrap();
    clock_views(place.path());
    let run = |line: &str| unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>());
    run("convert made/views/mesh.ply -o big.ply --scale 100").ok();
    let [a, b, c, d] = TINY;
    let fit = |truth: &str, out: &str| {
        run(&format!("fit made/views -o {out} --truth {truth} {a} {b} {c} {d}"))
    };
    // The mesh still is what is wanted; the figures are explained, and the truth that was meant is named.
    let said = fit("big.ply", "one").ok().stderr();
    let path = std::path::Path::new("made/views").join("mesh.ply");
    for words in [
        "big.ply: the truth lies in another frame",
        "times as large as the mesh",
        &format!("--truth {}", path.display()),
    ] {
        assert!(said.contains(words), "{words:?} is not in {said}");
    }
    let page = std::fs::read_to_string(place.path().join("one/report.html")).unwrap();
    assert!(page.contains("the truth lies in another frame"));
    let said = fit("made/views/mesh.ply", "two").ok().stderr();
    assert!(!said.contains("another frame"), "{said}");
    let compared = run("metrics made/mesh.ply big.ply --preset occnet --json").ok();
    assert!(compared.stderr().contains("the truth lies in another frame"));
    assert!(compared.json()["warning"].as_str().unwrap().contains("times as large"));
    let same = run("metrics made/mesh.ply made/views/mesh.ply --preset occnet --json").ok();
    assert!(same.json().get("warning").is_none() && !same.stderr().contains("frame"));

    // A truth without volume stops the figures of volumes alone; one that is none is refused before the work.
    std::fs::write(place.path().join("flat.obj"), "v -1 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let text = fit("flat.obj", "three").ok().stdout();
    assert!(text.contains("F-score") && text.contains("none: a mesh that is flat"), "{text}");
    let text = run("metrics flat.obj made/mesh.ply --preset mcmr").ok().stdout();
    assert!(text.contains("none: a mesh that is flat"), "{text}");
    std::fs::write(place.path().join("points.obj"), "v 0 0 0\nv 1 0 0\n").unwrap();
    fit("points.obj", "four").fails(3, &["points.obj", "no surface"]);
    assert!(!place.path().join("four").exists());
}

#[test]
fn a_verdict_is_said_and_with_strict_it_counts() {
    let place = tempfile::tempdir().unwrap();
    clock_views(place.path());
    let run = |line: &str| unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>());
    // Forty-two vertices are no clock.
    let coarse = "--set start-level=1 --set level=1 --set steps=2";
    let said = run(&format!("fit made/views -o out --strict {coarse}"));
    assert_eq!(said.code(), Some(1), "{}", said.stderr());
    let metrics = std::fs::read_to_string(place.path().join("out/metrics.json")).unwrap();
    let metrics: serde_json::Value = serde_json::from_str(&metrics).unwrap();
    let verdict = &metrics["verdict"];
    let grade = verdict["grade"].as_str().unwrap();
    assert!(said.stderr().contains(&format!("the fit is {grade}")), "{}", said.stderr());
    assert!(
        said.stdout().contains(grade) && said.stdout().contains("verdict"),
        "{}",
        said.stdout()
    );
    let reason = verdict["reasons"][0].as_str().unwrap();
    assert!(reason.contains("mask IoU"), "{verdict}");
    let page = std::fs::read_to_string(place.path().join("out/report.html")).unwrap();
    assert!(page.contains(reason) && page.contains("missing (orange)"));
    assert!(place.path().join("out/mesh.glb").is_file());
}

#[test]
fn all_agree_about_faces_that_run_through_each_other() {
    let place = tempfile::tempdir().unwrap();
    clock_views(place.path());
    let run = |line: &str| unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>());
    let [a, b, c, d] = TINY;
    let text = run(&format!("fit made/views -o out {a} {b} {c} {d}")).ok().stdout();
    let metrics = std::fs::read_to_string(place.path().join("out/metrics.json")).unwrap();
    let metrics: serde_json::Value = serde_json::from_str(&metrics).unwrap();
    let checked = run("check out/mesh.ply --json");
    assert_eq!(checked.json()["mesh"]["self_intersections"], metrics["self_intersections"]);
    assert!(text.contains("a closed solid"), "{text}");
    assert!(run("check out/mesh.ply").ok().stdout().contains("a closed solid"));

    // Closed, and no solid: two balls that overlap.
    let mut two = mesh_core::primitives::icosphere(2);
    two.append(&two.clone().translated([0.9, 0.1, 0.2])).unwrap();
    let count = two.self_intersections().len();
    mesh_core::write_mesh(place.path().join("two.ply"), &two).unwrap();
    let found = run("check two.ply");
    assert_eq!(found.code(), Some(1));
    let (said, words) = (found.stdout(), format!("{count} pairs of faces run through each other"));
    assert!(said.contains(&words) && !said.contains("a closed solid"), "{said}");
    assert!(found.stderr().contains(&words));
}

#[test]
fn qualities_are_configurations_and_the_higher_is_suggested_where_it_shows_more() {
    let place = tempfile::tempdir().unwrap();
    clock_views(place.path());
    let run = |line: &str| unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>());
    let settings = |quality: &str| {
        run(&format!("check --quality {quality} --json")).ok().json()["config"].clone()
    };
    assert_eq!((&settings("draft")["level"], &settings("normal")["level"]), (&4.into(), &5.into()));
    let high = settings("high");
    assert_eq!((&high["level"], &high["color"]), (&6.into(), &"texture".into()));
    run("check --quality best").fails(2, &["draft", "normal", "high"]);
    run("check --quality high --config x.toml").fails(2, &["--config"]);
    run("check --system img2mesh --quality high").fails(2, &["--preset"]);

    let rest = "--set start-level=1 --set steps=8";
    let said = run(&format!("fit made/views -o coarse --set level=1 {rest}")).ok().stderr();
    assert!(said.contains("pixels to a vertex): --quality high"), "{said}");
    let said =
        run(&format!("fit made/views -o fine --quality high --set level=3 {rest}")).ok().stderr();
    assert!(!said.contains("--quality"), "{said}");
    let width = |name: &str| {
        let gif = std::fs::read(place.path().join(name).join("turntable.gif")).unwrap();
        u16::from_le_bytes([gif[6], gif[7]])
    };
    assert_eq!((width("coarse"), width("fine")), (256, 512));
    let mesh = mesh_core::read_mesh(place.path().join("fine/mesh.glb")).unwrap();
    assert!(mesh.texture.is_some());
}
