//! The camera of an image, as it is guessed.

use std::f64::consts::{PI, TAU};

use autodiff_lite::{Tape, Var};
use mesh_core::iou;
use ndarray::{Array1, Array2};
use train::{DataError, Subset, Terms};

use super::config::RotationLoss;
use super::data::Data;
use super::model::Predicted;
use super::photo::lens_of;
use super::pose::{Pose, SMALLEST};
use super::prediction::row;
use super::upright::upright;
use super::{Mcmr, Sample};
use crate::stacked::stacked;
use crate::viewpoint::{
    DIRECTIONS, Hypothesis, LOOKED_AT, Viewpoint, begin_at, hypotheses, viewpoint_loss,
};

impl Mcmr {
    /// Lets viewpoints begin at the elevation and the distance that the data has in the mean.
    pub(super) fn camera_begins_at(&mut self, data: &Data) -> Result<(), DataError> {
        let Some(head) = &mut self.model.viewpoint else { return Ok(()) };
        let lens = lens_of(&self.config);
        let looked_at = data.trained().iter().take(LOOKED_AT);
        let views = looked_at
            .map(|&object| {
                Ok(data.photo(object)?.plain(Subset::Train, &self.config).pose.viewpoint(lens))
            })
            .collect::<Result<Vec<_>, DataError>>()?;
        begin_at(head, &views);
        Ok(())
    }

