#![allow(clippy::unwrap_used, reason = "tests")]

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::results::{CellRecord, ColumnRecord, RowRecord};

/// A row with values by object, seed by seed.
fn with_row(results: &mut Results, label: &str, seeds: &[Vec<f64>]) {
    for (seed, values) in seeds.iter().enumerate() {
        let names: Vec<String> = (0..values.len()).map(|k| format!("object {k}")).collect();
        let list = results.objects.iter().position(|known| *known == names).unwrap_or_else(|| {
            results.objects.push(names);
            results.objects.len() - 1
        });
        let cell = CellRecord {
            column: "error".into(),
            value: Some(values.iter().sum::<f64>() / values.len() as f64),
            objects: (values.len() > 1).then_some(list),
            scores: if values.len() > 1 {
                values.iter().copied().map(Some).collect()
            } else {
                vec![]
            },
        };
        results.rows.push(RowRecord {
            table: "t".into(),
            label: label.into(),
            job: label.into(),
            seed: seed as u64,
            seconds: 0.0,
            cells: vec![cell],
            pictures: vec![],
        });
    }
}

fn of(rows: &[(&str, &[Vec<f64>])]) -> Results {
    let column =
        ColumnRecord { table: "t".into(), name: "error".into(), better: None, decimals: 3 };
    let mut results = Results { columns: vec![column], ..Results::default() };
    for (label, seeds) in rows {
        with_row(&mut results, label, seeds);
    }
    results
}

fn score(row: &str) -> Score {
    Score::new("t", row, "error")
}

fn verdict(results: &Results, comparison: Comparison) -> Judged {
    judge(&[Claim::new("a claim", [comparison])], results).remove(0)
}

/// Nearly normal, of deviation 1.
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

/// Errors of 30 objects in three seeds: what is hard for one model is hard for the other; `gain` is what the second is better by.
fn two_models(rng: &mut ChaCha8Rng, gain: f64, between: f64) -> [Vec<Vec<f64>>; 2] {
    let mut rows = [Vec::new(), Vec::new()];
    for _ in 0..3 {
        let hard: Vec<f64> = (0..30).map(|_| 4.0 + normal(rng)).collect();
        for (k, row) in rows.iter_mut().enumerate() {
            let of_seed = between * normal(rng) - gain * k as f64;
            row.push(hard.iter().map(|hard| hard + of_seed + 0.3 * normal(rng)).collect());
        }
    }
    rows
}

/// Two rows of one distribution: whichever came out better did so by luck, and in 100 tables hardly one says otherwise.
#[test]
fn better_by_luck_is_undecided() {
    let mut rng = ChaCha8Rng::seed_from_u64(22);
    for between in [0.0, 0.2] {
        let mut decided = 0;
        for _ in 0..100 {
            let [a, b] = two_models(&mut rng, 0.0, between);
            let results = of(&[("a", &a), ("b", &b)]);
            let [lower, higher] = [score("b").below(score("a")), score("b").above(score("a"))];
            let mean = |row: &str| {
                let samples = results.samples("t", row, "error");
                samples.iter().map(|sample| sample.value).sum::<f64>()
            };
            // What a look at the means would have claimed.
            let claimed = if mean("b") < mean("a") { lower } else { higher };
            decided += usize::from(verdict(&results, claimed).verdict != Verdict::Undecided);
        }
        assert!(decided <= 8, "{decided} of 100 by luck, seeds differing by {between}");
    }
}

/// One lucky seed makes the mean, and nothing else does.
#[test]
fn one_seed_that_is_an_outlier_decides_nothing() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let [a, mut b] = two_models(&mut rng, 0.0, 0.02);
    b[1].iter_mut().for_each(|value| *value -= 2.0);
    let judged = verdict(&of(&[("a", &a), ("b", &b)]), score("b").below(score("a")));
    let finding = &judged.findings[0];
    assert_eq!(judged.verdict, Verdict::Undecided, "{}", judged.found());
    assert!(finding.own < finding.other && (finding.seeds, finding.objects) == (3, 90));
}

