//! Arguments of `unsphere predict`.

use std::path::PathBuf;

use clap::Args;

use super::output::Output;
use super::reading::Reading;

#[derive(Args, Debug)]
#[command(
    after_help = "VIEWS is whatever `unsphere fit` reads: images with masks and cameras, of any size and number. A
view whose file is missing is left out with a warning. Views that are not given judge the mesh.

The folder, unsphere-predict unless -o names one, gets mesh.glb, mesh.obj, mesh.ply, turntable.gif,
report.html and metrics.json; where the mesh was refined, one-pass.glb too, as the network made it, and
its scores beside the others. Of mcmr, whose meshes have textures, mesh.obj comes with mesh.mtl and
mesh.png; of pixel2mesh, ode-pixel2mesh, depth-pixel2mesh and mesh-rcnn there are deformation.gif and
sequence/, the mesh on its way as 00.ply, 01.ply and so on.
The mesh is in the coordinates of the cameras, which must be those of the training: a model knows
objects of the size and place that it has seen. Without --checkpoint it is SYSTEM.safetensors, as
`unsphere export` writes it, in the first of these folders that has it: weights beside the program,
share/unsphere/weights where it is installed, unsphere/weights among the user's data
(XDG_DATA_HOME), weights where it was built.

Examples:
  unsphere predict img2mesh views/ -o out                with its own weights
  unsphere predict pixel2mesh image.png -o out           from one image
  unsphere predict pixel2mesh image.png --solid -o out   to be printed
  unsphere predict img2mesh views/ -c run -o out         with your weights
  unsphere predict img2mesh views/ -c run --views 4,9    from two of them
  unsphere predict img2mesh two/ -c run --score views/   scored by others
  unsphere predict mesh-rcnn a.png -c run --depth a.pfm  with depth"
)]
pub(crate) struct Predict {
    /// What was trained.
    #[arg(index = 1)]
    pub(crate) system: String,
    /// Views of one object.
    #[arg(index = 2)]
    pub(crate) views: PathBuf,
    /// A run's folder or its checkpoints, of which the best is taken, or a checkpoint's file; without it, the weights that
    /// come along.
    #[arg(long, short, value_name = "RUN|FILE")]
    pub(crate) checkpoint: Option<PathBuf>,
    /// Where the weights that come along are, instead of the usual places.
    #[arg(long, value_name = "FOLDER", conflicts_with = "checkpoint")]
    pub(crate) weights_dir: Option<PathBuf>,
    /// The last checkpoint of the run instead of the best.
    #[arg(long, requires = "checkpoint")]
    pub(crate) last: bool,
    #[command(flatten)]
    pub(crate) output: Output,
    /// Names of the views that are given, whole or by their last part, or their numbers, which where names have none count from 0;
    /// without it, all.
    #[arg(long = "views", value_name = "NAME,..", value_delimiter = ',', conflicts_with = "first")]
    pub(crate) given: Vec<String>,
    /// How many views are given, from the first on.
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) first: Option<u32>,
    /// Depth of the image (EXR, PFM, npy, grey PNG): planar, or, for a model of estimates, disparity of any scale.
    ///
    /// One number a pixel, in any unit; pictures in colour are refused. It is known at a tenth of the object's pixels at least (0 is a
    /// hole), and as wide for its height as the image.
    #[arg(long, value_name = "FILE")]
    pub(crate) depth: Option<PathBuf>,
    /// Focal lengths and principal point of the image, pixels.
    #[arg(
        long,
        value_name = "FX,FY,CX,CY",
        value_delimiter = ',',
        num_args = 1,
        allow_negative_numbers = true
    )]
    pub(crate) intrinsics: Vec<f64>,
    /// More views of the object, which only judge the mesh.
    #[arg(long, value_name = "VIEWS")]
    pub(crate) score: Option<PathBuf>,
    /// Steps of refinement: the predicted mesh is moved until its outlines agree with the given views, and takes their
    /// colours. 0 leaves it as the network made it. Without it, 100 for img2mesh, 50 for
    /// mesh-rcnn and 0 for the others.
    #[arg(long, value_name = "STEPS", value_parser = clap::value_parser!(u32).range(..=10_000))]
    pub(crate) refine: Option<u32>,
    /// Where faces run through each other, make a solid of the mesh: the surface of all that it encloses, with other vertices than the
    /// network's, and without a texture. A refined mesh seldom needs it.
    #[arg(long)]
    pub(crate) solid: bool,
    /// Also measure how long a prediction takes, and write it down: the median of five more.
    #[arg(long)]
    pub(crate) time: bool,
    #[command(flatten)]
    pub(crate) reading: Reading,
}
