//! Scores on what was not trained on, and what there is to show of them.

use losses::metrics::{DepthError, Preset, depth_error, evaluate, point_distances};
use mesh_core::{ByteImage, DepthMap, Image, TriMesh};
use train::report::ViewPair;
use train::{Better, DataError, Metric, Subset};

use super::depth_targets::rendered;
use super::mesh_init::MeshInit;
use super::refined::Refined;
use super::scenes::{Scene, Scenes, overlap};
use crate::paired::mesh_above_image;
use crate::parts::{mean_metric, of_all};
use crate::quality::Quality;

/// Objects shown together.
const SHOWN: usize = 6;
/// What a pixel of the object costs where the mesh is not seen, in the unit of the frame: half of an object.
const PENALTY: f64 = 0.5;

/// The scores of one image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// Mesh R-CNN's protocol: the truth's longest edge is 10, 10,000 points each, mean squared distances of both ways.
    pub chamfer: f64,
    /// F-scores at distances of 0.1, 0.3 and 0.5 in that scale, shares.
    pub f_scores: [f64; 3],
    /// Mean absolute cosine of normals at nearest points, of both ways.
    pub normals: f64,
    /// Pixel2Mesh's protocol: lengths times 0.57, the same mean, times 1000.
    pub chamfer_p2m: f64,
    /// F-scores at squared distances of 1e-4 and 2e-4 in that scale, shares.
    pub f_scores_p2m: [f64; 2],
    /// Mean absolute difference of depth over the true mask, in the unit of the frame; a pixel that is not covered counts
    /// 0.5.
    pub depth: f64,
    /// The same over the pixels that are covered alone; not a number where none is.
    pub depth_covered: f64,
    /// The share of the true mask that is not covered.
    pub uncovered: f64,
    /// Mean absolute difference of vertex colours from the nearest true point's, a mean over channels; none without
    /// colours.
    pub color: Option<f64>,
    /// Intersection over union of the cells with the true ones, and that of the training's mean shape; none without a
    /// voxel branch.
    pub iou: Option<[f64; 2]>,
    /// What of the surface runs through itself or is folded over.
    pub quality: Quality,
}

/// The scores of the images of a subset.
#[derive(Clone, Debug, Default)]
pub struct Scored {
    /// One an image: its object and its scores.
    pub each: Vec<(usize, Score)>,
    /// What the object of each is called: category and name.
    pub names: Vec<String>,
}

impl Scored {
    /// The means over objects, of each the mean over its images.
    pub fn mean(&self) -> Score {
        let mean =
            |f: &dyn Fn(&Score) -> f64| self.metric("", Better::Smaller, &|s| Some(f(s))).value;
        let some = |f: &dyn Fn(&Score) -> Option<f64>| {
            let metric = self.metric("", Better::Smaller, f);
            (!metric.by_object.is_empty()).then_some(metric.value)
        };
        let iou = [0, 1].map(|k| some(&move |s| s.iou.map(|iou| iou[k])));
        Score {
            chamfer: mean(&|s| s.chamfer),
            f_scores: [0, 1, 2].map(|k| mean(&move |s| s.f_scores[k])),
            normals: mean(&|s| s.normals),
            chamfer_p2m: mean(&|s| s.chamfer_p2m),
            f_scores_p2m: [0, 1].map(|k| mean(&move |s| s.f_scores_p2m[k])),
            depth: mean(&|s| s.depth),
            depth_covered: some(&|s| Some(s.depth_covered).filter(|error| error.is_finite()))
                .unwrap_or(f64::NAN),
            uncovered: mean(&|s| s.uncovered),
            color: some(&|s| s.color),
            iou: iou[0].zip(iou[1]).map(|(own, mean)| [own, mean]),
            quality: Quality {
                self_intersecting: mean(&|s| s.quality.self_intersecting),
                folded: mean(&|s| s.quality.folded),
            },
        }
    }