/// A gain of a third of what objects differ by: seen because they are paired.
#[test]
fn what_is_better_holds_and_what_is_worse_is_reversed() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let [a, b] = two_models(&mut rng, 0.35, 0.02);
    let results = of(&[("a", &a), ("b", &b)]);
    let below = verdict(&results, score("b").below(score("a")));
    assert_eq!(below.verdict, Verdict::Holds, "{}", below.found());
    let above = verdict(&results, score("b").above(score("a")));
    assert_eq!((above.verdict, above.close), (Verdict::Reversed, false));
    // And a margin decides what it says: the gain is between 0.2 and 0.8.
    let by =
        |margin: f64| verdict(&results, score("b").below(score("a")).by(margin, "said before"));
    assert_eq!((by(0.2).verdict, by(0.8).verdict), (Verdict::Holds, Verdict::Reversed));
    assert_eq!(by(0.2).margins, ["said before"]);
}

#[test]
fn not_behind_is_a_ratio_of_errors_within_its_margin() {
    let row = |errors: f64, seeds: usize| -> Vec<Vec<f64>> {
        (0..seeds)
            .map(|s| (0..20).map(|k| errors * (1.0 + 0.01 * ((k + s) % 5) as f64)).collect())
            .collect()
    };
    let iou = |errors: f64| -> Vec<Vec<f64>> {
        row(errors, 3).into_iter().map(|seed| seed.into_iter().map(|e| 1.0 - e).collect()).collect()
    };
    for (own, expected) in [(1.02, Verdict::Holds), (1.2, Verdict::Reversed)] {
        let results = of(&[("own", &row(own, 3)), ("other", &row(1.0, 3))]);
        let judged = verdict(&results, score("own").not_behind(score("other"), 0.0));
        assert_eq!(judged.verdict, expected, "{own}: {}", judged.found());
        // Of an IoU the error is what is missing to 1: 0.9 and 0.88 are 20 % apart.
        let results = of(&[("own", &iou(0.1 * own)), ("other", &iou(0.1))]);
        let judged = verdict(&results, score("own").not_behind(score("other"), 1.0));
        assert_eq!(judged.verdict, expected, "{own}: {}", judged.found());
    }
}

/// What cannot be paired is not compared, and says why.
#[test]
fn rows_of_other_objects_are_not_compared() {
    let (three, four) = (vec![vec![1.0, 2.0, 3.0]; 3], vec![vec![0.1, 0.2, 0.3, 0.4]; 3]);
    let gap = vec![vec![1.0, 2.0, f64::NAN]; 3];
    let results = of(&[("three", &three), ("four", &four), ("gap", &gap)]);
    let note = |own: &str, other: &str| {
        let judged = verdict(&results, score(own).below(score(other)));
        assert_eq!(judged.verdict, Verdict::Undecided);
        judged.findings[0].note.clone().unwrap()
    };
    assert!(note("four", "three").contains("different objects"));
    // The value of a row with a gap is no number either, as the tables leave it out.
    assert!(note("gap", "three").contains("no value for object 2"));
    assert!(note("three", "absent").contains("\"absent\" has no error"));
}

/// Without values by object a seed is one value, and one seed is nothing.
#[test]
fn without_objects_seeds_decide() {
    let seeds = |values: [f64; 3]| values.map(|value| vec![value]).to_vec();
    let results = of(&[
        ("slow", &seeds([50.0, 52.0, 51.0])),
        ("fast", &seeds([20.0, 21.0, 20.5])),
        ("noisy", &seeds([40.0, 10.0, 60.0])),
        ("once", &[vec![3.0]]),
    ]);
    let of = |row: &str| verdict(&results, score(row).below(score("slow")));
    assert_eq!(of("fast").verdict, Verdict::Holds);
    assert_eq!((of("noisy").verdict, of("noisy").close), (Verdict::Undecided, false));
    let once = of("once");
    assert_eq!(once.verdict, Verdict::Undecided);
    assert_eq!(once.findings[0].note.as_deref(), Some("one seed has no interval"));
    let exact = verdict(&results, score("once").at_most(1.0, 3.0, 0.0, "as many").exactly());
    assert_eq!(exact.verdict, Verdict::Holds);
    let none = verdict(&results, score("slow").above(51.5).exactly());
    assert_eq!(none.verdict, Verdict::Undecided);
}