    /// The cameras of images that are not mirrored: by the quaternion, or of a few likely viewpoints that from which the
    /// mesh has the outline that fits the image's mask best.
    ///
    /// Each viewpoint is tried with the size and the place that are guessed, and with those by which the mesh fills the box of
    /// the mask.
    pub(super) fn poses<'t>(
        &self,
        tape: &'t Tape,
        predicted: &Predicted<'t>,
        samples: &[Sample],
    ) -> Vec<Pose> {
        let Some(guess) = predicted.viewpoint else {
            return (0..samples.len()).map(|i| quaternion_pose(predicted, i)).collect();
        };
        let likely = hypotheses(&guess, self.config.camera_hypotheses);
        let lens = lens_of(&self.config);
        let positions = predicted.positions.value();
        let boxes: Vec<_> = samples.iter().map(|s| s.bounds(self.config.image_size)).collect();
        let mut best: Vec<(f64, Pose)> = (0..samples.len())
            .map(|i| (f64::NEG_INFINITY, self.pose_at(predicted, i, &likely[i][0])))
            .collect();
        let tried = likely.iter().map(Vec::len).max().unwrap_or(0);
        for (k, fills) in (0..tried).flat_map(|k| [(k, false), (k, true)]) {
            let pose = |i: usize| {
                let pose = self.pose_at(predicted, i, &likely[i][k.min(likely[i].len() - 1)]);
                let Some(bounds) = boxes[i].filter(|_| fills) else { return pose };
                pose.filling(row(&positions, i).as_chunks::<3>().0, bounds, lens)
            };
            let poses: Vec<Pose> = (0..samples.len()).map(pose).collect();
            for (i, overlap) in self.overlaps(tape, predicted, samples, &poses).enumerate() {
                if overlap > best[i].0 {
                    best[i] = (overlap, poses[i]);
                }
            }
        }
        best.into_iter().map(|(_, pose)| pose).collect()
    }

    /// The cameras that training draws with, `[N, 3, 4]`: the rough ones, or the guesses for the directions nearest to them, which
    /// what is drawn moves too.
    pub(super) fn training_cameras<'t>(
        &self,
        tape: &'t Tape,
        predicted: &Predicted<'t>,
        samples: &[&Sample],
        epoch: u64,
    ) -> Var<'t> {
        let lens = lens_of(&self.config);
        let own = self.config.own_cameras_at.is_some_and(|first| epoch >= first);
        let Some(guess) = predicted.viewpoint.filter(|_| own) else {
            let rows: Vec<[f32; 12]> =
                samples.iter().map(|s| s.in_target(s.pose).projection(lens)).collect();
            return stacked(tape, rows.iter().map(|row| &row[..]), &[samples.len(), 3, 4]);
        };
        let spacing = TAU / DIRECTIONS as f64;
        let nearest = |sample: &Sample| {
            let steps = sample.pose.viewpoint(lens).azimuth / spacing;
            steps.round().rem_euclid(DIRECTIONS as f64) as usize
        };
        let chosen: Vec<usize> = samples.iter().map(|sample| nearest(sample)).collect();
        let of = |f: &dyn Fn(usize) -> f64| {
            tape.constant(Array1::from_shape_fn(samples.len(), |i| f(i) as f32))
        };
        let is = Array2::from_shape_fn((samples.len(), DIRECTIONS), |(i, k)| {
            f32::from(u8::from(chosen[i] == k))
        });
        let azimuth = (guess.turns * tape.constant(is)).sum_axis(1);
        let azimuth = azimuth + of(&|i| spacing * chosen[i] as f64);
        // In a mirror x is turned over: the azimuth, and the place in the image.
        let sign = of(&|i| if samples[i].turned { -1.0 } else { 1.0 });
        let azimuth = azimuth * sign + of(&|i| if samples[i].turned { PI } else { 0.0 });
        let [x, y] = [1, 2].map(|k| predicted.place.index_axis(1, k));
        upright([azimuth, guess.elevation, guess.log_distance, x * sign, y], lens)
    }

    /// Terms with what guessed cameras miss of the rough ones, as they were predicted: mirrored, both would be.
    pub(super) fn with_camera<'t>(
        &self,
        tape: &'t Tape,
        terms: Terms<'t>,
        predicted: &Predicted<'t>,
        samples: &[&Sample],
    ) -> Terms<'t> {
        let c = &self.config;
        let known = |width: usize, part: &dyn Fn(&Pose) -> Vec<f64>| {
            let rows: Vec<Vec<f32>> = samples
                .iter()
                .map(|s| part(&s.pose).into_iter().map(|x| x as f32).collect())
                .collect();
            stacked(tape, rows.iter().map(|row| &row[..]), &[samples.len(), width])
        };
        let place = known(3, &|pose| vec![pose.scale, pose.place[0], pose.place[1]]);
        let place = losses::l2(predicted.place, place, None);
        if let Some(guess) = &predicted.viewpoint {
            let lens = lens_of(c);
            let truth: Vec<Viewpoint> = samples.iter().map(|s| s.pose.viewpoint(lens)).collect();
            return terms.with("camera", c.camera_weight, place).with(
                "viewpoint",
                c.viewpoint_weight,
                viewpoint_loss(guess, &truth),
            );
        }
        let rotation = known(4, &|pose| pose.rotation.to_vec());
        let rotations = match c.rotation_loss {
            RotationLoss::Cosine => losses::rotation_loss(predicted.rotation, rotation),
            RotationLoss::Sine => losses::rotation_sine(predicted.rotation, rotation),
        };
        terms.with("camera", c.camera_weight, rotations.add(place)).with(
            "camera-length",
            c.camera_length_weight,
            losses::quaternion_length(predicted.raw_rotation),
        )
    }

    /// The upright camera of a hypothesis, with the place that is guessed.
    fn pose_at(&self, predicted: &Predicted<'_>, index: usize, hypothesis: &Hypothesis) -> Pose {
        let place = row(&predicted.place.value(), index);
        let place = [place[1], place[2]].map(f64::from);
        let pose = Pose::from_viewpoint(&hypothesis.viewpoint, place, lens_of(&self.config));
        Pose { scale: pose.scale.max(SMALLEST), ..pose }
    }

    /// Intersection over union of what is seen by these cameras and the images' masks.
    fn overlaps<'t>(
        &self,
        tape: &'t Tape,
        predicted: &Predicted<'t>,
        samples: &[Sample],
        poses: &[Pose],
    ) -> impl Iterator<Item = f64> {
        let lens = lens_of(&self.config);
        let rows: Vec<[f32; 12]> = poses.iter().map(|pose| pose.projection(lens)).collect();
        let matrices = stacked(tape, rows.iter().map(|row| &row[..]), &[poses.len(), 3, 4]);
        let seen = self.renderer.mask(predicted.positions, matrices);
        let pixels = self.config.image_size.pow(2);
        samples.iter().enumerate().map(move |(i, sample)| {
            let seen = seen[i * pixels..][..pixels].iter();
            iou(seen.zip(&sample.mask).map(|(&a, &b)| (a >= 0.5, b >= 128))).unwrap_or(0.0)
        })
    }
}

