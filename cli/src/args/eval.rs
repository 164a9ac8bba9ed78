//! Arguments of `unsphere eval`.

use std::path::PathBuf;

use clap::Args;
use train::Subset;

use super::reading::Reading;
use super::settings::key_value;
use super::values::{SUBSETS, one_of};

#[derive(Args, Debug)]
#[command(
    after_help = "The scores are those of the training's own: of objects that are not trained on, in what the model was
not given. What is for validation is there to choose by, as often as you like; what is for tests is scored
once, when nothing is chosen any more. DATA is what the run was trained on unless it is said, read as is said
here (--max-size, --mask); a run on data that the system makes is scored on the same. --set may change what leaves the parameters as they are, the
number of views for example.

Examples:
  unsphere eval img2mesh --checkpoint runs/clock --max-size 256
  unsphere eval img2mesh --checkpoint runs/clock --set views=1 --json
  unsphere eval img2mesh --checkpoint runs/clock --split test
  unsphere eval img2mesh --checkpoint runs/clock other_clock.zip"
)]
pub(crate) struct Eval {
    /// What was trained.
    #[arg(index = 1)]
    pub(crate) system: String,
    /// What it is scored on; without it, what the run was trained on.
    #[arg(index = 2)]
    pub(crate) data: Option<PathBuf>,
    /// A run's folder, of which the best checkpoint is taken, or a checkpoint's file.
    #[arg(long, short, value_name = "RUN|FILE")]
    pub(crate) checkpoint: PathBuf,
    /// Which part of the data is scored.
    #[arg(long, value_name = "SUBSET", default_value = "validation", value_parser = one_of(SUBSETS))]
    pub(crate) split: Subset,
    /// The last checkpoint of the run instead of the best.
    #[arg(long)]
    pub(crate) last: bool,
    /// One setting over those of the run; can be given many times.
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = key_value)]
    pub(crate) set: Vec<(String, String)>,
    #[command(flatten)]
    pub(crate) reading: Reading,
}
