//! The one rule for claims.
//!
//! A comparison pairs two rows object by object within each seed, and has a 95 % interval of their mean difference, or of the
//! ratio of their mean errors ([`bootstrap`](crate::bootstrap)). It **holds** if the whole interval is on the claimed side of the margin,
//! is **reversed** if the whole interval is on the other side, and else **undecided**; what ends at 0, where there is no margin,
//! is on neither side; what ends at a margin is within it.
//! A claim holds if all its comparisons do, which needs no correction for their number. It is reversed if one of them is, and so the
//! oftener by chance, the more there are: such a claim is not made again, it is looked into.
//!
//! Objects of different seeds are different objects, since seeds draw data. Of data of one's own (`--data`) all seeds have the same
//! ones: the interval then is that of other trainings, and too narrow for other objects. Rows whose objects are not the same, or one of
//! which has no value for an object, cannot be paired: such a comparison is undecided, and says why.

#[cfg(test)]
mod tests;

use std::fmt::{self, Write as _};

use serde::Serialize;

use crate::bootstrap::{Interval, Paired, Statistic, estimate, interval};
use crate::claim::{Against, Claim, Comparison, Margin, Score, Side};
use crate::results::{Results, Sample};

/// How much narrower an interval may be expected to become with five seeds instead of three: Student's points and the roots of
/// the numbers of seeds, 2.776 √3 / (4.303 √5).
const WITH_FIVE: f64 = 0.5;

/// What came of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// It is so, beyond chance.
    Holds,
    /// It is the other way round, beyond chance.
    Reversed,
    /// It may be either.
    Undecided,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Holds => "holds",
            Self::Reversed => "reversed",
            Self::Undecided => "undecided",
        })
    }
}

/// A claim that was judged.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judged {
    /// The sentence.
    pub text: String,
    /// What came of it.
    pub verdict: Verdict,
    /// What came of each of its comparisons.
    pub findings: Vec<Finding>,
    /// Where its margins come from.
    pub margins: Vec<String>,
    /// Whether five seeds instead of three may be expected to decide it.
    pub close: bool,
}

/// A comparison that was judged.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// What came of it.
    pub verdict: Verdict,
    /// The mean of the score that the claim is about, over the seeds of both.
    pub own: Option<f64>,
    /// The mean of what it is compared with.
    pub other: Option<f64>,
    /// Their difference, or the ratio of their errors.
    pub interval: Option<Interval>,
    /// What that is.
    pub kind: &'static str,
    /// What it has to be below or above.
    pub border: f64,
    /// Seeds that both have.
    pub seeds: usize,
    /// Objects of all seeds; 0 where there are no values by object.
    pub objects: usize,
    /// Why there is no interval, where there is none.
    pub note: Option<String>,
}

impl Judged {
    /// The figures in a line.
    pub fn found(&self) -> String {
        let mut texts: Vec<String> = self.findings.iter().map(Finding::to_text).collect();
        // Counts are often the same in every comparison.
        texts.dedup();
        texts.join("; ")
    }
}

impl Finding {
    /// The figures: both means, their difference or ratio, its interval.
    pub fn to_text(&self) -> String {
        let figure = |value: Option<f64>| value.map_or_else(|| "none".to_owned(), short);
        let mut text = format!("{} against {}", figure(self.own), figure(self.other));
        if let Some(Interval { estimate, low, high }) = self.interval {
            let [estimate, low, high] = [estimate, low, high].map(short);
            let _ = write!(text, ", {} {estimate} [{low}, {high}]", self.kind);
        }
        match &self.note {
            Some(note) => text + ": " + note,
            None => text,
        }
    }
}

/// Four digits, for people.
fn short(value: f64) -> String {
    let magnitude = value.abs().max(1e-12).log10().floor();
    let places = (3.0 - magnitude).clamp(0.0, 6.0) as usize;
    format!("{value:.places$}")
}

/// Judges claims by the rule.
pub fn judge(claims: &[Claim], results: &Results) -> Vec<Judged> {
    claims.iter().map(|claim| judged(claim, results)).collect()
}

