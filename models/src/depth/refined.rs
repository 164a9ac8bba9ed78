//! A system that refines meshes by what an image shows, whatever they begin with.

use std::sync::Arc;

use autodiff_lite::{Module, Tape, Var, Visitor, VisitorMut, join_path};
use datasets::{SurfacePoints, View};
use diff_raster::Scratch;
use mesh_core::TriMesh;
use ndarray::{Array3, ArrayD, arr0};
use nets::{Init, MeshRefinementHead, NormKind};
use recon::scene::scene_of;
use train::{
    Compile, Compiled, DataError, DataSummary, Draw, Inherited, LossError, Metric, PredictError,
    Shown, Source, StepInfo, Subset, Summary, System, Terms,
};

use super::config::RefineConfig;
use super::depth_targets::{DepthTargets, Known};
use super::encoder::Encoder;
use super::mesh_init::{MeshInit, tetrahedra};
use super::packed::Packed;
use super::places::published_places;
use super::rendered::{Wanted, depth_difference, draw, pixel_difference};
use super::residuals::depth_residuals;
use super::scenes::{Scene, Scenes};
use super::stage_meshes::{StageMeshes, divided, mesh, moved};
use super::surface::{SurfaceTerms, Truth, color_difference, compared, roughness};
use crate::instance::Instance;
use crate::paired::InputImage;
use crate::predict::{PredictInput, Prediction};
use crate::pretrained::unusable;
use crate::stacked::stacked;

/// Places beyond so many half-widths of the image say no more than that they are outside.
const OUTSIDE: f32 = 3.0;
/// What the random meshes of a step draw by, beside its stages.
const TETRAHEDRA: u64 = 1 << 32;

/// A backbone, what gives the first meshes, and the stages that refine them.
#[derive(Debug)]
pub struct Refined<B: MeshInit> {
    pub(super) config: B::Config,
    seed: u64,
    pub(super) encoder: Encoder,
    pub(super) mesh_init: B,
    head: MeshRefinementHead,
    pub(super) scratch: Scratch,
}

impl<B: MeshInit> Module<f32> for Refined<B> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<f32>) {
        self.encoder.visit(&join_path(path, "encoder"), visitor);
        self.mesh_init.visit(&join_path(path, "beginning"), visitor);
        self.head.visit(&join_path(path, "mesh_head"), visitor);
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<f32>) {
        self.encoder.visit_mut(&join_path(path, "encoder"), visitor);
        self.mesh_init.visit_mut(&join_path(path, "beginning"), visitor);
        self.head.visit_mut(&join_path(path, "mesh_head"), visitor);
    }
}

/// All that the network says of a batch.
pub(super) struct Forward<'t> {
    pub(super) logits: Option<Var<'t>>,
    /// The meshes that refinement begins with.
    pub(super) first: StageMeshes<'t>,
    pub(super) stages: Vec<StageMeshes<'t>>,
    /// Of the last stage's vertices, `[1, ΣV, 3]`.
    pub(super) colors: Option<Var<'t>>,
    /// `[N, 3, 4]`
    pub(super) cameras: Var<'t>,
}

impl<'t> Forward<'t> {
    pub(super) fn last(&self) -> &StageMeshes<'t> {
        self.stages.last().unwrap_or(&self.first)
    }
}

impl<B: MeshInit> Refined<B> {
    pub(super) fn refine(&self) -> &RefineConfig {
        B::refine(&self.config)
    }

    /// The options.
    pub fn config(&self) -> &B::Config {
        &self.config
    }

