//! Many objects: shards, kills and one process give the same.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{copied, files_in, unsphere_with};

const TINY: &str = "--set level=3 --set steps=12";

/// Views of five objects in their folders, `a/1` to `b/2`, and a list of them.
fn objects(place: &Path) -> PathBuf {
    let mut list = String::from("# five\n");
    for (k, name) in ["a/1", "a/2", "a/3", "b/1", "b/2"].iter().enumerate() {
        let line = format!(
            "demo --seed {k} --views 8 --size 32 --keep-views -o made{k} --set level=2 --set start-level=2 --set steps=1"
        );
        unsphere_with(place, &line.split(' ').collect::<Vec<_>>()).ok();
        copied(&place.join(format!("made{k}/views")), &place.join("objects").join(name));
        // One with its truth.
        let truth = if k == 1 { "\ta/2/mesh.ply" } else { "" };
        list.extend([name, truth, "\n"]);
    }
    let path = place.join("objects/list.txt");
    std::fs::write(&path, list).unwrap();
    path
}

/// What is in a folder but for what says how long it took.
fn bytes(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let files = files_in(folder).into_iter().filter(|path| !path.ends_with("report.html"));
    files
        .map(|path| (path.strip_prefix(folder).unwrap().to_owned(), std::fs::read(&path).unwrap()))
        .collect()
}

#[test]
fn two_shards_of_which_one_was_killed_are_one_process() {
    let place = tempfile::tempdir().unwrap();
    objects(place.path());
    let run = |line: &str| unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>());
    let batch = "fit --batch objects/list.txt";
    let said = run(&format!("{batch} -o one {TINY}")).ok();
    assert!(said.stdout().contains("5 objects: 5 done, 0 failed, 0 waiting"), "{}", said.stdout());
    assert!(said.stderr().contains("2 of 5, a_2: doubtful, mask IoU 0."), "{}", said.stderr());

    // The first shard has the first, third and fifth object; it is killed behind the first.
    let line = format!("{batch} -o two --shard 1/2 {TINY}");
    let mut killed = Command::new(env!("CARGO_BIN_EXE_unsphere"))
        .args(line.split(' '))
        .current_dir(place.path())
        .stderr(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while !place.path().join("two/a_1/metrics.json").exists() {
        assert!(start.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(2));
    }
    killed.kill().unwrap();
    killed.wait().unwrap();
    assert!(!place.path().join("two/b_2").exists(), "it was too quick to be killed");

    // The second as a job array of Slurm has it, counted from 0.
    let second = Command::new(env!("CARGO_BIN_EXE_unsphere"))
        .args(format!("{batch} -o two --json {TINY}").split(' '))
        .current_dir(place.path())
        .env("SLURM_ARRAY_TASK_ID", "1")
        .env("SLURM_ARRAY_TASK_COUNT", "2")
        .env("SLURM_ARRAY_TASK_MIN", "0")
        .output()
        .unwrap();
    assert!(second.status.success());
    let json: serde_json::Value = serde_json::from_slice(&second.stdout).unwrap();
    assert_eq!((json["shard"].as_str(), json["fitted"].as_u64()), (Some("2/2"), Some(2)));
    let table = std::fs::read_to_string(place.path().join("two/summary.csv")).unwrap();
    assert_eq!(table.matches(",waiting,").count(), 5 - 2 - 1, "{table}");

    // The killed one goes on where it was, and what it left is gone.
    let said = run(&line).ok().stderr();
    assert!(
        said.contains("1 of 3, a_1: is done") && said.contains("3 of 3, b_2: doubtful, mask IoU"),
        "{said}"
    );
    let (one, two) = (bytes(&place.path().join("one")), bytes(&place.path().join("two")));
    assert_eq!(one.keys().collect::<Vec<_>>(), two.keys().collect::<Vec<_>>());
    for (path, bytes) in &one {
        assert!(bytes == &two[path], "{} differs", path.display());
    }
    assert_eq!(one.keys().filter(|path| path.ends_with("mesh.glb")).count(), 5);
    let table = String::from_utf8(one[Path::new("summary.csv")].clone()).unwrap();
    assert_eq!(table.lines().count(), 6);
    // Only the one with a truth has figures of it.
    let mut titles = table.lines().next().unwrap().split(',');
    let column = titles.position(|title| title.to_lowercase().starts_with("chamfer")).unwrap();
    let chamfer = |line: &str| line.split(',').nth(column).unwrap().parse::<f64>().is_ok();
    assert_eq!(
        table.lines().skip(1).map(chamfer).collect::<Vec<_>>(),
        [false, true, false, false, false]
    );
    let page = String::from_utf8(one[Path::new("index.html")].clone()).unwrap();
    assert!(page.contains("b_2/turntable.gif") && page.contains("5 done, 0 failed"));

    // Other settings are not mixed into the same table.
    run(&format!("{batch} -o one --set level=3 --set steps=13"))
        .fails(2, &["one", "config.toml", "--force"]);
    // Nor are views that were read otherwise.
    run(&format!("{batch} -o one {TINY} --max-size 32"))
        .fails(2, &["one", "reading.json", "`max_size` null", "32", "--force"]);
    run(&format!("{batch} -o one {TINY} --mask alpha")).fails(2, &["`mask` \"auto\"", "alpha"]);
    run(&format!("{batch} -o one {TINY} --up -y")).fails(2, &["a_1", "made with \"y\" up", "-y"]);
    // The verdict is the same of what was done before.
    let strict = format!("{batch} -o one {TINY} --strict");
    assert_eq!([run(&strict), run(&strict)].map(|said| said.code()), [Some(1); 2]);
    // Nor is a truth that the list no longer has.
    let list = place.path().join("objects/list.txt");
    let text = std::fs::read_to_string(&list).unwrap();
    std::fs::write(&list, text.replace("\ta/2/mesh.ply", "")).unwrap();
    run(&format!("{batch} -o one {TINY}")).fails(2, &["a_2", "compared with a true mesh"]);
}

