//! What can be said after `unsphere data depth`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::output::folder;
use super::values::hex_color;

#[derive(Args, Debug)]
#[command(
    after_help = "Any network that takes one image and answers with one number per pixel will do. It is exported
to ONNX by its authors or with torch.onnx; nothing is downloaded. Each picture NAME.png becomes
NAME.pfm, the disparity as the network gives it (larger is nearer, in no unit), and NAME.png, the
same in shades of grey. Where a picture has transparency it is put before --background, and a floor
that the network made up beneath the object is reported.

Needs a binary with the feature onnx: cargo install --path cli --features onnx

Examples:
  unsphere data depth chair.png --model midas_v21_small_256.onnx -o depth
  unsphere data depth *.png --model vits.onnx --kind depth-anything -o depth"
)]
#[cfg_attr(not(feature = "onnx"), allow(dead_code, reason = "said, and refused"))]
pub(crate) struct Depth {
    /// Images, PNG or JPEG.
    #[arg(required = true, value_name = "IMAGES")]
    pub(crate) pictures: Vec<PathBuf>,
    /// The network, in ONNX's form.
    #[arg(long, value_name = "FILE")]
    pub(crate) model: PathBuf,
    /// How images are made ready for it.
    #[arg(long, value_enum, default_value_t = DepthModelKind::MidasSmall)]
    pub(crate) kind: DepthModelKind,
    /// Folder for the results; new or empty.
    #[arg(long, short, visible_alias = "out", value_name = "FOLDER", value_parser = folder())]
    pub(crate) output: PathBuf,
    /// Write into a folder that exists already, replacing files of the same names.
    #[arg(long)]
    pub(crate) force: bool,
    /// What is put behind transparent images.
    #[arg(long, value_name = "RRGGBB", default_value = "ffffff", value_parser = hex_color)]
    pub(crate) background: [u8; 3],
}

/// Families of networks, by what they expect of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum DepthModelKind {
    /// MiDaS 2.1 small: within 256 pixels.
    MidasSmall,
    /// MiDaS 2.1: within 384 pixels.
    Midas,
    /// MiDaS 3 with transformers (DPT): 384 pixels.
    MidasDpt,
    /// Depth Anything, versions 1 and 2: at least 518 pixels.
    DepthAnything,
}
