//! Scores on what was not trained on, and what there is to show of them.

use std::collections::BTreeMap;

use ode_deform::solve::Stats;
use rayon::prelude::*;
use train::report::ViewPair;
use train::{Better, DataError, Metric, Subset};

use super::deformer::Deformer;
use super::single_view::SingleView;
use crate::paired::{Pair, Pairs, PointScores, picture_above, point_scores};
use crate::parts::mean_metric;

/// Objects shown together.
const SHOWN: usize = 6;

/// The scores of the images of a subset.
#[derive(Clone, Debug, Default)]
pub struct Scored {
    /// One an image: its object, its scores, the work that its mesh took.
    pub each: Vec<(usize, PointScores, Stats)>,
    /// What the object of each is called: category and name.
    pub names: Vec<String>,
}

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
            .filter(|metric| metric.name != "normals" || metric.value.is_finite())
            .collect();
        metrics.push(mean("evaluations", Better::Smaller, &|(.., stats)| stats.evaluations as f64));
        metrics
    }
}

impl Scored {
    /// Scores of whatever is said of each image of a subset, `views` of each object.
    ///
    /// # Errors
    /// If a file cannot be read, there is nothing for that, or `of` says so.
    pub fn of(
        data: &Pairs,
        (subset, views): (Subset, usize),
        of: impl Fn(&Pair) -> Result<(PointScores, Stats), DataError> + Sync,
    ) -> Result<Self, DataError> {
        let one = |k: usize| -> Result<(usize, PointScores, Stats), DataError> {
            let (object, pair) = data.trial(subset, views, k)?;
            let (scores, stats) = of(&pair)?;
            Ok((object, scores, stats))
        };
        let count = data.trials(subset, views)?;
        let all: Vec<_> = (0..count).into_par_iter().map(one).collect();
        let each: Vec<_> = all.into_iter().collect::<Result<_, _>>()?;
        let names = each.iter().map(|(object, ..)| data.object_name(*object)).collect();
        Ok(Self { each, names })
    }
}

impl<D: Deformer> SingleView<D> {
    /// Scores on a subset, image by image.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    pub fn scored(&self, data: &Pairs, subset: Subset) -> Result<Scored, DataError> {
        Scored::of(data, (subset, self.shared().pairs.scored_views), |pair| {
            // What does not come to its end is no mesh at all.
            let (mesh, stats) = self.mesh_of(&pair.picture).unwrap_or_default();
            Ok((point_scores(&mesh, &pair.truth), stats))
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
            let (mesh, _) = self.mesh_of(&pair.picture).unwrap_or_default();
            let scores = point_scores(&mesh, &pair.truth);
            let caption = format!("{}: Chamfer {:.3}", pair.picture.name, scores.chamfer);
            let mesh = pair.picture.frame.mesh_in_world(mesh);
            Ok(picture_above(&pair.picture, &mesh, caption))
        };
        (0..shown).map(one).collect()
    }
}
