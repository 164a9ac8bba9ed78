//! Scores on what was not trained on.

use autodiff_lite::{Tape, Tensor};
use losses::metrics::{
    self, FrechetError, MaskRule, McmrAlignment, frechet, mask_iou_by, mcmr_iou, rotation_angle,
    ssim, symmetric_rotation_angle, voxel_iou,
};
use mesh_core::{ByteImage, Image, MedianOfEven, TriMesh, bounds, median};
use ndarray::ArrayView2;
use rayon::prelude::*;
use train::{Better, DataError, Metric, Subset};

use super::data::Data;
use super::model::Predicted;
use super::prediction::row;
use super::replaced::Replaced;
use super::{Mcmr, Pose, Sample};
use crate::parts::mean_metric;

/// Images that go through the network together.
const BATCH: usize = 16;
/// Cells along the longest edge for the strict 3D IoU; the published one has as many.
const CELLS: usize = 32;

/// How one object came out that was scored.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScoredObject {
    /// Its number in the data.
    pub object: usize,
    /// Category and name.
    pub name: String,
    /// Its category's number.
    pub kind: usize,
    /// How much of each mean shape it was made of.
    pub weights: Vec<f32>,
    /// IoU of hard masks (pixels' centres, from one half on) with the predicted camera.
    pub mask_iou: f64,
    /// The same with the true camera.
    pub mask_iou_true: f64,
    /// The published rule with the predicted camera: any trace of a soft mask counts.
    pub published_iou: f64,
    /// The same with the true camera.
    pub published_iou_true: f64,
    /// Of the rendering with the true camera against the masked photograph.
    pub ssim: f64,
    /// Mean absolute difference of the same.
    pub l1: f64,
    /// Between the predicted and the true camera, degrees.
    pub rotation: f64,
    /// The same modulo the turns about the upright axis that leave the true surface as it is: a round table has no front; none
    /// without a true mesh.
    pub rotation_symmetric: Option<f64>,
    /// Whether the cameras differ by more than 90 degrees; none where the object has no front, or no true mesh.
    pub flipped: Option<bool>,
    /// 3D IoU by the published protocol; none without a true mesh.
    pub iou_3d: Option<f64>,
    /// 3D IoU with nothing aligned; none without a true mesh.
    pub iou_3d_strict: Option<f64>,
    /// Sides of the box around the predicted mesh in its own frame: how wide, high and long it is.
    pub sides: [f32; 3],
}

/// All of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scored {
    /// One an object.
    pub each: Vec<ScoredObject>,
    /// Between renderings with the true camera and masked photographs; none without Inception's weights, or of a single object.
    pub fid: Option<f64>,
    /// The published code's figure of that name, a mean over pairs; none without the weights.
    pub feature_distance: Option<f64>,
}

impl Scored {
    /// The mean of a figure over the objects that have one.
    pub fn mean(&self, of: impl Fn(&ScoredObject) -> Option<f64>) -> Option<f64> {
        let values: Vec<f64> = self.each.iter().filter_map(of).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    }

    /// The lower median of a figure over the objects that have one.
    pub fn median(&self, of: impl Fn(&ScoredObject) -> Option<f64>) -> Option<f64> {
        median(self.each.iter().filter_map(of), MedianOfEven::Lower)
    }

    /// The objects of one category.
    #[must_use]
    pub fn of_kind(&self, kind: usize) -> Self {
        let each = self.each.iter().filter(|one| one.kind == kind).cloned().collect();
        Self { each, fid: None, feature_distance: None }
    }

    /// The share of objects that are of the commonest category among those whose largest weight is the same mean shape's.
    pub fn purity(&self) -> f64 {
        let kinds = 1 + self.each.iter().map(|one| one.kind).max().unwrap_or(0);
        let shapes = self.each.first().map_or(0, |one| one.weights.len());
        let mut counts = vec![vec![0_usize; kinds]; shapes];
        for one in &self.each {
            counts[largest(&one.weights)][one.kind] += 1;
        }
        let most: usize = counts.iter().map(|row| row.iter().max().copied().unwrap_or(0)).sum();
        most as f64 / self.each.len().max(1) as f64
    }

