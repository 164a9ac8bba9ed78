//! Losses that leap, and terms that count for nothing.

use super::*;

/// A loss that rises for good is followed after ten steps; one that is not above 0 has no spikes.
#[test]
fn spikes_end_where_the_loss_stays() {
    let place = tempfile::tempdir().unwrap();
    let config = |factors: &[f64]| {
        config(|c| {
            (c.train.epochs, c.train.skip_spikes) = (6, Some(5.0));
            c.system.factors = factors.to_vec();
        })
    };
    let skipped = |folder: &Path| -> Vec<u64> {
        let step = |line| match line {
            Line::Skipped { step, .. } => Some(step),
            _ => None,
        };
        logged(folder).into_iter().filter_map(step).collect()
    };
    let of = |name: &str, factors: &[f64]| {
        let folder = place.path().join(name);
        run_in(&folder, &config(factors), false, &mut on()).unwrap();
        skipped(&folder)
    };
    assert_eq!(of("one", &[1.0, 1.0, 1.0, 100.0, 1.0]), [4]);
    assert_eq!(of("below", &[-1.0]), [0; 0]);
    let level = [1.0, 1.0, 1.0, 100.0];
    assert_eq!(of("level", &level), (4..14).collect::<Vec<u64>>());
    // How many they were outlasts a stop.
    let folder = place.path().join("stopped");
    let mut stop =
        on().until_event(|event| matches!(event, Event::Skipped { step, .. } if *step == 7));
    assert_eq!(run_in(&folder, &config(&level), false, &mut stop).unwrap().steps, 7);
    run_in(&folder, &config(&level), true, &mut on()).unwrap();
    assert_eq!(logged(&folder), logged(&place.path().join("level")));
}

#[test]
fn what_has_no_weight_may_be_no_number() {
    let place = tempfile::tempdir().unwrap();
    let of = |name: &str, unbounded: bool| {
        let folder = place.path().join(name);
        let config = config(|c| (c.train.epochs, c.system.unbounded) = (1, unbounded));
        let outcome = run_in(&folder, &config, false, &mut on()).unwrap();
        (weights(&outcome.system), logged(&folder))
    };
    let (found, expected) = (of("unbounded", true), of("bounded", false));
    assert_eq!(found, expected);
    for line in found.1 {
        if let Line::Step { terms, .. } = line {
            assert_eq!(terms[2], ("watched".to_owned(), 0.0));
        }
    }
}
