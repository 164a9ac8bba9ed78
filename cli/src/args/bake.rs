//! `unsphere bake`.

use std::path::PathBuf;

use clap::Args;
use mesh_core::UpAxis;
use recon::bake::UvKind;

use super::output::Output;
use super::reading::Reading;
use super::values::{Choices, UpOrAuto, one_of, up_axis};

const UVS: &Choices<UvKind> = &[
    (
        "auto",
        "The mesh's own where they lie in [0, 1] and do not overlap, else new ones",
        UvKind::Auto,
    ),
    ("keep", "The mesh's own, also where they overlap", UvKind::Keep),
    ("new", "New ones, in charts with room between them", UvKind::New),
];

#[derive(Args, Debug)]
#[command(
    after_help = "VIEWS is whatever `unsphere fit` reads: images with masks and cameras. The mesh must be in the frame of
the cameras, as mesh.obj and mesh.ply of a fit are; mesh.glb of a fit stands upright, so that where
the cameras have another axis up than +Y it needs --mesh-up y. Where mesh and masks do not meet, a
warning says what is probably wrong.

The folder gets mesh.glb, mesh.obj with its .mtl and .png, mesh.ply (a colour per vertex),
turntable.gif, report.html and metrics.json. The scores are of all views that were baked, and of
those of --score or --hold-out beside them.

Examples:
  unsphere bake edited.glb views/ -o textured
  unsphere bake scan.ply photos/ -o textured --texture-size 4096
  unsphere bake edited.obj views/ -o textured --uv keep --score others/
  unsphere bake clock/mesh.glb scan/transforms.json -o again --mesh-up y"
)]
pub(crate) struct Bake {
    /// The mesh: .obj, .ply, .glb, .off or .stl.
    pub(crate) mesh: PathBuf,
    /// Views of the object.
    pub(crate) views: PathBuf,
    #[command(flatten)]
    pub(crate) output: Output,
    /// Which texture coordinates.
    #[arg(long, default_value = "auto", value_parser = one_of(UVS))]
    pub(crate) uv: UvKind,
    /// Width and height of the texture in pixels, 64 to 8192 [default: as fine as the images, at most 4096].
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(64..=8192))]
    pub(crate) texture_size: Option<u32>,
    /// Mix photographs as they are, though they differ in exposure or white balance.
    #[arg(long)]
    pub(crate) keep_exposure: bool,
    /// Which axis is up in MESH, where that is not the one of the cameras: it is turned from the one to the other.
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    pub(crate) mesh_up: Option<UpAxis>,
    #[command(flatten)]
    pub(crate) reading: Reading,
    /// Other views of the object, in the same coordinates, that only score the result.
    #[arg(long, value_name = "VIEWS")]
    pub(crate) score: Option<PathBuf>,
    /// Keep every Nth view out (4, 9, 14, .. with 5), or those that the source keeps for tests, and score the result by them.
    #[arg(long, value_name = "N", conflicts_with = "score")]
    #[arg(value_parser = clap::value_parser!(u32).range(2..))]
    pub(crate) hold_out: Option<u32>,
    /// Which axis is up in the world of the cameras: y, z, -y and so on; auto finds it by the cameras. The page, the turntable and
    /// mesh.glb stand upright.
    #[arg(long, value_name = "AXIS", default_value = "auto", allow_hyphen_values = true, value_parser = up_axis)]
    pub(crate) up: UpOrAuto,
}
