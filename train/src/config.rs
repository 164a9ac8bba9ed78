//! How a training runs, and the one flat table that holds it beside the system's own options.

use autodiff_lite::optim::Schedule;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use toml::Table;

use crate::settings::{LARGEST, Options, Reads, Tabular, above_to, date, reads};

crate::options! {
    /// Options of the training loop, each with the default that [`TrainConfig::default`] gives.
    #[serde(deny_unknown_fields)]
    pub struct TrainConfig {
        /// Seed of everything random: first weights, order, samples, dropout.
        pub seed: u64 = 0, in ..=LARGEST;
        /// Passes over the data.
        pub epochs: u64 = 10, in 1..=1_000_000;
        /// Ends earlier, after so many steps.
        #[serde(with = "crate::settings::optional")]
        pub max_steps: Option<u64> = None, in 1..=LARGEST;
        /// Samples in a batch.
        pub batch: usize = 4, in 1..=65536;
        /// Batches whose gradients are averaged for one step.
        pub accumulate: usize = 1, in 1..=65536;
        /// Parts that a batch is cut into, each on a tape of its own at the same time. Results depend on it
        /// (in the last bits, and by which random numbers are drawn), on the number of threads they do not.
        pub shards: usize = 1, in 1..=65536;
        /// The optimiser.
        pub optimizer: OptimizerKind = OptimizerKind::Adam;
        /// Learning rate.
        pub learning_rate: f64 = 1e-4, in 0.0..=1e6;
        /// Decay of the mean of gradients (Adam).
        pub beta1: f64 = 0.9, in 0.0..1.0;
        /// Decay of the mean of squared gradients (Adam).
        pub beta2: f64 = 0.999, in 0.0..1.0;
        /// Part of the velocity that is kept (SGD).
        pub momentum: f64 = 0.9, in 0.0..1.0;
        /// Pull of the weights towards zero.
        pub weight_decay: f64 = 0.0, in 0.0..=1e3;
        /// How the learning rate changes.
        pub schedule: ScheduleKind = ScheduleKind::Constant;
        /// Epochs between two drops (`step`).
        pub drop_every: u64 = 5, in 1..=LARGEST;
        /// Epochs, counted from 0, before which the learning rate drops (`milestones`).
        pub milestones: Vec<u64> = Vec::new(), in ..=LARGEST;
        /// What a drop multiplies the learning rate by (`step`, `milestones`).
        pub drop: f64 = 0.5, in 0.0..=1e3;
        /// Steps in which the learning rate rises at the start (`cosine`).
        pub warmup: u64 = 0, in ..=LARGEST;
        /// The share of the learning rate that is left at the end (`cosine`).
        pub floor: f64 = 0.0, in 0.0..=1.0;
        /// Decay of the exponential moving average of the weights (EMA), which is then what is scored, kept as the best and
        /// predicts; without, the weights of the last step are. 0.999 remembers about the last thousand steps.
        #[serde(with = "crate::settings::optional")]
        pub ema_decay: Option<f64> = None, in 0.0..1.0;
        /// Limit on the Euclidean norm of all gradients together.
        #[serde(with = "crate::settings::optional")]
        pub clip_norm: Option<f64> = None, in above_to(0.0, f64::MAX);
        /// Leaves out a step whose loss is more than so many times the moving average of the losses. Mesh R-CNN uses
        /// 50. After ten in a row the loss is taken to have risen for good: the next step counts, and the average begins with it.
        #[serde(with = "crate::settings::optional")]
        pub skip_spikes: Option<f64> = None, in 1.0..=f64::MAX;
        /// Epochs between two scorings of what is for validation, by which the best checkpoint is chosen; without, only
        /// at the end.
        #[serde(with = "crate::settings::optional", alias = "evaluate-every")]
        pub validation_every: Option<u64> = Some(1), in 1..=LARGEST;
        /// Epochs between two sheets of images; without, only at the end.
        #[serde(with = "crate::settings::optional")]
        pub samples_every: Option<u64> = Some(1), in 1..=LARGEST;
        /// Steps between two checkpoints; without, only at validations and at the end.
        #[serde(with = "crate::settings::optional")]
        pub checkpoint_steps: Option<u64> = None, in 1..=LARGEST;
        /// Minutes after which a checkpoint is due.
        #[serde(with = "crate::settings::optional")]
        pub checkpoint_minutes: Option<f64> = Some(10.0), in above_to(0.0, 1e6);
        /// The metric that chooses the best checkpoint; without, the system's own. Where a run goes on with another, what was the
        /// best before no longer counts.
        #[serde(with = "crate::settings::optional")]
        pub best: Option<String> = None;
        /// Scorings of validation without a better one after which a run ends (early stopping); without, it goes on to its end.
        #[serde(with = "crate::settings::optional")]
        pub patience: Option<u64> = None, in 1..=65_536;
        /// Whether TensorBoard's event files are written.
        pub tensorboard: bool = true;
    }
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

/// How the learning rate changes over time.
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

/// What may be changed when a run goes on: it leaves the steps that were taken as they are.
pub const CHANGEABLE: &[&str] = &[
    "epochs",
    "max-steps",
    "validation-every",
    "samples-every",
    "checkpoint-steps",
    "checkpoint-minutes",
    "best",
    "patience",
    "tensorboard",
];

impl TrainConfig {
    /// What is wrong with these options, one sentence each; empty when nothing is.
    pub fn check(&self) -> Vec<String> {
        let mut problems = self.out_of_range();
        let (batch, shards) = (self.batch, self.shards);
        if shards > batch {
            let what = format!("1 to `batch`, {batch}: each part of a batch has a sample");
            problems.push(format!("`shards` is {shards}, expected {what}"));
        }
        if !self.milestones.is_sorted() {
            problems
                .push(format!("`milestones` is {:?}, expected ascending epochs", self.milestones));
        }
        if self.patience.is_some() && self.validation_every.is_none() {
            let text = "`patience` counts validations, and `validation-every` is none";
            problems.push(text.to_owned());
        }
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
/// alike; no system may have an option that is named like one of the loop.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Configuration<C> {
    /// The loop's options.
    pub train: TrainConfig,
    /// The system's options.
    pub system: C,
}

impl<C: Options> Tabular for Configuration<C> {
    fn from_table(table: Table) -> Result<Self, toml::de::Error> {
        let (train, system) = parted(
            table,
            &C::retired(),
            (&TrainConfig::default().to_table(), &reads::<TrainConfig>),
            (&C::default().to_table(), &reads::<C>),
        )?;
        Ok(Self { train: TrainConfig::from_table(train)?, system: C::from_table(system)? })
    }

    /// The one table.
    fn to_table(&self) -> Table {
        let mut table = self.train.to_table();
        table.extend(self.system.to_table());
        table
    }

    fn to_text(&self) -> String {
        pretty(&self.to_table())
    }
}

impl<C: Options> Serialize for Configuration<C> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.to_table().serialize(serializer)
    }
}