    /// Mean weights, `[N]`, of one category.
    pub fn weights_of(&self, kind: usize) -> Vec<f64> {
        let of: Vec<&ScoredObject> = self.each.iter().filter(|one| one.kind == kind).collect();
        let shapes = self.each.first().map_or(0, |one| one.weights.len());
        let mean = |i: usize| of.iter().map(|one| f64::from(one.weights[i])).sum::<f64>();
        (0..shapes).map(|i| mean(i) / of.len().max(1) as f64).collect()
    }

    /// How many mean shapes are in use: the exponential of the entropy of the mean weights.
    pub fn shapes_in_use(&self) -> f64 {
        let shapes = self.each.first().map_or(0, |one| one.weights.len());
        let mean = |i: usize| self.mean(|one| Some(f64::from(one.weights[i]))).unwrap_or(0.0);
        let entropy: f64 = (0..shapes).map(mean).filter(|&w| w > 0.0).map(|w| -w * w.ln()).sum();
        entropy.exp()
    }

    /// The means by name, with the values of the objects, of which each is one photograph; and what is said of all
    /// objects together.
    pub fn metrics(&self) -> Vec<Metric> {
        let mean = |name: &str, better, of: fn(&ScoredObject) -> Option<f64>| {
            let values = self.each.iter().filter_map(|one| Some((&*one.name, of(one)?)));
            mean_metric(name, better, values)
        };
        let mut all = vec![
            mean("mask-iou", Better::Larger, |one| Some(one.mask_iou)),
            mean("mask-iou-true-camera", Better::Larger, |one| Some(one.mask_iou_true)),
            mean("mask-iou-published", Better::Larger, |one| Some(one.published_iou)),
            mean("mask-iou-published-true-camera", Better::Larger, |one| {
                Some(one.published_iou_true)
            }),
            mean("ssim", Better::Larger, |one| Some(one.ssim)),
            mean("l1", Better::Smaller, |one| Some(one.l1)),
            mean("rotation", Better::Smaller, |one| Some(one.rotation)),
            mean("rotation-symmetric", Better::Smaller, |one| one.rotation_symmetric),
            mean("flipped", Better::Smaller, |one| one.flipped.map(|is| f64::from(u8::from(is)))),
            mean("iou-3d", Better::Larger, |one| one.iou_3d),
            mean("iou-3d-strict", Better::Larger, |one| one.iou_3d_strict),
        ];
        // Of objects without a true mesh there is nothing to say.
        all.retain(|metric| !metric.by_object.is_empty());
        let of_all = [
            // A few flipped cameras say much in the mean.
            ("rotation-symmetric-median", self.median(|one| one.rotation_symmetric)),
            ("fid", self.fid),
            ("feature-distance", self.feature_distance),
        ];
        all.extend(of_all.into_iter().filter_map(|(name, v)| v.map(|v| Metric::smaller(name, v))));
        all.push(Metric::larger("purity", self.purity()));
        all.push(Metric::larger("shapes-in-use", self.shapes_in_use()));
        all
    }
}

pub(super) fn largest(weights: &[f32]) -> usize {
    (0..weights.len()).fold(0, |best, i| if weights[i] > weights[best] { i } else { best })
}

/// One object before its shape is compared.
struct Judged {
    scored: ScoredObject,
    /// The camera's and the true one.
    rotations: [[f64; 4]; 2],
    mesh: TriMesh,
    features: Option<[Vec<f32>; 2]>,
}

/// Predictions of a batch as they are drawn, by the predicted cameras and by the true ones. Plain values, which threads may share.
struct Drawn {
    /// Pixels of a side of the images.
    side: usize,
    /// `[N, S, S]`, soft.
    silhouettes: [Tensor<f32>; 2],
    /// `[N, S, S, 3]`, by the true cameras.
    image: Tensor<f32>,
    /// `[N, S, S]`, hard.
    masks: [Vec<f32>; 2],
}

