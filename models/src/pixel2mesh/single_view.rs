//! A system that makes a mesh from one image, whatever deforms it.

use autodiff_lite::{Module, Tape, Var, Visitor, VisitorMut};
use datasets::View;
use mesh_core::TriMesh;
use ndarray::ArrayD;
use nets::{Init, Pixel2MeshEncoder, ViewpointGuess, ViewpointHead};
use ode_deform::solve::{SolveError, Stats};
use recon::scene::scene_of;
use train::{
    Compile, Compiled, DataError, DataSummary, Draw, Inherited, LossError, Metric, PredictError,
    Shown, Source, StepInfo, Subset, Summary, System, Terms,
};

use super::config::{EncoderForm, SharedConfig};
use super::decay::half_squares;
use super::deformer::{Deformed, Deformer, Run};
use super::projection::published_lens;
use super::sums::Sums;
use super::template::Template;
use crate::instance::Instance;
use crate::paired::{FrameKind, InputImage, Pair, Pairs};
use crate::predict::{PredictInput, Prediction};
use crate::stacked::stacked;
use crate::viewpoint::DIRECTIONS;

/// An encoder, a template and what deforms it.
#[derive(Debug)]
pub struct SingleView<D: Deformer> {
    pub(super) config: D::Config,
    seed: u64,
    pub(super) encoder: Pixel2MeshEncoder,
    pub(super) deformer: D,
    pub(super) template: Template,
    /// What estimates cameras, where the configuration asks for it.
    pub(super) viewpoint: Option<ViewpointHead>,
}

impl<D: Deformer> Module<f32> for SingleView<D> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<f32>) {
        self.encoder.visit(&autodiff_lite::join_path(path, "encoder"), visitor);
        self.deformer.visit(&autodiff_lite::join_path(path, "deformer"), visitor);
        self.viewpoint.visit(&autodiff_lite::join_path(path, "viewpoint"), visitor);
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<f32>) {
        self.encoder.visit_mut(&autodiff_lite::join_path(path, "encoder"), visitor);
        self.deformer.visit_mut(&autodiff_lite::join_path(path, "deformer"), visitor);
        self.viewpoint.visit_mut(&autodiff_lite::join_path(path, "viewpoint"), visitor);
    }
}

impl<D: Deformer> SingleView<D> {
    /// The options that both ways to deform share.
    pub fn shared(&self) -> &SharedConfig {
        D::shared(&self.config)
    }

    /// The options.
    pub fn config(&self) -> &D::Config {
        &self.config
    }

    /// What deformation begins with.
    pub fn template(&self) -> &Template {
        &self.template
    }

    /// What deforms.
    pub fn deformer(&self) -> &D {
        &self.deformer
    }

    /// The same with other options of the deformation: other steps or another method, with the same parameters.
    ///
    /// # Panics
    /// If the parameters of such a deformation have other shapes.
    #[must_use]
    pub fn with_config(&self, config: &D::Config) -> Self {
        let mut other = Self::new(config, self.seed);
        other.template = self.template.clone();
        let mut values = Vec::new();
        self.visit("", &mut |path: &str, param: &autodiff_lite::Param| {
            values.push((path.to_owned(), param.clone()));
        });
        let mut values = values.into_iter();
        other.visit_mut("", &mut |path: &str, param: &mut autodiff_lite::Param| {
            let (from, value) = values.next().expect("as many parameters");
            assert!(from == path && value.shape() == param.shape(), "with_config: {path} differs");
            param.as_slice_mut().copy_from_slice(value.as_slice());
        });
        other
    }