impl<'de, C: Options> Deserialize<'de> for Configuration<C> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let table = Table::deserialize(deserializer)?;
        Self::from_table(table).map_err(|error| D::Error::custom(error.message()))
    }
}

fn pretty(table: &Table) -> String {
    toml::to_string_pretty(table).expect("a table")
}

/// The options that a half of the table has when nothing is said, and what reads it.
type Half<'a> = (&'a Table, Reads<'a>);

/// What a table says of the loop, and of the system.
fn parted(
    mut table: Table,
    retired: &[&str],
    (known, reads_loop): Half<'_>,
    (own, reads_system): Half<'_>,
) -> Result<(Table, Table), toml::de::Error> {
    for key in retired {
        table.remove(*key);
    }
    let of_loop = |key: &String| known.contains_key(key) || is_alias(key, reads_loop);
    let unknown =
        |key: &String| !of_loop(key) && !own.contains_key(key) && !is_alias(key, reads_system);
    if let Some(key) = table.keys().find(|key| unknown(key)) {
        let mut names: Vec<&str> = own.keys().chain(known.keys()).map(String::as_str).collect();
        names.sort_unstable();
        let names = names.join(", ");
        return Err(toml::de::Error::custom(format!(
            "unknown field `{key}`, expected one of {names}"
        )));
    }
    Ok(table.into_iter().partition(|(key, _)| of_loop(key)))
}

/// Whether a configuration reads a key that it does not write: a name that a field had before.
///
/// No field can hold a date, so that one in its place is an error where the key is read and passes where it is not.
fn is_alias(key: &str, reads: Reads<'_>) -> bool {
    reads([(key.to_owned(), date())].into_iter().collect())
        .is_err_and(|error| !error.message().contains("unknown field"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    crate::options! {
        /// Those of a system.
        #[serde(deny_unknown_fields)]
        struct Own retires ["view-angle"] {
            /// A level.
            mesh_level: u32 = 0;
            /// A count.
            views: usize = 0;
        }
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

    /// What earlier versions wrote is read: a key that has another name now, and one that says nothing any more. What is
    /// set by either name goes over what stands there by the other.
    #[test]
    fn former_keys_are_read() {
        let former = "evaluate-every = 7\nview-angle = 30\nviews = 3\n";
        let read = |text: &str, set: &[(&str, &str)]| {
            let set: Vec<_> = set.iter().map(|&(k, v)| (k.to_owned(), v.to_owned())).collect();
            crate::settings::read_text::<Both>("test".as_ref(), text, &set).unwrap()
        };
        let both = read(former, &[]);
        assert_eq!((both.train.validation_every, both.system.views), (Some(7), 3));
        let text = crate::settings::to_toml(&both);
        assert!(text.contains("validation-every = 7") && !text.contains("evaluate-every"));
        assert!(!text.contains("view-angle"), "{text}");
        for (there, set) in [
            ("evaluate-every = 7", "validation_every"),
            ("validation-every = 7", "evaluate-every"),
            ("validation-every = 7", "validation-every"),
        ] {
            assert_eq!(read(there, &[(set, "9")]).train.validation_every, Some(9), "{there} {set}");
        }
        let wrong = toml::from_str::<Both>("evaluate-every = \"x\"").unwrap_err().to_string();
        assert!(wrong.contains("`evaluate-every`"), "{wrong}");
    }

    #[test]
    fn what_is_out_of_range_is_named() {
        assert_eq!(TrainConfig::default().check(), Vec::<String>::new());
        let wrong = TrainConfig {
            batch: 0,
            learning_rate: f64::NAN,
            milestones: vec![3, 2],
            patience: Some(3),
            validation_every: None,
            ..TrainConfig::default()
        };
        let problems = wrong.check().join("; ");
        for field in ["`batch`", "`shards`", "`learning-rate`", "`milestones`", "`patience`"] {
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
