//! Several processes at one training.

use super::threads::Peer;
use super::*;
use crate::progress::Communication;

/// What each of `size` processes comes to; each has its watch, made by `watch` for its rank.
fn among<'w>(
    size: usize,
    folder: &Path,
    config: &(impl Fn(usize) -> Config + Sync),
    resume: bool,
    watch: &(impl Fn(usize) -> Watch<'w> + Sync),
) -> Vec<Result<Outcome<Blob>, TrainError>> {
    let first = if resume { RunFolder::resume(folder) } else { RunFolder::create(folder, false) };
    let run = first.unwrap();
    let others = RunFolder::at(folder);
    std::thread::scope(|scope| {
        let threads: Vec<_> = Peer::all(size)
            .into_iter()
            .enumerate()
            .map(|(rank, peer)| {
                let run = if rank == 0 { &run } else { &others };
                scope.spawn(move || {
                    // A pool of its own: who waits for the others would keep them from a common one.
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
                    let mut watch = watch(rank);
                    pool.install(|| run_at(run, &config(rank), resume, &peer, &mut watch))
                })
            })
            .collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    })
}

fn nobody(_: usize) -> Watch<'static> {
    on()
}

/// A batch that falls into fewer shards than were asked for, several batches a step, dropout, averages, a network that
/// grows, and a parameter that few samples need.
fn shared() -> Config {
    config(|c| {
        (c.train.batch, c.train.shards, c.train.accumulate) = (5, 4, 2);
        (c.train.epochs, c.train.ema_decay) = (12, Some(0.5));
        (c.system.grow_at, c.system.uneven) = (Some(2), true);
    })
}

/// Steps that are left out, and with them what statistics learned.
fn leaping() -> Config {
    config(|c| {
        (c.train.skip_spikes, c.train.shards, c.system.uneven) = (Some(1.02), 3, true);
    })
}

fn last(folder: &Path) -> Vec<u8> {
    std::fs::read(folder.join("checkpoints/last.safetensors")).unwrap()
}

#[test]
fn processes_change_no_bit() {
    let place = tempfile::tempdir().unwrap();
    for (name, config) in [("shared", shared()), ("leaping", leaping())] {
        let whole = place.path().join(name);
        let expected = run_in(&whole, &config, false, &mut on()).unwrap();
        let skipped = logged(&whole).iter().any(|line| matches!(line, Line::Skipped { .. }));
        assert_eq!(skipped, config.train.skip_spikes.is_some());
        assert_eq!(expected.system.seen.as_slice() != [0.6; 3], config.system.uneven);
        for size in 1..=3 {
            let folder = place.path().join(format!("{name}-{size}"));
            let outcomes = among(size, &folder, &|_| config.clone(), false, &nobody);
            for (rank, outcome) in outcomes.into_iter().enumerate() {
                let outcome = outcome.unwrap();
                assert!(weights(&outcome.system) == weights(&expected.system), "{rank} of {size}");
                assert_eq!((outcome.best, outcome.steps), (expected.best, expected.steps));
                assert_eq!(outcome.metrics.is_empty(), rank > 0);
            }
            assert_eq!(logged(&folder), logged(&whole), "{size} processes");
            assert!(last(&folder) == last(&whole), "{size} processes");
        }
    }
}

/// It goes on with another number of processes.
#[test]
fn another_number_of_processes_goes_on() {
    let place = tempfile::tempdir().unwrap();
    let whole = place.path().join("whole");
    run_in(&whole, &shared(), false, &mut on()).unwrap();
    for sizes in [[1, 3], [3, 1], [2, 3]] {
        let folder = place.path().join(format!("{sizes:?}"));
        // One of them is told to stop, not always the first.
        let stopped = |rank: usize| {
            let on = on();
            let cancelled = rank + 1 == sizes[0];
            on.until_event(move |event| {
                cancelled
                    && matches!(
                        event,
                        Event::Step(Step { step: 3.., .. }) | Event::Skipped { step: 3.., .. }
                    )
            })
        };
        let ends = among(sizes[0], &folder, &|_| shared(), false, &stopped);
        let ends: Vec<_> =
            ends.into_iter().map(Result::unwrap).map(|end| (end.ended, end.steps)).collect();
        assert_eq!(ends, vec![(Ended::Cancelled, ends[0].1); sizes[0]]);
        assert!(ends[0].1 < 12);
        for outcome in among(sizes[1], &folder, &|_| shared(), true, &nobody) {
            assert_eq!(outcome.unwrap().ended, Ended::Completed);
        }
        assert!(last(&folder) == last(&whole), "{sizes:?}");
        assert_eq!(logged(&folder), logged(&whole), "{sizes:?}");
    }
}

