//! Scores at cameras that were not given, and what there is to show of them.

use autodiff_lite::Tape;
use mesh_core::{ByteImage, TriMesh};
use rayon::prelude::*;

use super::data::{Data, Prepared, Sample};
use super::{Img2Mesh, Meshes};
use crate::report::ViewPair;
use crate::train::{DataError, Metric, Shown};

/// Views of a group that are scored at most: the rest costs time and tells little.
const MOST_SCORED: usize = 8;
/// Views shown.
const MOST_SHOWN: usize = 6;

/// The means over the views of one group.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    iou: f64,
    l1: f64,
    psnr: f64,
}

impl Img2Mesh {
    /// Mean scores over all groups of what is held out, each with `views` views given. The cameras
    /// scored are not those given, unless there are no others.
    pub(super) fn score(&self, data: &Data, views: usize) -> Result<Vec<Metric>, DataError> {
        let scores: Vec<Result<Score, DataError>> = (0..data.trials(views))
            .into_par_iter()
            .map(|k| Ok(self.score_group(&data.trial(&self.config, views, k)?, views)))
            .collect();
        let scores = scores.into_iter().collect::<Result<Vec<_>, _>>()?;
        let mean = |f: fn(&Score) -> f64| scores.iter().map(f).sum::<f64>() / scores.len() as f64;
        Ok(vec![
            Metric::larger("mask-iou", mean(|s| s.iou)),
            Metric::smaller("image-l1", mean(|s| s.l1)),
            Metric::larger("psnr", mean(|s| s.psnr)),
        ])
    }

    fn score_group(&self, group: &Sample, views: usize) -> Score {
        let tape = Tape::eval();
        let (meshes, others) = self.reconstruct(&tape, group, views);
        let mut sum = Score::default();
        for view in &others {
            let rendered = self.draw_view(&tape, meshes, view);
            let one = score(&rendered.0, &rendered.1, view);
            sum.iou += one.iou;
            sum.l1 += one.l1;
            sum.psnr += one.psnr;
        }
        let n = others.len() as f64;
        Score { iou: sum.iou / n, l1: sum.l1 / n, psnr: sum.psnr / n }
    }

    /// The mesh from the first views of a group, and the views to compare it with.
    fn reconstruct<'t, 'g>(
        &self,
        tape: &'t Tape,
        group: &'g Sample,
        views: usize,
    ) -> (Meshes<'t>, Vec<&'g Prepared>) {
        let (given, others) = group.views.split_at(views.min(group.views.len()));
        let meshes = self.meshes(tape, 1, given);
        let others = if others.is_empty() { given } else { others };
        (meshes, others.iter().take(MOST_SCORED).map(AsRef::as_ref).collect())
    }

    /// Colours `[R, R, 3]` and hard mask `[R, R]` from one camera.
    fn draw_view(&self, tape: &Tape, meshes: Meshes<'_>, view: &Prepared) -> (Vec<f32>, Vec<f32>) {
        let matrices = super::render::stacked(tape, [&view.matrix[..]].into_iter(), &[1, 3, 4]);
        // On the tape of the meshes, whose lifetime is that of this call.
        let positions = tape.constant(meshes.positions.value());
        let colors = tape.constant(meshes.colors.value());
        let rendered = self.stage.render(positions, colors, matrices);
        (rendered.image.value().iter().copied().collect(), rendered.fragments.mask())
    }

    /// The first group: the model above the truth, and the mesh.
    pub(super) fn shown(&self, data: &Data) -> Result<Shown, DataError> {
        let views = self.config.views;
        let group = data.trial(&self.config, views, 0)?;
        let tape = Tape::eval();
        let (meshes, others) = self.reconstruct(&tape, &group, views);
        let side = self.config.render_size;
        let pictures = others.iter().take(MOST_SHOWN).map(|view| {
            let (color, mask) = self.draw_view(&tape, meshes, view);
            let iou = score(&color, &mask, view).iou;
            let caption = format!("{}: IoU {iou:.3}", view.name);
            ViewPair { caption, model: picture(&color, side), truth: picture(&view.target, side) }
        });
        Ok(Shown { views: pictures.collect(), mesh: Some(self.mesh(meshes)) })
    }

    /// The mesh in the world of the cameras.
    pub(super) fn mesh(&self, meshes: Meshes<'_>) -> TriMesh {
        let frame = self.model.frame.as_slice();
        let rows = |x: &[f32]| x.as_chunks::<3>().0.to_vec();
        let (positions, colors) = (meshes.positions.value(), meshes.colors.value());
        let positions = rows(positions.as_slice().unwrap_or_default());
        let place = |p: [f32; 3]| std::array::from_fn(|k| frame[k] + frame[3] * p[k]);
        let mut mesh =
            TriMesh::new(positions.into_iter().map(place).collect(), self.stage.corners.clone());
        mesh.colors = Some(rows(colors.as_slice().unwrap_or_default()));
        mesh
    }
}

fn picture(color: &[f32], side: usize) -> ByteImage {
    let data = color.iter().map(|x| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect();
    ByteImage { height: side, width: side, channels: 3, data }
}

fn score(color: &[f32], mask: &[f32], truth: &Prepared) -> Score {
    let (mut both, mut any, mut l1, mut squares) = (0.0, 0.0, 0.0, 0.0);
    let mut inside = 0.0;
    let pixels = mask.iter().zip(&truth.mask);
    for ((&m, &t), (c, w)) in
        pixels.zip(color.as_chunks::<3>().0.iter().zip(truth.target.as_chunks::<3>().0))
    {
        let (m, t) = (m > 0.5, t > 0.5);
        both += f64::from(u8::from(m && t));
        any += f64::from(u8::from(m || t));
        for (c, w) in c.iter().zip(w) {
            let difference = f64::from(c - w);
            l1 += difference.abs();
            if t {
                squares += difference * difference;
                inside += 1.0;
            }
        }
    }
    let iou = if any > 0.0 { both / any } else { 1.0 };
    // Two pictures that agree have no finite PSNR; 100 dB stands for that, and for no mask.
    let error: f64 = if inside > 0.0 { squares / inside } else { 0.0 };
    Score { iou, l1: l1 / color.len().max(1) as f64, psnr: -10.0 * error.max(1e-10).log10() }
}
