//! `unsphere render`: a mesh and cameras in, images out.

use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use datasets::{MaskSource, ReadOptions, View};
use mesh_core::{ByteImage, Camera, TriMesh, encode_depth, encode_png};
use recon::turntable::{BACKDROP, encode_gif, orbit};
use serde::Serialize;
use synth::{Lighting, RenderOptions, Rendering, render_each};
use train::output::OutputFolder;
use train::report::counted;

use crate::args::{Picture, Render, create};
use crate::command::data::mask::one_each;
use crate::console::Console;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::mesh_file::read_mesh;
use crate::progress::Progress;
use crate::views::read_views;

/// Hundredths of a second for each image of a GIF.
const DELAY: u16 = 6;

/// What the frames of an animation may take, which are encoded together.
const MOST_BYTES: u64 = 4_000_000_000;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Rendered<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    output: &'a Path,
    pictures: usize,
}

pub(crate) fn run(console: Console, arguments: &Render) -> Result<(), Failure> {
    let output = &arguments.output;
    let kind = Picture::of(output)
        .map_err(|error| Failure::Usage(format!("-o {}: {error}", output.display())))?;
    if kind == Picture::Gif && (arguments.cameras.is_some() || arguments.depth) {
        let text = "a .gif shows the turntable: --cameras and --depth need a folder after -o";
        return Err(Failure::Usage(text.to_owned()));
    }
    if kind == Picture::Png && arguments.view.len() > 1 {
        let text = "a .png shows one view: name one by --view, or a folder after -o";
        return Err(Failure::Usage(text.to_owned()));
    }
    // Refusals come before the work.
    let folder = (kind == Picture::Folder).then(|| create(output, arguments.force)).transpose()?;
    // Nothing is kept of what is not finished.
    let _interrupt = Interrupt::listen(folder.as_ref().map(OutputFolder::unfinished))?;
    let depth = arguments.depth.then(|| output.with_extension("exr"));
    let mut files = std::iter::once(output).chain(&depth).filter(|_| folder.is_none());
    if let Some(file) = files.find(|file| file.exists() && !arguments.force) {
        let text = format!("{} exists already; choose another name or --force", file.display());
        return Err(Failure::Other(text));
    }
    let mesh = read_mesh(console, &arguments.mesh)?.upright(arguments.up);
    if mesh.faces.is_empty() {
        let path = arguments.mesh.display();
        return Err(Failure::Input(format!("{path}: no faces, so there is nothing to render")));
    }
    let mut cameras = cameras(console, &mesh, arguments)?;
    if kind == Picture::Png {
        cameras.truncate(1);
    }
    let pictures = cameras.len();
    let drawing = Drawing { console, mesh: &mesh, cameras, arguments };
    match folder {
        Some(folder) => {
            drawing.write_folder(&folder)?;
            folder.commit()?;
        }
        None if kind == Picture::Gif => drawing.write_animation(output)?,
        None => drawing.write_picture(output)?,
    }
    let rendered = Rendered { output, pictures };
    console.result(&rendered, |r| {
        format!("{} in {}", counted(r.pictures, "image"), r.output.display())
    })
}

/// Cameras and what their images are called.
fn cameras(
    console: Console,
    mesh: &TriMesh,
    arguments: &Render,
) -> Result<Vec<(String, Camera)>, Failure> {
    let all: Vec<(String, Camera)> = if let Some(path) = &arguments.cameras {
        let options = ReadOptions { mask: MaskSource::Whole, ..ReadOptions::default() };
        let views = read_views(console, path, &options)?;
        views.views.into_iter().map(|view| (view.name, view.camera)).collect()
    } else {
        let bounds = mesh.bounds().ok_or_else(|| {
            Failure::Input(format!("{}: has no vertices", arguments.mesh.display()))
        })?;
        let elevation = arguments.elevation.to_radians();
        orbit(bounds, arguments.frames as usize, elevation, arguments.size as usize)
            .into_iter()
            .enumerate()
            .map(|(k, camera)| (k.to_string(), camera))
            .collect()
    };
    if arguments.view.is_empty() {
        return Ok(all);
    }
    arguments
        .view
        .iter()
        .map(|name| {
            all.iter().find(|(other, _)| other == name).cloned().ok_or_else(|| {
                let (first, last) = (&all[0].0, &all[all.len() - 1].0);
                let text = format!("--view {name}: no such view, they go from {first} to {last}");
                Failure::Usage(text)
            })
        })
        .collect()
}

