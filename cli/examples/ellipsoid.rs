//! A seventh system: an ellipsoid from one image. It is all here, and has every command of the program.
//!
//! ```text
//! cargo run --release -p unsphere --example ellipsoid -- train ellipsoid -o runs/ellipsoid --set epochs=20
//! cargo run --release -p unsphere --example ellipsoid -- predict ellipsoid views/ -c runs/ellipsoid -o mesh
//! cargo run --release -p unsphere --example ellipsoid -- check --system ellipsoid --options
//! ```

use std::process::ExitCode;

use autodiff_lite::{Activation, Tape, Var, impl_module};
use datasets::{ReadOptions, View};
use mesh_core::{Camera, TriMesh, primitives::icosphere};
use models::predict::{PredictInput, Prediction, Predictor, Request};
use ndarray::Array2;
use nets::{Init, Linear};
use rand::RngExt;
use synth::{RenderOptions, render_views};
use train::{
    Compile, DataError, DataSummary, Draw, Fingerprint, LossError, Metric, PredictError, Source,
    StepInfo, Subset, Summary, System, Terms, options,
};
use unsphere::Program;

/// Cells along each side of what the network sees of a mask.
const CELLS: usize = 12;
/// Pixels along each side of the images that it learns from.
const SIDE: usize = 48;

options! {
    /// What the network and its data can be told.
    #[serde(deny_unknown_fields)]
    struct EllipsoidConfig {
        /// Columns between its two layers.
        hidden: usize = 64, in 1..=4096;
        /// Ellipsoids that are made to learn from; a tenth as many more are for validation, and as many for tests.
        objects: usize = 200, in 10..=100_000;
    }
}

/// The share of a mask in each cell, to the logarithms of three radii.
#[derive(Debug)]
struct Ellipsoid {
    first: Linear,
    second: Linear,
    config: EllipsoidConfig,
}
impl_module!(Ellipsoid: f32 { first, second } fixed { config });

/// What is known of an ellipsoid.
struct Sample {
    number: usize,
    cells: Vec<f32>,
    logs: [f32; 3],
}

impl Compile for Ellipsoid {}

impl System for Ellipsoid {
    const NAME: &'static str = "ellipsoid";
    const PRESETS: &'static [(&'static str, &'static str)] = &[
        ("tiny", "epochs = 2\nlearning-rate = 0.003\nobjects = 20\n"),
        ("small", "epochs = 30\nlearning-rate = 0.003\n"),
    ];
    const BEST: &'static str = "radius-error";
    type Config = EllipsoidConfig;
    type ReadOptions = ReadOptions;
    type Data = Vec<Sample>;
    type Sample = Sample;
    type Input = [View];
    type Prediction = TriMesh;

    fn summary(config: &EllipsoidConfig) -> Summary {
        let trainable = (CELLS * CELLS + 1) * config.hidden + 3 * (config.hidden + 1);
        let shapes = vec![
            ("mask".to_owned(), format!("[N, {}]", CELLS * CELLS)),
            ("radii".to_owned(), "[N, 3]".to_owned()),
        ];
        Summary { trainable, frozen: 0, shapes }
    }

    fn new(config: &EllipsoidConfig, seed: u64) -> Self {
        let init = Init::new(seed);
        let layer = |name: &str, inputs, outputs| Linear::new(&init.at(name), inputs, outputs);
        Self {
            first: layer("first", CELLS * CELLS, config.hidden),
            second: layer("second", config.hidden, 3),
            config: config.clone(),
        }
    }

    fn open(
        config: &EllipsoidConfig,
        source: &Source<'_, ReadOptions>,
    ) -> Result<Vec<Sample>, DataError> {
        if source.path.is_some() {
            return Err(DataError::Unfit(
                "ellipsoid makes its own data: leave the path out".into(),
            ));
        }
        let total = config.objects + 2 * (config.objects / 10);
        let camera = Camera::look_at([1.6, 1.3, 2.2], [0.0; 3], [0.0, 1.0, 0.0], 0.8, SIDE, SIDE);
        let mut samples = Vec::new();
        for number in 0..total {
            let mut rng =
                Draw { seed: source.seed, epoch: 0, index: number as u64, item: number }.rng();
            let logs = [(); 3].map(|()| -1.2 + rng.random::<f32>());
            let mesh = icosphere(3).scaled(logs.map(f32::exp));
            let made = render_views(
                &mesh,
                std::slice::from_ref(&camera),
                &RenderOptions::default(),
                &|_, _| (),
            );
            let views = made.map_err(|error| DataError::Unfit(error.to_string()))?;
            samples.push(Sample { number, cells: cells(&views[0]), logs });
            (source.progress)(number + 1, total);
        }
        Ok(samples)
    }

    fn fingerprint(data: &Vec<Sample>) -> u64 {
        let bytes = |hash: Fingerprint, sample: &Sample| {
            sample.logs.iter().fold(hash, |hash, log| hash.with(&log.to_le_bytes()))
        };
        data.iter().fold(Fingerprint::new(), bytes).value()
    }

    fn epoch_len(&self, _: &Vec<Sample>) -> usize {
        self.config.objects
    }

    fn draw(&self, data: &Vec<Sample>, draw: &Draw) -> Result<Sample, DataError> {
        let Sample { number, cells, logs } = &data[draw.item];
        Ok(Sample { number: *number, cells: cells.clone(), logs: *logs })
    }

    fn name_of(sample: &Sample) -> String {
        format!("ellipsoid {}", sample.number)
    }

    fn loss<'t>(
        &self,
        tape: &'t Tape,
        batch: &[Sample],
        _: StepInfo,
    ) -> Result<Terms<'t>, LossError> {
        let truth = Array2::from_shape_fn((batch.len(), 3), |(i, k)| batch[i].logs[k]);
        let error =
            self.logs(tape, batch.iter().map(|sample| &sample.cells[..])) - tape.constant(truth);
        Ok(Terms::new().with("radii", 1.0, error.square().mean()))
    }

    fn data_summary(data: &Vec<Sample>) -> Option<DataSummary> {
        let sizes = Subset::ALL.map(|subset| of(data, subset).len());
        Some(DataSummary { unit: "ellipsoids", sizes, warnings: Vec::new() })
    }

    fn evaluate(&self, data: &Vec<Sample>, subset: Subset) -> Result<Vec<Metric>, DataError> {
        let scored = of(data, subset);
        let tape = Tape::eval();
        let found = self.logs(&tape, scored.iter().map(|sample| &sample.cells[..])).value();
        let errors: Vec<(String, f64)> = scored
            .iter()
            .zip(found.as_slice().as_chunks::<3>().0)
            .map(|(sample, found)| {
                let sum: f32 = found.iter().zip(sample.logs).map(|(a, b)| (a - b).abs()).sum();
                (Self::name_of(sample), f64::from(sum / 3.0))
            })
            .collect();
        let mean = errors.iter().map(|(_, error)| error).sum::<f64>() / errors.len() as f64;
        // Each ellipsoid's own value goes into the results, for those who compare two systems.
        Ok(vec![Metric::smaller("radius-error", mean).of_objects(errors)])
    }

    fn predict(&self, views: &[View]) -> Result<TriMesh, PredictError> {
        let view = views.first().ok_or(PredictError::NoView)?;
        let tape = Tape::eval();
        let logs = self.logs(&tape, std::iter::once(&cells(view)[..])).value();
        Ok(icosphere(3).scaled([logs[[0, 0]], logs[[0, 1]], logs[[0, 2]]].map(f32::exp)))
    }
}