/// Tasks of a job array begin in the same moment, and all write what the folder keeps of them.
#[test]
fn tasks_may_begin_at_once() {
    let place = tempfile::tempdir().unwrap();
    let list = "none/1\nnone/2\nnone/3\nnone/4\n";
    std::fs::write(place.path().join("list.txt"), list).unwrap();
    for round in 0..5 {
        let begin = |shard: u32| {
            let line = format!("fit --batch list.txt -o {round} --shard {shard}/4 {TINY}");
            Command::new(env!("CARGO_BIN_EXE_unsphere"))
                .args(line.split(' '))
                .current_dir(place.path())
                .stdout(Stdio::null())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap()
        };
        let tasks: Vec<_> = (1..=4).map(begin).collect();
        for task in tasks {
            // There is nothing to fit, and nothing else to complain of.
            let said = task.wait_with_output().unwrap().stderr;
            let said = String::from_utf8(said).unwrap();
            assert!(said.contains("1 object could not be fitted"), "{said}");
        }
    }
}

#[test]
fn an_object_that_cannot_be_fitted_stops_no_other() {
    let place = tempfile::tempdir().unwrap();
    let list = objects(place.path());
    let run = |line: &str| unsphere_with(place.path(), &line.split(' ').collect::<Vec<_>>());
    std::fs::remove_file(place.path().join("objects/a/1/3_rgb.png")).unwrap();
    std::fs::write(&list, "a/1\na/2\nnowhere\n").unwrap();
    let line = format!("fit --batch objects/list.txt -o out {TINY}");
    let run_it = run(&line);
    assert_eq!(run_it.code(), Some(1), "{}", run_it.stderr());
    assert!(
        run_it.stdout().contains("3 objects: 1 done, 2 failed, 0 waiting"),
        "{}",
        run_it.stdout()
    );
    assert!(run_it.stderr().contains("2 objects could not be fitted"));
    let table = std::fs::read_to_string(place.path().join("out/summary.csv")).unwrap();
    assert!(table.contains("3_rgb.png") && table.contains("nowhere"), "{table}");
    assert!(!place.path().join("out/a_1").exists());

    // Mended, it is tried again, and its failure is forgotten.
    std::fs::copy(
        place.path().join("objects/a/1/2_rgb.png"),
        place.path().join("objects/a/1/3_rgb.png"),
    )
    .unwrap();
    std::fs::write(&list, "a/1\na/2\n").unwrap();
    let said = run(&line).ok();
    assert!(said.stdout().contains("2 objects: 2 done, 0 failed"), "{}", said.stdout());
    assert!(!place.path().join("out/a_1.failed.txt").exists());

    // What no batch has written stays.
    let mine = place.path().join("mine/a_2");
    std::fs::create_dir_all(&mine).unwrap();
    std::fs::write(mine.join("mesh.obj"), "mine").unwrap();
    // A training keeps its configuration under the same name.
    std::fs::write(mine.join("config.toml"), "[train]\nepochs = 3\n").unwrap();
    run(&format!("fit --batch objects/list.txt -o mine {TINY}")).fails(2, &["a_2", "--force"]);
    assert_eq!(std::fs::read_to_string(mine.join("mesh.obj")).unwrap(), "mine");
    std::fs::remove_dir_all(&mine).unwrap();
    std::fs::write(place.path().join("mine/index.html"), "mine").unwrap();
    run(&format!("fit --batch objects/list.txt -o mine {TINY}")).fails(2, &["index.html"]);

    run("fit --batch nothing.txt -o out").fails(3, &["nothing.txt"]);
    run("fit --batch objects/list.txt -o out --shard 3/2").fails(2, &["--shard", "2/4"]);
    run("fit objects/a/1 --shard 1/2 -o out").fails(2, &["--batch"]);
    run("fit -o out").fails(2, &["VIEWS"]);
}