    pub(super) fn forward<'t>(&self, tape: &'t Tape, scenes: &[&Scene]) -> Forward<'t> {
        self.forward_from(tape, scenes, None)
    }

    /// The same; with a seed from random meshes, whatever the cells say.
    fn forward_from<'t>(
        &self,
        tape: &'t Tape,
        scenes: &[&Scene],
        random: Option<u64>,
    ) -> Forward<'t> {
        let lenses = scenes.iter().map(|scene| &scene.image.lens[..]);
        let cameras = stacked(tape, lenses, &[scenes.len(), 3, 4]);
        let maps = tape.scope("encoder", || self.encoder.maps(tape, scenes));
        let initial = self.mesh_init.init(maps[3], scenes);
        let (packed, positions) = match random {
            Some(seed) => tetrahedra(tape, scenes.len(), seed),
            None => (initial.packed, initial.positions),
        };
        let first = StageMeshes { packed, positions, before: positions };
        let mut now = first.clone();
        let (mut hidden, mut colors) = (None, None);
        let mut stages = Vec::new();
        for (i, stage) in self.head.stages.iter().enumerate() {
            if let Some(finer) = (i > 0).then(|| self.mesh_init.divided(i - 1)).flatten() {
                (now, hidden) = divided(&now, hidden, vec![finer; scenes.len()]);
            }
            let packed = &now.packed;
            let place = if self.refine().published_places {
                published_places(packed.spread(now.positions), cameras)
            } else {
                places(packed, now.positions, cameras, scenes)
            };
            let refined = moved(stage, &mut now, &maps, (place, self.told(place, scenes), hidden));
            hidden = Some(refined.hidden);
            colors = refined.color;
            stages.push(now.clone());
        }
        Forward { logits: initial.logits, first, stages, colors, cameras }
    }

    /// What vertices are told of themselves: their places, and what there is to say of these.
    fn told<'t>(&self, place: Var<'t>, scenes: &[&Scene]) -> Var<'t> {
        let config = self.refine();
        if !config.depth_residuals {
            return place;
        }
        let residuals = depth_residuals(place, scenes, (config.depth, config.blind));
        place.tape().concat(&[place, residuals], 2)
    }

    /// The mesh of one image in the frame of its camera, coloured where the last stage knows colours; and the logits of
    /// its cells. Moved apart where it passes through itself, if the options say so.
    pub fn mesh_of(&self, scene: &Scene) -> (TriMesh, Vec<f32>) {
        let tape = Tape::eval();
        let forward = self.forward(&tape, &[scene]);
        let logits = forward.logits.map(|logits| logits.value().iter().copied().collect());
        let mesh = mesh(forward.last(), forward.colors);
        (self.refine().pairs.finished(mesh), logits.unwrap_or_default())
    }

    /// The mesh of one image as the network puts it out, and the meshes before and after each stage, without
    /// colours; all in the frame of the camera.
    pub fn mesh_and_stages_of(&self, scene: &Scene) -> (TriMesh, Vec<TriMesh>) {
        let tape = Tape::eval();
        let forward = self.forward(&tape, &[scene]);
        let all = std::iter::once(&forward.first).chain(&forward.stages);
        let stages = all.map(|meshes| mesh(meshes, None)).collect();
        (mesh(forward.last(), forward.colors), stages)
    }

    /// The first view as the network takes it. Its depth is what the network is given: planar depth, or, of a network for
    /// estimates, one over a disparity of any scale and shift.
    pub(crate) fn scene(&self, views: &[View]) -> Result<Scene, PredictError> {
        let view = views.first().ok_or(PredictError::NoView)?;
        let (config, pairs) = (self.refine(), &self.refine().pairs);
        let image = InputImage::new(view, pairs.image_size, pairs.scale)?;
        if config.inputs() == 4 && image.depth.is_none() {
            let remedy = "this network was trained with depth, which --depth gives";
            return Err(PredictError::Missing { what: "depth", remedy });
        }
        let depth_targets = DepthTargets::new(&image, Known::Given, config, 0);
        Ok(Scene {
            image: Arc::new(image),
            depth_targets: Arc::new(depth_targets),
            truth: SurfacePoints::default(),
            colors: Vec::new(),
        })
    }

    /// Chamfer, normals and edges of all stages, and the colours of the last.
    fn surface_loss<'t>(
        &self,
        forward: &Forward<'t>,
        scenes: &[&Scene],
        at: StepInfo,
    ) -> (SurfaceTerms<'t>, Option<Var<'t>>) {
        let tape = forward.cameras.tape();
        let config = self.refine();
        let truth = Truth::new(tape, scenes);
        let share = 1.0 / forward.stages.len() as f32;
        let [mut chamfer, mut normal, mut edge, mut rough] = [const { Vec::new() }; 4];
        let mut color = None;
        for (i, stage) in forward.stages.iter().enumerate() {
            let seed = Draw::for_loss(self.seed, at, i as u64);
            let normals = config.normal_weight > 0.0;
            let (terms, sampled) = compared(&stage.packed, stage.positions, &truth, normals, seed);
            chamfer.push((share, terms.chamfer));
            edge.push((share, terms.edge));
            rough.extend(roughness(stage, config).map(|rough| (share, rough)));
            normal.extend(terms.normal.map(|normal| (share, normal)));
            if i + 1 == forward.stages.len() {
                let difference = |colors| color_difference(&stage.packed, colors, &sampled, scenes);
                color = forward.colors.and_then(difference);
            }
        }
        let sum = |terms: &[(f32, Var<'t>)]| tape.lincomb(terms);
        let some = |terms: &[(f32, Var<'t>)]| (!terms.is_empty()).then(|| sum(terms));
        let (normal, rough) = (some(&normal), some(&rough));
        (SurfaceTerms { chamfer: sum(&chamfer), normal, edge: sum(&edge), rough }, color)
    }

    fn drawn_loss<'t>(
        &self,
        forward: &Forward<'t>,
        scenes: &[&Scene],
    ) -> (Option<Var<'t>>, Option<Var<'t>>) {
        let config = self.refine();
        let depth = config.depth_weight > 0.0;
        if !depth && forward.colors.is_none() {
            return (None, None);
        }
        let silhouette = depth && config.coverage > 0.0;
        let colors = forward.colors.filter(|_| config.color_weight > 0.0);
        let (cameras, side) = (forward.cameras, config.pairs.image_size);
        let drawn = |stage: &StageMeshes<'t>, colors| {
            let wanted = Wanted { silhouette, colors };
            draw(&self.scratch, &stage.packed, stage.positions, cameras, side, wanted)
        };
        let last = drawn(forward.last(), colors);
        let image = pixel_difference(&last, scenes);
        if !depth {
            return (None, image);
        }
        let earlier = forward.stages.split_last().map_or(&[][..], |(_, earlier)| earlier);
        let earlier = if config.depth_of_all_stages { earlier } else { &[] };
        let share = 1.0 / (earlier.len() + 1) as f32;
        let each = earlier.iter().map(|stage| drawn(stage, None)).chain([last]);
        let each = each.map(|drawn| (share, depth_difference(&drawn, scenes, config)));
        let mean = each.collect::<Vec<(f32, Var<'t>)>>();
        (Some(forward.cameras.tape().lincomb(&mean)), image)
    }
}

/// Where vertices are seen, right and up over the image, and how deep in the volume, -1 to 1 each: `[N, Vmax, 3]`.
fn places<'t>(packed: &Packed, positions: Var<'t>, cameras: Var<'t>, scenes: &[&Scene]) -> Var<'t> {
    let tape = positions.tape();
    let seen = packed.spread(positions).project(cameras);
    let column = |of: &dyn Fn([f32; 2]) -> f32| {
        tape.constant(Array3::from_shape_fn((scenes.len(), 1, 1), |(n, _, _)| {
            of(scenes[n].depth_targets.ends)
        }))
    };
    // Linear in one over the depth, as the cells are.
    let factor = column(&|[near, far]| 2.0 / (far.recip() - near.recip()));
    let summand = column(&|[near, far]| -1.0 - 2.0 / near / (far.recip() - near.recip()));
    let nearest =
        scenes.iter().map(|scene| scene.depth_targets.ends[0]).fold(f32::INFINITY, f32::min);
    let depth = seen.slice_axis(2, 2..3).clamp(0.1 * nearest, f32::INFINITY);
    let depth = depth.recip().mul(factor).add(summand);
    let both = tape.concat(&[seen.slice_axis(2, 0..2), depth], 2);
    both.clamp(-OUTSIDE, OUTSIDE)
}

/// The cells' binary cross entropy, a mean over all of them.
fn cell_loss<'t>(logits: Var<'t>, scenes: &[&Scene]) -> Var<'t> {
    let cells = scenes.iter().flat_map(|scene| &scene.depth_targets.cells);
    let target: Vec<f32> = cells.map(|&bit| f32::from(u8::from(bit))).collect();
    let target = stacked(logits.tape(), std::iter::once(&target[..]), &logits.shape());
    (logits.softplus() - logits * target).mean()
}

