//! What an image is compared with beside its surface: depth, and the cells of what its camera sees.

use std::sync::Arc;

use datasets::View;
use diff_raster::{Faces, Settings, rasterize};
use mesh_core::nalgebra::{Matrix3, Vector3};
use mesh_core::vector::affine;
use mesh_core::{
    ByteImage, Camera, CameraVolume, DepthMap, DisparityMap, GroundPlane, Lens, Mask, TriMesh,
    voxelize_surface,
};
use ndarray::Array3;
use synth::Monocular;

use super::config::{DepthKind, DepthLossKind, EstimateErrors, PlaceKind, RefineConfig};
use super::guide;
use crate::paired::{Frame, InputImage};
use crate::view_cache::Stored;

/// What belongs to one image, made once.
#[derive(Clone, Debug)]
pub struct DepthTargets {
    /// The frame of the camera, in which everything is predicted.
    pub frame: Frame,
    /// Depth of the middle of an object.
    pub middle: f32,
    /// Nearest and farthest depth of the volume.
    pub ends: [f32; 2],
    /// What the network is given of depth, `[S, S]`; empty if nothing. 0 to 1, nearer is larger.
    pub channel: Vec<f32>,
    /// Signed distance from the outline, `[S, S]`, in pixels, negative inside; empty if vertices are not told.
    pub outline: Vec<f32>,
    /// Planar depth `[S, S]` in the frame, `+∞` where nothing is seen; empty where it is not known.
    pub depth: Vec<f32>,
    /// What a rendered depth is compared with, `[S, S]`: depth, or disparity of any scale and shift.
    pub target: Vec<f32>,
    /// Which pixels are compared: inside the silhouette, known, and not of a floor that was made up. `[S, S]`
    pub compared: Vec<bool>,
    /// Which cells are occupied, row, column, step in depth; empty if nobody asked.
    pub cells: Vec<bool>,
}

/// What is known of an image's depth.
#[derive(Clone, Copy, Debug)]
pub(super) enum Known<'a> {
    /// The true surface, in the world, and a seed for what is estimated of it.
    Surface(&'a TriMesh, u64),
    /// No more than what came with the image.
    Given,
}

impl Stored for DepthTargets {
    fn bytes(&self) -> usize {
        let floats = self.channel.len() + self.outline.len() + self.depth.len() + self.target.len();
        4 * floats + self.compared.len() + self.cells.len()
    }
}

impl DepthTargets {
    /// For an image; cells only with a surface.
    pub(super) fn new(
        image: &InputImage,
        known: Known<'_>,
        config: &RefineConfig,
        cells: usize,
    ) -> Self {
        let mut place = Placed::of(image, config);
        let side = image.camera.width;
        let object: Vec<bool> = image.mask.iter().map(|&m| m > 127).collect();
        let depth = planar_depth(image, known, &place.frame);
        if config.place == PlaceKind::Seen {
            place.stand_at(guide::median_depth(&depth, object.iter().copied()), config.reach);
        }
        let disparity = match config.depth {
            DepthKind::Estimated => disparity(&depth, image, known, &place.frame, config),
            _ => Vec::new(),
        };
        let channel = match config.depth {
            DepthKind::None => Vec::new(),
            // What came with no depth is given none.
            _ if depth.is_empty() => vec![0.0; side * side],
            DepthKind::True => guide::of_depth(&depth, place.ends),
            DepthKind::Estimated => guide::of_disparity(&disparity, &object, config.raw_depth),
        };
        let (target, compared) = if config.depth == DepthKind::Estimated {
            let compared = on_object(&disparity, &object, side);
            (guide::standard(&disparity, &compared), compared)
        } else {
            of_known_depth(&depth, &object, config.depth_loss)
        };
        let cells = match known {
            Known::Surface(mesh, _) if cells > 0 => {
                occupied(&volume(image, place.ends), &place.frame.mesh_placed(mesh), cells)
            }
            _ => Vec::new(),
        };
        let outline = if config.depth_residuals {
            Mask { height: side, width: side, data: object }.signed_distance(0.0).data
        } else {
            Vec::new()
        };
        let Placed { frame, middle, ends } = place;
        Self { frame, middle, ends, channel, outline, depth, target, compared, cells }
    }

    /// The volume whose cells are predicted, in the frame.
    pub fn volume(&self, image: &InputImage) -> CameraVolume {
        volume(image, self.ends)
    }
}

/// Where an image's object is.
struct Placed {
    frame: Frame,
    middle: f32,
    ends: [f32; 2],
}

impl Placed {
    fn of(image: &InputImage, config: &RefineConfig) -> Self {
        let (frame, middle) = match config.place {
            PlaceKind::Fixed | PlaceKind::Seen => (image.frame, config.middle),
            PlaceKind::Known => {
                let camera = &image.camera;
                // Focal length over half of the image.
                let focal = match camera.lens {
                    Lens::Perspective { fx, .. } => 2.0 * fx / camera.width as f64,
                    Lens::Orthographic { .. } => 1.0,
                };
                // An object beside or behind the camera is not one; any positive depth will do.
                let depth = camera.project([0.0; 3]).depth.max(1e-6);
                (Frame::of(camera, focal / depth), focal)
            }
        };
        let ends = config.reach.map(|times| (times * middle) as f32);
        Self { frame, middle: middle as f32, ends }
    }

    /// The middle of the object where its depth is known.
    fn stand_at(&mut self, middle: Option<f32>, reach: [f64; 2]) {
        if let Some(middle) = middle {
            self.middle = middle;
            self.ends = reach.map(|times| times as f32 * middle);
        }
    }
}

