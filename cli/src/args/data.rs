//! What can be said after `unsphere data`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use synth::NormalSpace;
use synth::generate::{CameraSet, Normalize, OutputLayout};
use train::Shard;

use super::dataset::{Convert, Inspect, Validate};
use super::depth::Depth;
use super::mask::Mask;
use super::output::folder;
use super::settings::DataSettings;
use super::values::{Choices, LIGHTS, Light, hex_color, one_of};

#[derive(Args, Debug)]
#[command(arg_required_else_help = true)]
pub(crate) struct Data {
    #[command(subcommand)]
    pub(crate) verb: DataVerb,
}

#[derive(Debug, Subcommand)]
pub(crate) enum DataVerb {
    /// Make a dataset: procedural objects, or a mesh of yours, seen from all around.
    Generate(Box<Generate>),
    /// Show what is in a dataset, and say what looks wrong with its cameras and masks.
    Inspect(Inspect),
    /// Read everything in a dataset and list every fault.
    Validate(Validate),
    /// Write a dataset in another layout.
    Convert(Convert),
    /// Estimate the depth of images with a network of yours, in ONNX's form.
    Depth(Depth),
    /// Find the object in images before any background: by its colours in all views, or with a network of yours.
    Mask(Box<Mask>),
}

#[derive(Args, Debug)]
#[command(
    after_help = "Families: airplane (plane), car, bus, chair, table, lamp, bicycle (bike), motorbike (motorcycle),
alarm_clock (clock), or all.

The folder gets one folder for each object, objects.json with the seeds and what was drawn,
splits.json, contact_sheet.png and dataset.toml. The same options give the same bytes, whatever the
number of threads. Ctrl-C keeps the objects that are complete; the same command again goes on from
there.

--set reaches what has no option of its own, for example
  --set 'split=[0.8,0.1,0.1]'                  training, validation, test
  --set 'noise={rotation=20,scale=0.2}'        how rough the poses are
  --set 'monocular={blur=[0,0],ground=[0,0]}'  sharp depth without a floor

Examples:
  unsphere data generate --families plane,car --objects 200 --layout r2n2 -o a
  unsphere data generate --cameras sphere --size 256 --depth true -o all
  unsphere data generate --cameras collection --layout transforms -o photos
  unsphere data generate --from furniture/ --layout r2n2 -o views
  unsphere data generate --objects 5000 --shard 2/8 -o shapes
  unsphere data generate --from chair.obj --cameras sphere --views 99 -o chair"
)]
pub(crate) struct Generate {
    /// Folder of the dataset; new, empty, or begun with the same options.
    #[arg(long, short, visible_alias = "out", value_name = "FOLDER", value_parser = folder())]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) configuration: DataSettings,
    /// Only the I-th of N parts of the objects, from 1. Several processes make one dataset in one folder, with the same
    /// options otherwise; the last to end writes the files of the whole.
    #[arg(long, value_name = "I/N")]
    pub(crate) shard: Option<Shard>,
    /// What kinds of objects, separated by commas.
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    pub(crate) families: Vec<String>,
    /// Objects of each kind [default: 20].
    #[arg(long, value_name = "N")]
    pub(crate) objects: Option<usize>,
    /// This mesh instead (.obj, .ply, .glb, .off or .stl), or all of a folder with a subfolder for each kind; colours and
    /// texture are kept.
    #[arg(long, value_name = "MESH|FOLDER", conflicts_with_all = ["families", "objects"])]
    pub(crate) from: Option<PathBuf>,
    /// A table (CSV) of the folder's meshes with the columns `file` and `split`: train, validation or test. Meshes that it
    /// does not have for one of these are left out; without it the subsets are drawn.
    #[arg(long, value_name = "FILE", requires = "from")]
    pub(crate) splits: Option<PathBuf>,
    /// What size that mesh is brought to.
    #[arg(long, value_parser = one_of(SIZE_RULES), default_value = "unit-diagonal", requires = "from")]
    pub(crate) normalize: Normalize,
    /// How files are laid out [default: kaolin].
    #[arg(long, value_parser = one_of(LAYOUTS))]
    pub(crate) layout: Option<OutputLayout>,
    /// Where cameras stand [default: r2n2].
    #[arg(long, value_parser = one_of(CAMERAS))]
    pub(crate) cameras: Option<CameraSet>,
    /// Views of each object [default: 24, in collections 1].
    #[arg(long, value_name = "N")]
    pub(crate) views: Option<usize>,
    /// Pixels: width and height, or WIDTHxHEIGHT [default: 137].
    #[arg(long, value_name = "PIXELS", value_parser = size)]
    pub(crate) size: Option<[usize; 2]>,
    /// Kinds of depth to write, separated by commas.
    #[arg(long, value_enum, value_delimiter = ',')]
    pub(crate) depth: Vec<DepthKind>,
    /// Write normals, in this frame.
    #[arg(long, value_parser = one_of(FRAMES))]
    pub(crate) normals: Option<NormalSpace>,
    /// What is behind the object [default: 000000].
    #[arg(long, value_name = "RRGGBB", value_parser = hex_color)]
    pub(crate) background: Option<[u8; 3]>,
    /// The light [default: studio].
    #[arg(long, value_parser = one_of(LIGHTS))]
    pub(crate) light: Option<Light>,
    /// Points on the surface, in the layout r2n2 [default: 10000].
    #[arg(long, value_name = "N")]
    pub(crate) points: Option<usize>,
    /// Cells along each side of the voxels, in the layout r2n2 [default: 32].
    #[arg(long, value_name = "N")]
    pub(crate) voxels: Option<usize>,
}

