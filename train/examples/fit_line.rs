//! Fits a line to noisy points: the smallest system, trained into a run folder.
//!
//! `cargo run -p unsphere-train --example fit_line -- [folder]`; without a folder, a temporary one.

use std::io::Write;
use std::path::PathBuf;

use autodiff_lite::{Activation, Param, Tape, impl_module};
use ndarray::{Array1, Array2};
use rand::RngExt;
use train::progress::{Event, Watch};
use train::{
    Compile, Configuration, DataError, Draw, Job, LossError, Metric, PredictError, Provenance,
    RunFolder, Source, StepInfo, Subset, Summary, System, Terms, options, train,
};

options! {
    /// How the points lie.
    struct LineConfig {
        /// How far points are from the line, at most.
        noise: f32 = 0.1, in 0.0..=1.0;
    }
}

/// y = weight x + bias.
#[derive(Debug)]
struct Line {
    weight: Param,
    bias: Param,
    config: LineConfig,
}
impl_module!(Line: f32 { weight, bias } fixed { config });

impl Compile for Line {}

impl System for Line {
    const NAME: &'static str = "line";
    const PRESETS: &'static [(&'static str, &'static str)] = &[];
    const BEST: &'static str = "error";
    type Config = LineConfig;
    type ReadOptions = ();
    type Data = ();
    /// A point.
    type Sample = [f32; 2];
    type Input = f32;
    type Prediction = f32;

    fn summary(_: &LineConfig) -> Summary {
        Summary { trainable: 2, ..Summary::default() }
    }

    fn new(config: &LineConfig, _seed: u64) -> Self {
        let zero = |n| Param::new(Array2::<f32>::zeros((1, n)));
        Self { weight: zero(1), bias: Param::new(Array1::<f32>::zeros(1)), config: config.clone() }
    }

    fn open(_: &LineConfig, _: &Source<'_>) -> Result<(), DataError> {
        Ok(())
    }

    fn fingerprint((): &()) -> u64 {
        1
    }

    fn epoch_len(&self, (): &()) -> usize {
        64
    }

    fn draw(&self, (): &(), draw: &Draw) -> Result<[f32; 2], DataError> {
        let mut rng = draw.rng();
        let x = 2.0 * rng.random::<f32>() - 1.0;
        let noise = self.config.noise * (2.0 * rng.random::<f32>() - 1.0);
        Ok([x, 0.7 * x + 0.2 + noise])
    }

    fn name_of(sample: &[f32; 2]) -> String {
        format!("the point at {}", sample[0])
    }

    fn loss<'t>(
        &self,
        tape: &'t Tape,
        batch: &[[f32; 2]],
        _: StepInfo,
    ) -> Result<Terms<'t>, LossError> {
        let column = |k: usize| Array2::from_shape_fn((batch.len(), 1), |(i, _)| batch[i][k]);
        let x = tape.constant(column(0));
        let bias = Some(tape.param(&self.bias));
        let y = x.linear(tape.param(&self.weight), bias, Activation::None);
        Ok(Terms::new().with("squared", 1.0, (y - tape.constant(column(1))).square().mean()))
    }

    /// Against the line itself, whatever the points are for.
    fn evaluate(&self, (): &(), _: Subset) -> Result<Vec<Metric>, DataError> {
        let error = [-1.0, 0.0, 1.0].map(|x: f32| (self.at(x) - (0.7 * x + 0.2)).abs());
        Ok(vec![Metric::smaller("error", f64::from(error.into_iter().fold(0.0, f32::max)))])
    }

    fn predict(&self, x: &f32) -> Result<f32, PredictError> {
        Ok(self.at(*x))
    }
}

impl Line {
    fn at(&self, x: f32) -> f32 {
        self.weight.as_slice()[0] * x + self.bias.as_slice()[0]
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut out = std::io::stdout();
    let place = tempfile::tempdir()?;
    let folder = std::env::args().nth(1).map_or_else(|| place.path().join("line"), PathBuf::from);
    let mut config: Configuration<LineConfig> = Configuration::default();
    (config.train.epochs, config.train.batch, config.train.learning_rate) = (20, 16, 0.05);
    let run = RunFolder::create(&folder, false)?;
    let provenance = Provenance::default();
    let job = Job {
        config: &config,
        data: &(),
        run: &run,
        provenance: &provenance,
        resume: false,
        from: None,
    };
    let mut watch = Watch::new(|event: &Event| {
        if let Event::Evaluated { step, metrics, .. } = event {
            let _ = writeln!(out, "after {step:3} steps: off by {:.4}", metrics[0].value);
        }
    });
    let outcome = train::<Line>(&job, &mut watch)?;
    drop(watch);
    writeln!(out, "at 0.5 the line is at {:.3}", outcome.system.at(0.5))?;
    Ok(())
}
