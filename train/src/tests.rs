//! The loop, tried on a small system of its own.

#![allow(clippy::unwrap_used, reason = "tests")]

mod averages;
mod blob;
mod checkpoints;
mod events;
mod folders;
mod power;
mod processes;
mod spikes;
mod threads;

use std::path::Path;

use autodiff_lite::{Module, Param};

use super::log::{History, Line};
use super::progress::{Ended, Event, Step, Watch};
use super::*;
use blob::{Blob, Options, silhouette};
use events::scalars;

type Config = Configuration<Options>;

fn config(change: impl FnOnce(&mut Config)) -> Config {
    let mut config = Config::default();
    config.train.epochs = 3;
    config.train.batch = 3;
    config.train.learning_rate = 0.02;
    config.train.schedule = ScheduleKind::Cosine;
    config.train.clip_norm = Some(0.5);
    change(&mut config);
    config
}

fn run_in(
    folder: &Path,
    config: &Config,
    resume: bool,
    watch: &mut Watch<'_>,
) -> Result<Outcome<Blob>, TrainError> {
    let run = if resume { RunFolder::resume(folder)? } else { RunFolder::create(folder, false)? };
    run_at(&run, config, resume, &Solo, watch)
}

fn run_at(
    run: &RunFolder,
    config: &Config,
    resume: bool,
    communicator: &dyn Communicator,
    watch: &mut Watch<'_>,
) -> Result<Outcome<Blob>, TrainError> {
    let provenance = Provenance { version: "test".into(), ..Provenance::default() };
    let job = Job { config, data: &(), run, provenance: &provenance, resume, from: None };
    train_among::<Blob>(&job, communicator, watch)
}

fn on() -> Watch<'static> {
    Watch::default()
}

fn weights(system: &Blob) -> Vec<f32> {
    let mut all = Vec::new();
    system.visit("", &mut |_: &str, param: &Param| all.extend_from_slice(param.as_slice()));
    all
}

/// The log without its header and times.
fn logged(folder: &Path) -> Vec<Line> {
    let history = History::read(&folder.join("metrics.jsonl")).unwrap();
    let timeless = |line| match line {
        Line::Resumed { .. } => None,
        Line::Step { step, epoch, loss, terms, learning_rate, gradient_norm, .. } => {
            let (seconds, communication) = (0.0, None);
            Some(Line::Step {
                step,
                epoch,
                loss,
                terms,
                learning_rate,
                gradient_norm,
                seconds,
                communication,
            })
        }
        line => Some(line),
    };
    history.lines.into_iter().filter_map(timeless).collect()
}

#[test]
fn it_learns() {
    let place = tempfile::tempdir().unwrap();
    let config = config(|c| (c.train.epochs, c.system.hidden) = (60, 32));
    let (mut scores, mut losses) = (Vec::new(), Vec::new());
    let mut watch = Watch::new(|event: &Event| match event {
        Event::Evaluated { metrics, .. } => scores.push(metrics[0].value),
        Event::Step(step) => losses.push(step.loss),
        _ => {}
    });
    let outcome = run_in(&place.path().join("run"), &config, false, &mut watch).unwrap();
    drop(watch);
    assert_eq!((outcome.steps, scores.len(), outcome.ended), (240, 60, Ended::Completed));
    let best = scores.iter().copied().fold(0.0, f64::max);
    assert_eq!(outcome.best.unwrap().0, best);
    // From 0.67 to 0.82, and from 0.29 to 0.14.
    assert!(scores[59] > scores[0] + 0.1, "{scores:?}");
    let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
    assert!(mean(&losses[220..]) < 0.65 * mean(&losses[..20]), "{losses:?}");
    // The best checkpoint is that of its step, and predicts.
    let path = place.path().join("run/checkpoints/best.safetensors");
    let checkpoint = Checkpoint::read(&path).unwrap();
    assert_eq!(checkpoint.step().unwrap(), outcome.best.unwrap().1);
    let (system, found) = checkpoint.load::<Blob>().unwrap();
    assert_eq!(found, config);
    // It is the best on validation, which other subsets are not.
    let [train, validation, test] =
        Subset::ALL.map(|subset| system.evaluate(&(), subset).unwrap()[0].value);
    assert!(validation == best && train != best && test != best, "{train} {validation} {test}");
    assert_eq!(system.predict(&[0.5, 0.6, 0.7]).unwrap().len(), 126);
}