    /// The mean over objects of what their images have, with the value of each.
    fn metric(&self, name: &str, better: Better, of: &dyn Fn(&Score) -> Option<f64>) -> Metric {
        let each = self.each.iter().zip(&self.names);
        mean_metric(name, better, each.filter_map(|((_, score), name)| Some((&**name, of(score)?))))
    }

    /// The means by name, with the values of the objects.
    pub fn metrics(&self) -> Vec<Metric> {
        let larger =
            |name: &str, of: fn(&Score) -> Option<f64>| self.metric(name, Better::Larger, &of);
        let smaller =
            |name: &str, of: fn(&Score) -> Option<f64>| self.metric(name, Better::Smaller, &of);
        let mut metrics = vec![
            smaller("chamfer", |s| Some(s.chamfer)),
            larger("f-0.1", |s| Some(s.f_scores[0])),
            larger("f-0.3", |s| Some(s.f_scores[1])),
            larger("f-0.5", |s| Some(s.f_scores[2])),
            larger("normals", |s| Some(s.normals)),
            smaller("chamfer-p2m", |s| Some(s.chamfer_p2m)),
            larger("f-p2m", |s| Some(s.f_scores_p2m[0])),
            larger("f-p2m-2", |s| Some(s.f_scores_p2m[1])),
            smaller("depth-error", |s| Some(s.depth)),
            smaller("depth-error-covered", |s| {
                Some(s.depth_covered).filter(|error| error.is_finite())
            }),
            smaller("uncovered", |s| Some(s.uncovered)),
            smaller("color-error", |s| s.color),
            larger("voxel-iou", |s| Some(s.iou?[0])),
            larger("mean-shape-iou", |s| Some(s.iou?[1])),
            smaller("self-intersecting", |s| Some(s.quality.self_intersecting)),
            smaller("folded", |s| Some(s.quality.folded)),
        ];
        // What no image has, without colours or cells, is no score.
        metrics.retain(|metric| !metric.by_object.is_empty());
        metrics
    }

    /// Scores of whatever is said of each scene of a subset, `views` of each object; `of` is also told the true mesh in the
    /// scene's frame.
    ///
    /// # Errors
    /// If a file cannot be read, there is nothing for that, or `of` says so.
    pub fn of(
        data: &Scenes,
        (subset, views): (Subset, usize),
        of: impl Fn(&Scene, &TriMesh) -> Result<Score, DataError> + Sync,
    ) -> Result<Self, DataError> {
        let one = |k: usize| -> Result<(usize, Score), DataError> {
            let (object, scene) = data.trial(subset, views, k)?;
            let surface = data.mesh(object)?;
            let mesh = surface.mesh.as_ref().expect("an object without a mesh is an error");
            let truth = scene.depth_targets.frame.mesh_placed(mesh);
            Ok((object, of(&scene, &truth)?))
        };
        let count = data.pairs().trials(subset, views)?;
        let each: Vec<(usize, Score)> = of_all(count, one)?;
        let names = each.iter().map(|(object, _)| data.pairs().object_name(*object)).collect();
        Ok(Self { each, names })
    }
}

impl Score {
    /// Of any mesh, against a scene and its true mesh, all in the scene's frame.
    pub fn of(mesh: &TriMesh, scene: &Scene, truth: &TriMesh) -> Self {
        let mut score = distances(mesh, truth, scene.depth_targets.frame.scale());
        if let Some(error) = depth_of(mesh, scene) {
            (score.depth, score.uncovered) = (error.mean, error.uncovered);
            score.depth_covered =
                (error.mean - PENALTY * error.uncovered) / (1.0 - error.uncovered);
        }
        score.color = color_error(mesh, scene);
        score.quality = Quality::of(mesh);
        score
    }
}

