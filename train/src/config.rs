//! How a training runs, and the one flat table that holds it beside the system's own options.

use autodiff_lite::optim::Schedule;
use serde::de::{DeserializeOwned, Error as _};
use serde::ser::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use toml::{Table, Value};

use crate::settings::in_toml;

/// Options of the training loop, each with the default that [`TrainConfig::default`] gives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct TrainConfig {
    /// Seed of everything random: first weights, order, samples, dropout. Default 0.
    pub seed: u64,
    /// Passes over the data. Default 10.
    pub epochs: u64,
    /// Ends earlier, after so many steps; 0 does not. Default 0.
    pub max_steps: u64,
    /// Samples in a batch. Default 4.
    pub batch: usize,
    /// Batches whose gradients are averaged for one step. Default 1.
    pub accumulate: usize,
    /// Parts that a batch is cut into, each on a tape of its own at the same time. Results depend
    /// on it (in the last bits), on the number of threads they do not. Default 1.
    pub shards: usize,
    /// The optimiser. Default `"adam"`.
    pub optimizer: OptimizerKind,
    /// Step length. Default 1e-4.
    pub learning_rate: f64,
    /// Decay of the mean of gradients (Adam). Default 0.9.
    pub beta1: f64,
    /// Decay of the mean of squared gradients (Adam). Default 0.999.
    pub beta2: f64,
    /// Part of the velocity that is kept (SGD). Default 0.9.
    pub momentum: f64,
    /// Pull of the weights towards zero. Default 0.
    pub weight_decay: f64,
    /// How the step length changes. Default `"constant"`.
    pub schedule: ScheduleKind,
    /// Epochs between two drops (`step`). Default 5.
    pub drop_every: u64,
    /// Epochs, counted from 0, before which the step length drops (`milestones`). Default none.
    pub milestones: Vec<u64>,
    /// What a drop multiplies the step length by (`step`, `milestones`). Default 0.5.
    pub drop: f64,
    /// Steps in which the step length rises at the start (`cosine`). Default 0.
    pub warmup: u64,
    /// The share of the step length that is left at the end (`cosine`). Default 0.
    pub floor: f64,
    /// Limit on the Euclidean norm of all gradients together; 0 is none. Default 0.
    pub clip_norm: f64,
    /// Leaves out a step whose loss is more than so many times the moving average of the losses;
    /// 0 leaves out none. Mesh R-CNN uses 50. Default 0.
    pub skip_spikes: f64,
    /// Epochs between two evaluations; 0 evaluates only at the end. Default 1.
    pub evaluate_every: u64,
    /// Epochs between two sheets of images; 0 draws them only at the end. Default 1.
    pub samples_every: u64,
    /// Steps between two checkpoints; 0 writes them only at evaluations and at the end. Default 0.
    pub checkpoint_steps: u64,
    /// Minutes after which a checkpoint is due; 0 is never. Default 10.
    pub checkpoint_minutes: f64,
    /// The metric that chooses the best checkpoint; empty for the system's own. Default empty.
    pub best: String,
    /// Whether TensorBoard's event files are written. Default true.
    pub tensorboard: bool,
}

/// The optimisers that a training can use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OptimizerKind {
    /// Adam with decay through the moments.
    Adam,
    /// Adam with decoupled decay.
    AdamW,
    /// Stochastic gradient descent with momentum.
    Sgd,
}

/// How the step length changes over time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ScheduleKind {
    /// Not at all.
    Constant,
    /// A drop every so many epochs.
    Step,
    /// Drops at given epochs.
    Milestones,
    /// A rise, then half a cosine down to the floor.
    Cosine,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            epochs: 10,
            max_steps: 0,
            batch: 4,
            accumulate: 1,
            shards: 1,
            optimizer: OptimizerKind::Adam,
            learning_rate: 1e-4,
            beta1: 0.9,
            beta2: 0.999,
            momentum: 0.9,
            weight_decay: 0.0,
            schedule: ScheduleKind::Constant,
            drop_every: 5,
            milestones: Vec::new(),
            drop: 0.5,
            warmup: 0,
            floor: 0.0,
            clip_norm: 0.0,
            skip_spikes: 0.0,
            evaluate_every: 1,
            samples_every: 1,
            checkpoint_steps: 0,
            checkpoint_minutes: 10.0,
            best: String::new(),
            tensorboard: true,
        }
    }
}

/// What may be changed when a run goes on: it leaves the steps that were taken as they are.
pub const CHANGEABLE: &[&str] = &[
    "epochs",
    "max-steps",
    "evaluate-every",
    "samples-every",
    "checkpoint-steps",
    "checkpoint-minutes",
    "tensorboard",
];