    /// Meshes of images, each in the frame of its image.
    pub(super) fn deformed<'t>(
        &self,
        tape: &'t Tape,
        images: &[&InputImage],
        run: Run,
    ) -> Result<Deformed<'t>, SolveError> {
        let n = images.len();
        let pixels = self.pixels(tape, images);
        let camera = match self.shared().projection {
            Some(lens) => published_lens(tape, n, lens),
            None => stacked(tape, images.iter().map(|p| &p.lens[..]), &[n, 3, 4]),
        };
        let mut maps = tape.scope("encoder", || maps(&self.encoder, pixels));
        let scale = self.shared().feature_scale as f32;
        if scale != 1.0 {
            maps = maps.map(|map| map * scale);
        }
        let inputs: Vec<Var<'t>> = std::iter::once(camera).chain(maps).collect();
        self.deformer.deform(&self.template, &inputs, run)
    }

    /// `[N, S, S, 3]`.
    pub(super) fn pixels<'t>(&self, tape: &'t Tape, images: &[&InputImage]) -> Var<'t> {
        let side = self.shared().pairs.image_size;
        let pixels = images.iter().map(|p| &p.pixels[..]);
        stacked(tape, pixels, &[images.len(), side, side, 3])
    }

    /// The mesh of one image by its own camera, in its frame, and the work that it took.
    ///
    /// # Errors
    /// If an integration does not come to its end.
    pub(super) fn mesh_told(&self, image: &InputImage) -> Result<(TriMesh, Stats), SolveError> {
        let tape = Tape::eval();
        let deformed = self.deformed(&tape, &[image], Run::Test)?;
        let last = deformed.stages.last().expect("a stage");
        Ok((self.mesh(last.level, last.positions), deformed.stats))
    }

    /// The mesh of one image by its own camera, and meshes on the way from the ellipsoid to it, in the frame of the
    /// image.
    ///
    /// # Errors
    /// If an integration does not come to its end.
    pub fn mesh_and_sequence_of(
        &self,
        image: &InputImage,
        frames: usize,
    ) -> Result<(TriMesh, Vec<TriMesh>), SolveError> {
        let tape = Tape::eval();
        let run = Run::Sequence { frames: frames.max(2) };
        let deformed = self.deformed(&tape, &[image], run)?;
        let level = |mesh: &Var<'_>| {
            let vertices = mesh.shape()[1];
            let of = |level: &super::Level| level.mesh.positions.len() == vertices;
            self.template.levels.iter().position(of).expect("a level of the template")
        };
        let last = deformed.stages.last().expect("a stage");
        let sequence = deformed.sequence.iter().map(|mesh| self.mesh(level(mesh), *mesh));
        Ok((self.mesh(last.level, last.positions), sequence.collect()))
    }

    fn mesh(&self, level: usize, positions: Var<'_>) -> TriMesh {
        let value = positions.value();
        let rows = value.as_slice().as_chunks::<3>().0.to_vec();
        TriMesh::new(rows, self.template.levels[level].mesh.faces.clone())
    }
}

/// The encoder's maps, finest first. Like [`guess`] not generic, so that it is compiled here for both systems.
#[inline(never)]
pub(super) fn maps<'t>(encoder: &Pixel2MeshEncoder, images: Var<'t>) -> [Var<'t>; 4] {
    encoder.forward(images)
}

/// From where images were taken.
#[inline(never)]
pub(super) fn guess<'t>(head: &ViewpointHead, images: Var<'t>) -> ViewpointGuess<'t> {
    head.forward(images)
}

impl<D: Deformer> SingleView<D> {
    /// With the pulls of weights towards zero that are asked for.
    fn decayed<'t>(&self, tape: &'t Tape, mut terms: Terms<'t>) -> Terms<'t> {
        let shared = self.shared();
        if shared.encoder_decay > 0.0 {
            let kernel = |path: &str| path.contains("conv") && path.ends_with("weight");
            let squares = half_squares(tape, &self.encoder, kernel);
            terms = terms.with("encoder-decay", shared.encoder_decay, squares);
        }
        if shared.graph_decay > 0.0 {
            let squares = half_squares(tape, &self.deformer, |_| true);
            terms = terms.with("graph-decay", shared.graph_decay, squares);
        }
        terms
    }
}