fn judged(claim: &Claim, results: &Results) -> Judged {
    let compared: Vec<(Finding, bool)> =
        claim.comparisons.iter().map(|comparison| compare(comparison, results)).collect();
    let any = |verdict: Verdict| compared.iter().any(|(finding, _)| finding.verdict == verdict);
    let verdict = if any(Verdict::Reversed) {
        Verdict::Reversed
    } else if any(Verdict::Undecided) || compared.is_empty() {
        Verdict::Undecided
    } else {
        Verdict::Holds
    };
    let decided = |(finding, close): &(Finding, bool)| *close || finding.verdict == Verdict::Holds;
    Judged {
        text: claim.text.clone(),
        verdict,
        close: verdict == Verdict::Undecided && compared.iter().all(decided),
        findings: compared.into_iter().map(|(finding, _)| finding).collect(),
        margins: claim.reasons().into_iter().map(str::to_owned).collect(),
    }
}

/// What is asked of the figure of a comparison.
struct Question {
    statistic: Statistic,
    kind: &'static str,
    side: Side,
    border: f64,
    /// The value that errors are counted from; none where values are compared as they are.
    perfect: Option<f64>,
}

impl Question {
    fn of(comparison: &Comparison) -> Self {
        let by = |by: f64| if comparison.side == Side::Below { -by } else { by };
        let (statistic, kind, border, perfect) = match &comparison.margin {
            Margin::None => (Statistic::Difference, "difference", 0.0, None),
            Margin::By(margin, _) => (Statistic::Difference, "difference", by(*margin), None),
            Margin::Times { most, perfect, .. } => {
                let kind = if *perfect == 0.0 { "ratio" } else { "ratio of errors" };
                (Statistic::Ratio, kind, *most, Some(*perfect))
            }
        };
        Self { statistic, kind, side: comparison.side, border, perfect }
    }

    /// Whether a figure is on the claimed side. What is exactly at a margin is within it; without one, equal is not better.
    fn holds(&self, figure: f64) -> bool {
        let beyond = match self.side {
            Side::Below => figure < self.border,
            Side::Above => figure > self.border,
        };
        beyond || (self.border != 0.0 && figure.to_bits() == self.border.to_bits())
    }

    /// Whether a figure is on the other side.
    fn is_beyond(&self, figure: f64) -> bool {
        match self.side {
            Side::Below => figure > self.border,
            Side::Above => figure < self.border,
        }
    }

    fn error(&self, value: f64) -> f64 {
        self.perfect.map_or(value, |perfect| (perfect - value).abs())
    }

    fn judge(&self, Interval { estimate, low, high }: Interval) -> (Verdict, bool) {
        match (self.holds(low), self.holds(high)) {
            (true, true) => (Verdict::Holds, false),
            (false, false) if self.is_beyond(low) && self.is_beyond(high) => {
                (Verdict::Reversed, false)
            }
            (false, false) => (Verdict::Undecided, false),
            _ => {
                let narrower = |end: f64| estimate + WITH_FIVE * (end - estimate);
                (Verdict::Undecided, self.holds(narrower(low)) && self.holds(narrower(high)))
            }
        }
    }
}

fn compare(comparison: &Comparison, results: &Results) -> (Finding, bool) {
    let question = Question::of(comparison);
    let mut finding = Finding {
        verdict: Verdict::Undecided,
        own: None,
        other: None,
        interval: None,
        kind: question.kind,
        border: question.border,
        seeds: 0,
        objects: 0,
        note: None,
    };
    let paired = match paired(comparison, results) {
        Ok(paired) => paired,
        Err(note) => {
            finding.note = Some(note);
            return (finding, false);
        }
    };
    let mean = |side: fn(&Paired) -> &[f64]| {
        let of_seed = |seed: &Paired| side(seed).iter().sum::<f64>() / side(seed).len() as f64;
        paired.iter().map(of_seed).sum::<f64>() / paired.len() as f64
    };
    (finding.own, finding.other) = (Some(mean(|p| &p.own)), Some(mean(|p| &p.other)));
    finding.seeds = paired.len();
    let objects: usize = paired.iter().map(|seed| seed.own.len()).sum();
    finding.objects = if objects > paired.len() { objects } else { 0 };
    let errors: Vec<Paired> = paired
        .iter()
        .map(|seed| Paired {
            own: seed.own.iter().map(|&value| question.error(value)).collect(),
            other: seed.other.iter().map(|&value| question.error(value)).collect(),
        })
        .collect();
    finding.interval = if comparison.exact {
        range(&errors, question.statistic)
    } else {
        interval(&errors, question.statistic)
    };
    let Some(interval) = finding.interval else {
        let why = if paired.len() == 1 && finding.objects == 0 {
            "one seed has no interval"
        } else {
            "it is not a number"
        };
        finding.note = Some(why.to_owned());
        return (finding, false);
    };
    let (verdict, close) = question.judge(interval);
    finding.verdict = verdict;
    // A range from the least to the largest only grows.
    let may_narrow = finding.seeds == 3 && !comparison.exact;
    (finding, close && may_narrow)
}

