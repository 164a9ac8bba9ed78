//! How figures went over a training.

use std::path::Path;

use serde::{Deserialize, Serialize};
use train::RunFolder;

/// Points that are kept of a curve.
const POINTS: usize = 60;
/// What the loss is called.
pub(crate) const LOSS: &str = "loss";

/// A figure over the steps of a training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Curve {
    /// `loss`, or `validation: ` and the name of the score.
    pub(crate) name: String,
    /// Steps and values.
    pub(crate) points: Vec<[f64; 2]>,
}

/// The loss, as means over equal parts of the training in the folder, and the scores of validation; none where nothing was
/// trained there.
pub(crate) fn curves(folder: &Path) -> Vec<Curve> {
    let Ok(found) = RunFolder::at(folder).curves() else { return Vec::new() };
    let mut curves = vec![Curve { name: LOSS.to_owned(), points: thinned(&found.losses) }];
    for (step, scores) in &found.scores {
        for (name, value) in scores {
            let name = format!("validation: {name}");
            let at = curves.iter().position(|curve| curve.name == name).unwrap_or_else(|| {
                curves.push(Curve { name, points: Vec::new() });
                curves.len() - 1
            });
            curves[at].points.push([*step as f64, *value]);
        }
    }
    for curve in &mut curves {
        curve.points.retain(|[_, value]| value.is_finite());
        for [_, value] in &mut curve.points {
            *value = format!("{value:.3e}").parse().unwrap_or(*value);
        }
    }
    // A single point is no course.
    curves.retain(|curve| curve.points.len() > 1);
    curves
}

/// Means over as many equal parts, each at its last step.
fn thinned(all: &[(u64, f64)]) -> Vec<[f64; 2]> {
    let part = all.len().div_ceil(POINTS).max(1);
    let mean = |part: &[(u64, f64)]| {
        let sum: f64 = part.iter().map(|(_, value)| value).sum();
        part.last().map(|(step, _)| [*step as f64, sum / part.len() as f64])
    };
    all.chunks(part).filter_map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_courses_are_thinned_to_means() {
        let all: Vec<(u64, f64)> = (1..=600).map(|step| (step, step as f64)).collect();
        let thin = thinned(&all);
        assert_eq!((thin.len(), thin[0], thin[59]), (60, [10.0, 5.5], [600.0, 595.5]));
        assert_eq!(thinned(&all[..3]), [[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]);
        assert!(thinned(&[]).is_empty() && curves(Path::new("nowhere")).is_empty());
    }
}
