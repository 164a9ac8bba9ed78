//! Depth and intrinsics beside a picture.

use std::path::Path;

use datasets::{ReadOptions, View, read_depth_file, read_disparity_file};
use mesh_core::{DepthMap, Lens, TriMesh};

use super::material::{Material, Request};
use super::predictor::Predictor;
use crate::depth::{Beginning, DepthKind, Refined};
use crate::train::{DataError, System};

/// The least disparity that stands for an estimate's farthest pixel; the nearest is 1.
const FARTHEST: f32 = 0.1;

impl<B: Beginning> Predictor for Refined<B> {
    const TRAINING: &'static str = B::TRAINING;

    fn gather(&self, request: &Request<'_>) -> Result<Material, DataError> {
        let options = ReadOptions { depth: true, ..request.options.clone() };
        let mut material = Material::one(&Request { options, ..request.clone() })?;
        let view = &mut material.given[0];
        if let Some(intrinsics) = request.intrinsics {
            look_through(view, intrinsics)?;
            material.warnings.retain(|warning| !warning.starts_with("the camera of a single"));
        }
        if let Some(path) = request.depth {
            let estimated = B::refine(self.config()).depth == DepthKind::Estimated;
            view.depth = Some(if estimated { guessed(path, view)? } else { measured(path, view)? });
        }
        Ok(material)
    }

    fn mesh(&self, material: &Material) -> Result<TriMesh, String> {
        self.predict(&material.given)
    }

    fn sequence(&self, material: &Material) -> Result<Vec<TriMesh>, String> {
        let scene = self.scene(&material.given)?;
        let stages = self.stages_of(&scene).into_iter();
        Ok(stages.map(|mesh| scene.relief.frame.mesh_in_world(mesh)).collect())
    }
}

/// Replaces a view's lens.
fn look_through(view: &mut View, [fx, fy, cx, cy]: [f64; 4]) -> Result<(), DataError> {
    let sound =
        [fx, fy].iter().all(|f| *f > 0.0 && f.is_finite()) && cx.is_finite() && cy.is_finite();
    if !sound {
        let text = format!(
            "--intrinsics {fx},{fy},{cx},{cy}: expected focal lengths above 0, then a point"
        );
        return Err(DataError::Unfit(text));
    }
    view.camera.lens = Lens::Perspective { fx, fy, cx, cy };
    Ok(())
}

fn measured(path: &Path, view: &View) -> Result<DepthMap, DataError> {
    let depth = read_depth_file(path, 1.0)?;
    Ok(fitted(&depth, view))
}

/// An estimate as a depth: one over a disparity that was brought to 0.1 to 1. Scale and shift mean nothing to the network.
fn guessed(path: &Path, view: &View) -> Result<DepthMap, DataError> {
    let map = read_disparity_file(path)?;
    let finite = || map.data.iter().copied().filter(|d| d.is_finite());
    let low = finite().fold(f32::INFINITY, f32::min);
    let span = finite().fold(f32::NEG_INFINITY, f32::max) - low;
    let depth = |&d: &f32| {
        let share = if span > 0.0 { (d - low) / span } else { 0.5 };
        if d.is_finite() { (FARTHEST + (1.0 - FARTHEST) * share).recip() } else { f32::INFINITY }
    };
    let data = map.data.iter().map(depth).collect();
    Ok(fitted(&DepthMap { height: map.height, width: map.width, data }, view))
}

/// The nearest pixels, in the size of the picture.
fn fitted(depth: &DepthMap, view: &View) -> DepthMap {
    let (height, width) = (view.color.height, view.color.width);
    let at = |i: usize, from: usize, to: usize| (2 * i + 1) * from / (2 * to);
    let pixel = |p: usize| {
        let (row, column) =
            (at(p / width, depth.height, height), at(p % width, depth.width, width));
        depth.data[row * depth.width + column]
    };
    DepthMap { height, width, data: (0..height * width).map(pixel).collect() }
}
