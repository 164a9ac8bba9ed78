//! How far a figure may be from what other seeds and other objects would have given: a 95 % interval.
//!
//! Seeds are resampled, then objects within each, 10,000 times; the two sides of a comparison stay together, object by
//! object. Of the resampled figures the percentiles count. BCa's acceleration is not taken: it would be a jackknife over
//! seeds, of which there are three.
//!
//! Percentiles are too narrow where seeds are few: three values have 27 resamples, none of which goes beyond the largest, so
//! that such an interval covers the truth in about 75 of 100 cases. It is therefore widened to Student's interval of the
//! seeds' own figures, which is right for any number of seeds if these are about normal, whatever part of their
//! differences is due to objects and whatever to training. Where a score has no values by object, Student's is all there is.
//! With a single seed the objects alone are resampled, and nothing is said of other trainings.
//!
//! # References
//! Davison and Hinkley 1997, *Bootstrap Methods and their Application*, section 3.8 (data in two levels). Hesterberg 2015, *What
//! Teachers Should Know About the Bootstrap*, section 5 (percentiles of few values are too narrow). Cameron and Miller 2015, *A
//! Practitioner's Guide to Cluster-Robust Inference*, section VI (few clusters: Student's distribution with one degree of freedom less
//! than clusters). Cochran 1977, *Sampling Techniques*, section 6 (ratios of means).

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Resamples of an interval.
pub const RESAMPLES: usize = 10_000;
/// The part of the resamples that lies beyond each end.
const TAIL: f64 = 0.025;
const SEED: u64 = 1979;

/// Student's two-sided 95 % points by degrees of freedom, from 1 on.
const STUDENT: [f64; 30] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160,
    2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056,
    2.052, 2.048, 2.045, 2.042,
];

/// A figure with the ends of its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Interval {
    /// The figure itself.
    pub estimate: f64,
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
}

/// What one seed has of both sides of a comparison: the values of the same objects in the same order, or one value each.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Paired {
    pub(crate) own: Vec<f64>,
    pub(crate) other: Vec<f64>,
}

/// How two means become one figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Statistic {
    /// The first less the second.
    Difference,
    /// The first divided by the second.
    Ratio,
}

impl Statistic {
    fn of(self, [own, other]: [f64; 2]) -> f64 {
        match self {
            Self::Difference => own - other,
            Self::Ratio => own / other,
        }
    }
}

impl Paired {
    /// One value of each side.
    pub(crate) fn single(own: f64, other: f64) -> Self {
        Self { own: vec![own], other: vec![other] }
    }

    /// Values alone, against nothing.
    pub(crate) fn alone(own: Vec<f64>) -> Self {
        Self { other: vec![0.0; own.len()], own }
    }

    fn means(&self) -> [f64; 2] {
        [mean(&self.own), mean(&self.other)]
    }
}

/// The figure of some seeds; each seed counts as much. None where a value is missing.
pub(crate) fn estimate(seeds: &[Paired], statistic: Statistic) -> Option<f64> {
    let means: Vec<[f64; 2]> = seeds.iter().map(Paired::means).collect();
    Some(statistic.of(together(&means))).filter(|figure| figure.is_finite())
}

/// The figure with its interval; none where there is a single value, or one that is not a number.
pub(crate) fn interval(seeds: &[Paired], statistic: Statistic) -> Option<Interval> {
    interval_of(seeds, statistic, RESAMPLES)
}

fn interval_of(seeds: &[Paired], statistic: Statistic, resamples: usize) -> Option<Interval> {
    let estimate = estimate(seeds, statistic)?;
    let objects = seeds.iter().all(|seed| seed.own.len() > 1);
    let resampled = objects.then(|| percentiles(seeds, statistic, resamples));
    let ends = [resampled, student(seeds, statistic)];
    let (low, high) = ends.into_iter().flatten().reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
    (low.is_finite() && high.is_finite()).then_some(Interval { estimate, low, high })
}

/// The ends by resampling seeds, and objects within them.
fn percentiles(seeds: &[Paired], statistic: Statistic, resamples: usize) -> (f64, f64) {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut figures: Vec<f64> = (0..resamples)
        .map(|_| {
            let mut sum = [0.0; 2];
            for _ in 0..seeds.len() {
                let seed = &seeds[rng.random_range(0..seeds.len())];
                let count = seed.own.len();
                let mut own = [0.0; 2];
                for _ in 0..count {
                    let object = rng.random_range(0..count);
                    own[0] += seed.own[object];
                    own[1] += seed.other[object];
                }
                for (sum, own) in sum.iter_mut().zip(own) {
                    *sum += own / count as f64;
                }
            }
            statistic.of(sum.map(|sum| sum / seeds.len() as f64))
        })
        .collect();
    figures.sort_unstable_by(f64::total_cmp);
    let beyond = (TAIL * resamples as f64) as usize;
    (figures[beyond], figures[resamples - 1 - beyond])
}