impl<B: MeshInit> Refined<B> {
    /// Scores on a subset, image by image.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    pub fn scored(&self, data: &Scenes, subset: Subset) -> Result<Scored, DataError> {
        let views = self.refine().pairs.scored_views;
        let mean_shape = if B::cells(&self.config) > 0 { data.mean_shape()? } else { &[] };
        Scored::of(data, (subset, views), |scene, truth| Ok(self.score(scene, truth, mean_shape)))
    }

    /// Of one scene; `truth` is its mesh in the frame.
    fn score(&self, scene: &Scene, truth: &TriMesh, mean_shape: &[bool]) -> Score {
        let (mesh, logits) = self.mesh_of(scene);
        let mut score = Score::of(&mesh, scene, truth);
        if !scene.depth_targets.cells.is_empty() && !logits.is_empty() {
            let own = self.mesh_init.occupied_cells(&logits);
            let cells = &scene.depth_targets.cells;
            score.iou = Some([overlap(&own, cells), overlap(mean_shape, cells)]);
        }
        score
    }

    /// Some images spread over all of a subset: the mesh from the image's camera above the image.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    pub fn gallery(&self, data: &Scenes, subset: Subset) -> Result<Vec<ViewPair>, DataError> {
        let count = data.pairs().trials(subset, 1)?;
        let shown = SHOWN.min(count);
        let one = |i: usize| {
            let (object, scene) = data.trial(subset, 1, i * count / shown)?;
            let surface = data.mesh(object)?;
            let truth = surface.mesh.as_ref().expect("an object without a mesh is an error");
            let frame = &scene.depth_targets.frame;
            let (mesh, _) = self.mesh_of(&scene);
            let scores = distances(&mesh, &frame.mesh_placed(truth), frame.scale());
            let caption = format!("{}: Chamfer {:.3}", scene.image.name, scores.chamfer);
            Ok(mesh_above_image(&scene.image, &frame.mesh_in_world(mesh), caption))
        };
        (0..shown).map(one).collect()
    }
}

/// Both protocols; `scale` is what the frame multiplied lengths by, which Pixel2Mesh's protocol undoes.
pub(super) fn distances(mesh: &TriMesh, truth: &TriMesh, scale: f64) -> Score {
    let unit = [(1.0 / scale) as f32; 3];
    let (mesh, truth) = (mesh.clone().scaled(unit), truth.clone().scaled(unit));
    let report = |preset: Preset| evaluate(&mesh, &truth, &preset.protocol(0)).ok();
    let far = f64::NAN;
    let depths = Score { depth: far, depth_covered: far, ..Score::default() };
    let mut score = Score { chamfer: far, chamfer_p2m: far, ..depths };
    if let (Some(own), Some(p2m)) = (report(Preset::MeshRcnn), report(Preset::P2m)) {
        score.chamfer = own.chamfer.unwrap_or(far);
        score.f_scores = std::array::from_fn(|k| own.f_scores[k].f_score);
        score.normals = own.normal_consistency.unwrap_or(far);
        score.chamfer_p2m = 1e3 * p2m.chamfer.unwrap_or(far);
        score.f_scores_p2m = std::array::from_fn(|k| p2m.f_scores[k].f_score);
    }
    score
}

/// At the image's camera, over the pixels of its mask.
pub(super) fn depth_of(mesh: &TriMesh, scene: &Scene) -> Option<DepthError> {
    let side = scene.image.camera.width;
    let map = |data: Vec<f32>| DepthMap { height: side, width: side, data };
    let data = scene.image.mask.clone();
    let mask = Image::from(&ByteImage { height: side, width: side, channels: 1, data });
    let found = map(rendered(mesh, &scene.image));
    let known = map(scene.depth_targets.depth.clone());
    depth_error(&found, &known, &mask, PENALTY)
}

pub(super) fn color_error(mesh: &TriMesh, scene: &Scene) -> Option<f64> {
    let own = mesh.colors.as_ref()?;
    if scene.colors.len() != scene.truth.positions.len() || scene.colors.is_empty() {
        return None;
    }
    let nearest = point_distances(&mesh.positions, &scene.truth.positions).accuracy_index;
    let away = |(a, &i): (&[f32; 3], &u32)| -> f64 {
        let b = scene.colors[i as usize];
        (0..3).map(|c| f64::from((a[c] - b[c]).abs())).sum::<f64>() / 3.0
    };
    Some(own.iter().zip(&nearest).map(away).sum::<f64>() / own.len().max(1) as f64)
}
