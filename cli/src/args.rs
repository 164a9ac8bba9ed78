//! The command line: what can be said, and the help that teaches it.

mod bake;
mod capture;
mod convert;
mod data;
mod dataset;
mod depth;
mod eval;
mod export;
mod mask;
mod output;
mod predict;
mod reading;
mod reproduce;
mod settings;
mod values;

use std::any::TypeId;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use mesh_core::UpAxis;

use train::Shard;

pub(crate) use bake::Bake;
pub(crate) use capture::Capture;
pub(crate) use convert::ConvertMesh;
pub(crate) use data::{Data, DataVerb, DepthKind, Generate};
pub(crate) use dataset::{Convert, Inspect, Validate, WrittenLayout};
pub(crate) use depth::Depth;
#[cfg(feature = "onnx")]
pub(crate) use depth::DepthModelKind;
pub(crate) use eval::Eval;
pub(crate) use export::Export;
pub(crate) use mask::{Mask, Masking};
pub(crate) use output::{Output, Picture, create, refuse_existing};
pub(crate) use predict::Predict;
pub(crate) use reading::Reading;
pub(crate) use reproduce::Reproduce;
pub(crate) use settings::{Configuration, SystemSettings};
pub(crate) use values::UpOrAuto;
use values::{LIGHTS, Light, degrees, hex_color, one_of, up_axis};

/// Images of an object in, a triangle mesh out.
///
/// Every mesh starts as a sphere and is deformed until its images agree with yours. No GPU, no
/// display and no network are needed.
#[derive(Debug, Parser)]
#[command(name = "unsphere", version, arg_required_else_help = true, max_term_width = 100)]
#[command(after_help = "Examples:
  unsphere demo                                  see it work, in seconds
  unsphere fit rendered_clock.zip -o clock       a mesh from views
  unsphere render clock/mesh.glb -o turn.gif     look at it from all around
  unsphere train img2mesh clock.zip -o run       learn to predict meshes
  unsphere predict img2mesh few/ -c run -o mesh  a mesh of a few views
  unsphere bake edited.glb clock.zip -o textured a texture for a mesh
  unsphere metrics clock/mesh.ply truth.obj      compare two meshes
  unsphere check clock/mesh.ply                  is it closed, is it printable?
  unsphere convert clock/mesh.glb -o clock.stl   another format or size
  unsphere data inspect scan/                    do its cameras and masks agree?

Exit codes: 0 done, 1 failure, 2 wrong usage, 3 bad input data, 130 stopped by Ctrl-C.")]
pub(crate) struct Arguments {
    #[command(flatten)]
    pub(crate) global: Global,
    #[command(flatten)]
    pub(crate) logging: Logging,
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// What every command understands.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct Global {
    /// Seed of everything that is drawn at random; results are the same for the same seed.
    #[arg(long, global = true, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Threads to use, 0 for as many as there are cores; results do not depend on it.
    #[arg(long, global = true, value_name = "N", default_value_t = 0, hide_default_value = true)]
    #[arg(value_parser = clap::value_parser!(u16).range(..=1024))]
    pub(crate) threads: u16,
    /// Say nothing on stderr but errors.
    #[arg(long, short, global = true)]
    pub(crate) quiet: bool,
    /// Print results as JSON on stdout.
    #[arg(long, global = true)]
    pub(crate) json: bool,
}

/// Where the events of a command are logged.
#[derive(Args, Clone, Debug)]
pub(crate) struct Logging {
    /// Also write what happens as JSON, an object a line, behind what is in the file; - for stdout, the result included.
    #[arg(long, global = true, value_name = "FILE")]
    pub(crate) log_json: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Make views of an alarm clock, fit a mesh to them, and compare it with the true clock.
    Demo(Demo),
    /// Fit a mesh to views of one object: images, masks and cameras.
    Fit(Fit),
    /// Train a system that predicts meshes, or go on with a training.
    Train(Train),
    /// Score a trained system on what it did not see.
    Eval(Eval),
    /// Make a mesh of views by a trained system, without fitting.
    Predict(Predict),
    /// Give the weights of a training away: small, scored, with a model card.
    Export(Export),
    /// Give a mesh that exists a texture, baked from views with cameras.
    Bake(Bake),
    /// Draw a mesh: from the cameras of views, or on a turntable.
    Render(Render),
    /// Write a mesh in another format, simplified or to a size, for a printer for one.
    Convert(ConvertMesh),
    /// Compare two meshes by the published protocols.
    Metrics(Metrics),
    /// Examine a mesh, views, weights, or a configuration, before work is spent on them.
    Check(Check),
    /// Find the cameras of photographs with COLMAP, and what in them is the object: views to fit.
    Capture(Capture),
    /// Make, inspect, validate and convert datasets.
    Data(Data),
    /// Make a published table again, with what it claims.
    Reproduce(Reproduce),
    /// Print a completion script for a shell.
    Completions(Completions),
    /// Write the manual's pages, one a command, for `man`.
    Man(Manual),
}