/// Student's interval of the seeds' own figures; none for a single seed. A ratio's is that of its linear part.
fn student(seeds: &[Paired], statistic: Statistic) -> Option<(f64, f64)> {
    let (&quantile, count) = (student_point(seeds.len())?, seeds.len() as f64);
    let means: Vec<[f64; 2]> = seeds.iter().map(Paired::means).collect();
    let all = together(&means);
    let estimate = statistic.of(all);
    let figure = |&[own, other]: &[f64; 2]| match statistic {
        Statistic::Difference => own - other,
        Statistic::Ratio => estimate + (own - estimate * other) / all[1],
    };
    let squares: f64 = means.iter().map(|means| (figure(means) - estimate).powi(2)).sum();
    let half = quantile * (squares / (count - 1.0) / count).sqrt();
    Some((estimate - half, estimate + half))
}

/// Of so many seeds; beyond the table its last entry, which is a little wide.
fn student_point(seeds: usize) -> Option<&'static f64> {
    let freedom = seeds.checked_sub(2)?;
    STUDENT.get(freedom).or(STUDENT.last())
}

fn together(means: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|side| means.iter().map(|means| means[side]).sum::<f64>() / means.len() as f64)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    /// Nearly normal, of deviation 1.
    fn normal(rng: &mut ChaCha8Rng) -> f64 {
        (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
    }

    /// Seeds whose objects share what the seed does to both sides, whose difference has the mean `gain`, and varies from seed
    /// to seed by `between` and from object to object by 1.
    fn drawn(
        rng: &mut ChaCha8Rng,
        [seeds, objects]: [usize; 2],
        between: f64,
        gain: f64,
    ) -> Vec<Paired> {
        (0..seeds)
            .map(|_| {
                let of_seed = gain + between * normal(rng);
                let other: Vec<f64> = (0..objects).map(|_| 20.0 + 3.0 * normal(rng)).collect();
                let own = other.iter().map(|other| other + of_seed + normal(rng)).collect();
                Paired { own, other }
            })
            .collect()
    }

    fn coverage(between: f64, statistic: Statistic, ends: impl Fn(&[Paired]) -> (f64, f64)) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let trials = 1500;
        let truth = statistic.of([21.0, 20.0]);
        let covered = |_: &usize| {
            let (low, high) = ends(&drawn(&mut rng, [3, 24], between, 1.0));
            low <= truth && truth <= high
        };
        (0..trials).filter(covered).count() as f64 / f64::from(trials as u32)
    }

    /// Where objects differ, where seeds differ, and where both do: at least 95 of 100, and no interval is so wide that it
    /// would always cover.
    #[test]
    fn intervals_cover_the_truth_in_95_of_100_cases() {
        let spread = 1.0 / 24.0_f64.sqrt();
        for statistic in [Statistic::Difference, Statistic::Ratio] {
            for (between, most) in [(0.0, 1.0), (spread, 0.99), (4.0 * spread, 0.965)] {
                let found = coverage(between, statistic, |seeds| {
                    let interval = interval_of(seeds, statistic, 200).unwrap();
                    (interval.low, interval.high)
                });
                assert!((0.94..=most).contains(&found), "{statistic:?} {between:.2}: {found}");
            }
        }
    }

    /// Why Student's interval is taken beside the percentiles.
    #[test]
    fn percentiles_alone_are_too_narrow_where_seeds_differ() {
        let wide = Statistic::Difference;
        let found = coverage(2.0, wide, |seeds| percentiles(seeds, wide, 200));
        assert!(found < 0.85, "{found}");
    }

    #[test]
    fn one_seed_has_the_interval_of_its_objects() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let seeds = drawn(&mut rng, [1, 100], 0.0, 1.0);
        let found = interval(&seeds, Statistic::Difference).unwrap();
        // The standard error of a hundred differences of deviation 1, twice.
        let half = 0.5 * (found.high - found.low);
        assert!((0.15..0.25).contains(&half) && found.low < found.estimate, "{found:?}");
        assert_eq!(interval(&seeds, Statistic::Difference), Some(found));
        assert_eq!(interval(&[Paired::single(1.0, 2.0)], Statistic::Difference), None);
    }

    /// By hand: differences 1, 2, 3 have the mean 2, the deviation 1, and 4.303 over the root of 3 beside it.
    #[test]
    fn without_objects_the_interval_is_students() {
        let seeds = [1.0, 2.0, 3.0].map(|own| Paired::single(own, 0.0));
        let found = interval(&seeds, Statistic::Difference).unwrap();
        let half = 4.303 / 3.0_f64.sqrt();
        assert!(
            (found.low - (2.0 - half)).abs() < 1e-12 && (found.high - (2.0 + half)).abs() < 1e-12
        );
        assert_eq!(student_point(1), None);
        assert_eq!(student_point(99), Some(&2.042));
    }

    #[test]
    fn what_is_not_a_number_has_no_interval() {
        let seeds = [Paired { own: vec![1.0, f64::NAN], other: vec![0.0; 2] }];
        assert_eq!(interval(&seeds, Statistic::Difference), None);
        let seeds = [Paired { own: vec![1.0, 2.0], other: vec![0.0; 2] }];
        assert_eq!(interval(&seeds, Statistic::Ratio), None);
        assert_eq!(interval(&[], Statistic::Difference), None);
    }
}
