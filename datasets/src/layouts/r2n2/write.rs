//! Writing objects in the layout of ShapeNet and 3D-R2N2.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use mesh_core::io::{binvox, obj};
use mesh_core::{ByteImage, CameraError, DepthMap, R2n2View, encode_depth, encode_png};

use super::{MESHES, POINTS, RENDERING, RENDERINGS, VOXELS, metadata, points};
use crate::assemble::{put, remove};
use crate::dataset::Truth;
use crate::error::WriteViewsError;
use crate::view::View;

/// One image of an object and what goes with it.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendering {
    /// The image, `[H, W, 4]`, sRGB with straight alpha: how much of each pixel is the object.
    pub rgba: ByteImage,
    /// Where it was taken from, with the lens of 35 mm on 32 mm, centred.
    pub camera: R2n2View,
    /// Planar depth, `[H, W]`.
    pub depth: Option<DepthMap>,
    /// Normals in the camera's frame, `[H, W, 3]`: `round(127.5 (n + 1))`, 0 where there are none.
    pub normals: Option<ByteImage>,
}

impl Rendering {
    /// A view as this layout holds it; the mask becomes the alpha.
    ///
    /// # Errors
    /// If the camera has another lens, or does not look at the origin with +Y up.
    pub fn from_view(view: &View) -> Result<Self, CameraError> {
        let camera = view.camera.to_r2n2()?;
        let View { color, mask, depth, .. } = view;
        let pixels = color.data.chunks_exact(3).zip(&mask.data);
        let data = pixels.flat_map(|(c, &a)| [c[0], c[1], c[2], a]).collect();
        let rgba = ByteImage { height: color.height, width: color.width, channels: 4, data };
        Ok(Self { rgba, camera, depth: depth.clone(), normals: None })
    }

    fn fault(&self) -> Option<&'static str> {
        let ByteImage { height, width, channels, ref data } = self.rgba;
        let pixels = height * width;
        if channels != 4 || pixels == 0 || data.len() != 4 * pixels {
            return Some("an image must be [H, W, 4] and not empty");
        }
        let same = |h: usize, w: usize| (h, w) == (height, width);
        if self.depth.as_ref().is_some_and(|d| !same(d.height, d.width) || d.data.len() != pixels) {
            return Some("depth must have the size of its image");
        }
        let normals = self.normals.as_ref();
        if normals.is_some_and(|n| {
            !same(n.height, n.width) || n.channels != 3 || n.data.len() != 3 * pixels
        }) {
            return Some("normals must be [H, W, 3] of the size of their image");
        }
        let R2n2View { azimuth, elevation, distance_ratio } = self.camera;
        let sound = azimuth.is_finite() && elevation.abs() < 90.0 && distance_ratio > 0.0;
        (!sound).then_some("a camera must have a finite azimuth, an elevation within 90 degrees, and a distance above 0")
    }
}

/// Writes one object below `root`: its images and, as far as they are there, its true surface
/// (`ShapeNetCore.v1`), points (`model_normal.xyz`) and voxels (`ShapeNetVox32`).
///
/// Folders are made where they do not exist. Every file is written atomically, and the metadata
/// last, so that readers, and [`is_complete`], find the object whole or not at all; several
/// objects may be written from several threads. The same input gives the same bytes.
/// Depth and normals of an earlier writing that are not among these views are removed; the truth of one stays, since it may be
/// ShapeNet's own. The last column of the metadata is the lens's true field of view, 49.13 degrees, unlike the originals'.
///
/// # Errors
/// If a file cannot be written, a name is not that of a folder, there is no view, an image, depth
/// or normals are not of the stated shape, or the voxels do not fill a cube.
pub fn write_object(
    root: &Path,
    synset: &str,
    model: &str,
    views: &[Rendering],
    truth: &Truth,
) -> Result<(), WriteViewsError> {
    let object = root.join(RENDERINGS).join(synset).join(model);
    let refused = |what: String| Err(WriteViewsError::new(&object, what));
    if let Some(name) = [synset, model].iter().find(|name| !is_folder_name(name)) {
        return refused(format!("{name:?} is not the name of a folder"));
    }
    if views.is_empty() {
        return refused("there is no view".to_owned());
    }
    if let Some((i, fault)) = views.iter().enumerate().find_map(|(i, v)| Some((i, v.fault()?))) {
        return refused(format!("view {i}: {fault}"));
    }
    let lengths = truth.points.as_ref().map(|p| (p.positions.len(), p.normals.len()));
    if let Some((positions, normals)) = lengths.filter(|(p, n)| p != n) {
        return refused(format!("{positions} points with {normals} normals"));
    }
    let folder = object.join(RENDERING);
    make(&folder)?;
    let metadata = folder.join(metadata::FILE);
    if metadata.exists() {
        // While it is being replaced the object is not whole.
        std::fs::remove_file(&metadata).map_err(|e| WriteViewsError::new(&metadata, e))?;
    }
    let (mut names, mut lines) = (String::new(), String::new());
    for (i, view) in views.iter().enumerate() {
        let name = format!("{i:02}.png");
        put(&folder.join(&name), &encode_png(&view.rgba))?;
        let [depth, normals] =
            ["depth.exr", "normal.png"].map(|end| folder.join(format!("{i:02}_{end}")));
        match &view.depth {
            Some(map) => put(&depth, &encode_depth(map))?,
            None => remove(&depth)?,
        }
        match &view.normals {
            Some(image) => put(&normals, &encode_png(image))?,
            None => remove(&normals)?,
        }
        let R2n2View { azimuth, elevation, distance_ratio } = view.camera;
        let fov = 2.0 * (16.0_f64 / 35.0).atan().to_degrees();
        writeln!(names, "{name}").expect("into memory");
        writeln!(lines, "{azimuth} {elevation} 0 {distance_ratio} {fov:.6}").expect("into memory");
    }
    put(&folder.join(metadata::NAMES), names.as_bytes())?;
    write_truth(root, synset, model, truth)?;
    put(&metadata, lines.as_bytes())
}

/// Whether [`write_object`] has come to its end for this object, so that it need not be written
/// again.
pub fn is_complete(root: &Path, synset: &str, model: &str) -> bool {
    let object = root.join(RENDERINGS).join(synset).join(model);
    object.join(RENDERING).join(metadata::FILE).is_file()
}

fn write_truth(
    root: &Path,
    synset: &str,
    model: &str,
    truth: &Truth,
) -> Result<(), WriteViewsError> {
    let folder = |kind: &str| root.join(kind).join(synset).join(model);
    if let Some(points) = &truth.points {
        put(&folder(RENDERINGS).join(POINTS), points::text(points).as_bytes())?;
    }
    if let Some(voxels) = &truth.voxels {
        let path = in_folder(&folder(VOXELS), "model.binvox")?;
        binvox::write(&path, voxels).map_err(|e| WriteViewsError::new(&path, e))?;
    }
    if let Some(mesh) = &truth.mesh {
        let path = in_folder(&folder(MESHES), "model.obj")?;
        obj::write(&path, mesh).map_err(|e| WriteViewsError::new(&path, e))?;
    }
    Ok(())
}

fn in_folder(folder: &Path, name: &str) -> Result<PathBuf, WriteViewsError> {
    make(folder)?;
    Ok(folder.join(name))
}

fn make(folder: &Path) -> Result<(), WriteViewsError> {
    std::fs::create_dir_all(folder).map_err(|e| WriteViewsError::new(folder, e))
}

fn is_folder_name(name: &str) -> bool {
    !name.is_empty() && name != "." && name != ".." && !name.contains(['/', '\\', '\0'])
}