#[derive(Args, Debug)]
#[command(after_help = "Examples:
  unsphere demo                        the standard clock, into unsphere-demo
  unsphere demo --seed 7 -o seven      another clock
  unsphere demo --views 40 --size 128  fewer and smaller pictures
  unsphere demo --set color=texture    colours in a texture")]
pub(crate) struct Demo {
    #[command(flatten)]
    pub(crate) output: Output,
    #[command(flatten)]
    pub(crate) configuration: Configuration,
    /// How many images are made of the clock.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(3..=10_000))]
    pub(crate) views: u32,
    /// Their width and height in pixels.
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(16..=4096))]
    pub(crate) size: u32,
    /// Keep the images too, in kaolin's layout, as `views/` in the output folder.
    #[arg(long)]
    pub(crate) keep_views: bool,
}

#[derive(Args, Debug)]
#[command(after_help = "VIEWS is one of
  a folder or zip of kaolin's synthetic views (0_rgb.png, 0_metadata.json, ..)
  a transforms.json of NeRF, instant-ngp or nerfstudio, or its folder
  a COLMAP project (sparse/0, images)
  photographs with a cameras.json or projection matrices
  photographs from a turntable (--turntable)
  a BOP scene, or a dataset of many (--object)

Every fifth view (4, 9, 14, ..) is kept out of the fit and scores the result, or those that the
source keeps for tests (transforms_test.json, test_filenames); --set hold-out=none uses all. The folder, unsphere-fit unless
-o names one, gets mesh.glb, mesh.obj, mesh.ply, turntable.gif, report.html, metrics.json
and config.toml. The mesh is in the coordinates of the cameras; mesh.glb is turned so that up is +Y.
Ctrl-C ends the fit early and writes what there is, as doubtful at best; a second one drops it.

A verdict says how far the mesh can be trusted: good, doubtful or failed, each with its reasons. Failed
is an error (exit code 1), with --strict doubtful too; the mesh is written all the same.

Examples:
  unsphere fit rendered_clock.zip -o clock
  unsphere fit scan/transforms.json -o scan-mesh --quality high
  unsphere fit photos/ -o mug --mask backdrop --max-size 1024
  unsphere fit photos/ -o mug --masks masks/ --score other-photos/
  unsphere fit scan/ -o again --config scan-mesh/config.toml --force
  unsphere fit --batch objects.txt -o meshes --shard 2/4")]
pub(crate) struct Fit {
    /// Views of one object.
    #[arg(required_unless_present = "batch")]
    pub(crate) views: Option<PathBuf>,
    /// Many objects instead: a text file with the path of the views of one in each line, and behind a tab that of its true
    /// mesh where it is known. Each gets a folder in the output, which gets summary.csv and index.html; what is done
    /// already is left.
    #[arg(long, value_name = "LIST", conflicts_with_all = ["views", "score", "truth"])]
    pub(crate) batch: Option<PathBuf>,
    /// Only the I-th of N parts of the batch, from 1; in a job array of Slurm it is the task's (SLURM_ARRAY_TASK_ID,
    /// SLURM_ARRAY_TASK_COUNT).
    #[arg(long, value_name = "I/N")]
    pub(crate) shard: Option<Shard>,
    #[command(flatten)]
    pub(crate) output: Output,
    #[command(flatten)]
    pub(crate) configuration: Configuration,
    #[command(flatten)]
    pub(crate) reading: Reading,
    /// Other views of the object, in the same coordinates: the result is scored on these, and all of VIEWS are fitted.
    #[arg(long, value_name = "VIEWS")]
    pub(crate) score: Option<PathBuf>,
    /// The true mesh, in the same coordinates: the result is compared with it. One that lies elsewhere is found out, and the one
    /// beside the views that does not is suggested.
    #[arg(long, value_name = "MESH")]
    pub(crate) truth: Option<PathBuf>,
    /// A verdict of doubtful is an error too, as one of failed is; the mesh is written all the same.
    #[arg(long)]
    pub(crate) strict: bool,
    /// Which axis is up: y, z, -y and so on; auto finds it by the cameras. The page, the turntable and mesh.glb stand
    /// upright.
    #[arg(long, value_name = "AXIS", default_value = "auto", allow_hyphen_values = true, value_parser = up_axis)]
    pub(crate) up: UpOrAuto,
}

#[derive(Args, Debug)]
#[command(
    after_help = "The folder describes itself: config.toml, provenance.json, metrics.jsonl and .csv, tensorboard/,