#[test]
fn a_run_that_was_stopped_goes_on_as_if_it_had_not() {
    let place = tempfile::tempdir().unwrap();
    let config = config(|c| {
        c.train.skip_spikes = Some(1.02);
        c.train.shards = 2;
        c.system.grow_at = Some(1);
    });
    let whole = place.path().join("whole");
    let expected = weights(&run_in(&whole, &config, false, &mut on()).unwrap().system);
    assert!(logged(&whole).iter().any(|line| matches!(line, Line::Skipped { .. })));
    for at in [1, 3, 4, 5, 8, 11] {
        let folder = place.path().join(format!("stopped-{at}"));
        let mut stop = on().until_event(|event| {
            matches!(event, Event::Step(Step { step, .. }) | Event::Skipped { step, .. } if *step >= at)
        });
        let outcome = run_in(&folder, &config, false, &mut stop).unwrap();
        assert_eq!((outcome.ended, outcome.steps), (Ended::Cancelled, at));
        let resumed = run_in(&folder, &config, true, &mut on()).unwrap();
        assert_eq!(resumed.ended, Ended::Completed);
        assert_eq!(weights(&resumed.system), expected, "stopped at {at}");
        assert_eq!(logged(&folder), logged(&whole), "stopped at {at}");
        let last =
            |folder: &Path| std::fs::read(folder.join("checkpoints/last.safetensors")).unwrap();
        assert!(last(&folder) == last(&whole), "stopped at {at}");
    }
}

/// Running statistics stay as well: what is left out leaves no trace.
#[test]
fn a_step_that_is_left_out_changes_no_number() {
    let place = tempfile::tempdir().unwrap();
    let config = config(|c| {
        (c.train.skip_spikes, c.train.shards, c.train.accumulate) = (Some(1.02), 2, 2);
        (c.train.epochs, c.system.uneven) = (12, true);
    });
    let stopped = |name: &str, when: fn(&Event) -> bool| {
        let folder = place.path().join(name);
        run_in(&folder, &config, false, &mut on().until_event(when)).unwrap()
    };
    let after = stopped("after", |event| matches!(event, Event::Skipped { .. }));
    assert_eq!(after.ended, Ended::Cancelled);
    let steps = after.steps - 1;
    let folder = place.path().join("before");
    let mut stop =
        on().until_event(|event| matches!(event, Event::Step(Step { step, .. }) if *step == steps));
    let before = run_in(&folder, &config, false, &mut stop).unwrap();
    assert_eq!(before.steps, steps);
    assert_eq!(weights(&after.system), weights(&before.system));
    let first = stopped("first", |event| matches!(event, Event::Step(_)));
    assert_ne!(first.system.seen.as_slice(), [0.6; 3]);
}

/// A kill leaves an older checkpoint and a log that goes further, perhaps with half a line.
#[test]
fn a_run_that_was_killed_goes_on_as_if_it_had_not() {
    let place = tempfile::tempdir().unwrap();
    let config = config(|c| c.train.checkpoint_steps = Some(3));
    let whole = place.path().join("whole");
    let expected = weights(&run_in(&whole, &config, false, &mut on()).unwrap().system);
    for at in [4, 7, 10] {
        let folder = place.path().join(format!("killed-{at}"));
        let killed = std::panic::catch_unwind(|| {
            let mut watch = Watch::new(|event: &Event| match event {
                Event::Step(Step { step, .. }) if *step == at => panic!("killed"),
                _ => (),
            });
            run_in(&folder, &config, false, &mut watch)
        });
        assert!(killed.is_err());
        let log = folder.join("metrics.jsonl");
        let text = std::fs::read_to_string(&log).unwrap() + "{\"kind\":\"st";
        std::fs::write(&log, text).unwrap();
        let resumed = run_in(&folder, &config, true, &mut on()).unwrap();
        assert_eq!(weights(&resumed.system), expected, "killed at {at}");
        assert_eq!(logged(&folder), logged(&whole), "killed at {at}");
    }
}