impl<B: MeshInit> Compile for Refined<B> {
    fn compiled() -> Compiled<Self> {
        B::compiled()
    }
}

impl<B: MeshInit> System for Refined<B> {
    const NAME: &'static str = B::NAME;
    const PRESETS: &'static [(&'static str, &'static str)] = B::PRESETS;
    const BEST: &'static str = "chamfer";

    type Config = B::Config;
    type ReadOptions = datasets::ReadOptions;
    type Data = Scenes;
    type Sample = Scene;
    type Input = [View];
    type Prediction = TriMesh;

    fn check(config: &B::Config) -> Vec<String> {
        B::check(config)
    }

    fn summary(config: &B::Config) -> Summary {
        let refine = B::refine(config);
        let (side, channels) = (refine.pairs.image_size, refine.resnet().channels());
        let blocks = refine.resnet().blocks;
        let mut shapes =
            vec![("(1) input".to_owned(), format!("{side} x {side} x {}", refine.inputs()))];
        let name = format!("{:?}", refine.backbone).replace("Resnet", "ResNet-");
        for (k, side) in refine.sides().into_iter().enumerate() {
            let row = format!("({}) ({}) {name} conv{}_{}", k + 2, k + 1, k + 2, blocks[k]);
            shapes.push((row, format!("{side} x {side} x {}", channels[k])));
        }
        let (beginning, rows) = B::size(config);
        shapes.extend(rows);
        for stage in 0..refine.stages {
            let (row, from) = (stage + 9, stage + 8);
            let name =
                format!("({row}) (2), (3), (4), (5), ({from}) refinement stage {}", stage + 1);
            let color = refine.colors && stage + 1 == refine.stages;
            shapes.push((name, format!("V x {}, F x 3", if color { 6 } else { 3 })));
        }
        let [backbone, frozen] = refine.backbone_parameters();
        let trainable = backbone + beginning + refine.refinement_parameters();
        Summary { trainable, frozen, shapes }
    }

