//! Scores on what was not trained on, and what there is to show of them.

use std::collections::BTreeMap;

use mesh_core::{MedianOfEven, TriMesh, median};
use ode_deform::solve::Stats;
use train::report::ViewPair;
use train::{Better, DataError, Metric, Subset};

use super::camera::{Estimate, Seen};
use super::deformer::Deformer;
use super::single_view::SingleView;
use crate::paired::{Pair, Pairs, PointScores, mesh_above_image, point_scores};
use crate::parts::{mean_metric, of_all};
use crate::viewpoint::Viewpoint;

/// Objects shown together.
const SHOWN: usize = 6;

/// The scores of the images of a subset.
#[derive(Clone, Debug, Default)]
pub struct Scored {
    /// One an image: its object, its scores, the work that its mesh took.
    pub each: Vec<(usize, PointScores, Stats)>,
    /// What the object of each is called: category and name.
    pub names: Vec<String>,
    /// By how many degrees the azimuth of each is wrong, where a camera head guesses it; else empty.
    pub azimuths: Vec<f64>,
}

/// An azimuth that is wrong by more degrees takes the front for the back.
const FLIPPED: f64 = 120.0;

impl Scored {
    /// The means over objects, of each the mean over its images.
    pub fn mean(&self) -> PointScores {
        let mut objects: BTreeMap<&str, Vec<PointScores>> = BTreeMap::new();
        for ((_, scores, _), name) in self.each.iter().zip(&self.names) {
            objects.entry(name).or_default().push(*scores);
        }
        let means: Vec<PointScores> =
            objects.into_values().map(|all| PointScores::mean(&all)).collect();
        PointScores::mean(&means)
    }

    /// The mean number of evaluations.
    pub fn evaluations(&self) -> f64 {
        let sum: usize = self.each.iter().map(|(.., stats)| stats.evaluations).sum();
        sum as f64 / self.each.len().max(1) as f64
    }

    /// The mean number of steps.
    pub fn steps(&self) -> f64 {
        let sum: usize = self.each.iter().map(|(.., stats)| stats.accepted).sum();
        sum as f64 / self.each.len().max(1) as f64
    }

    /// The median error of the azimuth in degrees; not a number where none is guessed.
    pub fn azimuth_error(&self) -> f64 {
        let errors = self.azimuths.iter().copied();
        median(errors, MedianOfEven::Mean).unwrap_or(f64::NAN)
    }

    /// The share of the images whose azimuth is wrong by more than 120 degrees; not a number where none is guessed.
    pub fn flips(&self) -> f64 {
        let flipped = self.azimuths.iter().filter(|&&error| error > FLIPPED).count();
        flipped as f64 / self.azimuths.len() as f64
    }

    /// The means over objects by name with the values of each, and the evaluations.
    pub fn metrics(&self) -> Vec<Metric> {
        let mean = |name: &str, better, of: &dyn Fn(&(usize, PointScores, Stats)) -> f64| {
            let values = self.each.iter().zip(&self.names);
            mean_metric(name, better, values.map(|(one, name)| (&**name, of(one))))
        };
        let named = PointScores::default().named().into_iter().enumerate();
        let mut metrics: Vec<Metric> = named
            .map(|(k, (name, _, larger))| {
                let better = if larger { Better::Larger } else { Better::Smaller };
                mean(name, better, &|(_, scores, _)| scores.named()[k].1)
            })
            // Not where nothing has true normals; a mesh among others that has none of its own is told.
            .filter(|metric| metric.name != "normals" || any_number(metric))
            .collect();
        if !self.azimuths.is_empty() {
            metrics.push(Metric::smaller("azimuth-error", self.azimuth_error()));
            let flips = self.names.iter().zip(&self.azimuths);
            let flips = flips.map(|(name, &error)| (&**name, f64::from(u8::from(error > FLIPPED))));
            metrics.push(mean_metric("flips", Better::Smaller, flips));
        }
        metrics.push(mean("evaluations", Better::Smaller, &|(.., stats)| stats.evaluations as f64));
        metrics
    }
}

/// Whether it is a number for one of the objects.
fn any_number(metric: &Metric) -> bool {
    metric.by_object.iter().any(|(_, value)| !value.is_nan())
}

impl Scored {
    /// Scores of whatever is said of each image of a subset, `views` of each object.
    ///
    /// # Errors
    /// If a file cannot be read, there is nothing for that, or `of` says so.
    pub fn of(
        data: &Pairs,
        subset: (Subset, usize),
        of: impl Fn(&Pair) -> Result<(PointScores, Stats), DataError> + Sync,
    ) -> Result<Self, DataError> {
        Self::judged(data, subset, |pair| of(pair).map(|(scores, stats)| (scores, stats, None)))
    }

    /// The same with the error of the azimuth, where one is guessed.
    fn judged(
        data: &Pairs,
        (subset, views): (Subset, usize),
        of: impl Fn(&Pair) -> Result<(PointScores, Stats, Option<f64>), DataError> + Sync,
    ) -> Result<Self, DataError> {
        let one = |k: usize| {
            let (object, pair) = data.trial(subset, views, k)?;
            Ok((object, of(&pair)?))
        };
        let count = data.trials(subset, views)?;
        let mut scored = Self::default();
        for (object, (scores, stats, azimuth)) in of_all(count, one)? {
            scored.each.push((object, scores, stats));
            scored.names.push(data.object_name(object));
            scored.azimuths.extend(azimuth);
        }
        Ok(scored)
    }
}

impl<D: Deformer> SingleView<D> {
    /// Scores on a subset, image by image.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    pub fn scored(&self, data: &Pairs, subset: Subset) -> Result<Scored, DataError> {
        Scored::judged(data, (subset, self.shared().pairs.scored_views), |pair| {
            let image = &*pair.image;
            // What does not come to its end is no mesh at all.
            let (mesh, stats, guess) = match self.seen(image) {
                Ok(Seen::Told(mesh, stats)) => {
                    (mesh, stats, self.viewpoints_of(image).first().copied())
                }
                Ok(Seen::Estimated(Estimate { mesh, stats, hypothesis, .. })) => {
                    (mesh, stats, Some(hypothesis))
                }
                Err(_) => (TriMesh::default(), Stats::default(), None),
            };
            let truth = Viewpoint::of(&image.camera);
            let error = guess.map(|guess| guess.viewpoint.azimuth_error(&truth));
            let error = error.or_else(|| self.viewpoint.as_ref().map(|_| 180.0));
            Ok((point_scores(&mesh, &pair.truth), stats, error))
        })
    }

    /// Some images spread over all of a subset: the mesh from the image's camera above the image.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    pub fn gallery(&self, data: &Pairs, subset: Subset) -> Result<Vec<ViewPair>, DataError> {
        let count = data.trials(subset, 1)?;
        let shown = SHOWN.min(count);
        let one = |i: usize| {
            let (_, pair) = data.trial(subset, 1, i * count / shown)?;
            let (mesh, _) = self.mesh_of(&pair.image).unwrap_or_default();
            let scores = point_scores(&mesh, &pair.truth);
            let caption = format!("{}: Chamfer {:.3}", pair.image.name, scores.chamfer);
            let mesh = pair.image.frame.mesh_in_world(mesh);
            Ok(mesh_above_image(&pair.image, &mesh, caption))
        };
        (0..shown).map(one).collect()
    }
}