checkpoints/ (best and last), samples/ and report.html. Ctrl-C and SIGTERM write a checkpoint; a run that was
stopped or killed goes on with --resume, and its result is that of a run that was not, bit by bit.
`unsphere check --system img2mesh` says what a configuration amounts to, with --options what can be set.

Examples:
  unsphere train img2mesh -o runs/look --preset tiny  a made clock, in seconds
  unsphere train img2mesh rendered_clock.zip -o runs/clock --max-size 256
  unsphere train img2mesh --resume runs/clock --max-size 256 --set epochs=80
  unsphere train img2mesh mugs/ --from runs/clock -o runs/mugs
  unsphere eval img2mesh --checkpoint runs/clock --max-size 256
  tensorboard --logdir runs
Several processes, of a build with feature mpi, share the shards of each batch:
  mpirun -n 4 unsphere train img2mesh mugs/ -o runs/mugs --set shards=4"
)]
pub(crate) struct Train {
    /// What is trained.
    #[arg(index = 1)]
    pub(crate) system: String,
    /// What it learns from; without it the system makes its own.
    #[arg(index = 2)]
    pub(crate) data: Option<PathBuf>,
    /// Folder for the run; made if it does not exist.
    #[arg(long, short, value_name = "RUN", required_unless_present = "resume")]
    #[arg(value_parser = output::folder())]
    pub(crate) output: Option<PathBuf>,
    /// Replace a run that is there.
    #[arg(long)]
    pub(crate) force: bool,
    /// Go on with this run, from its last checkpoint.
    #[arg(long, value_name = "RUN", conflicts_with_all = ["output", "force", "preset", "config"])]
    pub(crate) resume: Option<PathBuf>,
    /// Begin with the weights of this run or checkpoint, and with its options where --set does not say otherwise, to learn from
    /// other data, or on with other options; what it lacks begins at random.
    #[arg(long, value_name = "WEIGHTS", conflicts_with_all = ["resume", "preset", "config"])]
    pub(crate) from: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) settings: SystemSettings,
    #[command(flatten)]
    pub(crate) reading: Reading,
}

#[derive(Args, Debug)]
#[command(after_help = "What is written follows from the name after -o:
  turn.gif     the turntable, animated
  front.png    one image: the first camera, or the one that --view names
  folder       one PNG per camera; with --depth also NAME_depth.exr

Examples:
  unsphere render mesh.glb -o turn.gif --frames 72 --elevation 30
  unsphere render mesh.ply -o front.png --size 1024 --light studio
  unsphere render mesh.ply -o again --cameras rendered_clock.zip --depth
  unsphere render scan.ply -o turn.gif --up z")]
pub(crate) struct Render {
    /// The mesh: .obj, .ply, .glb, .off or .stl.
    pub(crate) mesh: PathBuf,
    /// A .gif, a .png, or a folder.
    #[arg(long, short, value_name = "PATH", value_parser = output::picture())]
    pub(crate) output: PathBuf,
    /// Replace what is there.
    #[arg(long)]
    pub(crate) force: bool,
    /// Views whose cameras are used; without them the mesh stands on a turntable.
    #[arg(long, value_name = "VIEWS")]
    pub(crate) cameras: Option<PathBuf>,
    /// Only the camera of this view; can be given many times.
    #[arg(long = "view", value_name = "NAME")]
    pub(crate) view: Vec<String>,
    /// Images on the turntable.
    #[arg(long, default_value_t = 48, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    #[arg(conflicts_with = "cameras")]
    pub(crate) frames: u32,
    /// How far above the object the turntable's camera stands, degrees.
    #[arg(long, default_value_t = 20.0, allow_negative_numbers = true, value_name = "DEGREES")]
    #[arg(value_parser = degrees, conflicts_with = "cameras")]
    pub(crate) elevation: f64,
    /// Width and height of the turntable's images.
    #[arg(long, default_value_t = 400, value_parser = clap::value_parser!(u32).range(8..=8192))]
    #[arg(conflicts_with = "cameras")]
    pub(crate) size: u32,
    /// Which axis of the mesh is up on the turntable: y, z, -y and so on.
    #[arg(
        long,
        value_name = "AXIS",
        default_value = "y",
        allow_hyphen_values = true,
        conflicts_with = "cameras"
    )]
    pub(crate) up: UpAxis,
    /// Also write planar depth, as EXR.
    #[arg(long)]
    pub(crate) depth: bool,
    /// The light [default: flat, and shape where the mesh has no colours].
    #[arg(long, value_parser = one_of(LIGHTS))]
    pub(crate) light: Option<Light>,
    /// What is behind the object [default: edf0f5 on a turntable, 000000 from the cameras of views].
    #[arg(long, value_name = "RRGGBB", value_parser = hex_color)]
    pub(crate) background: Option<[u8; 3]>,
}