    fn new(config: &B::Config, seed: u64) -> Self {
        let init = Init::new(seed);
        let refine = B::refine(config);
        let channels = refine.resnet().channels().iter().sum();
        let (hidden, depth) = (refine.hidden, refine.graph_convolutions);
        let at = init.at("mesh_head");
        let sizes = [channels, hidden, refine.places()];
        let mut head = MeshRefinementHead::with_places(&at, sizes, refine.stages, depth);
        if refine.colors {
            head = head.with_color(&at);
        }
        Self {
            encoder: Encoder::new(&init.at("encoder"), refine),
            mesh_init: B::new(config, &init.at("beginning")),
            head,
            scratch: Scratch::default(),
            config: config.clone(),
            seed,
        }
    }

    fn init_from_data(
        &mut self,
        _: &Scenes,
        inherited: Option<&Inherited>,
    ) -> Result<(), DataError> {
        let begins = inherited.is_none_or(|i| !i.has("encoder"));
        if let Some(path) = self.refine().weights.clone().filter(|_| begins) {
            let loaded = self.encoder.load(&path);
            loaded.map_err(unusable)?;
        }
        Ok(())
    }

    fn open(
        config: &B::Config,
        source: &Source<'_, Self::ReadOptions>,
    ) -> Result<Scenes, DataError> {
        Scenes::open(B::refine(config), B::cells(config), source)
    }

    fn fingerprint(data: &Scenes) -> u64 {
        data.pairs().fingerprint()
    }

    fn epoch_len(&self, data: &Scenes) -> usize {
        data.pairs().trained().len()
    }

