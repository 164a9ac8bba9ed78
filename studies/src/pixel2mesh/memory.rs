//! Constant memory: a training step at more and more evaluations, by each adjoint.

use std::time::Instant;

use autodiff_lite::{Activation, Module, Param, SparseMatrix, Tape, Var};
use mesh_core::primitives::icosphere;
use mesh_core::{MedianOfEven, Topology, median};
use models::paired::Pair;
use models::pixel2mesh::{OdeConfig, OdePixel2Mesh};
use ndarray::{Array3, Array4};
use nets::Init;
use ode_deform::Adjoint;
use ode_deform::deform::{DeformationField, FieldConfig};
use ode_deform::solve::{EULER, Problem, StepController};
use train::settings::to_toml;
use train::{Configuration, System};

use super::QUICK;
use crate::effort::{one_step, samples};
use crate::preset::{open, preset};
use crate::progress::Watch;
use crate::{Cell, Claim, Plan, PlannedJob, Row, Scale, Score, Study, StudyError, Work};

const TABLE: &str = "A training step at so many evaluations";
/// Times that a step is timed; the median counts.
const TIMED: usize = 5;
/// How much more memory the last row may take than the first.
const FLAT: f64 = 1.10;
/// How much more an evaluation may take in one row than in the first, or less.
const LINEAR: f64 = 1.5;
/// What an evaluation more takes where everything is recorded.
const GROWTH: &str = "direct, MB an evaluation";
/// How far gradients that should be equal may differ, relative to the largest.
const EQUAL: f64 = 1e-10;

/// The memory and the time of a training step at 4 to 64 evaluations, with every operation recorded and with steps
/// computed once more on the way back; how far their gradients differ, and how far those of the continuous adjoint do.
#[derive(Clone, Copy, Debug)]
pub struct MemoryStudy;

fn counts(scale: Scale) -> &'static [usize] {
    if scale == Scale::Quick { &[4, 8, 16] } else { &[4, 8, 16, 32, 64] }
}

fn config(scale: Scale) -> Configuration<OdeConfig> {
    let mut changes = vec![
        ("method", "euler"),
        ("batch", "4"),
        ("shards", "1"),
        ("objects", "4"),
        ("test-objects", "1"),
    ];
    if scale == Scale::Quick {
        changes.extend(QUICK);
    }
    preset::<OdePixel2Mesh>("table", &changes)
}

fn label(evaluations: usize) -> String {
    format!("{evaluations} evaluations")
}

impl Study for MemoryStudy {
    fn name(&self) -> &'static str {
        "ode-memory"
    }

    fn about(&self) -> &'static str {
        "deformation in continuous time: memory and gradients at 4 to 64 evaluations"
    }

    fn plan(&self, scale: Scale) -> Plan {
        let job = |&count: &usize| PlannedJob {
            id: format!("evaluations-{count}"),
            label: label(count),
            length: 0,
        };
        let jobs = counts(scale).iter().map(job).collect();
        let settings = format!("{}counts = {:?}\n", to_toml(&config(scale)), counts(scale));
        Plan { jobs, settings }
    }

    fn run(&self, work: &Work<'_>, watch: &mut Watch<'_>) -> Result<Vec<Row>, StudyError> {
        let wanted = |count: &&usize| format!("evaluations-{count}") == work.id;
        let count = *counts(work.scale).iter().find(wanted).expect("one of the jobs");
        let config = config(work.scale);
        let data = open::<OdePixel2Mesh>(work, &config)?;
        let start = Instant::now();
        let (mut row, mut growth) = (Row::new(TABLE, label(count)), 0.0);
        for (name, adjoint) in
            [("checkpointed", Adjoint::Checkpointed), ("direct", Adjoint::Direct)]
        {
            work.tell(watch, 0.5, name)?;
            let step = 1.0 / count as f64;
            let own =
                OdeConfig { adjoint, start: [0.0; 2], step: [step; 2], ..config.system.clone() };
            let system = OdePixel2Mesh::new(&own, work.seed);
            let batch = samples(&system, &data, config.train.batch)?;
            let (bytes, seconds) = measured(&system, &batch);
            if adjoint == Adjoint::Direct {
                // What the second half of the evaluations takes.
                let half = OdeConfig { step: [2.0 * step; 2], ..own };
                let (fewer, _) = measured(&OdePixel2Mesh::new(&half, work.seed), &batch);
                growth = (bytes - fewer) / (0.5 * count as f64);
            }
            row = row
                .with(Cell::smaller(format!("{name}, MB"), bytes / 1e6, 2))
                .with(Cell::smaller(format!("{name}, ms"), 1e3 * seconds, 1));
        }
        let [exact, checkpointed, backsolve] =
            [Adjoint::Direct, Adjoint::Checkpointed, Adjoint::Backsolve]
                .map(|adjoint| gradient(adjoint, count, work.seed));
        let [same, error] =
            [checkpointed, backsolve].map(|other| log10(difference(&exact, &other)));
        let row = row
            .with(Cell::smaller(GROWTH, growth / 1e6, 3))
            .with(Cell::smaller("log10 of their difference", same, 1))
            .with(Cell::smaller("log10 of Backsolve's error", error, 2));
        Ok(vec![row.took(start.elapsed().as_secs_f64())])
    }

    fn claims(&self) -> Vec<Claim> {
        let counts = counts(Scale::Full);
        let score = |count: usize, column: &str| Score::new(TABLE, label(count), column);
        let first = counts[0];
        let last = counts[counts.len() - 1];
        let flat = "stated before the run: constant up to what a longer list of steps takes";
        let linear = "stated before the run: linear up to how buffers are shared";
        let grows = counts.iter().filter(|&&count| count != first).flat_map(|&count| {
            let (more, less) = (score(count, GROWTH), score(first, GROWTH));
            [
                more.clone().at_most(LINEAR, less.clone(), 0.0, linear).exactly(),
                less.at_most(LINEAR, more, 0.0, linear).exactly(),
            ]
        });
        let equal = counts
            .iter()
            .map(|&count| score(count, "log10 of their difference").below(EQUAL.log10()).exactly());
        let falls = counts.windows(2).map(|pair| {
            let [coarse, fine] = [0, 1].map(|k| score(pair[k], "log10 of Backsolve's error"));
            fine.below(coarse).exactly()
        });
        vec![
            Claim::new(
                "checkpointed, the memory stays within 10 % from the first row to the last",
                [score(last, "checkpointed, MB")
                    .at_most(FLAT, score(first, "checkpointed, MB"), 0.0, flat)
                    .exactly()],
            ),
            Claim::new(
                "recorded whole, the memory grows linearly: every evaluation takes as much, within a half",
                grows,
            ),
            Claim::new("both gradients are equal within 1e-10 in double precision", equal),
            Claim::new("the continuous adjoint's error falls with the step size", falls),
        ]
    }

    fn caption(&self, _: &str, _: Scale) -> String {
        "Euler's method from 0 to 1, 618 vertices, batch of 4, the whole step: encoder, deformation, losses, gradients. MB: all buffers that the \
         step's tape asked for; MB an evaluation: what the second half of the evaluations takes. Differences of gradients, in double precision on a small field: the largest over all parameters, relative to the \
         largest entry."
            .to_owned()
    }
}

