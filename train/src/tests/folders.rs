//! The folder of a run: what stays, what goes, and who works in it.

use super::*;
use crate::output::journal::{Change, recorded};

fn read(folder: &Path, name: &str) -> Vec<u8> {
    std::fs::read(folder.join(name)).unwrap()
}

/// Every file with its bytes.
fn contents(folder: &Path) -> Vec<(std::path::PathBuf, Vec<u8>)> {
    let (mut all, mut pending) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(folder) = pending.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                pending.push(path);
            } else {
                let bytes = std::fs::read(&path).unwrap();
                all.push((path, bytes));
            }
        }
    }
    all.sort();
    all
}

#[test]
fn what_was_logged_stays_to_the_byte() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("run");
    let config = config(|c| c.train.epochs = 6);
    run_in(&folder, &config, false, &mut on()).unwrap();
    let before = read(&folder, "metrics.jsonl");
    // There is nothing left to train.
    run_in(&folder, &config, true, &mut on()).unwrap();
    let after = read(&folder, "metrics.jsonl");
    assert!(after.starts_with(&before));
    let more = String::from_utf8(after[before.len()..].to_vec()).unwrap();
    assert!(more.lines().count() == 1 && more.contains("resumed"), "{more}");
}

/// The page of a finished run stays, and a page that is written in a later part of a run has its pictures.
#[test]
fn pages_keep_their_pictures() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("run");
    let config = config(|c| c.train.epochs = 2);
    let (_, changes) = recorded(|| run_in(&folder, &config, false, &mut on()).unwrap());
    // One for each evaluation.
    assert_eq!(changes.iter().filter(|change| is_page(change)).count(), 2);
    let (page, table) = (read(&folder, "report.html"), read(&folder, "metrics.csv"));
    let pictures = |page: &[u8]| String::from_utf8_lossy(page).matches("data:image/png").count();
    assert!(pictures(&page) > 0);
    let (_, changes) = recorded(|| run_in(&folder, &config, true, &mut on()).unwrap());
    assert_eq!(changes.iter().filter(|change| is_page(change)).count(), 0);
    assert!(read(&folder, "report.html") == page && read(&folder, "metrics.csv") == table);
    // What a kill or a power cut took of them comes back.
    for (name, whole) in [("report.html", &page), ("metrics.csv", &table)] {
        std::fs::write(folder.join(name), &whole[..whole.len() / 2]).unwrap();
        run_in(&folder, &config, true, &mut on()).unwrap();
        assert_eq!(pictures(&read(&folder, "report.html")), pictures(&page), "{name}");
        assert!(read(&folder, "metrics.csv") == table, "{name}");
    }
    // A part of a run that ends before its next samples.
    let mut longer = config.clone();
    longer.train.epochs = 4;
    let mut stop = on().until_event(|event| matches!(event, Event::Step(_)));
    run_in(&folder, &longer, true, &mut stop).unwrap();
    assert!(read(&folder, "metrics.csv").len() > table.len());
    assert_eq!(pictures(&read(&folder, "report.html")), pictures(&page));
}

/// Whether a change brings a new page.
fn is_page(change: &Change) -> bool {
    matches!(change, Change::Rename(_, to) if to.ends_with("report.html"))
}