/// A mesh, and from where it is drawn.
struct Drawing<'a> {
    console: Console,
    mesh: &'a TriMesh,
    cameras: Vec<(String, Camera)>,
    arguments: &'a Render,
}

impl Drawing<'_> {
    /// Writes each image as it is drawn: all of them together may be more than the memory.
    fn write_folder(&self, folder: &OutputFolder) -> Result<(), Failure> {
        let stem = |name: &str| name.replace(['/', '\\'], "_");
        let named = self.cameras.iter().map(|(name, _)| (&**name, format!("{}.png", stem(name))));
        let files = one_each("image", named)?;
        self.draw(&|k, view| {
            folder.write(&files[k], &encode_png(&view.color))?;
            if let Some(depth) = &view.depth {
                let file = format!("{}_depth.exr", stem(&self.cameras[k].0));
                folder.write(&file, &encode_depth(depth))?;
            }
            Ok(())
        })
    }

    fn write_animation(&self, output: &Path) -> Result<(), Failure> {
        let bytes: u64 = self.cameras.iter().map(|(_, c)| 3 * (c.width * c.height) as u64).sum();
        if bytes > MOST_BYTES {
            let text = "of memory, expected at most 4: fewer --frames, or a smaller --size";
            let taken = bytes as f64 / 1e9;
            return Err(Failure::Usage(format!(
                "the animation's frames take {taken:.1} GB {text}"
            )));
        }
        let frames: Vec<OnceLock<ByteImage>> =
            self.cameras.iter().map(|_| OnceLock::new()).collect();
        self.draw(&|k, view| {
            frames[k].get_or_init(|| view.color);
            Ok(())
        })?;
        let frames: Vec<ByteImage> = frames.into_iter().filter_map(OnceLock::into_inner).collect();
        write(output, &encode_gif(&frames, DELAY))
    }

    fn write_picture(&self, output: &Path) -> Result<(), Failure> {
        self.draw(&|_, view| {
            write(output, &encode_png(&view.color))?;
            view.depth.map_or(Ok(()), |depth| {
                let place = output.with_extension("exr");
                mesh_core::write_depth(place, &depth).map_err(Failure::other)
            })
        })
    }

    /// Draws all images, and hands each over with its place as soon as it is there, from any thread.
    fn draw(
        &self,
        take: &(dyn Fn(usize, View) -> Result<(), Failure> + Sync),
    ) -> Result<(), Failure> {
        let Self { console, mesh, cameras, arguments } = self;
        // Beside views it is what theirs have, as most; else light, so that dark objects stand out.
        let usual = if arguments.cameras.is_some() { [0.0; 3] } else { BACKDROP };
        let background =
            arguments.background.map_or(usual, |color| color.map(|b| f32::from(b) / 255.0));
        let options = RenderOptions {
            lighting: arguments.light.map_or_else(|| Lighting::for_mesh(mesh), |light| light()),
            background,
            depth: arguments.depth,
            ..RenderOptions::default()
        };
        let cameras: Vec<Camera> = cameras.iter().map(|(_, camera)| camera.clone()).collect();
        let (progress, done) = (Progress::new(*console, "render"), AtomicUsize::new(0));
        let taken = |k: usize, rendering: Rendering| {
            take(k, rendering.view)?;
            progress.set(done.fetch_add(1, Ordering::Relaxed) + 1, cameras.len());
            Ok(())
        };
        let drawn = render_each(mesh, &cameras, &options, &taken);
        drawn.map_err(|error| Failure::Input(format!("{}: {error}", arguments.mesh.display())))?
    }
}

/// Writes a file by itself, whole or not at all.
fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    mesh_core::io::write_atomic(path, |out| out.write_all(bytes)).map_err(Failure::other)
}
