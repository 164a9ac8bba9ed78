//! Arguments of `unsphere reproduce`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use studies::Scale;
use train::Shard;

use super::output::folder;

#[derive(Args, Debug)]
#[command(
    after_help = "The folder gets table.md, report.html and results.json after every finished job, results/ (one
file a job and seed) and work/ (the trainings). Run the same command again and it goes on: what is
finished is kept, what was interrupted goes on from its checkpoint, and --seeds can grow. A cell is
the mean over the seeds, in square brackets its 95 % interval, in round ones each seed's value. Each
folder in work/ is a run that `unsphere eval` and `unsphere predict` take as --checkpoint.

Claims hold, are reversed or are undecided by one rule: the 95 % interval of the difference, paired by
object and seed. results.json has all that the tables, claims and pages are made of; --report makes
them again from it. Processes may share the work: each with --shard, --only or --seed into a folder of its
own, then --merge; docs/clusters.md has the scripts.

With --quick the exit code is 1 if a floor is missed, or reached by a model that must not, so that it
can stand in CI.

Examples:
  unsphere reproduce --list                            what there is
  unsphere reproduce --plan                            how long all of it takes
  unsphere reproduce img2mesh --quick                  a minute's worth
  unsphere reproduce img2mesh -o table                 three seeds for claims
  unsphere reproduce img2mesh -o table --seeds 5       five, after that
  unsphere reproduce all --scale tenth -o tables       with a tenth of the steps
  unsphere reproduce img2mesh -o b --only cnn-2        one row
  unsphere reproduce img2mesh -o b --shard 2/8         an eighth of the jobs
  unsphere reproduce img2mesh --merge a b -o table     the tables of both
  unsphere reproduce img2mesh --report docs/results/img2mesh.json -o page"
)]
#[allow(clippy::struct_excessive_bools, reason = "flags of a command line")]
pub(crate) struct Reproduce {
    /// The study, or several with --plan; `all` is every study that needs no data; --list names them.
    #[arg(value_name = "STUDY")]
    pub(crate) names: Vec<String>,
    /// Name the studies, and what each shows.
    #[arg(long, conflicts_with_all = ["names", "output", "quick", "scale", "data", "plan", "merge", "report"])]
    pub(crate) list: bool,
    /// Say what it would take, row by row, and do nothing.
    #[arg(long, conflicts_with_all = ["output", "force", "merge", "report"])]
    pub(crate) plan: bool,
    /// Folder for the tables; without it, `reproduce-STUDY`, or `reproduce-STUDY-SCALE`.
    #[arg(long, short, value_name = "FOLDER", value_parser = folder())]
    pub(crate) output: Option<PathBuf>,
    /// Drop results in the folder that are of something else.
    #[arg(long)]
    pub(crate) force: bool,
    /// How many seeds, counted from --seed or 0 on; without it, three for rows that a claim rests on and
    /// one for others, or two with --scale tenth.
    #[arg(long, value_name = "N")]
    #[arg(value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub(crate) seeds: Option<u16>,
    /// Only these jobs, as --plan names them; what is there of others stays.
    #[arg(long, value_name = "JOB", value_delimiter = ',', conflicts_with = "merge")]
    pub(crate) only: Vec<String>,
    /// Only the I-th of N parts of the jobs and seeds, from 1, each into a folder of its own; --merge puts them together.
    #[arg(long, value_name = "I/N", conflicts_with_all = ["merge", "report"])]
    pub(crate) shard: Option<Shard>,
    /// How much is done: the tables, every row in a tenth of the steps, or a minute's worth.
    #[arg(long, value_name = "SCALE", default_value = "full")]
    pub(crate) scale: ScaleArgument,
    /// The same as --scale quick.
    #[arg(long, conflicts_with = "scale")]
    pub(crate) quick: bool,
    /// Data of your own where the study can use it; without it the study makes its own.
    #[arg(long, value_name = "PATH")]
    pub(crate) data: Option<PathBuf>,
    /// Put together what several processes made, each in its folder.
    #[arg(long, value_name = "FOLDER", num_args = 1.., conflicts_with = "report")]
    pub(crate) merge: Vec<PathBuf>,
    /// Make tables and page again from results, a results.json or its folder, without training.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["seeds", "only", "quick", "data"])]
    pub(crate) report: Option<PathBuf>,
}

/// How much of a study is done.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum ScaleArgument {
    /// The tables.
    Full,
    /// Every row in a tenth of the steps.
    Tenth,
    /// A minute's worth.
    Quick,
}

impl Reproduce {
    /// The scale, by either name.
    pub(crate) fn scale(&self) -> Scale {
        match self.scale {
            _ if self.quick => Scale::Quick,
            ScaleArgument::Full => Scale::Full,
            ScaleArgument::Tenth => Scale::Tenth,
            ScaleArgument::Quick => Scale::Quick,
        }
    }
}