#[test]
fn threads_change_no_bit() {
    let place = tempfile::tempdir().unwrap();
    for shards in [1, 3] {
        let config = config(|c| (c.train.shards, c.train.epochs) = (shards, 2));
        let of = |threads: usize| {
            let folder = place.path().join(format!("{shards}-{threads}"));
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let outcome = pool.install(|| run_in(&folder, &config, false, &mut on())).unwrap();
            (weights(&outcome.system), logged(&folder))
        };
        let one = of(1);
        assert_eq!(one, of(2));
        assert_eq!(one, of(3));
    }
}

#[test]
fn batches_may_be_cut_or_accumulated() {
    let place = tempfile::tempdir().unwrap();
    let of = |name: &str, batch: usize, accumulate: usize, shards: usize| {
        let config = config(|c| {
            (c.train.batch, c.train.accumulate, c.train.shards) = (batch, accumulate, shards);
            // Dropout draws per tape, and clipping and Adam make much of little.
            c.system.dropout = 0.0;
            (c.train.clip_norm, c.train.optimizer) = (None, OptimizerKind::Sgd);
        });
        let folder = place.path().join(name);
        weights(&run_in(&folder, &config, false, &mut on()).unwrap().system)
    };
    let whole = of("whole", 6, 1, 1);
    for other in [of("accumulated", 2, 3, 1), of("cut", 6, 1, 4), of("both", 3, 2, 2)] {
        assert_ne!(whole, of("less", 3, 1, 1));
        let _ = std::fs::remove_dir_all(place.path().join("less"));
        for (a, b) in whole.iter().zip(&other) {
            assert!((a - b).abs() < 1e-4 * (1.0 + a.abs()), "{a} {b}");
        }
    }
}

#[test]
fn a_number_that_is_none_is_traced() {
    let place = tempfile::tempdir().unwrap();
    let config = config(|c| {
        c.system.poisoned = Some(4);
        c.train.shards = 2;
        c.train.checkpoint_steps = Some(1);
    });
    let error = run_in(&place.path().join("run"), &config, false, &mut on()).unwrap_err();
    let TrainError::NotFinite(found) = &error else { panic!("{error}") };
    assert_eq!((found.term.as_str(), found.sample.as_str()), ("mask", "sample object 4"));
    assert_eq!(found.tensor, Tensor::Value);
    assert!(found.step < 4 && error.to_string().contains("the value of loss `mask`"), "{error}");
    // A weight that is none is found before all else.
    let mut spoiled = Blob::new(&Options::default(), 0);
    spoiled.offsets.1.as_slice_mut()[3] = f32::INFINITY;
    let samples: Vec<_> = (0..3).map(|k| silhouette(k, 0.0, k.to_string())).collect();
    let at = StepInfo { step: 5, epoch: 1 };
    let mut tapes = super::step::Tapes::new(super::share::Share::new(3, 1, [0, 1]));
    let mut alone = super::ranks::Ranks::new(&Solo);
    let error = tapes.gradient(&spoiled, &samples, (at, 0), &mut alone, |_| ()).unwrap_err();
    let TrainError::NotFinite(error) = error else { panic!("{error}") };
    assert_eq!(error.tensor, Tensor::Parameter("offsets.1".into()));
    assert_eq!((error.step, error.epoch), (5, 1));
}

/// Samples are drawn a step ahead; an error waits for the step that they are of.
#[test]
fn a_sample_that_cannot_be_read_ends_its_own_step() {
    let place = tempfile::tempdir().unwrap();
    let order = super::draw::order(0, 0, 12);
    for at in [0, 1, 3] {
        let config = config(|c| c.system.unreadable = Some(order[3 * at + 1] as u64));
        let mut steps = 0;
        let folder = place.path().join(format!("failed-{at}"));
        let mut watch = Watch::new(|event: &Event| {
            steps += usize::from(matches!(event, Event::Step(_)));
        });
        let error = run_in(&folder, &config, false, &mut watch);
        drop(watch);
        let error = error.unwrap_err().to_string();
        assert!(error.contains("cannot be read"), "{error}");
        assert_eq!(steps, at);
        // A run that ends before that step does not hear of it.
        let folder = place.path().join(format!("stopped-{at}"));
        let stop = &mut on().until_event(
            |event| matches!(event, Event::Step(Step { step, .. }) if *step == at as u64),
        );
        assert_eq!(run_in(&folder, &config, false, stop).is_ok(), at > 0);
    }
}