/// From the least to the largest figure of the seeds.
fn range(seeds: &[Paired], statistic: Statistic) -> Option<Interval> {
    let figures: Option<Vec<f64>> =
        seeds.iter().map(|seed| estimate(std::slice::from_ref(seed), statistic)).collect();
    let figures = figures?;
    let low = figures.iter().copied().reduce(f64::min)?;
    let high = figures.iter().copied().reduce(f64::max)?;
    Some(Interval { estimate: estimate(seeds, statistic)?, low, high })
}

/// Both sides of a comparison, seed by seed; or why they cannot be paired.
fn paired(comparison: &Comparison, results: &Results) -> Result<Vec<Paired>, String> {
    let own = pooled(&comparison.own, results)?;
    let other = match &comparison.other {
        Against::Score(score) => pooled(score, results)?,
        Against::Value(value) => {
            let constant = |sample: &Sample| Sample {
                value: *value,
                objects: sample.objects.iter().map(|(name, _)| (name.clone(), *value)).collect(),
                ..*sample
            };
            own.iter().map(constant).collect()
        }
    };
    let mut pairs = Vec::new();
    for own in &own {
        let Some(other) = other.iter().find(|other| other.seed == own.seed) else { continue };
        pairs.push(pair(own, other)?);
    }
    if pairs.is_empty() {
        return Err("no seed has both".to_owned());
    }
    if pairs.iter().any(|seed| seed.own.len() == 1) {
        // Some without values by object: then seed by seed.
        let single = |seed: &Paired| {
            let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
            Paired::single(mean(&seed.own), mean(&seed.other))
        };
        pairs = pairs.iter().map(single).collect();
    }
    Ok(pairs)
}

/// One seed of both sides, object by object where both have values by object.
fn pair(own: &Sample, other: &Sample) -> Result<Paired, String> {
    if own.objects.is_empty() || other.objects.is_empty() {
        return Ok(Paired::single(own.value, other.value));
    }
    let sorted = |sample: &Sample| {
        let mut objects = sample.objects.clone();
        objects.sort_by(|a, b| a.0.cmp(&b.0));
        objects
    };
    let (own_objects, other_objects) = (sorted(own), sorted(other));
    let names = |objects: &[(String, f64)]| -> Vec<String> {
        objects.iter().map(|(name, _)| name.clone()).collect()
    };
    let seed = own.seed;
    if names(&own_objects) != names(&other_objects) {
        return Err(format!("seed {seed}: the rows are of different objects"));
    }
    for (name, value) in own_objects.iter().chain(&other_objects) {
        if !value.is_finite() {
            return Err(format!("seed {seed}: a row has no value for {name}"));
        }
    }
    let values =
        |objects: Vec<(String, f64)>| objects.into_iter().map(|(_, value)| value).collect();
    Ok(Paired { own: values(own_objects), other: values(other_objects) })
}

/// A score seed by seed: of several rows the mean, and the objects of all.
fn pooled(score: &Score, results: &Results) -> Result<Vec<Sample>, String> {
    let Score { table, rows, column } = score;
    let mut pooled: Option<Vec<Sample>> = None;
    for (at, row) in rows.iter().enumerate() {
        let mut samples = results.samples(table, row, column);
        if samples.is_empty() {
            return Err(format!("{row:?} has no {column}"));
        }
        if rows.len() > 1 {
            // Objects of the same name in different rows are different ones.
            for (name, _) in samples.iter_mut().flat_map(|sample| &mut sample.objects) {
                *name = format!("{at} {name}");
            }
        }
        pooled = Some(match pooled {
            None => samples,
            Some(before) => before
                .into_iter()
                .filter_map(|sample| {
                    let more = samples.iter().find(|more| more.seed == sample.seed)?;
                    Some(joined(sample, more, at))
                })
                .collect(),
        });
    }
    Ok(pooled.unwrap_or_default())
}

/// A sample of `before` rows and one of another.
fn joined(mut sample: Sample, more: &Sample, before: usize) -> Sample {
    let before = before as f64;
    sample.value = (before * sample.value + more.value) / (before + 1.0);
    if sample.objects.is_empty() || more.objects.is_empty() {
        sample.objects.clear();
    } else {
        sample.objects.extend(more.objects.iter().cloned());
    }
    sample
}
