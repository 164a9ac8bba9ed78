//! `unsphere render`: a mesh and cameras in, images out.

use std::path::Path;

use datasets::{MaskSource, ReadOptions, View};
use mesh_core::{Camera, TriMesh, encode_depth, encode_png};
use recon::turntable::{BACKDROP, encode_gif, orbit};
use serde::Serialize;
use synth::{Lighting, RenderOptions, render_views};
use train::output::OutputFolder;
use train::report::counted;

use crate::args::{Picture, Render};
use crate::console::Console;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::mesh_file::read_mesh;
use crate::progress::Progress;
use crate::views::read_views;

/// Hundredths of a second for each image of a GIF.
const DELAY: u16 = 6;

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
    // Refusals come before the work.
    let folder = (kind == Picture::Folder)
        .then(|| OutputFolder::create(output, arguments.force))
        .transpose()?;
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
    let views = draw(console, &mesh, &cameras, arguments)?;
    if let Some(folder) = folder {
        for ((name, _), view) in cameras.iter().zip(&views) {
            let stem = name.replace(['/', '\\'], "_");
            folder.write(&format!("{stem}.png"), &encode_png(&view.color))?;
            if let Some(depth) = &view.depth {
                folder.write(&format!("{stem}_depth.exr"), &encode_depth(depth))?;
            }
        }
        folder.commit()?;
    } else {
        let bytes = if kind == Picture::Gif {
            let frames: Vec<_> = views.iter().map(|view| view.color.clone()).collect();
            encode_gif(&frames, DELAY)
        } else {
            encode_png(&views[0].color)
        };
        mesh_core::io::write_atomic(output, |out| out.write_all(&bytes)).map_err(Failure::other)?;
        if let Some(depth) = &views[0].depth {
            let place = output.with_extension("exr");
            mesh_core::write_depth(place, depth).map_err(Failure::other)?;
        }
    }
    let rendered = Rendered { output, pictures: views.len() };
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

fn draw(
    console: Console,
    mesh: &TriMesh,
    cameras: &[(String, Camera)],
    arguments: &Render,
) -> Result<Vec<View>, Failure> {
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
    let progress = Progress::new(console, "render");
    render_views(mesh, &cameras, &options, &|done, all| progress.set(done, all))
        .map_err(|error| Failure::Input(format!("{}: {error}", arguments.mesh.display())))
}