#[test]
fn there_is_a_checkpoint_before_the_first_step() {
    let place = tempfile::tempdir().unwrap();
    let config = config(|_| ());
    let whole = place.path().join("whole");
    let expected = weights(&run_in(&whole, &config, false, &mut on()).unwrap().system);
    let folder = place.path().join("killed");
    let killed = std::panic::catch_unwind(|| {
        let mut watch = Watch::new(|event: &Event| {
            assert!(!matches!(event, Event::Started { .. }), "killed");
        });
        run_in(&folder, &config, false, &mut watch)
    });
    assert!(killed.is_err());
    // A kill before even that one leaves a run that begins anew, either way.
    let resumed = run_in(&folder, &config, true, &mut on()).unwrap();
    assert_eq!(weights(&resumed.system), expected);
    assert_eq!(logged(&folder), logged(&whole));
    for resume in [true, false] {
        let bare = place.path().join(format!("bare-{resume}"));
        std::fs::create_dir_all(bare.join("checkpoints")).unwrap();
        for name in ["provenance.json", "config.toml"] {
            std::fs::copy(whole.join(name), bare.join(name)).unwrap();
        }
        let header = read(&whole, "metrics.jsonl").iter().position(|&b| b == b'\n').unwrap();
        let log = &read(&whole, "metrics.jsonl")[..=header];
        std::fs::write(bare.join("metrics.jsonl"), log).unwrap();
        let begun = run_in(&bare, &config, resume, &mut on()).unwrap();
        assert_eq!(weights(&begun.system), expected);
        assert_eq!(logged(&bare), logged(&whole));
    }
}

/// A run that lost a file does not begin anew over what is left of it.
#[test]
fn a_run_that_lost_a_file_is_left_alone() {
    let place = tempfile::tempdir().unwrap();
    let config = config(|c| c.train.epochs = 2);
    for lost in ["checkpoints/last.safetensors", "config.toml", "metrics.jsonl"] {
        let folder = place.path().join(lost.replace('/', "-"));
        run_in(&folder, &config, false, &mut on()).unwrap();
        std::fs::remove_file(folder.join(lost)).unwrap();
        let before = contents(&folder);
        let error = run_in(&folder, &config, true, &mut on()).unwrap_err();
        assert!(matches!(error, TrainError::Run(RunError::Lost { .. })), "{error}");
        assert!(error.to_string().contains(lost), "{error}");
        assert!(contents(&folder) == before, "{lost}");
        // Not even where the folder was taken before the file was lost.
        let run = RunFolder::at(&folder);
        let provenance = Provenance::default();
        let job = Job {
            config: &config,
            data: &(),
            run: &run,
            provenance: &provenance,
            resume: true,
            from: None,
        };
        if lost.starts_with("checkpoints") {
            train::<Blob>(&job, &mut on()).unwrap_err();
            assert!(contents(&folder) == before, "{lost}");
        }
        assert!(matches!(RunFolder::examine(&folder, false), Err(RunError::Exists { .. })));
        RunFolder::create(&folder, true).unwrap();
    }
}

#[test]
fn two_do_not_work_in_one_folder() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("run");
    let mut tried = 0;
    let short = config(|c| c.train.epochs = 1);
    let mut watch = Watch::new(|event: &Event| {
        if let Event::Step(_) = event {
            tried += 1;
            for again in [RunFolder::resume(&folder), RunFolder::create(&folder, true)] {
                let error = again.unwrap_err();
                assert!(matches!(error, RunError::Busy { .. }), "{error}");
                let holder = format!("process {} on ", std::process::id());
                assert!(error.to_string().contains(&holder), "{error}");
            }
            // Those who only read may.
            assert!(CheckpointPath::find(&folder, true).is_ok());
        }
    });
    run_in(&folder, &short, false, &mut watch).unwrap();
    drop(watch);
    assert_eq!(tried, 4);
    assert!(!folder.join(".lock").exists());
    RunFolder::resume(&folder).unwrap();
}

#[test]
fn what_killed_ones_left_is_swept() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("run");
    let config = config(|c| c.train.epochs = 1);
    run_in(&folder, &config, false, &mut on()).unwrap();
    let left = [
        ".lock",
        ".unfinished-config.toml",
        "checkpoints/.unfinished-last.safetensors",
        "checkpoints/.tmpA1b2C3",
        "samples/.unfinished-epoch-00001.png",
    ];
    let mine = ["notes.txt", ".tmpA1b2C3", "checkpoints/.tmp-mine", "checkpoints/step.safetensors"];
    for name in left.iter().chain(&mine) {
        std::fs::write(folder.join(name), "x").unwrap();
    }
    // Who only asks removes nothing but the lock's file.
    RunFolder::examine(&folder, true).unwrap();
    assert!(left[1..].iter().all(|name| folder.join(name).exists()));
    run_in(&folder, &config, true, &mut on()).unwrap();
    assert!(left.iter().all(|name| !folder.join(name).exists()));
    assert!(mine.iter().all(|name| folder.join(name).exists()));
}

