//! Averaged weights, and weights that a training begins with, in the loop.

use super::*;
use crate::Inherited;

fn averaged(change: impl FnOnce(&mut Config)) -> Config {
    config(|c| {
        c.train.ema_decay = Some(0.5);
        change(c);
    })
}

/// A training that begins with the weights of `from`; what it took from there.
fn begun_with(
    from: &Path,
    folder: &Path,
    config: &Config,
) -> (Result<Outcome<Blob>, TrainError>, Option<Inherited>) {
    let run = RunFolder::create(folder, false).unwrap();
    let provenance = Provenance::default();
    let job = Job {
        config,
        data: &(),
        run: &run,
        provenance: &provenance,
        resume: false,
        from: Some(from),
    };
    let mut inherited = None;
    let mut watch = Watch::new(|event: &Event| {
        if let Event::Inherited(what) = event {
            inherited = Some(what.clone());
        }
    });
    let outcome = train::<Blob>(&job, &mut watch);
    drop(watch);
    (outcome, inherited)
}

/// Averages change nothing of the way that the weights take, and are what is scored, kept and loaded.
#[test]
fn averages_predict_and_leave_the_training_as_it_is() {
    let place = tempfile::tempdir().unwrap();
    let [raw, mean] = [config(|_| ()), averaged(|_| ())];
    let [raw_run, mean_run] = ["raw", "mean"].map(|name| place.path().join(name));
    let raw_outcome = run_in(&raw_run, &raw, false, &mut on()).unwrap();
    let mean_outcome = run_in(&mean_run, &mean, false, &mut on()).unwrap();
    let losses = |folder: &Path| {
        let steps = logged(folder).into_iter().filter(|line| matches!(line, Line::Step { .. }));
        steps.collect::<Vec<_>>()
    };
    assert_eq!(losses(&raw_run), losses(&mean_run));
    let means = weights(&mean_outcome.system);
    assert_ne!(weights(&raw_outcome.system), means);
    let last = mean_run.join("checkpoints/last.safetensors");
    let (loaded, _) = Checkpoint::read(&last).unwrap().load::<Blob>().unwrap();
    assert_eq!(weights(&loaded), means);
    // The scores of the last evaluation are theirs.
    let score = loaded.evaluate(&(), Subset::Validation).unwrap()[0].value;
    assert_eq!(mean_outcome.metrics[0].value, score);
    assert_ne!(raw_outcome.metrics[0].value, score);
}

#[test]
fn averages_go_on_to_the_bit_after_a_stop() {
    let place = tempfile::tempdir().unwrap();
    let config = averaged(|c| c.system.grow_at = Some(1));
    let last = |folder: &Path| std::fs::read(folder.join("checkpoints/last.safetensors")).unwrap();
    let whole = place.path().join("whole");
    run_in(&whole, &config, false, &mut on()).unwrap();
    for at in [2, 4, 7] {
        let folder = place.path().join(format!("stopped-{at}"));
        let mut stop = on()
            .until_event(|event| matches!(event, Event::Step(Step { step, .. }) if *step >= at));
        let ended = run_in(&folder, &config, false, &mut stop).unwrap().ended;
        assert_eq!(ended, Ended::Cancelled);
        run_in(&folder, &config, true, &mut on()).unwrap();
        assert!(last(&folder) == last(&whole), "stopped at {at}");
        assert_eq!(logged(&folder), logged(&whole), "stopped at {at}");
    }
}

#[test]
fn a_training_begins_with_the_weights_of_another() {
    let place = tempfile::tempdir().unwrap();
    let first = place.path().join("first");
    let trained = run_in(&first, &averaged(|_| ()), false, &mut on()).unwrap();
    let from = first.join("checkpoints/last.safetensors");
    // A rate of nothing leaves them as they were taken.
    let still = config(|c| (c.train.learning_rate, c.train.epochs) = (1e-30, 1));
    let (outcome, inherited) = begun_with(&from, &place.path().join("second"), &still);
    assert_eq!(weights(&outcome.unwrap().system), weights(&trained.system));
    let inherited = inherited.unwrap();
    assert_eq!((inherited.taken, inherited.remarks()), (6, Vec::new()));
    assert!(inherited.has("hidden") && !inherited.has("hid") && !inherited.has("encoder"));
    // Other shapes are an error that names them.
    let wider = config(|c| c.system.hidden = 16);
    let (outcome, _) = begun_with(&from, &place.path().join("third"), &wider);
    let error = outcome.unwrap_err().to_string();
    assert!(error.contains("hidden.0") && error.contains("last.safetensors"), "{error}");
}

/// Half precision, averages in the place of the weights, no optimiser, and a checkpoint still.
#[test]
fn weights_are_given_away_in_half_the_bytes() {
    let place = tempfile::tempdir().unwrap();
    let run = place.path().join("run");
    let trained = run_in(&run, &averaged(|_| ()), false, &mut on()).unwrap();
    let last = run.join("checkpoints/last.safetensors");
    let checkpoint = Checkpoint::read(&last).unwrap();
    assert_eq!(checkpoint.card(), None);
    let bytes = checkpoint.weights("# A blob\n\nKnows \"ellipsoids\".");
    assert!(bytes.len() < std::fs::metadata(&last).unwrap().len() as usize / 3);
    let file = place.path().join("blob.safetensors");
    std::fs::write(&file, &bytes).unwrap();
    let shipped = Checkpoint::read(&file).unwrap();
    assert_eq!(shipped.card(), Some("# A blob\n\nKnows \"ellipsoids\"."));
    assert_eq!(shipped.step().unwrap(), 12);
    let (loaded, config) = shipped.load::<Blob>().unwrap();
    assert_eq!(config, averaged(|_| ()));
    for (a, b) in weights(&loaded).iter().zip(weights(&trained.system)) {
        assert!((a - b).abs() <= b.abs() / 2048.0 + 1e-7, "{a} {b}");
    }
    // What is small stays whole.
    assert_eq!(loaded.seen.as_slice(), trained.system.seen.as_slice());
    let (begun, _) = begun_with(&file, &place.path().join("next"), &config);
    assert_eq!(begun.unwrap().steps, 12);
    // What stands beside the weights is read as it was, and is none of them.
    let mut beside = autodiff_lite::state::State::new();
    beside.insert("a.b", &[2, 1], &[0.1_f32, -7e-9]);
    let more = shipped.weights_beside("", &beside);
    let noted = Checkpoint::from_bytes(&file, &more).unwrap();
    assert_eq!(noted.beside("a.b"), beside.array("a.b"));
    assert_eq!((noted.beside("a"), shipped.beside("a.b")), (None, None));
    assert_eq!(weights(&noted.load::<Blob>().unwrap().0), weights(&loaded));
    let again = Checkpoint::from_bytes(&file, &noted.weights("")).unwrap().beside("a.b");
    assert_eq!(again, None);
    // Damage is noticed as in any checkpoint.
    let mut damaged = bytes;
    *damaged.last_mut().unwrap() ^= 1;
    std::fs::write(&file, damaged).unwrap();
    assert!(matches!(Checkpoint::read(&file), Err(CheckpointError::Damaged { .. })));
}