/// The camera that one image's quaternion says.
fn quaternion_pose(predicted: &Predicted<'_>, index: usize) -> Pose {
    let place = row(&predicted.place.value(), index);
    let rotation = row(&predicted.rotation.value(), index);
    let pose = Pose::from_row(&[place, rotation].concat());
    Pose { scale: pose.scale.max(SMALLEST), ..pose }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use ndarray::{arr1, arr2};
    use nets::ViewpointGuess;

    use super::super::config::{CameraHead, McmrConfig};
    use super::*;

    fn system(config: McmrConfig) -> (Mcmr, Data) {
        let config = McmrConfig {
            camera_head: CameraHead::Viewpoint,
            objects: 2,
            test_objects: 1,
            families: vec!["car".to_owned()],
            width: 4,
            features: 16,
            texture_width: 1,
            hidden: 16,
            flip: 0.0,
            jitter: 0.0,
            ..config
        };
        let data = Data::synthetic(&config).unwrap();
        (<Mcmr as train::System>::new(&config, 1), data)
    }

    /// Two directions of eight: `likely`, with three quarters, and `other`; degrees.
    fn guess<'t>(tape: &'t Tape, likely: f64, other: f64, at: Viewpoint) -> ViewpointGuess<'t> {
        let spacing = 360.0 / DIRECTIONS as f64;
        let mut logits = Array1::from_elem(DIRECTIONS, -20.0_f32);
        let mut turns = Array1::<f32>::zeros(DIRECTIONS);
        for (degrees, share) in [(likely, 0.75_f32), (other, 0.25)] {
            let k = (degrees / spacing).round();
            let index = k.rem_euclid(DIRECTIONS as f64) as usize;
            logits[index] = share.ln();
            turns[index] = (degrees - k * spacing).to_radians() as f32;
        }
        let row = |values: Array1<f32>| -> Var<'t> {
            tape.constant(values.into_shape_with_order((1, DIRECTIONS)).unwrap())
        };
        ViewpointGuess {
            logits: row(logits),
            turns: row(turns),
            elevation: tape.constant(arr1(&[at.elevation as f32])),
            log_distance: tape.constant(arr1(&[at.distance.ln() as f32])),
        }
    }

    /// A long body of which the image shows the side, while the likelier guess would have its end: the outline knows better.
    /// Size and place come from the mask's box, however wrong they were guessed.
    #[test]
    fn the_outline_chooses() {
        let (system, data) = system(McmrConfig::default());
        let lens = lens_of(&system.config);
        let mut sample =
            data.photo(data.trained()[0]).unwrap().plain(Subset::Train, &system.config);
        let tape = Tape::eval();
        let mut predicted = system.predicted(&tape, &[&sample]);
        let body: Vec<f32> = system
            .template
            .sphere
            .iter()
            .flat_map(|p| [0.1 * p[0], 0.08 * p[1], 0.4 * p[2]])
            .collect();
        predicted.positions = stacked(&tape, [&body[..]].into_iter(), &[1, body.len() / 3, 3]);
        let truth = Viewpoint { azimuth: 0.1, elevation: 0.2, distance: 0.5 };
        let pose = Pose::from_viewpoint(&truth, [0.1, -0.05], lens);
        let rows = [pose.projection(lens)];
        let matrices = stacked(&tape, rows.iter().map(|row| &row[..]), &[1, 3, 4]);
        let seen = system.renderer.mask(predicted.positions, matrices);
        sample.mask = seen.iter().map(|&m| if m > 0.5 { 255 } else { 0 }).collect();
        assert!(seen.iter().sum::<f32>() > 200.0);
        let far = Viewpoint { distance: 0.9, ..truth };
        predicted.viewpoint = Some(guess(&tape, 95.0, truth.azimuth.to_degrees(), far));
        predicted.place = tape.constant(arr2(&[[1.0, 0.3, 0.3]]));
        let found = system.poses(&tape, &predicted, std::slice::from_ref(&sample))[0];
        assert!((found.viewpoint(lens).azimuth - truth.azimuth).abs() < 1e-3, "{found:?}");
        assert!((found.scale / pose.scale - 1.0).abs() < 0.05, "{found:?} {pose:?}");
        for k in 0..2 {
            assert!((found.place[k] - pose.place[k]).abs() < 0.03, "{found:?} {pose:?}");
        }
        // With one guess there is nothing to choose.
        let one = McmrConfig { camera_hypotheses: 1, ..system.config.clone() };
        let system = Mcmr { config: one, ..system };
        let found = system.poses(&tape, &predicted, std::slice::from_ref(&sample))[0];
        assert!((found.viewpoint(lens).azimuth - 95.0_f64.to_radians()).abs() < 1e-3);
    }

    /// From its epoch on, training draws with the guess for the direction that is nearest to the rough camera, however likely it is
    /// held; before, with the rough one. What is compared with a mirrored image is drawn mirrored.
    #[test]
    fn training_draws_with_its_own_cameras() {
        let own = McmrConfig { own_cameras_at: Some(3), ..McmrConfig::default() };
        let (system, data) = system(own);
        let lens = lens_of(&system.config);
        let mut sample =
            data.photo(data.trained()[0]).unwrap().plain(Subset::Train, &system.config);
        let tape = Tape::eval();
        let mut predicted = system.predicted(&tape, &[&sample]);
        predicted.place = tape.constant(arr2(&[[1.0, 0.1, -0.2]]));
        let spacing = 360.0 / DIRECTIONS as f64;
        let rough = sample.pose.viewpoint(lens);
        let near = (rough.azimuth.to_degrees() / spacing).round() * spacing + 9.0;
        predicted.viewpoint = Some(guess(&tape, near + 180.0, near, rough));
        let drawn = |epoch: u64, sample: &Sample| {
            system.training_cameras(&tape, &predicted, &[sample], epoch).value().to_owned()
        };
        let same = |found: &ndarray::ArrayD<f32>, pose: Pose| {
            let expected = pose.projection(lens);
            let far = found.iter().zip(expected).find(|(a, b)| (*a - b).abs() > 1e-4);
            assert!(far.is_none(), "{found:?} {expected:?}");
        };
        same(&drawn(2, &sample), sample.pose);
        let viewpoint = Viewpoint { azimuth: near.to_radians(), ..rough };
        let own =
            Pose::from_viewpoint(&viewpoint, [0.1, -0.2].map(|x: f64| f64::from(x as f32)), lens);
        same(&drawn(3, &sample), own);
        sample.turned = true;
        same(&drawn(2, &sample), sample.pose.flipped());
        same(&drawn(3, &sample), own.flipped());
    }

    fn mean(views: &[Viewpoint], of: impl Fn(&Viewpoint) -> f64) -> f64 {
        views.iter().map(of).sum::<f64>() / views.len() as f64
    }

    #[test]
    fn viewpoints_begin_where_the_data_is() {
        let (mut system, data) = system(McmrConfig::default());
        system.camera_begins_at(&data).unwrap();
        let lens = lens_of(&system.config);
        let samples: Vec<Sample> = data
            .trained()
            .iter()
            .map(|&object| data.photo(object).unwrap().plain(Subset::Train, &system.config))
            .collect();
        let tape = Tape::eval();
        let guess = system.predicted(&tape, &samples.iter().collect::<Vec<_>>()).viewpoint.unwrap();
        let views: Vec<Viewpoint> = samples.iter().map(|s| s.pose.viewpoint(lens)).collect();
        let found: Array2<f32> = Array2::from_shape_fn((2, samples.len()), |(k, i)| {
            [guess.elevation, guess.log_distance][k].value()[[i]]
        });
        for i in 0..samples.len() {
            assert!((f64::from(found[[0, i]]) - mean(&views, |v| v.elevation)).abs() < 0.15);
            assert!((f64::from(found[[1, i]]) - mean(&views, |v| v.distance.ln())).abs() < 0.15);
        }
    }
}