#[test]
fn what_is_optional_may_fail() {
    let place = tempfile::tempdir().unwrap();
    let config = config(|_| ());
    let whole = place.path().join("whole");
    let expected = weights(&run_in(&whole, &config, false, &mut on()).unwrap().system);
    let folder = place.path().join("run");
    let (mut warned, mut blocked) = (Vec::new(), false);
    let mut watch = Watch::new(|event: &Event| match event {
        Event::Started { .. } => {
            // Files where folders are to be, and folders where files are.
            std::fs::write(folder.join("samples"), "").unwrap();
            for name in ["metrics.csv", "report.html"] {
                std::fs::create_dir(folder.join(name)).unwrap();
            }
            blocked = true;
        }
        Event::Warned { text } => warned.push(text.clone()),
        _ => {}
    });
    let outcome = run_in(&folder, &config, false, &mut watch).unwrap();
    drop(watch);
    assert!(blocked && outcome.ended == Ended::Completed);
    assert_eq!((weights(&outcome.system), logged(&folder)), (expected, logged(&whole)));
    // Each once, though each failed three times.
    assert_eq!(warned.len(), 3, "{warned:?}");
    for name in ["samples", "metrics.csv", "report.html"] {
        let said = |text: &String| text.contains(name) && text.contains("the training goes on");
        assert!(warned.iter().any(said), "{name}: {warned:?}");
    }
}

#[cfg(unix)]
#[test]
fn files_are_as_the_umask_has_it() {
    use std::os::unix::fs::PermissionsExt;
    let place = tempfile::tempdir().unwrap();
    let plain = place.path().join("plain");
    std::fs::write(&plain, "").unwrap();
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
    let folder = place.path().join("run");
    run_in(&folder, &config(|c| c.train.epochs = 1), false, &mut on()).unwrap();
    for name in ["config.toml", "metrics.jsonl", "checkpoints/last.safetensors", "report.html"] {
        assert_eq!(mode(&folder.join(name)), mode(&plain), "{name}");
    }
}

#[test]
fn a_loss_of_which_nothing_counts_is_told_with_its_terms() {
    let place = tempfile::tempdir().unwrap();
    for shards in [1, 3] {
        let config = config(|c| (c.system.weightless, c.train.shards) = (true, shards));
        let folder = place.path().join(format!("run-{shards}"));
        let error = run_in(&folder, &config, false, &mut on()).unwrap_err();
        let TrainError::Loss { error: reason, .. } = &error else { panic!("{error}") };
        let LossError::Weightless { terms } = reason else { panic!("{reason}") };
        assert_eq!(terms, &["mask", "edge", "watched"]);
        let text = error.to_string();
        assert!(text.contains("other than 0, of [mask, edge, watched]"), "{text}");
    }
}

#[test]
fn a_loss_without_a_value_is_told_as_that() {
    let place = tempfile::tempdir().unwrap();
    for shards in [1, 3] {
        let config = config(|c| (c.system.unsolved, c.train.shards) = (Some(4), shards));
        let folder = place.path().join(format!("run-{shards}"));
        let error = run_in(&folder, &config, false, &mut on()).unwrap_err();
        let TrainError::Loss { samples, error: reason, .. } = &error else { panic!("{error}") };
        assert_eq!(samples, "sample object 4");
        assert!(matches!(reason, LossError::Solve(_)));
        let text = error.to_string();
        assert!(text.contains("under the least of 1e-8"), "{text}");
        assert!(!text.contains("learning-rate"), "{text}");
        // The checkpoint from before the first step is there.
        assert!(folder.join("checkpoints/last.safetensors").exists());
    }
}