/// The token is pulled elsewhere, while the training waits in the middle of its first step's event.
#[test]
fn another_thread_ends_it_with_a_checkpoint() {
    let place = tempfile::tempdir().unwrap();
    let (config, folder) = (config(|_| ()), place.path().join("run"));
    let whole = place.path().join("whole");
    let expected = weights(&run_in(&whole, &config, false, &mut on()).unwrap().system);
    let (begun, begins) = std::sync::mpsc::channel();
    let (pulled, pull) = std::sync::mpsc::channel();
    let (mut saved, cancel) = (Vec::new(), progress::Cancel::default());
    let wait = move |event: &Event| {
        if let Event::Step(_) = event {
            begun.send(()).unwrap();
            pull.recv().unwrap();
        }
    };
    let mut watch = Watch::new(wait).until(cancel.clone()).and(|event: &Event| {
        if let Event::Saved { step, .. } = event {
            saved.push(*step);
        }
    });
    let outcome = std::thread::scope(|scope| {
        scope.spawn(move || {
            begins.recv().unwrap();
            cancel.cancel();
            pulled.send(()).unwrap();
        });
        run_in(&folder, &config, false, &mut watch).unwrap()
    });
    drop(watch);
    assert_eq!((outcome.ended, outcome.steps, saved), (Ended::Cancelled, 1, vec![1]));
    let resumed = run_in(&folder, &config, true, &mut on()).unwrap();
    assert_eq!(weights(&resumed.system), expected);
}

#[test]
fn what_cannot_be_is_refused() {
    let place = tempfile::tempdir().unwrap();
    let fails = |change: &dyn Fn(&mut Config)| {
        let folder = place.path().join("run");
        let error = run_in(&folder, &config(change), false, &mut on()).unwrap_err().to_string();
        std::fs::remove_dir_all(folder).unwrap();
        error
    };
    let both = fails(&|c| (c.train.epochs, c.system.hidden) = (0, 0));
    assert!(both.contains("`epochs`") && both.contains("`hidden`"), "{both}");
    assert!(fails(&|c| (c.train.shards, c.system.coupled) = (2, true)).contains("`shards`"));
    let best = fails(&|c| c.train.best = Some("psnr".into()));
    assert!(best.contains("psnr") && best.contains("mask-iou"), "{best}");
}

#[test]
fn steps_outlast_scores_that_fail() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("run");
    let changed = config(|c| {
        c.train.best = Some("psnr".into());
        (c.train.epochs, c.train.validation_every, c.train.checkpoint_minutes) = (3, None, None);
    });
    run_in(&folder, &changed, false, &mut on()).unwrap_err();
    let path = folder.join("checkpoints/last.safetensors");
    let last = Checkpoint::read(&path).unwrap();
    assert!(last.step().unwrap() > 0, "all steps are lost");
    // With a name that there is it goes on.
    let mended = Config { train: TrainConfig { best: None, ..changed.train }, ..changed };
    let resumed = run_in(&folder, &mended, true, &mut on()).unwrap();
    assert_eq!((resumed.ended, resumed.best.unwrap().1), (Ended::Completed, 12));
}

/// Learning nothing, the first score is the best, and a run that goes on is as old as before.
#[test]
fn a_run_without_a_better_score_ends() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("run");
    let with = |patience| {
        config(|c| {
            (c.train.epochs, c.train.learning_rate, c.train.patience) = (20, 0.0, Some(patience));
            c.train.validation_every = Some(2);
        })
    };
    let mut said = Vec::new();
    let mut watch = Watch::new(|event: &Event| {
        if let Event::Warned { text } = event {
            said.push(text.clone());
        }
    });
    let outcome = run_in(&folder, &with(3), false, &mut watch).unwrap();
    drop(watch);
    // Of four steps an epoch: scored after 2, and three times more.
    assert_eq!((outcome.steps, outcome.best.unwrap().1), (32, 8));
    assert_eq!(outcome.ended, Ended::Completed);
    assert!(said.iter().any(|text| text.contains("step 32 of 80")), "{said:?}");
    assert_eq!(run_in(&folder, &with(3), true, &mut on()).unwrap().steps, 32);
    assert_eq!(run_in(&folder, &with(5), true, &mut on()).unwrap().steps, 48);
}