impl<D: Deformer> Compile for SingleView<D> {
    fn compiled() -> Compiled<Self> {
        D::compiled()
    }
}

impl<D: Deformer> System for SingleView<D> {
    const NAME: &'static str = D::NAME;
    const PRESETS: &'static [(&'static str, &'static str)] = D::PRESETS;
    const BEST: &'static str = "chamfer";

    type Config = D::Config;
    type ReadOptions = datasets::ReadOptions;
    type Data = Pairs;
    type Sample = Pair;
    type Input = [View];
    type Prediction = TriMesh;

    fn check(config: &D::Config) -> Vec<String> {
        D::check(config)
    }

    fn summary(config: &D::Config) -> Summary {
        let shared = D::shared(config);
        let (side, channels) = (shared.pairs.image_size, &shared.channels);
        let maps: Vec<String> = (2..6)
            .map(|stage| {
                let side = side.div_ceil(1 << stage);
                format!("[N, {side}, {side}, {}]", channels[stage])
            })
            .collect();
        let (deformer, inside) = D::size(config);
        let mut shapes = vec![
            ("image".to_owned(), format!("[N, {side}, {side}, 3]")),
            ("maps".to_owned(), maps.join(", ")),
        ];
        shapes.extend(inside);
        let vertices = 2 + (156 - 2) * 4_usize.pow(shared.level);
        shapes.push(("mesh".to_owned(), format!("[N, {vertices}, 3], {} faces", 2 * vertices - 4)));
        let encoder = shared.encoder_parameters();
        let camera = shared.camera_parameters();
        if camera > 0 {
            let directions =
                format!("{DIRECTIONS} directions, a turn from each, elevation, distance");
            shapes.push(("camera".to_owned(), directions));
            shapes.push(("trained in the camera head".to_owned(), camera.to_string()));
        }
        shapes.push(("trained in the encoder".to_owned(), encoder.to_string()));
        shapes.push(("trained in the deformation".to_owned(), deformer.to_string()));
        Summary { trainable: encoder + deformer + camera, frozen: 0, shapes }
    }

    fn new(config: &D::Config, seed: u64) -> Self {
        let init = Init::new(seed);
        let shared = D::shared(config);
        let template = match shared.frame {
            FrameKind::Camera => Template::new(shared.level),
            FrameKind::Object => Template::new(shared.level).about_origin(),
        };
        let at = init.at("encoder");
        let plain = Pixel2MeshEncoder::new(&at, shared.channels, shared.encoder_init);
        let encoder = match shared.encoder_form {
            EncoderForm::Plain => plain,
            EncoderForm::Residual => plain.residual(&at),
        };
        let deformer = D::new(config, &init.at("deformer"), &template);
        let head = || ViewpointHead::new(&init.at("viewpoint"), 3, DIRECTIONS);
        let viewpoint = shared.has_camera_head().then(head);
        Self { config: config.clone(), seed, encoder, deformer, template, viewpoint }
    }

    fn init_from_data(
        &mut self,
        data: &Pairs,
        inherited: Option<&Inherited>,
    ) -> Result<(), DataError> {
        if inherited.is_some_and(|i| i.has("viewpoint")) {
            return Ok(());
        }
        self.camera_begins_at(data)
    }

    fn open(
        config: &D::Config,
        source: &Source<'_, Self::ReadOptions>,
    ) -> Result<Pairs, DataError> {
        let shared = D::shared(config);
        Ok(Pairs::open(&shared.pairs, source)?.with_frame(shared.frame))
    }

    fn fingerprint(data: &Pairs) -> u64 {
        data.fingerprint()
    }

    fn epoch_len(&self, data: &Pairs) -> usize {
        data.trained().len()
    }

    fn draw(&self, data: &Pairs, draw: &Draw) -> Result<Pair, DataError> {
        let object = data.trained()[draw.item];
        data.draw(object, self.shared().pairs.points, &mut draw.rng())
    }