    fn draw(&self, data: &Scenes, draw: &Draw) -> Result<Scene, DataError> {
        let object = data.pairs().trained()[draw.item];
        data.draw(object, self.refine().pairs.points, &mut draw.rng())
    }

    fn name_of(sample: &Scene) -> String {
        sample.image.name.clone()
    }

    fn loss<'t>(
        &self,
        tape: &'t Tape,
        batch: &[Scene],
        at: StepInfo,
    ) -> Result<Terms<'t>, LossError> {
        B::instance(self).loss(tape, batch, at)
    }

    fn data_summary(data: &Scenes) -> Option<DataSummary> {
        Some(data.pairs().summary())
    }

    fn evaluate(&self, data: &Scenes, subset: Subset) -> Result<Vec<Metric>, DataError> {
        B::instance(self).evaluate(data, subset)
    }

    fn show(&self, data: &Scenes, subset: Subset) -> Result<Shown, DataError> {
        B::instance(self).show(data, subset)
    }

    fn coupling(&self) -> Option<&'static str> {
        let text = "`norm` is \"batch\", whose statistics are those of the batch (`norm = \"group\"` and `\"frozen\"` have none)";
        (self.refine().norm == NormKind::Batch).then_some(text)
    }

    /// The mesh in the world of the camera, from the first view.
    fn predict(&self, views: &[View]) -> Result<TriMesh, PredictError> {
        B::instance(self).predict(views)
    }
}

impl<B: MeshInit> Instance<Scenes, Scene> for Refined<B> {
    fn apply(&self, input: &PredictInput) -> Result<Prediction, PredictError> {
        self.applied(input)
    }

    fn image_side_outputs(&self, inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>> {
        self.image_side(inputs)
    }

    fn loss<'t>(
        &self,
        tape: &'t Tape,
        batch: &[Scene],
        at: StepInfo,
    ) -> Result<Terms<'t>, LossError> {
        let scenes: Vec<&Scene> = batch.iter().collect();
        let config = self.refine();
        let random = at.step < B::random_steps(&self.config);
        let random = random.then(|| Draw::for_loss(self.seed, at, TETRAHEDRA));
        let forward = self.forward_from(tape, &scenes, random);
        let (surface, color) = self.surface_loss(&forward, &scenes, at);
        let (depth, image) = self.drawn_loss(&forward, &scenes);
        let zero = || tape.constant(arr0(0.0));
        let mut terms = Terms::new().with("chamfer", config.chamfer_weight, surface.chamfer);
        if let Some(logits) = forward.logits {
            terms = terms.with("voxel", B::voxel_weight(&self.config), cell_loss(logits, &scenes));
        }
        terms = terms.with("edge", config.edge_weight, surface.edge);
        if config.normal_weight > 0.0 {
            terms = terms.with("normal", config.normal_weight, surface.normal.unwrap_or_else(zero));
        }
        if let Some(rough) = surface.rough {
            terms = terms.with("laplacian", 1.0, rough);
        }
        if let Some(depth) = depth {
            terms = terms.with("depth", config.depth_weight, depth);
        }
        if config.colors {
            terms = terms.with("color", config.color_weight, color.unwrap_or_else(zero)).with(
                "picture",
                config.color_weight,
                image.unwrap_or_else(zero),
            );
        }
        Ok(terms)
    }

    fn evaluate(&self, data: &Scenes, subset: Subset) -> Result<Vec<Metric>, DataError> {
        Ok(self.scored(data, subset)?.metrics())
    }

    fn show(&self, data: &Scenes, subset: Subset) -> Result<Shown, DataError> {
        let (_, scene) = data.trial(subset, 1, 0)?;
        let (mesh, _) = self.mesh_of(&scene);
        let mesh = scene.depth_targets.frame.mesh_in_world(mesh);
        Ok(Shown { views: self.gallery(data, subset)?, scene: Some(scene_of(&mesh)) })
    }

    fn predict(&self, views: &[View]) -> Result<TriMesh, PredictError> {
        self.predicted(views)
    }
}