/// The best so far is a value of one metric, and says nothing of another.
#[test]
fn another_metric_begins_without_a_best() {
    assert!(CHANGEABLE.contains(&"best"));
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("run");
    let begun = config(|c| c.train.epochs = 1);
    let (value, step) = run_in(&folder, &begun, false, &mut on()).unwrap().best.unwrap();
    assert!(value < 1.0 && step == 4, "{value} at {step}");
    let mut longer = begun.clone();
    // The same by its name.
    (longer.train.epochs, longer.train.best) = (2, Some(Blob::BEST.into()));
    let best = run_in(&folder, &longer, true, &mut on()).unwrap().best.unwrap();
    assert!(best.0 >= value, "{best:?}");
    (longer.train.epochs, longer.train.best) = (3, Some("constant".into()));
    let best = run_in(&folder, &longer, true, &mut on()).unwrap().best;
    assert_eq!(best, Some((1.0, 12)));
    let path = folder.join("checkpoints/best.safetensors");
    assert_eq!(Checkpoint::read(&path).unwrap().step().unwrap(), 12);
}

#[test]
fn all_logs_say_the_same() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("run");
    let config = config(|c| c.train.epochs = 2);
    run_in(&folder, &config, false, &mut on()).unwrap();
    let csv = std::fs::read_to_string(folder.join("metrics.csv")).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    let column = |name: &str| rows[0].iter().position(|&n| n == name).unwrap();
    let scalars = scalars(&folder.join("tensorboard"));
    let mut steps = 0;
    for line in logged(&folder) {
        let mut agree = |step: u64, name: &str, value: f64| {
            let row = rows.iter().find(|row| row[0] == step.to_string()).unwrap();
            assert_eq!(row[column(name)].parse::<f64>().unwrap(), value);
            let found = scalars.iter().find(|(tag, at, _)| tag == name && *at == step).unwrap();
            assert_eq!(found.2, value as f32);
            steps += 1;
        };
        match line {
            Line::Step { step, loss, terms, .. } => {
                agree(step, "loss", loss);
                assert!((terms.iter().map(|t| t.1).sum::<f64>() - loss).abs() < 1e-12);
                for (name, value) in &terms {
                    agree(step, &format!("term/{name}"), *value);
                }
            }
            Line::Validation { step, metrics, .. } => {
                for (name, value) in &metrics {
                    agree(step, &format!("validation/{name}"), *value);
                }
            }
            _ => unreachable!("neither skipped nor resumed"),
        }
    }
    assert_eq!(steps, 8 * 4 + 2 * 2);
    let header: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("provenance.json")).unwrap())
            .unwrap();
    assert_eq!(header["data_hash"], "0000000000000007");
    assert_eq!((&header["seed"], &header["total"]), (&0.into(), &8.into()));
    let sheet = mesh_core::read_image(folder.join("samples/epoch-00002.png")).unwrap();
    assert_eq!((sheet.width, sheet.height), (16, 16));
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
    assert!(
        page.contains("mask-iou") && page.contains("dropout") && page.contains("Learning rate")
    );
    let read: Config = crate::settings::read(Some(&folder.join("config.toml")), &[]).unwrap();
    assert_eq!(read, config);
}

#[test]
fn resuming_takes_a_run() {
    let place = tempfile::tempdir().unwrap();
    assert!(RunFolder::resume(place.path()).is_err());
    let folder = place.path().join("run");
    let config = config(|c| c.train.epochs = 1);
    run_in(&folder, &config, false, &mut on()).unwrap();
    assert!(run_in(&folder, &config, false, &mut on()).is_err());
    // More epochs than at first.
    let mut longer = config.clone();
    longer.train.epochs = 2;
    assert_eq!(run_in(&folder, &longer, true, &mut on()).unwrap().steps, 8);
    let (path, progress) = (None, &|_, _| ());
    Blob::open(&longer.system, &Source { path, options: &(), seed: 0, progress }).unwrap();
}