impl Ellipsoid {
    /// Cells of `N` masks to logarithms of radii, `[N, 3]`.
    fn logs<'t, 'a>(&self, tape: &'t Tape, masks: impl Iterator<Item = &'a [f32]>) -> Var<'t> {
        let rows: Vec<f32> = masks.flatten().copied().collect();
        let shape = (rows.len() / (CELLS * CELLS), CELLS * CELLS);
        let masks = tape.constant(Array2::from_shape_vec(shape, rows).expect("whole rows"));
        self.second.forward(self.first.forward_then(masks, Activation::Relu))
    }
}

impl Predictor for Ellipsoid {
    const ABOUT: &'static str = "One image to an ellipsoid";
    const TRAINING: &'static str = "`train ellipsoid -o runs/mine` trains one in seconds";

    fn load(&self, request: &Request<'_>) -> Result<PredictInput, DataError> {
        PredictInput::single(request)
    }

    fn apply(&self, input: &PredictInput) -> Result<Prediction, PredictError> {
        Ok(Prediction { mesh: self.predict(&input.given)?, ..Prediction::default() })
    }
}

/// The first are trained on, the last are for tests; each was drawn by itself, so that neighbours have nothing in common.
fn of(data: &[Sample], subset: Subset) -> &[Sample] {
    // A tenth as many as are trained on, rounded down, each.
    let scored = data.len() / 12;
    let (train, rest) = data.split_at(data.len() - 2 * scored);
    let (validation, test) = rest.split_at(scored);
    match subset {
        Subset::Train => train,
        Subset::Validation => validation,
        Subset::Test => test,
    }
}

/// The share of the object in each cell of a view's mask.
fn cells(view: &View) -> Vec<f32> {
    let (height, width) = (view.mask.height, view.mask.width);
    let (mut object, mut all) = ([0.0; CELLS * CELLS], [0.0; CELLS * CELLS]);
    for (pixel, &mask) in view.mask.data.iter().enumerate() {
        let cell = (pixel / width * CELLS / height) * CELLS + pixel % width * CELLS / width;
        object[cell] += f32::from(u8::from(mask > 127));
        all[cell] += 1.0;
    }
    object.iter().zip(all).map(|(object, all)| object / f32::max(all, 1.0)).collect()
}

fn main() -> ExitCode {
    Program::new().with::<Ellipsoid>().main()
}
