//! Arguments of `unsphere export`.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PathBufValueParser, TypedValueParser};

use super::reading::Reading;

#[derive(Args, Debug)]
#[command(
    after_help = "Two files are written: FILE.safetensors, the weights that predict in half precision, with the whole configuration,
and FILE.md, its model card: what it was trained on, by which command, for how long, and how well what is
written does on validation; with --test on the test objects too, once, when nothing is chosen any more. The
card stands in the weights as well. `predict --checkpoint FILE.safetensors` takes them, and without
--checkpoint what lies as SYSTEM.safetensors in one of the places that its help names.

With --onnx the networks are written that run on an image alone, for other programs: encoders, and heads
that are plain networks (opset 17, images [batch, channels, height, width] of the size that the system was
trained for, colours in [0, 1]). Nothing is scored then, unless -o is there too.

Examples:
  unsphere export img2mesh -c runs/clock -o weights/img2mesh.safetensors
  unsphere export mcmr -c runs/cars -o cars.safetensors --test
  unsphere export mcmr -c runs/cars --onnx cars.onnx"
)]
pub(crate) struct Export {
    /// What was trained.
    #[arg(index = 1)]
    pub(crate) system: String,
    /// What it is scored on; without it, what the run was trained on.
    #[arg(index = 2, requires = "output")]
    pub(crate) data: Option<PathBuf>,
    /// A run's folder, of which the best checkpoint is taken, or a checkpoint's file.
    #[arg(long, short, value_name = "RUN|FILE")]
    pub(crate) checkpoint: PathBuf,
    /// The last checkpoint of the run instead of the best.
    #[arg(long)]
    pub(crate) last: bool,
    /// Where the weights go, and their model card beside them; needed where no --onnx is there.
    #[arg(long, short, value_name = "FILE.safetensors", value_parser = weights())]
    #[arg(required_unless_present = "onnx")]
    pub(crate) output: Option<PathBuf>,
    /// Where its networks go, in ONNX's form; without -o nothing else is written, and nothing is scored.
    #[arg(long, value_name = "FILE.onnx", value_parser = onnx())]
    pub(crate) onnx: Option<PathBuf>,
    /// Replace files that are there.
    #[arg(long)]
    pub(crate) force: bool,
    /// Score the test data too: it is for the end.
    #[arg(long, requires = "output")]
    pub(crate) test: bool,
    #[command(flatten)]
    pub(crate) reading: Reading,
}

fn onnx() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| match path.extension() {
        Some(ending) if ending == "onnx" => Ok(path),
        _ => Err("networks are written: the name ends in .onnx"),
    })
}

fn weights() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| match path.extension() {
        Some(ending) if ending == "safetensors" => Ok(path),
        _ => Err("weights are written: the name ends in .safetensors"),
    })
}