fn volume(image: &InputImage, [near, far]: [f32; 2]) -> CameraVolume {
    let (rotation, translation) = (Matrix3::identity(), Vector3::zeros());
    let here = Camera { rotation, translation, ..image.camera.clone() };
    CameraVolume::new(here, f64::from(near), f64::from(far))
}

/// Planar depth in the frame: what came with the image, or else that of the true surface; empty where there is neither.
fn planar_depth(image: &InputImage, known: Known<'_>, frame: &Frame) -> Vec<f32> {
    match known {
        Known::Surface(mesh, _) if image.depth.is_none() => {
            rendered(&frame.mesh_placed(mesh), image)
        }
        _ => {
            let scale = frame.scale() as f32;
            let given = image.depth.as_deref().unwrap_or_default();
            given.iter().map(|z| z * scale).collect()
        }
    }
}

/// Disparity as a network would estimate it, or that of the given depth.
fn disparity(
    depth: &[f32],
    image: &InputImage,
    known: Known<'_>,
    frame: &Frame,
    config: &RefineConfig,
) -> Vec<f32> {
    match known {
        Known::Surface(mesh, seed) => {
            let monocular = match config.estimate_errors {
                EstimateErrors::Affine => Monocular::default(),
                EstimateErrors::Nonlinear => Monocular::with_relief_errors(),
            };
            estimated(depth, image, frame, mesh, (&monocular, seed))
        }
        Known::Given => depth.iter().copied().map(inverse).collect(),
    }
}

/// What a rendered depth is compared with, and which pixels of it, where depth itself is known.
fn of_known_depth(depth: &[f32], object: &[bool], loss: DepthLossKind) -> (Vec<f32>, Vec<bool>) {
    let known = depth.iter().zip(object).map(|(z, &o)| o && z.is_finite());
    let compared: Vec<bool> = known.collect();
    let target = match loss {
        DepthLossKind::Aligned | DepthLossKind::Trimmed => {
            let disparity: Vec<f32> = depth.iter().copied().map(inverse).collect();
            guide::standard(&disparity, &compared)
        }
        _ => depth.to_vec(),
    };
    (target, compared)
}

/// Disparity of a depth; what is not finite stays as it is.
fn inverse(z: f32) -> f32 {
    if z.is_finite() { z.recip() } else { z }
}

/// Planar depth of a mesh of the frame at the image's pixels.
pub(super) fn rendered(mesh: &TriMesh, image: &InputImage) -> Vec<f32> {
    let side = image.camera.width;
    let rows: [[f32; 4]; 3] =
        std::array::from_fn(|i| std::array::from_fn(|j| image.lens[4 * i + j]));
    let seen = |p: &[f32; 3]| -> [f32; 3] {
        let [x, y, w] = affine(&rows, *p);
        [x / w, y / w, w]
    };
    let projected: Vec<f32> = mesh.positions.iter().flat_map(seen).collect();
    let shape = (1, mesh.positions.len(), 3);
    let (Ok(faces), Ok(projected)) = (Faces::of(mesh), Array3::from_shape_vec(shape, projected))
    else {
        return vec![f32::INFINITY; side * side];
    };
    rasterize(projected.view(), &Arc::new(faces), &Settings::new(side, side)).depth.clone()
}

/// Disparity as a network would guess it from this image.
fn estimated(
    depth: &[f32],
    image: &InputImage,
    frame: &Frame,
    mesh: &TriMesh,
    (monocular, seed): (&Monocular, u64),
) -> Vec<f32> {
    let side = image.camera.width;
    let unit = (1.0 / frame.scale()) as f32;
    let data = depth.iter().map(|z| z * unit).collect();
    let blank = |channels| ByteImage::new(side, side, channels);
    let view = View {
        crop: None,
        name: String::new(),
        color: blank(3),
        mask: blank(1),
        camera: image.camera.clone(),
        depth: Some(DepthMap { height: side, width: side, data }),
    };
    let floor = mesh.bounds().map(|(low, _)| low[1]);
    let guess = monocular.guess(&view, floor, seed);
    guess.map_or_else(Vec::new, |guess| guess.image.data)
}

/// The object's pixels whose disparity is known and not that of a floor beneath it.
fn on_object(disparity: &[f32], object: &[bool], side: usize) -> Vec<bool> {
    let known = |p: usize| object[p] && disparity.get(p).is_some_and(|d| d.is_finite());
    let mut compared: Vec<bool> = (0..object.len()).map(known).collect();
    let map = DisparityMap { height: side, width: side, data: disparity.to_vec() };
    let data = object.iter().map(|&o| if o { 255 } else { 0 }).collect();
    let mask = ByteImage { height: side, width: side, channels: 1, data };
    let plane = (disparity.len() == object.len()).then(|| GroundPlane::find(&map, &mask)).flatten();
    if let Some(plane) = plane {
        let floor = plane.pixels(&map);
        compared.iter_mut().zip(&floor.data).for_each(|(c, &f)| *c &= f == 0);
    }
    compared
}

/// The cells whose middle is inside of a mesh, and those that its surface runs through: the latter hold what is thinner
/// than a cell.
fn occupied(volume: &CameraVolume, mesh: &TriMesh, cells: usize) -> Vec<bool> {
    let dims = [cells; 3];
    let mut solid = volume.voxelize(mesh, dims);
    let place = |p: [f32; 3]| volume.to_cube(p.map(f64::from)).map(|x| x as f32);
    let in_cube = mesh.clone().map_positions(place);
    if in_cube.positions.as_flattened().iter().all(|x| x.is_finite()) {
        let surface = voxelize_surface(&in_cube, dims, CameraVolume::CUBE);
        solid.bits.iter_mut().zip(&surface.bits).for_each(|(bit, &other)| *bit |= other);
    }
    solid.to_channels().into_iter().map(|value| value > 0.5).collect()
}
