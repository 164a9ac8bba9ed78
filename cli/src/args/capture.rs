//! What can be said after `unsphere capture`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::mask::Masking;
use super::output::folder;

#[derive(Args, Debug)]
#[command(
    after_help = "Photographs of an object that stands still, from all around, sharp and overlapping: 20 to 100 of
them. COLMAP, a program of others, finds the cameras (on the CPU; minutes); the distortion of the
lens is undone, masks are found as `unsphere data mask` does, and it is looked whether they agree.
What a photograph says of its orientation is applied.

The folder gets images/, masks/ and cameras.json, which `unsphere fit` reads, report.html, and the
model of COLMAP in colmap/. Ctrl-C stops COLMAP, and nothing is written.

Needs COLMAP: apt-get install colmap, brew install colmap, or conda install -c conda-forge colmap

Examples:
  unsphere capture photos/ -o mug && unsphere fit mug -o mug-mesh
  unsphere capture photos/ -o mug --max-size 1600 --lens simple-radial
  unsphere capture photos/ -o mug --model isnet-general-use.onnx --kind isnet"
)]
pub(crate) struct Capture {
    /// A folder of photographs, PNG or JPEG.
    pub(crate) photographs: PathBuf,
    /// Folder for the views; made if it does not exist.
    #[arg(long, short, visible_alias = "out", value_name = "FOLDER", value_parser = folder())]
    pub(crate) output: PathBuf,
    /// Write into a folder that is there and not empty, replacing files of the same names.
    #[arg(long)]
    pub(crate) force: bool,
    #[command(flatten)]
    pub(crate) masking: Masking,
    /// How the lens bends rays.
    #[arg(long, value_enum, default_value_t = LensModel::Radial)]
    pub(crate) lens: LensModel,
    /// Photographs were taken one after another, and only neighbours overlap: faster for hundreds.
    #[arg(long)]
    pub(crate) sequential: bool,
    /// Average larger photographs down to this many pixels on their longer side.
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(64..))]
    pub(crate) max_size: Option<u32>,
    /// The program: a name on the path, or a file.
    #[arg(long, value_name = "PROGRAM", default_value = "colmap")]
    pub(crate) colmap: PathBuf,
}

/// Lenses, by COLMAP's models.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum LensModel {
    /// A pinhole: no distortion.
    SimplePinhole,
    /// One number.
    SimpleRadial,
    /// Two numbers: most cameras and telephones.
    Radial,
    /// Four numbers, and two focal lengths.
    Opencv,
    /// A fisheye.
    OpencvFisheye,
}

impl LensModel {
    /// COLMAP's name.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::SimplePinhole => "SIMPLE_PINHOLE",
            Self::SimpleRadial => "SIMPLE_RADIAL",
            Self::Radial => "RADIAL",
            Self::Opencv => "OPENCV",
            Self::OpencvFisheye => "OPENCV_FISHEYE",
        }
    }
}