impl Drawn {
    /// How prediction `i` compares with its photograph, with no more than that filled in, and the two images: as it is drawn by
    /// the true camera, and the masked photograph.
    fn compared(&self, i: usize, sample: &Sample) -> (ScoredObject, [Image; 2]) {
        let side = self.side;
        let plane =
            |data: Vec<f32>, channels: usize| Image { height: side, width: side, channels, data };
        let mask = ByteImage { height: side, width: side, channels: 1, data: sample.mask.clone() };
        let truth = Image::from(&mask);
        let hard = |mask: &[f32]| plane(mask[i * side * side..][..side * side].to_vec(), 1);
        let target: Vec<f32> = sample
            .target
            .iter()
            .enumerate()
            .map(|(k, &c)| truth.data[k / 3] * f32::from(c) / 255.0)
            .collect();
        let target = plane(target, 3);
        let soft = [0, 1].map(|k| plane(row(&self.silhouettes[k], i), 1));
        let image = plane(row(&self.image, i), 3);
        let iou = |mask: &Image, rule| mask_iou_by(mask, &truth, rule);
        let scored = ScoredObject {
            mask_iou: iou(&hard(&self.masks[0]), MaskRule::FromHalf),
            mask_iou_true: iou(&hard(&self.masks[1]), MaskRule::FromHalf),
            published_iou: iou(&soft[0], MaskRule::AboveZero),
            published_iou_true: iou(&soft[1], MaskRule::AboveZero),
            ssim: ssim(&image, &target),
            l1: metrics::l1(&image, &target),
            ..ScoredObject::default()
        };
        (scored, [image, target])
    }
}

impl Mcmr {
    /// Scores on a subset, object by object.
    ///
    /// # Errors
    /// If a file cannot be read, there is nothing for that, or Inception's features of an image are not finite.
    pub fn scored(&self, data: &Data, subset: Subset) -> Result<Scored, DataError> {
        self.scored_with(data, subset, &Replaced::default())
    }

    /// The same with something else in the place of a part of each prediction.
    ///
    /// # Errors
    /// As [`scored`](Self::scored), or if the camera is to be another object's and there is none.
    pub fn scored_with(
        &self,
        data: &Data,
        subset: Subset,
        replaced: &Replaced,
    ) -> Result<Scored, DataError> {
        let objects = data.wanted(subset)?;
        if replaced.camera_of_another && objects.len() < 2 {
            let text =
                format!("1 object is for {subset}: there is no other whose camera it could have");
            return Err(DataError::Unfit(text));
        }
        let kinds: Vec<usize> = objects.iter().map(|&object| data.category(object).0).collect();
        let samples = data.samples(objects, subset, &self.config)?;
        let weights =
            |of: std::ops::Range<usize>| replaced.selection.weights(&kinds[of], self.config.shapes);
        // Half of all away: beside it are objects of the same category.
        let other = |i: usize| samples[(i + samples.len().div_ceil(2)) % samples.len()].true_pose;
        let judged = self.in_batches(&samples, BATCH, &weights, |tape, predicted, first, chunk| {
            let predicted = replaced.in_prediction(tape, predicted);
            let found = if replaced.camera_of_another {
                (0..chunk.len()).map(|i| other(first + i)).collect()
            } else {
                self.poses(tape, &predicted, chunk)
            };
            let objects = &objects[first..];
            self.judged(tape, &predicted, data, (objects, chunk, &found))
        });
        let mut judged: Vec<Judged> = judged.into_iter().flatten().collect();
        compare_shapes(&mut judged, data)?;
        let features: Vec<_> = judged.iter().filter_map(|one| one.features.as_ref()).collect();
        let (fid, feature_distance) = compare_features(&features)?;
        let each = judged.into_iter().map(|one| one.scored).collect();
        Ok(Scored { each, fid, feature_distance })
    }

    fn judged<'t>(
        &self,
        tape: &'t Tape,
        predicted: &Predicted<'t>,
        data: &Data,
        (objects, samples, poses): (&[usize], &[Sample], &[Pose]),
    ) -> Vec<Judged> {
        let side = self.config.image_size;
        let truths: Vec<_> = samples.iter().map(|sample| sample.true_pose).collect();
        let drawn = [poses, &truths].map(|poses| self.drawn(tape, predicted, poses));
        let drawn = Drawn {
            side,
            silhouettes: drawn.each_ref().map(|rendered| rendered.silhouette.value()),
            image: drawn[1].image.value(),
            masks: drawn.map(|rendered| rendered.mask),
        };
        let weights = predicted.weights.value();
        let perceptual = |i: usize| {
            let (compared, images) = drawn.compared(i, &samples[i]);
            let object = objects[i];
            let scored = ScoredObject {
                object,
                name: data.name(object),
                kind: data.category(object).0,
                weights: row(&weights, i),
                rotation: rotation_angle(poses[i].rotation, truths[i].rotation),
                ..compared
            };
            (scored, images)
        };
        let all: Vec<(ScoredObject, [Image; 2])> =
            (0..samples.len()).into_par_iter().map(perceptual).collect();
        let features = [0, 1].map(|which| {
            let images = all.iter().map(|(_, images)| &images[which].data[..]);
            let images = crate::stacked::stacked(tape, images, &[all.len(), side, side, 3]);
            data.perceptual().features(tape, images)
        });
        all.into_iter()
            .enumerate()
            .map(|(i, (scored, _))| {
                let mesh = self.bare_mesh_of(predicted, i);
                let sides = mesh.bounds().map_or([0.0; 3], bounds::sides);
                let scored = ScoredObject { sides, ..scored };
                let one = |all: &Vec<f32>| {
                    let width = all.len() / samples.len();
                    all[i * width..][..width].to_vec()
                };
                let features = match &features {
                    [Some(a), Some(b)] => Some([one(a), one(b)]),
                    _ => None,
                };
                let rotations = [poses[i].rotation, truths[i].rotation];
                Judged { scored, rotations, mesh, features }
            })
            .collect()
    }
}