impl TrainConfig {
    /// What is wrong with these options, one sentence each; empty when nothing is.
    pub fn check(&self) -> Vec<String> {
        let mut problems = Vec::new();
        let mut require = |holds: bool, field: &str, found: &dyn std::fmt::Display, what: &str| {
            if !holds {
                problems.push(format!("`{field}` is {found}, expected {what}"));
            }
        };
        for (count, field) in [
            (self.seed, "seed"),
            (self.max_steps, "max-steps"),
            (self.drop_every, "drop-every"),
            (self.warmup, "warmup"),
            (self.evaluate_every, "evaluate-every"),
            (self.samples_every, "samples-every"),
            (self.checkpoint_steps, "checkpoint-steps"),
        ] {
            require(in_toml(count), field, &count, "at most 2^63 - 1");
        }
        require((1..=1_000_000).contains(&self.epochs), "epochs", &self.epochs, "1 to 1000000");
        require((1..=65536).contains(&self.batch), "batch", &self.batch, "1 to 65536");
        require(
            (1..=65536).contains(&self.accumulate),
            "accumulate",
            &self.accumulate,
            "1 to 65536",
        );
        require(
            (1..=self.batch).contains(&self.shards),
            "shards",
            &self.shards,
            "1 to `batch`: each part of a batch has a sample",
        );
        let within = |v: f64, low: f64, high: f64| v >= low && v <= high;
        let rate = self.learning_rate;
        require(within(rate, 0.0, 1e6), "learning-rate", &rate, "0 to 1000000");
        let mut fraction = |value: f64, field: &str| {
            require((0.0..1.0).contains(&value), field, &value, "0 to less than 1");
        };
        fraction(self.beta1, "beta1");
        fraction(self.beta2, "beta2");
        fraction(self.momentum, "momentum");
        require(
            within(self.weight_decay, 0.0, 1e3),
            "weight-decay",
            &self.weight_decay,
            "0 to 1000",
        );
        require(self.drop_every >= 1, "drop-every", &self.drop_every, "at least 1");
        let milestones = &self.milestones;
        let ascending = milestones.is_sorted() && milestones.iter().all(|&epoch| in_toml(epoch));
        require(
            ascending,
            "milestones",
            &format!("{:?}", self.milestones),
            "ascending epochs, at most 2^63 - 1",
        );
        require(within(self.drop, 0.0, 1e3), "drop", &self.drop, "0 to 1000");
        require(within(self.floor, 0.0, 1.0), "floor", &self.floor, "0 to 1");
        require(within(self.clip_norm, 0.0, f64::MAX), "clip-norm", &self.clip_norm, "at least 0");
        let spikes = self.skip_spikes;
        require(
            spikes == 0.0 || within(spikes, 1.0, f64::MAX),
            "skip-spikes",
            &spikes,
            "0 or at least 1",
        );
        let minutes = self.checkpoint_minutes;
        require(within(minutes, 0.0, 1e6), "checkpoint-minutes", &minutes, "0 to 1000000");
        problems
    }

    /// The schedule in steps, for epochs of `steps_per_epoch` steps and `total` steps in all.
    pub(super) fn schedule(&self, steps_per_epoch: u64, total: u64) -> Schedule {
        let steps = |epochs: u64| epochs.saturating_mul(steps_per_epoch);
        let gamma = self.drop;
        match self.schedule {
            ScheduleKind::Constant => Schedule::Constant,
            ScheduleKind::Step => Schedule::Step { every: steps(self.drop_every), gamma },
            ScheduleKind::Milestones => Schedule::MultiStep {
                milestones: self.milestones.iter().map(|&epoch| steps(epoch)).collect(),
                gamma,
            },
            ScheduleKind::Cosine => {
                Schedule::Cosine { warmup: self.warmup, total, floor: self.floor }
            }
        }
    }
}

/// All options of a training: those of the loop and those of the system, in one flat table.
///
/// In TOML both stand side by side, so that `--set batch=8` and an option of the system are said
/// alike; no system may have an option that is named like one of the loop. Options never are
/// optional fields: what may be absent has a value that says so.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Configuration<C> {
    /// The loop's options.
    pub train: TrainConfig,
    /// The system's options.
    pub system: C,
}

impl<C: Serialize> Configuration<C> {
    /// The one table.
    pub(super) fn to_table(&self) -> Result<Table, toml::ser::Error> {
        let mut table = Table::try_from(&self.train)?;
        table.extend(Table::try_from(&self.system)?);
        Ok(table)
    }
}

