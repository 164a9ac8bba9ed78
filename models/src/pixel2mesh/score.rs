//! Scores on what is held out, and what there is to show of them.

use ode_deform::solve::Stats;
use rayon::prelude::*;
use train::report::ViewPair;
use train::{DataError, Metric};

use super::deformer::Deformer;
use super::single_view::SingleView;
use crate::paired::{Pairs, PointScores, picture_above, point_scores};

/// Objects shown together.
const SHOWN: usize = 6;

/// The scores of all images that are held out.
#[derive(Clone, Debug, Default)]
pub struct Scored {
    /// One an image: its object, its scores, the work that its mesh took.
    pub each: Vec<(usize, PointScores, Stats)>,
}

impl Scored {
    /// The means.
    pub fn mean(&self) -> PointScores {
        let all: Vec<PointScores> = self.each.iter().map(|(_, scores, _)| *scores).collect();
        PointScores::mean(&all)
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

    /// The means by name, and the evaluations.
    pub fn metrics(&self) -> Vec<Metric> {
        let named = self.mean().named();
        let mut metrics: Vec<Metric> =
            named
                .into_iter()
                .filter(|(name, value, _)| *name != "normals" || value.is_finite())
                .map(|(name, value, larger)| {
                    if larger { Metric::larger(name, value) } else { Metric::smaller(name, value) }
                })
                .collect();
        metrics.push(Metric::smaller("evaluations", self.evaluations()));
        metrics
    }
}

impl<D: Deformer> SingleView<D> {
    /// Scores on what is held out, image by image.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn scored(&self, data: &Pairs) -> Result<Scored, DataError> {
        let views = self.shared().pairs.scored_views;
        let one = |k: usize| -> Result<(usize, PointScores, Stats), DataError> {
            let (object, pair) = data.trial(views, k)?;
            // What does not come to its end is no mesh at all.
            let (mesh, stats) = self.mesh_of(&pair.picture).unwrap_or_default();
            Ok((object, point_scores(&mesh, &pair.truth), stats))
        };
        let all: Vec<_> = (0..views * data.held().len()).into_par_iter().map(one).collect();
        Ok(Scored { each: all.into_iter().collect::<Result<_, _>>()? })
    }

    /// Some images spread over all that are held out: the mesh from the image's camera above the image.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn gallery(&self, data: &Pairs) -> Result<Vec<ViewPair>, DataError> {
        let shown = SHOWN.min(data.held().len());
        let one = |i: usize| {
            let (_, pair) = data.trial(1, i * data.held().len() / shown)?;
            let (mesh, _) = self.mesh_of(&pair.picture).unwrap_or_default();
            let scores = point_scores(&mesh, &pair.truth);
            let caption = format!("{}: Chamfer {:.3}", pair.picture.name, scores.chamfer);
            let mesh = pair.picture.frame.mesh_in_world(mesh);
            Ok(picture_above(&pair.picture, &mesh, caption))
        };
        (0..shown).map(one).collect()
    }
}
