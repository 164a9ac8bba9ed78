//! Scores at cameras that were not given, and what there is to show of them.

use std::sync::Arc;

use autodiff_lite::Tape;
use mesh_core::{ByteImage, Image, TriMesh, iou};
use recon::scene::scene_of;
use train::report::ViewPair;
use train::{Better, DataError, Metric, Shown, Subset};

use super::data::{Data, Trial};
use super::prepared::Prepared;
use super::surface::{Surface, compared};
use super::{Img2Mesh, Meshes};
use crate::parts::{mean_metric, of_all};

/// Views shown of one object.
const MOST_SHOWN: usize = 6;
/// Objects shown together.
const GALLERY: usize = 8;

/// The means over the views of one group, and how the mesh compares with the true one.
#[derive(Clone, Debug, Default)]
struct Score {
    object: String,
    iou: f64,
    l1: f64,
    psnr: f64,
    surface: Option<Surface>,
}

impl Img2Mesh {
    /// Mean scores over the objects of a subset, of each over all of its groups, with `views` views given. The cameras
    /// scored are not those given, unless there are no others.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    ///
    /// # Panics
    /// If `views` is 0.
    pub fn evaluate_with(
        &self,
        data: &Data,
        subset: Subset,
        views: usize,
    ) -> Result<Vec<Metric>, DataError> {
        assert!(views > 0, "evaluate_with: a mesh takes a view at least");
        let scores = of_all(data.trials(subset, views)?, |k| {
            Ok(self.score_group(&data.trial(&self.config, (subset, views), k)?))
        })?;
        let all = |name: &str, better, of: fn(&Score) -> Option<f64>| {
            let values = scores.iter().filter_map(|score| Some((&*score.object, of(score)?)));
            mean_metric(name, better, values)
        };
        let metrics = [
            all("mask-iou", Better::Larger, |s| Some(s.iou)),
            all("image-l1", Better::Smaller, |s| Some(s.l1)),
            all("psnr", Better::Larger, |s| Some(s.psnr)),
            all("chamfer", Better::Smaller, |s| Some(s.surface?.chamfer)),
            all("f-score", Better::Larger, |s| Some(s.surface?.f_score)),
            all("self-intersecting", Better::Smaller, |s| {
                Some(s.surface?.quality.self_intersecting)
            }),
            all("folded", Better::Smaller, |s| Some(s.surface?.quality.folded)),
        ];
        // Of objects without a true surface there is nothing to say.
        Ok(metrics.into_iter().filter(|metric| !metric.by_object.is_empty()).collect())
    }

    fn score_group(&self, trial: &Trial) -> Score {
        let tape = Tape::eval();
        let meshes = self.meshes(&tape, &trial.given);
        let mut sum = Score { object: trial.object.clone(), ..Score::default() };
        for view in &trial.scored {
            let rendered = self.draw_view(&tape, meshes, view);
            let one = score(&rendered.0, &rendered.1, view);
            sum.iou += one.iou;
            sum.l1 += one.l1;
            sum.psnr += one.psnr;
        }
        let n = trial.scored.len() as f64;
        let surface = trial.truth.as_ref().map(|truth| compared(&self.mesh(meshes), truth));
        Score { iou: sum.iou / n, l1: sum.l1 / n, psnr: sum.psnr / n, surface, ..sum }
    }

    /// A mesh in the world of the cameras, and the mean IoU of its outlines with the masks of the views that it is made from.
    pub(super) fn judged(&self, views: &[Arc<Prepared>]) -> (TriMesh, f64) {
        let tape = Tape::eval();
        let meshes = self.meshes_uncached(&tape, views);
        let iou = |view: &Arc<Prepared>| {
            let (color, mask) = self.draw_view(&tape, meshes, view);
            score(&color, &mask, view).iou
        };
        let likeness = views.iter().map(iou).sum::<f64>() / views.len() as f64;
        (self.mesh(meshes), likeness)
    }

    /// Colours `[R, R, 3]` and hard mask `[R, R]` from one camera.
    fn draw_view(&self, tape: &Tape, meshes: Meshes<'_>, view: &Prepared) -> (Vec<f32>, Vec<f32>) {
        let matrices = self.cameras(tape, &[view], &[1, 3, 4]);
        // On the tape of the meshes, whose lifetime is that of this call.
        let positions = tape.constant(meshes.positions.value());
        let colors = tape.constant(meshes.colors.value());
        let rendered = self.finest().renderer.render(positions, colors, matrices);
        (rendered.image.value().iter().copied().collect(), rendered.frame.mask())
    }