impl<C: Serialize> Serialize for Configuration<C> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.to_table().map_err(S::Error::custom)?.serialize(serializer)
    }
}

impl<'de, C: DeserializeOwned + Serialize + Default> Deserialize<'de> for Configuration<C> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let table = Table::deserialize(deserializer)?;
        let known = Table::try_from(TrainConfig::default()).map_err(D::Error::custom)?;
        let own = Table::try_from(C::default()).map_err(D::Error::custom)?;
        let unknown = |key: &String| {
            !known.contains_key(key) && !own.contains_key(key) && !is_alias::<C>(key)
        };
        if let Some(key) = table.keys().find(|key| unknown(key)) {
            let mut names: Vec<&str> = own.keys().chain(known.keys()).map(String::as_str).collect();
            names.sort_unstable();
            let names = names.join(", ");
            return Err(D::Error::custom(format!(
                "unknown field `{key}`, expected one of {names}"
            )));
        }
        let (train, system): (Table, Table) =
            table.into_iter().partition(|(key, _)| known.contains_key(key));
        Ok(Self {
            train: part(train).map_err(D::Error::custom)?,
            system: part(system).map_err(D::Error::custom)?,
        })
    }
}

/// Whether a configuration reads a key that it does not write: a name that a field had before.
///
/// No field can hold a date, so that one in its place is an error where the key is read and passes where it is not.
fn is_alias<T: DeserializeOwned>(key: &str) -> bool {
    let date = Value::Datetime(toml::value::Datetime {
        date: Some(toml::value::Date { year: 1970, month: 1, day: 1 }),
        time: None,
        offset: None,
    });
    T::deserialize(Value::Table([(key.to_owned(), date)].into_iter().collect()))
        .is_err_and(|error| !error.message().contains("unknown field"))
}

/// One half of the table. A value that does not fit is named, which `toml` alone does not do.
fn part<T: DeserializeOwned>(table: Table) -> Result<T, String> {
    for (key, value) in &table {
        let alone: Table = [(key.clone(), value.clone())].into_iter().collect();
        if let Err(error) = T::deserialize(Value::Table(alone)) {
            return Err(format!("`{key}`: {}", error.message()));
        }
    }
    T::deserialize(Value::Table(table)).map_err(|error| error.message().to_owned())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
    struct Own {
        mesh_level: u32,
        views: usize,
    }

    type Both = Configuration<Own>;

    #[test]
    fn the_table_is_flat_and_comes_back() {
        let mut both = Both::default();
        (both.train.batch, both.system.views) = (7, 3);
        let text = crate::settings::to_toml(&both);
        assert!(text.contains("batch = 7") && text.contains("views = 3") && !text.contains("\n["));
        assert_eq!(toml::from_str::<Both>(&text).unwrap(), both);
        let set =
            |k: &str, v: &str| crate::settings::read::<Both>(None, &[(k.to_owned(), v.to_owned())]);
        assert_eq!(set("mesh_level", "4").unwrap().system.mesh_level, 4);
        assert_eq!(set("optimizer", "adamw").unwrap().train.optimizer, OptimizerKind::AdamW);
        let wrong = set("meshlevel", "4").unwrap_err().to_string();
        assert!(wrong.contains("meshlevel") && wrong.contains("mesh-level"), "{wrong}");
        let wrong = toml::from_str::<Both>("batch = 4\nviews = \"x\"").unwrap_err().to_string();
        assert!(wrong.contains("`views`"), "{wrong}");
    }

    #[test]
    fn what_is_out_of_range_is_named() {
        assert_eq!(TrainConfig::default().check(), Vec::<String>::new());
        let wrong = TrainConfig {
            batch: 0,
            learning_rate: f64::NAN,
            milestones: vec![3, 2],
            ..TrainConfig::default()
        };
        let problems = wrong.check().join("; ");
        for field in ["`batch`", "`shards`", "`learning-rate`", "`milestones`"] {
            assert!(problems.contains(field), "{field}: {problems}");
        }
    }

    #[test]
    fn schedules_count_epochs() {
        let step =
            TrainConfig { schedule: ScheduleKind::Step, drop_every: 2, ..TrainConfig::default() };
        let factors = [0, 19, 20, 40].map(|k| step.schedule(10, 100).factor(k));
        assert_eq!(factors, [1.0, 1.0, 0.5, 0.25]);
        let at = TrainConfig {
            schedule: ScheduleKind::Milestones,
            milestones: vec![3],
            drop: 0.1,
            ..TrainConfig::default()
        };
        assert_eq!([29, 30].map(|k| at.schedule(10, 100).factor(k)), [1.0, 0.1]);
    }
}
