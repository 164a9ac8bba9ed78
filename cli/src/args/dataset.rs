//! What can be said about datasets that are there: `unsphere data inspect`, `validate`, `convert`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::output::{Output, folder};
use super::reading::Reading;

#[derive(Args, Debug)]
#[command(
    after_help = "What looks wrong is named in words: flipped pictures, axes of another tool, inverted masks, masks
that are too large or too small, a lens or poses that are a little off, views that disagree with
the others, objects out of frame, sides that no view shows. docs/inspect.md has which sizes are found.

With -o a folder gets report.html, inspection.json, and for each object that was looked at a contact
sheet with the masks outlined and a drawing of the cameras around the visual hull; without, nothing
is written.

Examples:
  unsphere data inspect scan/
  unsphere data inspect ShapeNet/ --objects 12 -o look
  unsphere data inspect photos/ --turntable 36 --elevation 20 --fov 40
  unsphere data inspect scan/ --json"
)]
pub(crate) struct Inspect {
    /// A dataset of any layout, or the views of one object.
    pub(crate) path: PathBuf,
    #[command(flatten)]
    pub(crate) output: Output,
    #[command(flatten)]
    pub(crate) reading: Reading,
    /// How many objects are looked at closely, evenly spread over the list.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(crate) objects: u32,
}

#[derive(Args, Debug)]
#[command(
    after_help = "Every object, every view and every true shape is read. The exit code is 3 if there is any fault.

Examples:
  unsphere data validate scan/
  unsphere data validate ShapeNet/ --json"
)]
pub(crate) struct Validate {
    /// A dataset of any layout, or the views of one object.
    pub(crate) path: PathBuf,
    #[command(flatten)]
    pub(crate) reading: Reading,
}

#[derive(Args, Debug)]
#[command(
    after_help = "Layouts differ in what they can say: kaolin's has no lens off the centre, COLMAP's and
transforms.json no parallel rays. What cannot be said is refused, with the reason. A dataset of
many objects becomes a folder for each, CATEGORY/NAME; --object takes one alone. Only r2n2 has a
place for true shapes.

Examples:
  unsphere data convert scan/ scan-nerf --layout transforms
  unsphere data convert rendered_clock.zip clock --layout colmap
  unsphere data convert turn/ posed --layout photos --turntable 36 --fov 40"
)]
pub(crate) struct Convert {
    /// A dataset of any layout, or the views of one object.
    pub(crate) from: PathBuf,
    /// Folder for the result; made if it does not exist.
    #[arg(value_parser = folder())]
    pub(crate) to: PathBuf,
    /// The layout to write.
    #[arg(long, value_enum)]
    pub(crate) layout: WrittenLayout,
    /// Write into a folder that exists already, replacing files of the same names.
    #[arg(long)]
    pub(crate) force: bool,
    #[command(flatten)]
    pub(crate) reading: Reading,
}

/// Layouts that are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum WrittenLayout {
    /// kaolin's synthetic views.
    Kaolin,
    /// `transforms.json` of NeRF and nerfstudio.
    Transforms,
    /// A COLMAP project with a binary model.
    Colmap,
    /// A COLMAP project with a text model.
    ColmapText,
    /// Photographs with our `cameras.json`, which can say every camera.
    Photos,
    /// ShapeNet with R2N2's renderings, the true shapes too; only for cameras like R2N2's.
    R2n2,
}