    /// The first group of a subset: the model above the truth, and the mesh.
    pub(super) fn shown(&self, data: &Data, subset: Subset) -> Result<Shown, DataError> {
        let trial = data.trial(&self.config, (subset, self.config.views), 0)?;
        let tape = Tape::eval();
        let meshes = self.meshes(&tape, &trial.given);
        let views = trial.scored.iter().take(MOST_SHOWN);
        let views = views.map(|view| self.pair(&tape, meshes, view)).collect();
        Ok(Shown { views, scene: Some(scene_of(&self.mesh(meshes))) })
    }

    /// One view each of some groups spread over all of a subset, from `views` given.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    pub fn gallery(
        &self,
        data: &Data,
        subset: Subset,
        views: usize,
    ) -> Result<Vec<ViewPair>, DataError> {
        let trials = data.trials(subset, views)?;
        let shown = GALLERY.min(trials);
        let chosen = (0..shown).map(|i| i * trials / shown);
        chosen
            .map(|k| {
                let trial = data.trial(&self.config, (subset, views), k)?;
                let tape = Tape::eval();
                let meshes = self.meshes(&tape, &trial.given);
                Ok(self.pair(&tape, meshes, &trial.scored[0]))
            })
            .collect()
    }

    /// The views given in the first group of a subset that is scored, prepared.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    pub fn scored_sample(&self, data: &Data, subset: Subset) -> Result<super::Sample, DataError> {
        let views = data.trial(&self.config, (subset, self.config.views), 0)?.given;
        Ok(super::Sample { views })
    }

    /// The mesh from all views of a sample; their features are not kept.
    pub fn predict_sample(&self, sample: &super::Sample) -> TriMesh {
        let tape = Tape::eval();
        self.mesh(self.meshes_uncached(&tape, &sample.views))
    }

    fn pair(&self, tape: &Tape, meshes: Meshes<'_>, view: &Prepared) -> ViewPair {
        let side = self.config.render_size;
        let (height, width, channels) = (side, side, 3);
        let (data, mask) = self.draw_view(tape, meshes, view);
        let iou = score(&data, &mask, view).iou;
        let caption = format!("{}: IoU {iou:.3}", view.name);
        let model = Image { height, width, channels, data }.to_bytes();
        let truth = ByteImage { height, width, channels, data: view.target.clone() };
        ViewPair { caption, model, truth }
    }

    /// The mesh in the world of the cameras.
    pub(super) fn mesh(&self, meshes: Meshes<'_>) -> TriMesh {
        let frame = self.model.frame.as_slice();
        let rows = |x: &[f32]| x.as_chunks::<3>().0.to_vec();
        let (positions, colors) = (meshes.positions.value(), meshes.colors.value());
        let positions = rows(positions.as_slice());
        let place = |p: [f32; 3]| std::array::from_fn(|k| frame[k] + frame[3] * p[k]);
        let mut mesh = TriMesh::new(
            positions.into_iter().map(place).collect(),
            self.finest().renderer.corners.clone(),
        );
        mesh.colors = Some(rows(colors.as_slice()));
        mesh
    }
}

fn score(color: &[f32], mask: &[f32], truth: &Prepared) -> Score {
    let (mut l1, mut squares, mut inside) = (0.0, 0.0, 0.0);
    let colors = color.as_chunks::<3>().0.iter().zip(truth.target.as_chunks::<3>().0);
    for (&t, (c, w)) in truth.mask.iter().zip(colors) {
        for (c, w) in c.iter().zip(w) {
            let difference = f64::from(c - f32::from(*w) / 255.0);
            l1 += difference.abs();
            if t > 127 {
                squares += difference * difference;
                inside += 1.0;
            }
        }
    }
    let pixels = mask.iter().zip(&truth.mask);
    let iou = iou(pixels.map(|(&m, &t)| (m > 0.5, t > 127))).unwrap_or(1.0);
    // Two images that agree have no finite PSNR; 100 dB stands for that, and for no mask.
    let error: f64 = if inside > 0.0 { squares / inside } else { 0.0 };
    let l1 = l1 / color.len().max(1) as f64;
    Score { iou, l1, psnr: -10.0 * error.max(1e-10).log10(), ..Score::default() }
}
