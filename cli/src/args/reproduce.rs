//! Arguments of `unsphere reproduce`.

use std::path::PathBuf;

use clap::Args;

use super::output::folder;

#[derive(Args, Debug)]
#[command(
    after_help = "The folder gets table.md, report.html and results.json after every finished job, results/ (one
file a job and seed) and work/ (the trainings). Run the same command again and it goes on: what is
finished is kept, what was interrupted goes on from its checkpoint, and --seeds can grow. A cell is
the mean over the seeds, in brackets the largest less the smallest. Each folder in work/ is a run
that `unsphere eval` and `unsphere predict` take as --checkpoint.

With --quick the exit code is 1 if a claim does not hold, so that it can stand in CI.

Examples:
  unsphere reproduce --list                          what there is
  unsphere reproduce img2mesh --quick                a minute's worth
  unsphere reproduce img2mesh -o table --seeds 3     means and spreads over three seeds
  unsphere reproduce img2mesh -o table --seeds 5     two seeds more, after that"
)]
pub(crate) struct Reproduce {
    /// The study; --list names them.
    pub(crate) name: Option<String>,
    /// Name the studies, and what each shows.
    #[arg(long, conflicts_with_all = ["name", "output", "quick", "data"])]
    pub(crate) list: bool,
    /// Folder for the tables; without it, `reproduce-NAME`, or `reproduce-NAME-quick`.
    #[arg(long, short, value_name = "FOLDER", value_parser = folder())]
    pub(crate) output: Option<PathBuf>,
    /// Drop results in the folder that are of something else.
    #[arg(long)]
    pub(crate) force: bool,
    /// How many seeds, counted from --seed or 0 on.
    #[arg(long, value_name = "N", default_value_t = 1)]
    #[arg(value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub(crate) seeds: u16,
    /// A small version of the study, to see that nothing is broken.
    #[arg(long)]
    pub(crate) quick: bool,
    /// Data of your own where the study can use it; without it the study makes its own.
    #[arg(long, value_name = "PATH")]
    pub(crate) data: Option<PathBuf>,
}
