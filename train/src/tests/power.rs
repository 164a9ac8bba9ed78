//! A training whose machine loses power, at every change of a file.

use std::collections::BTreeSet;

use super::*;
use crate::output::OutputFolder;
use crate::output::disk::{make_folders, publish};
use crate::output::journal::{Change, Disk, Loss, note, recorded};

/// A run as it is left: gone on with if it is one, and begun anew if it is none.
fn finish(folder: &Path, config: &Config, at_least: u64) -> Outcome<Blob> {
    let mut first = None;
    let mut watch = Watch::new(|event: &Event| {
        if let Event::Started { done, .. } = event {
            first = Some(*done);
        }
    });
    let resume = RunFolder::resume(folder).is_ok();
    let outcome = run_in(folder, config, resume, &mut watch).unwrap();
    drop(watch);
    // What was not synced is made again.
    let history = History::read(&folder.join("metrics.jsonl")).unwrap();
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    assert!(read("metrics.csv") == history.to_csv());
    assert!(read("report.html").ends_with("</html>\n"));
    assert!(first.unwrap() >= at_least, "{first:?} of {at_least} steps that were called done");
    outcome
}

#[test]
fn a_training_outlasts_a_cut_at_every_change() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("whole");
    let config = config(|c| {
        (c.train.epochs, c.train.checkpoint_steps) = (2, Some(3));
        (c.train.validation_every, c.train.samples_every, c.train.tensorboard) =
            (Some(2), Some(2), false);
        c.system.hidden = 2;
    });
    let (outcome, changes) = recorded(|| {
        let mut watch = Watch::new(|event: &Event| {
            if let Event::Saved { step, .. } = event {
                note(Change::Said(*step));
            }
        });
        run_in(&folder, &config, false, &mut watch)
    });
    let expected = weights(&outcome.unwrap().system);
    assert!(changes.len() > 60, "{}", changes.len());
    // Waiting for the disk is for what the run goes on from.
    for derived in ["metrics.csv", "report.html", "epoch-00002.png"] {
        let named = |path: &Path| path.to_str().unwrap().ends_with(derived);
        let written = |change: &Change| matches!(change, Change::Rename(_, to) if named(to));
        let synced = |change: &Change| matches!(change, Change::Sync(path) if named(path));
        assert!(changes.iter().any(written) && !changes.iter().any(synced), "{derived}");
    }
    let mut disk = Disk::new(place.path());
    let (mut said, mut seen) = (0, BTreeSet::new());
    for (k, change) in changes.iter().enumerate() {
        disk.apply(change);
        if let Change::Said(step) = change {
            said = *step;
        }
        for loss in Loss::ALL {
            // What is left is often the same as a moment before.
            if !seen.insert((said, disk.left(loss))) {
                continue;
            }
            let after = place.path().join(format!("{k}-{loss:?}"));
            disk.restore(&after, loss);
            let run = after.join("whole");
            let outcome = finish(&run, &config, said);
            assert_eq!(weights(&outcome.system), expected, "{k} {change:?} {loss:?}");
            assert_eq!(logged(&run), logged(&folder), "{k} {change:?} {loss:?}");
            std::fs::remove_dir_all(after).unwrap();
        }
    }
    // In the end all of it is there, whatever is lost.
    for loss in Loss::ALL {
        let after = place.path().join(format!("end-{loss:?}"));
        disk.restore(&after, loss);
        let checkpoint = after.join("whole/checkpoints/last.safetensors");
        assert_eq!(Checkpoint::read(&checkpoint).unwrap().step().unwrap(), 8);
        assert_eq!(logged(&after.join("whole")), logged(&folder));
    }
}

/// A folder that others wrote is at its place with all that is in it, or not there, when one of another content was before.
#[test]
fn what_is_published_outlasts_a_cut_at_every_change() {
    let place = tempfile::tempdir().unwrap();
    let (from, to) = (place.path().join("unfinished"), place.path().join("category/0001"));
    let made = |text: &str| {
        make_folders(&from.join("images")).unwrap();
        std::fs::write(from.join("images/0.png"), text).unwrap();
        std::fs::write(from.join("object.json"), text).unwrap();
    };
    let ((), changes) = recorded(|| {
        for (text, said) in [("first", 1), ("second", 2)] {
            made(text);
            publish(&from, &to).unwrap();
            note(Change::Said(said));
        }
    });
    let mut disk = Disk::new(place.path());
    let mut said = 0;
    for (k, change) in changes.iter().enumerate() {
        disk.apply(change);
        if let Change::Said(now) = change {
            said = *now;
        }
        for loss in Loss::ALL {
            let after = tempfile::tempdir().unwrap();
            disk.restore(after.path(), loss);
            let object = after.path().join("category/0001");
            let text = |name: &str| std::fs::read_to_string(object.join(name)).unwrap_or_default();
            let [image, facts] = ["images/0.png", "object.json"].map(text);
            let expected = match (said, object.exists()) {
                (_, false) => "",
                (0, true) => "first",
                (1, true) if image == "first" => "first",
                _ => "second",
            };
            assert_eq!((&*image, &*facts), (expected, expected), "{k} {change:?} {loss:?}");
            let done = matches!(change, Change::Said(_));
            assert!(object.exists() || !done, "{k} {change:?} {loss:?}");
        }
    }
}

/// An output folder is not there, or is there with all that was put into it.
#[test]
fn a_delivery_outlasts_a_cut_at_every_change() {
    let place = tempfile::tempdir().unwrap();
    let target = place.path().join("out");
    let ((), changes) = recorded(|| {
        let folder = OutputFolder::create(&target, false).unwrap();
        folder.write("mesh.ply", b"vertices").unwrap();
        std::fs::create_dir(folder.path().join("sequence")).unwrap();
        folder.write("sequence/00.ply", b"more vertices").unwrap();
        folder.commit().unwrap();
        note(Change::Said(1));
    });
    let mut disk = Disk::new(place.path());
    let mut whole = 0;
    for (k, change) in changes.iter().enumerate() {
        disk.apply(change);
        let said = matches!(change, Change::Said(_));
        for loss in Loss::ALL {
            let after = tempfile::tempdir().unwrap();
            disk.restore(after.path(), loss);
            let out = after.path().join("out");
            assert!(out.exists() || !said, "{loss:?}");
            if out.exists() {
                whole += 1;
                let text = |name: &str| std::fs::read(out.join(name)).unwrap_or_default();
                assert_eq!(text("mesh.ply"), b"vertices", "{k} {change:?} {loss:?}");
                assert_eq!(text("sequence/00.ply"), b"more vertices", "{k} {change:?} {loss:?}");
            }
        }
    }
    assert!(whole >= Loss::ALL.len(), "{whole}");
}