    fn name_of(sample: &Pair) -> String {
        sample.image.name.clone()
    }

    fn loss<'t>(
        &self,
        tape: &'t Tape,
        batch: &[Pair],
        at: StepInfo,
    ) -> Result<Terms<'t>, LossError> {
        D::instance(self).loss(tape, batch, at)
    }

    fn data_summary(data: &Pairs) -> Option<DataSummary> {
        Some(data.summary())
    }

    fn evaluate(&self, data: &Pairs, subset: Subset) -> Result<Vec<Metric>, DataError> {
        D::instance(self).evaluate(data, subset)
    }

    fn show(&self, data: &Pairs, subset: Subset) -> Result<Shown, DataError> {
        D::instance(self).show(data, subset)
    }

    /// The mesh in the world of the camera, from the first view.
    fn predict(&self, views: &[View]) -> Result<TriMesh, PredictError> {
        D::instance(self).predict(views)
    }
}

impl<D: Deformer> Instance<Pairs, Pair> for SingleView<D> {
    fn apply(&self, input: &PredictInput) -> Result<Prediction, PredictError> {
        self.applied(input)
    }

    fn image_side_outputs(&self, inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>> {
        self.image_side(inputs)
    }

    fn loss<'t>(
        &self,
        tape: &'t Tape,
        batch: &[Pair],
        at: StepInfo,
    ) -> Result<Terms<'t>, LossError> {
        let images: Vec<&InputImage> = batch.iter().map(|pair| &*pair.image).collect();
        let run = Run::Training { seed: self.seed, step: at.step };
        let count = batch[0].truth.positions.len();
        let points = batch.iter().map(|pair| pair.truth.positions.as_flattened());
        let truth = stacked(tape, points, &[batch.len(), count, 3]);
        let normals: Vec<f32> =
            batch.iter().flat_map(|pair| pair.truth.normals.as_flattened()).copied().collect();
        let normals = if normals.len() == 3 * count * batch.len() { &normals[..] } else { &[] };
        let mut sums = Sums::default();
        match self.deformed(tape, &images, run) {
            Ok(deformed) => {
                for stage in &deformed.stages {
                    self.stage_terms(stage, truth, normals, &mut sums);
                }
            }
            // The loop stops at what is not a number, and finds the parameter or the sample that made it.
            Err(SolveError::NonFinite { .. }) => {
                sums.chamfer = Some(tape.constant(ndarray::arr0(f32::NAN)));
            }
            Err(error) => return Err(LossError::solve(error)),
        }
        let terms = sums.weighted(self.shared(), || tape.constant(ndarray::arr0(0.0)));
        Ok(self.decayed(tape, self.with_camera(tape, &images, terms)))
    }

    fn evaluate(&self, data: &Pairs, subset: Subset) -> Result<Vec<Metric>, DataError> {
        Ok(self.scored(data, subset)?.metrics())
    }

    fn show(&self, data: &Pairs, subset: Subset) -> Result<Shown, DataError> {
        let (_, pair) = data.trial(subset, 1, 0)?;
        let (mesh, _) = self.mesh_of(&pair.image).unwrap_or_default();
        let mesh = pair.image.frame.mesh_in_world(mesh);
        Ok(Shown { views: self.gallery(data, subset)?, scene: Some(scene_of(&mesh)) })
    }

    fn predict(&self, views: &[View]) -> Result<TriMesh, PredictError> {
        let image = self.image(views)?;
        let seen = self.seen(&image).map_err(PredictError::solve)?;
        Ok(seen.in_world_of(&image))
    }
}

impl<D: Deformer> SingleView<D> {
    /// The first view as the network takes it.
    pub(crate) fn image(&self, views: &[View]) -> Result<InputImage, PredictError> {
        let view = views.first().ok_or(PredictError::NoView)?;
        let pairs = &self.shared().pairs;
        Ok(InputImage::new(view, pairs.image_size, pairs.scale)?.with_frame(self.shared().frame))
    }
}