/// 3D IoU of all shapes: by the published protocol, whose alignment is the mean of a category's, and strict.
fn compare_shapes(judged: &mut [Judged], data: &Data) -> Result<(), DataError> {
    let truths = judged
        .iter()
        .map(|one| data.truth(one.scored.object))
        .collect::<Result<Vec<_>, DataError>>()?;
    let of = |kind: usize| {
        let pairs = judged.iter().zip(&truths).filter(|(one, _)| one.scored.kind == kind);
        let alignments: Vec<McmrAlignment> = pairs
            .filter_map(|(one, truth)| McmrAlignment::of(&one.mesh, truth.as_deref()?))
            .collect();
        McmrAlignment::mean(&alignments).unwrap_or(McmrAlignment::IDENTITY)
    };
    let alignments: Vec<McmrAlignment> = (0..data.categories().len()).map(of).collect();
    judged.par_iter_mut().zip(truths).for_each(|(one, truth)| {
        let Some(truth) = truth else { return };
        let alignment = alignments[one.scored.kind];
        one.scored.iou_3d = Some(mcmr_iou(&one.mesh, &truth, alignment));
        one.scored.iou_3d_strict = Some(voxel_iou(&one.mesh, &truth, CELLS));
        let (turns, [found, known]) = (data.turns(one.scored.object, &truth), one.rotations);
        one.scored.rotation_symmetric = Some(symmetric_rotation_angle(found, known, turns));
        one.scored.flipped = (turns.len() == 1).then_some(one.scored.rotation > 90.0);
    });
    Ok(())
}

/// The FID, of two pairs or more, and the published code's mean over pairs; of no pair neither.
fn compare_features(pairs: &[&[Vec<f32>; 2]]) -> Result<(Option<f64>, Option<f64>), DataError> {
    let Some(first) = pairs.first() else { return Ok((None, None)) };
    let width = first[0].len();
    let [a, b] = [0, 1].map(|which| {
        pairs.iter().flat_map(|pair| pair[which].iter().copied()).collect::<Vec<f32>>()
    });
    let view = |all| ArrayView2::from_shape((pairs.len(), width), all).expect("as many of each");
    let fid = match frechet(view(&a[..]), view(&b[..])) {
        Ok(fid) => Some(fid),
        Err(FrechetError::TooFew { .. }) => None,
        Err(error) => return Err(DataError::read(error)),
    };
    let sum: f64 = pairs.iter().map(|[a, b]| metrics::feature_distance(a, b)).sum();
    Ok((fid, Some(sum / pairs.len() as f64)))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn a_distance_of_features_is_there_or_says_why_not() {
        let pair = |x: f32| [vec![x, 1.0], vec![2.0 * x, 0.0]];
        let of = |pairs: &[[Vec<f32>; 2]]| compare_features(&pairs.iter().collect::<Vec<_>>());
        assert_eq!(of(&[]).unwrap(), (None, None));
        assert_eq!(of(&[pair(0.0)]).unwrap(), (None, Some(1.5)));
        let (fid, distance) = of(&[pair(0.0), pair(1.0)]).unwrap();
        assert!(fid.unwrap() > 1.0 && distance.is_some());
        let error = of(&[pair(0.0), pair(f32::NAN)]).unwrap_err().to_string();
        assert!(error.contains("finite"), "{error}");
    }
}