/// Rounding, where it is nothing at all.
fn log10(x: f64) -> f64 {
    x.max(1e-18).log10()
}

/// Bytes, and the median of the seconds.
fn measured(system: &OdePixel2Mesh, batch: &[Pair]) -> (f64, f64) {
    let mut tape = Tape::train(0);
    let mut times = Vec::new();
    for _ in 0..TIMED {
        let start = Instant::now();
        one_step(system, batch, &tape);
        tape.reset();
        times.push(start.elapsed().as_secs_f64());
    }
    let seconds = median(times, MedianOfEven::Upper).expect("a step is timed");
    (tape.pool().bytes() as f64, seconds)
}

/// The gradient of a small field's parameters through so many steps, in double precision.
fn gradient(adjoint: Adjoint, steps: usize, seed: u64) -> Vec<f64> {
    let ball = icosphere(1);
    let v = ball.positions.len();
    let topology = Topology::new(v, &ball.faces);
    let entries: Vec<(usize, usize, f64)> = (0..v)
        .flat_map(|i| {
            let row = topology.vertex_vertices.row(i);
            let share = 1.0 / row.len() as f64;
            row.iter().map(move |&j| (i, j as usize, share)).collect::<Vec<_>>()
        })
        .collect();
    let graph = SparseMatrix::from_triplets(v, v, &entries).expect("vertices");
    let config = FieldConfig {
        time: 1,
        hidden: 8,
        activation: Activation::Tanh,
        ..FieldConfig::published(4)
    };
    let field = DeformationField::<f64>::new(&Init::new(seed), config, graph);
    let tape = Tape::<f64>::train(0);
    let at = |i: usize, k: usize| f64::from(ball.positions[i][k]) * 0.3;
    let start = tape.leaf(Array3::from_shape_fn((1, v, 3), |(_, i, k)| at(i, k)));
    let rows = [[2.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, -1.0, 2.0]];
    let camera = tape.constant(Array3::from_shape_fn((1, 3, 4), |(_, i, j)| rows[i][j]));
    let map =
        Array4::from_shape_fn((1, 8, 8, 4), |(_, i, j, c)| ((i * 5 + j * 3 + c) as f64).cos());
    let problem =
        Problem::new([0.0, 1.0], &EULER, StepController::Fixed { step: 1.0 / steps as f64 });
    let inputs: [Var<'_, f64>; 2] = [camera, tape.constant(map)];
    let flow = adjoint.integrate(&field, start, &inputs, &problem).expect("fixed steps");
    let gradients = flow.end.square().sum().backward();
    let mut all = Vec::new();
    field.visit("", &mut |_: &str, param: &Param<f64>| {
        all.extend_from_slice(gradients.slice_of(param).unwrap_or_default());
    });
    all
}

/// The largest difference relative to the largest entry.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    let most = a.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let far = a.iter().zip(b).fold(0.0_f64, |far, (x, y)| far.max((x - y).abs()));
    if b.len() == a.len() { far / most } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_are_those_of_the_computed_flow_or_near() {
        let [exact, checkpointed] =
            [Adjoint::Direct, Adjoint::Checkpointed].map(|adjoint| gradient(adjoint, 8, 1));
        assert!(difference(&exact, &checkpointed) < EQUAL);
        let error = |steps: usize| {
            difference(
                &gradient(Adjoint::Direct, steps, 1),
                &gradient(Adjoint::Backsolve, steps, 1),
            )
        };
        let (coarse, fine) = (error(8), error(32));
        assert!(coarse > 1e-4 && fine < 0.5 * coarse, "{coarse} {fine}");
    }
}