/// Spoils a training at an object.
type Spoil = fn(&mut Config, u64);

/// Wherever something fails, all end, and say what one process says.
#[test]
fn all_end_with_what_failed_in_one() {
    let place = tempfile::tempdir().unwrap();
    let order = crate::draw::order(0, 0, 12);
    let spoils: [Spoil; 4] = [
        |c, item| c.system.poisoned = Some(item),
        |c, item| c.system.unreadable = Some(item),
        |c, item| c.system.unsolved = Some(item),
        |c, _| c.train.best = Some("psnr".into()),
    ];
    for (k, spoil) in spoils.into_iter().enumerate() {
        let spoiled = || {
            let mut config = config(|c| (c.train.batch, c.train.shards) = (3, 3));
            // The last sample of the second step: the last process's.
            spoil(&mut config, order[5] as u64);
            config
        };
        let folder = place.path().join(format!("alone-{k}"));
        let expected = run_in(&folder, &spoiled(), false, &mut on()).unwrap_err().to_string();
        let folder = place.path().join(format!("three-{k}"));
        let failed = among(3, &folder, &|_| spoiled(), false, &nobody);
        let own = if k == 3 { 0 } else { 2 };
        for (rank, outcome) in failed.into_iter().enumerate() {
            let error = outcome.unwrap_err();
            assert_eq!(matches!(error, TrainError::Elsewhere { .. }), rank != own, "{error}");
            let prefix = if rank == own { String::new() } else { format!("process {own}: ") };
            assert_eq!(error.to_string(), prefix + &expected);
        }
        assert!(Checkpoint::read(&folder.join("checkpoints/last.safetensors")).is_ok());
    }
}

#[test]
fn processes_that_cannot_share_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let refused = |name: &str, config: &(dyn Fn(usize) -> Config + Sync)| {
        let outcomes = among(2, &place.path().join(name), &config, false, &nobody);
        let errors: Vec<String> =
            outcomes.into_iter().map(|outcome| outcome.unwrap_err().to_string()).collect();
        assert_eq!(errors[0], errors[1]);
        errors[0].clone()
    };
    let few = refused("few", &|_| config(|c| c.train.shards = 1));
    assert!(few.contains("2 processes") && few.contains("`shards` = 1"), "{few}");
    let coupled = refused("coupled", &|_| config(|c| c.system.coupled = true));
    assert!(coupled.contains("2 processes") && coupled.contains("`coupled = false`"), "{coupled}");
    let apart = refused("apart", &|rank| {
        config(|c| (c.train.shards, c.train.momentum) = (2, 0.1 * rank as f64))
    });
    assert!(apart.contains("process 1 has other options"), "{apart}");
}

/// Of a step of one shard each, what a process sends is twice its share of the others' gradient.
#[test]
fn what_is_sent_is_counted() {
    let place = tempfile::tempdir().unwrap();
    let said = std::sync::Mutex::new(Vec::new());
    let hear = |_: usize| {
        Watch::new(|event: &Event| {
            if let Event::Step(Step { training: Some(training), .. }) = event {
                said.lock().unwrap().push(training.communication.unwrap());
            }
        })
    };
    let shared = |_: usize| config(|c| (c.train.epochs, c.train.shards) = (1, 3));
    let folder = place.path().join("three");
    assert!(among(3, &folder, &shared, false, &hear).iter().all(Result::is_ok));
    let trainable = Blob::summary(&Options::default()).trainable;
    let said = said.into_inner().unwrap();
    assert_eq!(said.len(), 3 * 4);
    for Communication { bytes, seconds, waiting } in said {
        let gradient = (2 * 2 * 4 * trainable / 3) as u64;
        // And what is said beside the gradient.
        assert!(bytes > gradient && bytes < gradient + 1024, "{bytes}, {gradient}");
        assert!(seconds > 0.0 && waiting > 0.0);
    }
    let log = std::fs::read_to_string(folder.join("metrics.jsonl")).unwrap();
    assert!(log.contains("\"processes\":3") && log.contains("\"communication\":{\"bytes\":"));
}
