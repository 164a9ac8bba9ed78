//! What stands after `-o`: what is written follows from its ending, and what is not written is refused.

use std::path::{Path, PathBuf};

use clap::Args;
use clap::builder::{PathBufValueParser, TypedValueParser};
use train::output::{OutputError, OutputFolder};

use crate::failure::Failure;

/// Where results go.
#[derive(Args, Clone, Debug)]
pub(crate) struct Output {
    /// Folder for the results; made if it does not exist.
    #[arg(long = "output", short = 'o', value_name = "FOLDER", value_parser = folder())]
    pub(crate) folder: Option<PathBuf>,
    /// Write into a folder that is there and not empty, replacing files of the same names.
    #[arg(long)]
    pub(crate) force: bool,
}

impl Output {
    /// Prepares the folder, `default` where none is named. Refusals come before the work.
    pub(crate) fn create(&self, default: &str) -> Result<OutputFolder, OutputError> {
        create(self.folder.as_deref().unwrap_or_else(|| Path::new(default)), self.force)
    }
}

/// Prepares a folder for results. One that is there and empty is as good as none.
pub(crate) fn create(folder: &Path, force: bool) -> Result<OutputFolder, OutputError> {
    let is_empty = std::fs::read_dir(folder).is_ok_and(|mut inside| inside.next().is_none());
    OutputFolder::create(folder, force || is_empty)
}

/// Refuses to replace a file that is there, unless that is asked for.
pub(crate) fn refuse_existing(files: &[impl AsRef<Path>], force: bool) -> Result<(), Failure> {
    match files.iter().map(AsRef::as_ref).find(|file| file.exists() && !force) {
        None => Ok(()),
        Some(file) => {
            let text = format!("{} exists already; choose another name or --force", file.display());
            Err(Failure::Other(text))
        }
    }
}

/// What the name of a rendering asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Picture {
    /// The turntable, animated.
    Gif,
    /// One image.
    Png,
    /// A folder with an image for each camera.
    Folder,
}

impl Picture {
    /// By the ending of a name; the error says what there is.
    pub(crate) fn of(path: &Path) -> Result<Self, String> {
        match ending(path).as_deref() {
            None => Ok(Self::Folder),
            Some("gif") => Ok(Self::Gif),
            Some("png") => Ok(Self::Png),
            Some(other) => Err(format!(
                ".{other} is not written: a name ends in .gif (the turntable) or .png (one image), or is a folder's \
                 (one .png a camera), {FOLDERS}"
            )),
        }
    }
}

/// How a folder is named that has an ending all the same.
const FOLDERS: &str = "without an ending or with / behind it";

/// The name of a folder: `mesh.glb` is none, since who writes it expects a file.
pub(crate) fn folder() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| match ending(&path) {
        None => Ok(path),
        Some(other) => Err(format!(
            "a folder is written, not a file of the kind .{other}: its name is one {FOLDERS}"
        )),
    })
}

/// The name of a mesh file.
pub(crate) fn mesh() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| match ending(&path).as_deref() {
        Some("3mf" | "glb" | "obj" | "ply" | "stl") => Ok(path),
        _ => Err("a mesh is written: its name ends in .3mf, .glb, .obj, .ply or .stl"),
    })
}

/// The name of a rendering.
pub(crate) fn picture() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| Picture::of(&path).map(|_| path))
}

/// Endings by which a file is meant and no folder: those of meshes, images, films, tables, texts, arrays, networks and archives.
const FILES: &str = "3ds 3mf abc blend dae fbx glb gltf obj off ply stl usd usda usdz \
    avif bmp exr gif heic jpeg jpg pfm png svg tif tiff webp avi mov mp4 webm \
    csv htm html json jsonl log md pdf toml txt npy npz onnx pth safetensors gz tar zip";

/// The ending of a file's name in small letters; none for what can only be meant as a folder: `runs/lr0.001`, `run.v2`, `v1/`,
/// or one that is there.
fn ending(path: &Path) -> Option<String> {
    let ending = path.extension()?.to_string_lossy().to_lowercase();
    let kind = FILES.split(' ').any(|known| known == ending);
    let slash = path
        .as_os_str()
        .as_encoded_bytes()
        .last()
        .is_some_and(|&b| std::path::is_separator(b.into()));
    (kind && !slash && !path.is_dir()).then_some(ending)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endings_say_what_is_written() {
        let of = |name: &str| Picture::of(Path::new(name)).map_err(|error| error.contains(".gif"));
        assert_eq!([of("a.gif"), of("b/A.PNG")], [Ok(Picture::Gif), Ok(Picture::Png)]);
        for folder in [
            "a",
            "a.stl/",
            "runs/lr0.001",
            ".hidden",
            "v1.2-beta",
            "run.v2",
            "a.b/c.final",
            "..",
            ".",
        ] {
            assert_eq!(of(folder), Ok(Picture::Folder), "{folder}");
        }
        for file in ["a.stl", "a.mp4", "a.3mf", "b/a.JPG", "a.exr"] {
            assert_eq!(of(file), Err(true), "{file}");
        }
        assert_eq!(of(env!("CARGO_MANIFEST_DIR")), Ok(Picture::Folder));
    }
}