const LAYOUTS: &Choices<OutputLayout> = &[
    ("kaolin", "kaolin's synthetic views", OutputLayout::Kaolin),
    ("r2n2", "ShapeNet with 3D-R2N2's renderings, points and voxels", OutputLayout::R2n2),
    ("transforms", "A transforms.json of NeRF and nerfstudio", OutputLayout::Transforms),
];

const ROUGH: &str =
    "As photographs are taken, one an object, with a rough pose beside the true one";
const CAMERAS: &Choices<CameraSet> = &[
    ("r2n2", "From a little above, all around, as 3D-R2N2 rendered ShapeNet", CameraSet::R2n2),
    ("sphere", "Evenly from everywhere, also from below", CameraSet::Sphere),
    ("collection", ROUGH, CameraSet::Collection),
];

const FRAMES: &Choices<NormalSpace> = &[
    ("camera", "x right, y up, z towards the viewer", NormalSpace::Camera),
    ("world", "The object's own", NormalSpace::World),
];

const SIZE_RULES: &Choices<Normalize> = &[
    ("unit-diagonal", "A box of diagonal 1, centred, as ShapeNet has it", Normalize::UnitDiagonal),
    ("unit-box", "A box of longest side 1, centred", Normalize::UnitBox),
    ("unit-sphere", "Vertices within 1 of the box's middle, centred", Normalize::UnitSphere),
    ("none", "As it is", Normalize::None),
];

/// Kinds of depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum DepthKind {
    /// Planar depth, EXR.
    True,
    /// Inverse depth up to scale and shift, blurred, with a floor: as networks guess it.
    Monocular,
}

fn size(text: &str) -> Result<[usize; 2], String> {
    let number = |text: &str| text.parse::<usize>().ok().filter(|n| (8..=8192).contains(n));
    let pair = match text.split_once(['x', 'X']) {
        Some((width, height)) => number(width).zip(number(height)),
        None => number(text).map(|n| (n, n)),
    };
    pair.map(|(width, height)| [width, height])
        .ok_or_else(|| "expected pixels, 8 to 8192, for example 256 or 320x240".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_one_number_or_two() {
        assert_eq!(size("137"), Ok([137, 137]));
        assert_eq!(size("320x240"), Ok([320, 240]));
        for wrong in ["", "x", "7", "10x", "100000", "-9", "8x8x8"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }
}