/// All of a claim's comparisons have to hold; one that is reversed reverses it.
#[test]
fn a_claim_is_as_good_as_its_worst_comparison() {
    let seeds = |value: f64| [value, value + 0.1, value - 0.1].map(|v| vec![v]).to_vec();
    let results = of(&[("a", &seeds(1.0)), ("b", &seeds(2.0)), ("c", &seeds(3.0))]);
    let judged = |pairs: &[(&str, &str)]| {
        let pairs = pairs.iter().map(|(own, other)| score(own).below(score(other)));
        judge(&[Claim::new("sorted", pairs)], &results).remove(0).verdict
    };
    assert_eq!(judged(&[("a", "b"), ("b", "c")]), Verdict::Holds);
    assert_eq!(judged(&[("a", "b"), ("b", "absent")]), Verdict::Undecided);
    assert_eq!(judged(&[("a", "absent"), ("c", "b")]), Verdict::Reversed);
    assert_eq!(judged(&[]), Verdict::Undecided);
    assert_eq!(judged(&[("a", "a")]), Verdict::Undecided);
}

/// Rows taken together: their objects count together, and are told apart by their rows.
#[test]
fn rows_are_taken_together() {
    let rows = |value: f64| vec![vec![value, value + 0.01, value - 0.01]; 3];
    let results = of(&[("a", &rows(1.0)), ("b", &rows(3.0)), ("c", &rows(2.5)), ("d", &rows(2.5))]);
    let together = score("a").and("b").below(score("c").and("d"));
    let judged = verdict(&results, together);
    let finding = &judged.findings[0];
    assert_eq!((finding.own, finding.other, finding.objects), (Some(2.0), Some(2.5), 18));
}

/// Close is what the narrower interval of five seeds would decide.
#[test]
fn what_five_seeds_may_decide_is_close() {
    let seeds = |values: [f64; 3]| values.map(|value| vec![value]).to_vec();
    let results = of(&[("zero", &seeds([0.0; 3])), ("near", &seeds([-1.0, -2.0, -0.5]))]);
    let judged = verdict(&results, score("near").below(score("zero")));
    assert_eq!((judged.verdict, judged.close), (Verdict::Undecided, true), "{}", judged.found());
    let judged = verdict(&results, score("near").above(score("zero")));
    assert_eq!((judged.verdict, judged.close), (Verdict::Undecided, false), "{}", judged.found());
}

/// By the rule: on the border is on neither side, whichever side is claimed.
#[test]
fn an_end_at_the_border_decides_nothing() {
    let judged_by = |border, side, low, high| {
        let question = Question {
            statistic: Statistic::Difference,
            kind: "difference",
            side,
            border,
            perfect: None,
        };
        question.judge(Interval { estimate: 0.5 * (low + high), low, high }).0
    };
    let judged = |side, low, high| judged_by(0.0, side, low, high);
    // What is exactly at a margin is within it.
    assert_eq!(judged_by(0.95, Side::Below, 0.9, 0.95), Verdict::Holds);
    assert_eq!(judged_by(0.95, Side::Above, 0.9, 0.95), Verdict::Undecided);
    for (low, high) in [(0.0, 5.0), (-5.0, 0.0), (0.0, 0.0)] {
        for side in [Side::Below, Side::Above] {
            assert_eq!(judged(side, low, high), Verdict::Undecided, "{low} {high}");
        }
    }
    assert_eq!(judged(Side::Below, 1.0, 5.0), Verdict::Reversed);
    assert_eq!(judged(Side::Below, -5.0, -1.0), Verdict::Holds);
    assert_eq!(judged(Side::Above, -5.0, -1.0), Verdict::Reversed);
}