#[derive(Args, Debug)]
#[command(
    after_help = "Each preset does what a paper or its code does: normalisation, points, squares, thresholds. Its
formula is in the output. Meshes must be in the same coordinates; nothing is aligned unless the
protocol says so, and where the truth lies in another frame a warning says how. A mesh that is flat
has no 3D IoU.

Examples:
  unsphere metrics mesh.ply truth.obj
  unsphere metrics mesh.ply truth.obj --preset meshrcnn --preset occnet --json"
)]
pub(crate) struct Metrics {
    /// The mesh to judge: .obj, .ply, .glb, .off or .stl.
    pub(crate) prediction: PathBuf,
    /// The true mesh.
    pub(crate) truth: PathBuf,
    /// Only this protocol: p2m, meshrcnn, occnet or mcmr; can be given many times.
    #[arg(long, value_name = "NAME")]
    pub(crate) preset: Vec<String>,
}

#[derive(Args, Debug)]
#[command(
    after_help = "A mesh passes when it is a closed solid: finite, closed, manifold, oriented, outward, and no face runs
through another one. Otherwise the exit code is 1 and the failures are named. Of weights, and of a training's
folder, it is said what they are of; those that are damaged are bad input.

Examples:
  unsphere check mesh.ply
  unsphere check runs/clock                        a training, or a .safetensors
  unsphere check --config fit.toml --set level=6
  unsphere check --config -                        all settings, by default
  unsphere check --system img2mesh --preset paper  what a system amounts to
  unsphere check --system img2mesh --options       what its settings mean
  unsphere check --views rendered_clock.zip"
)]
#[command(arg_required_else_help = true)]
pub(crate) struct Check {
    /// A mesh: .obj, .ply, .glb, .off or .stl; or weights: .safetensors, or a training's folder.
    pub(crate) mesh: Option<PathBuf>,
    /// Views: layout, sizes, masks, and whether the cameras see the object.
    #[arg(long, value_name = "VIEWS")]
    pub(crate) views: Option<PathBuf>,
    /// The configuration is of this system, instead of a fit's.
    #[arg(long, value_name = "SYSTEM")]
    pub(crate) system: Option<String>,
    /// List every setting of a fit or of the system: range, default, meaning, published value and its source.
    #[arg(long, conflicts_with_all = ["mesh", "views", "config", "quality", "set", "preset"])]
    pub(crate) options: bool,
    /// A configuration that comes with the system: tiny, small, paper, and more with some; a name that is none lists them.
    #[arg(long, value_name = "NAME", requires = "system", conflicts_with = "config")]
    pub(crate) preset: Option<String>,
    #[command(flatten)]
    pub(crate) configuration: Configuration,
    #[command(flatten)]
    pub(crate) reading: Reading,
}

#[derive(Args, Debug)]
#[command(after_help = "Examples:
  unsphere completions bash \\
    > ~/.local/share/bash-completion/completions/unsphere
  unsphere completions fish > ~/.config/fish/completions/unsphere.fish")]
pub(crate) struct Completions {
    /// The shell.
    pub(crate) shell: clap_complete::Shell,
}

#[derive(Args, Debug)]
#[command(after_help = "Examples:
  unsphere man -o pages && man pages/unsphere-fit.1
  unsphere man -o ~/.local/share/man/man1 --force      then: man unsphere-fit")]
pub(crate) struct Manual {
    #[command(flatten)]
    pub(crate) output: Output,
}

/// A command and those below it, whose options of numbers take one below 0 too: so that it is told which are allowed, and not that
/// `-1` is no option.
pub(crate) fn taking_negative_numbers(command: clap::Command) -> clap::Command {
    let numbers =
        [TypeId::of::<f64>(), TypeId::of::<u16>(), TypeId::of::<u32>(), TypeId::of::<u64>()];
    let command = command.mut_args(|argument| {
        let kind = argument.get_value_parser().type_id();
        if numbers.iter().any(|number| kind == *number) && !argument.is_positional() {
            argument.allow_negative_numbers(true)
        } else {
            argument
        }
    });
    command.mut_subcommands(taking_negative_numbers)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn numbers_that_make_no_sense_are_refused() {
        let parses = |line: &str| Arguments::try_parse_from(line.split(' ')).is_ok();
        assert!(parses("unsphere check mesh.ply --threads 1024"));
        // Each is a thread: more than a machine can start would take minutes to find out.
        assert!(!parses("unsphere check mesh.ply --threads 70000"));
        assert!(parses("unsphere render m.ply -o a.png --elevation -90"));
        assert!(!parses("unsphere render m.ply -o a.png --elevation nan"));
        assert!(!parses("unsphere render m.ply -o a.png --elevation 1e308"));
    }
}
