//! An object in the layout of ShapeNet and 3D-R2N2.

use std::path::Path;

use datasets::{Truth, r2n2};
use mesh_core::{TriMesh, VoxelGrid, bounds, encode_exr, voxelize_enclosed, voxelize_solid};

use super::config::GenerateConfig;
use super::error::GenerateError;
use super::object::{Made, ObjectInfo};
use super::store::{put, put_rough};

/// Folders of the layout that hold an object's files, the one with the images last.
pub(super) const PARTS: [&str; 3] = ["ShapeNetVox32", "ShapeNetCore.v1", "ShapeNetRendering"];

/// Writes an object below a root; `pictures` is the folder of its renderings there.
pub(super) fn write(
    made: Made<'_>,
    config: &GenerateConfig,
    root: &Path,
    object: &Path,
) -> Result<ObjectInfo, GenerateError> {
    let Made { info, mesh, points, renderings, monocular, rough } = made;
    let views: Vec<r2n2::Rendering> = renderings
        .iter()
        .map(|rendering| {
            Ok::<_, GenerateError>(r2n2::Rendering {
                rgba: rendering.rgba.clone().expect("drawn with alpha for this layout"),
                camera: rendering.view.camera.to_r2n2()?,
                depth: rendering.view.depth.clone().filter(|_| config.depth),
                normals: rendering.normal_image(),
            })
        })
        .collect::<Result<_, _>>()?;
    let voxels = (config.voxels > 0).then(|| voxels(&mesh, config.voxels));
    let pictures = object.join("rendering");
    for (i, image) in monocular.iter().enumerate() {
        put(&pictures.join(format!("{i:02}_monocular.exr")), &encode_exr(image))?;
    }
    let cameras: Vec<_> = renderings.iter().map(|rendering| &rendering.view.camera).collect();
    put_rough(&pictures, &cameras, &rough)?;
    let truth = Truth { mesh: Some(mesh.into_owned()), points, voxels };
    r2n2::write_object(root, &info.synset, &info.name, &views, &truth)?;
    Ok(info)
}

/// The solid in a cube around the middle of the box, whose side is the box's diagonal: so that a
/// cell has one size for all objects of a dataset.
fn voxels(mesh: &TriMesh, count: usize) -> VoxelGrid {
    let around = mesh.bounds().unwrap_or_default();
    let half = 0.5 * bounds::diagonal::<f32>(around);
    // Objects are of diagonal 1 up to rounding, and their grids should be one and the same.
    let half = if (half - 0.5).abs() < 1e-5 { 0.5 } else { half.max(1e-6) };
    let middle = bounds::center(around).map(|x| if x.abs() < 1e-5 * half { 0.0 } else { x });
    let bounds = (middle.map(|x| x - half), middle.map(|x| x + half));
    if mesh.health().is_watertight() {
        voxelize_solid(mesh, [count; 3], bounds)
    } else {
        voxelize_enclosed(mesh, [count; 3], bounds)
    }
}
