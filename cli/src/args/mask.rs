//! What can be said after `unsphere data mask`, and of masks after `unsphere capture`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use datasets::{MaskInput, Region};

use super::output::folder;
use super::reading::Reading;

#[derive(Args, Debug)]
#[command(
    after_help = "Without --model the object is what all cameras look at and what in its colours differs from
what is around it, in all views together: GrabCut's colour models and cuts, alternated with the
visual hull of all views' masks. It wants some background on all sides of the object in most images.

With --model a network says of each image what the object is (nothing is downloaded), and the
views put each other right: what the hull of the others does not cover is dropped, gaps that it
shows are filled. Images without cameras keep the largest part, and holes are filled.

Masks belong to the images as they are in their files; the distortion of a lens is left as it is.
To have it undone: unsphere data convert VIEWS --mask color-model --layout photos -o straight

Examples:
  unsphere data mask scan/ && unsphere fit scan/ -o mesh --masks scan/masks
  unsphere data mask scan/ -o masks --box -1,0,-1,1,2,1
  unsphere data mask scan/ -o masks --model isnet-general-use.onnx --kind isnet"
)]
pub(crate) struct Mask {
    /// Views of one object, or a folder of images where --model needs no cameras.
    pub(crate) path: PathBuf,
    #[command(flatten)]
    pub(crate) source: Masking,
    /// Folder for the masks, called as the images are [default: masks in the folder of the views].
    #[arg(long, short, visible_alias = "out", value_name = "FOLDER", value_parser = folder())]
    pub(crate) output: Option<PathBuf>,
    /// Write into a folder that exists already, replacing files of the same names.
    #[arg(long)]
    pub(crate) force: bool,
    #[command(flatten)]
    pub(crate) reading: Reading,
}

/// How masks are made.
#[derive(Args, Clone, Debug)]
pub(crate) struct Masking {
    /// A network that parts objects from backgrounds, in ONNX's form (a binary with the feature onnx).
    #[arg(long, value_name = "FILE")]
    pub(crate) model: Option<PathBuf>,
    /// How images are made ready for the network, and what its answer means.
    #[arg(long, value_enum, default_value_t = MaskModelKind::U2net, requires = "model")]
    pub(crate) kind: MaskModelKind,
    /// A rough box that holds the object, in the coordinates of the cameras, without --model [default: the ball that all
    /// cameras look at, as large as the images show it].
    #[arg(long = "box", value_name = "X0,Y0,Z0,X1,Y1,Z1", allow_hyphen_values = true)]
    #[arg(value_parser = region, conflicts_with = "model")]
    pub(crate) region: Option<Region>,
}

/// Families of networks, by what they expect of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum MaskModelKind {
    /// U²-Net and its small form: 320 pixels.
    U2net,
    /// IS-Net (DIS): 1024 pixels.
    Isnet,
    /// BiRefNet: 1024 pixels, logits.
    Birefnet,
}

#[cfg_attr(not(feature = "onnx"), allow(dead_code, reason = "said, and refused"))]
impl MaskModelKind {
    pub(crate) fn input(self) -> MaskInput {
        match self {
            Self::U2net => MaskInput::u2net(),
            Self::Isnet => MaskInput::isnet(),
            Self::Birefnet => MaskInput::birefnet(),
        }
    }
}

fn region(text: &str) -> Result<Region, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .filter_map(|n| n.trim().parse().ok())
        .filter(|n: &f64| n.is_finite())
        .collect();
    match numbers[..] {
        [a, b, c, d, e, f] if a < d && b < e && c < f && text.split(',').count() == 6 => {
            Ok(Region::cuboid([a, b, c], [d, e, f]))
        }
        _ => Err("expected six numbers, the lower corner of a box and the upper one".to_owned()),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_two_corners() {
        let found = region("-1,0,-2, 1,2.5,2").unwrap();
        assert_eq!(found, Region::cuboid([-1.0, 0.0, -2.0], [1.0, 2.5, 2.0]));
        for wrong in ["", "1,2,3", "1,1,1,0,2,2", "0,0,0,1,1,inf", "0,0,0,1,1,1,x", "a,0,0,1,1,1"] {
            assert!(region(wrong).is_err(), "{wrong}");
        }
    }
}
