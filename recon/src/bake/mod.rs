//! `bake`: a texture for a mesh that exists already, from views of it.
//!
//! Every texel is the weighted mean of what the views show there: a view counts by how squarely and how large it shows the
//! surface, not at all where another part is in front of it, and less where it differs from the others. It is what a
//! [fit](mod@crate::fit) does at its end, for a mesh that was edited, scanned, or made by another program. The texture lies as the
//! mesh's own coordinates say, where it has some that are of use, or else in an [`Atlas`].
//!
//! ```
//! use mesh_core::primitives;
//! use recon::bake::{BakeConfig, bake};
//! use synth::{Orbit, RenderOptions, render_views};
//!
//! // Twelve images of a red ellipsoid, and its shape alone.
//! let shape = primitives::icosphere(3).scaled([1.0, 0.6, 0.8]);
//! let object = shape.clone().colored([0.8, 0.1, 0.1]);
//! let cameras = Orbit { count: 12, width: 64, height: 64, ..Orbit::default() }.cameras();
//! let views = render_views(&object, &cameras, &RenderOptions::default(), &|_, _| ())?;
//! let views: Vec<_> = views.iter().collect();
//!
//! let baked = bake(&shape, &views, &BakeConfig::default(), &|_, _| ())?;
//! assert!(baked.mask_iou > 0.95 && baked.unseen < 0.2);
//! let texture = baked.mesh.texture.as_ref().ok_or("no texture")?;
//! let red = texture.image.data.iter().step_by(3).copied().fold(0.0, f32::max);
//! assert!((red - 0.8).abs() < 0.02);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod agreement;
pub(crate) mod closest_colors;
pub(crate) mod color;
mod config;
mod error;
pub(crate) mod exposure;
mod misfit;
mod placed;
pub(crate) mod sight;
pub(crate) mod texture;

#[cfg(test)]
mod tests;

use datasets::View;
use mesh_core::{Texture, Topology, TriMesh, subdivide};
use serde::Serialize;

pub use config::{BakeConfig, UvKind};
pub use error::BakeError;
pub use misfit::{MISSED, Misfit};

use crate::atlas::{Atlas, UvCoverage};
use crate::fit::target::Target;
use agreement::agreement;
use exposure::Exposure;
use placed::{Placed, targets};
use sight::Photographed;

/// Faces below which a mesh is divided to find what photographs differ by: colours of few vertices explain none of them.
const FEW_FACES: usize = 20_000;

/// Where the texture coordinates of a baked mesh are from, and why.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct UvOrigin {
    /// Whether they are those that the mesh had.
    pub kept: bool,
    /// Why, in words.
    pub reason: String,
    /// What was found of those that the mesh had; none where it had none, or nobody asked.
    pub coverage: Option<UvCoverage>,
}

/// What baking made.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Baked {
    /// The mesh, in its coordinates, with a texture and a colour per vertex.
    pub mesh: TriMesh,
    /// Where its texture coordinates are from.
    pub uv: UvOrigin,
    /// The share of the texels on the surface that no view shows, 0 to 1: their colours are a guess from those around.
    pub unseen: f64,
    /// Mean mask IoU on the views, of what is around the masks, before anything is baked: near 1 where the mesh is in the frame
    /// of the cameras.
    pub mask_iou: f64,
    /// Indices of the views that it was baked from: all but those whose mask is empty.
    pub views: Vec<usize>,
    /// How bright each of these views is beside the texture, red, green, blue in sRGB, where photographs differ in exposure or white
    /// balance; their geometric mean is 1.
    pub exposures: Option<Vec<[f32; 3]>>,
    /// What a user should know although it stopped nothing, one sentence each.
    pub warnings: Vec<String>,
}

impl Baked {
    /// Least and greatest of [`exposures`](Self::exposures).
    pub fn exposure_range(&self) -> Option<[f32; 2]> {
        exposure::range(self.exposures.as_deref())
    }
}

/// Bakes a texture for a mesh from views, all of which are used.
///
/// The mesh must be in the coordinates of the cameras: [`Baked::mask_iou`] tells, and [`Misfit`] what may be wrong. Any mesh
/// will do, open, in parts or of one polygon; one whose faces look inwards is turned round. What it has of colours and texture
/// images is replaced. `progress` hears how many looks at it are done, of how many. The result depends on its arguments
/// alone, not on the number of threads.
///
/// # Errors
/// See [`BakeError`]. Views with an empty mask are left out with a warning.
///
/// # Cost
/// A second for 100 views of 256 x 256 and a million texels on two cores. 70 bytes for each texel, a few for each pixel around the masks.
pub fn bake(
    mesh: &TriMesh,
    views: &[&View],
    config: &BakeConfig,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Baked, BakeError> {
    let problems = config.check();
    if !problems.is_empty() {
        return Err(BakeError::Config(problems));
    }
    mesh.validate()?;
    mesh.require_faces()?;
    let placed = Placed::of(mesh).ok_or(BakeError::NoExtent)?;
    if views.is_empty() {
        return Err(BakeError::NoViews);
    }
    views.iter().try_for_each(|view| view.validate())?;
    let (mut targets, seen) = targets(views);
    if seen.is_empty() {
        return Err(BakeError::EmptyMasks { views: views.len() });
    }
    placed.place(&mut targets);
    let mut warnings = Vec::new();
    let found = agreement(&targets, &placed.positions, &mesh.faces);
    let mesh = if found.inside_out {
        warnings.push("the faces of the mesh look inwards: they were turned round".to_owned());
        mesh.clone().flipped()
    } else {
        mesh.clone()
    };
    let (uv, own) = uv_origin(&mesh, config.uv)?;
    if let (true, Some(problem)) = (uv.kept, uv.coverage.and_then(|found| found.problem())) {
        warnings.push(format!("the mesh's texture coordinates {problem}"));
    }
    let photographed = Photographed::new(&seen, &targets, &placed.positions, &mesh.faces);
    let atlas = match (own, uv.coverage) {
        (Some(own), Some(coverage)) => {
            let side = config.texture_size.unwrap_or_else(|| side_of(&photographed, &coverage));
            Atlas::of_uvs(own.uvs, own.faces, side)
        }
        _ => texture::atlas(&photographed, config.texture_size).ok_or_else(|| BakeError::Room {
            side: config.texture_size.unwrap_or(texture::MOST),
            faces: mesh.faces.len(),
        })?,
    };
    let (colors, found_exposure) = colors(&photographed, config.balance_colors);
    let exposures = found_exposure.as_ref().map(Exposure::relative);
    let exposure = found_exposure.unwrap_or_else(|| Exposure::even(seen.len()));
    let painted = texture::painted(&photographed, &exposure, &colors, atlas, progress);
    let is_used =
        |view: &View| targets.iter().zip(&seen).any(|(_, seen)| std::ptr::eq(*seen, view));
    let (used, empty): (Vec<usize>, Vec<usize>) =
        (0..views.len()).partition(|&index| is_used(views[index]));
    if !empty.is_empty() {
        let names: Vec<&str> = empty.iter().map(|&index| views[index].name.as_str()).collect();
        warnings.push(format!("left out, since their mask is empty: views {}", names.join(", ")));
    }
    let texture = Some(painted.texture);
    Ok(Baked {
        mesh: TriMesh { colors: Some(colors), texture, ..mesh },
        uv,
        unseen: painted.unseen,
        mask_iou: found.mask_iou,
        views: used,
        exposures,
        warnings,
    })
}

/// Which texture coordinates are taken, and those of the mesh if it is these.
fn uv_origin(mesh: &TriMesh, kind: UvKind) -> Result<(UvOrigin, Option<Texture>), BakeError> {
    let origin = |kept: bool, reason: String, coverage| UvOrigin { kept, reason, coverage };
    if kind == UvKind::New {
        return Ok((origin(false, "new ones were asked for".to_owned(), None), None));
    }
    let (Some(own), Some(coverage)) = (&mesh.texture, UvCoverage::of(mesh)) else {
        let reason = "the mesh has none".to_owned();
        return match kind {
            UvKind::Keep => Err(BakeError::Uv { reason: "are not in the file".to_owned() }),
            _ => Ok((origin(false, reason, None), None)),
        };
    };
    match (kind, coverage.hindrance(), coverage.problem()) {
        (UvKind::Keep, Some(reason), _) => Err(BakeError::Uv { reason }),
        (UvKind::Keep, None, _) => {
            let reason = "the mesh's own were asked for".to_owned();
            Ok((origin(true, reason, Some(coverage)), Some(own.clone())))
        }
        (_, _, None) => {
            let reason = "the mesh's own lie in the unit square and do not overlap".to_owned();
            Ok((origin(true, reason, Some(coverage)), Some(own.clone())))
        }
        (_, _, Some(problem)) => {
            Ok((origin(false, format!("the mesh's own {problem}"), Some(coverage)), None))
        }
    }
}

/// The side at which texels of a layout that is given are as fine as the images, on average over the surface.
fn side_of(photographed: &Photographed<'_>, coverage: &UvCoverage) -> usize {
    let &Photographed { targets, positions, faces, .. } = photographed;
    let surface: f32 = mesh_core::face_areas(positions, faces).iter().sum();
    let side = texture::finest(targets) * (surface / coverage.area as f32).sqrt();
    // Mipmaps halve it a few times.
    (side.clamp(64.0, texture::MOST as f32) as usize).next_multiple_of(8)
}

/// The colours of the vertices, and what photographs differ by, where they do and that is asked for.
fn colors(photographed: &Photographed<'_>, balance: bool) -> (Vec<[f32; 3]>, Option<Exposure>) {
    let &Photographed { views, targets, positions, faces, .. } = photographed;
    let topology = Topology::new(positions.len(), faces);
    let even = Exposure::even(views.len());
    let solved = |exposure| color::vertex_colors(photographed, &topology, exposure, None);
    let mut colors = solved(&even);
    if !balance {
        return (colors, None);
    }
    if faces.len() >= FEW_FACES {
        let found = Exposure::found(photographed, &topology, &mut colors);
        return (colors, found);
    }
    match exposure_of_finer(views, targets, positions, faces) {
        Some(found) => (solved(&found), Some(found)),
        None => (colors, None),
    }
}

/// What photographs differ by, found with the colours of a surface that has more vertices.
fn exposure_of_finer(
    views: &[&View],
    targets: &[Target],
    positions: &[[f32; 3]],
    faces: &[[u32; 3]],
) -> Option<Exposure> {
    let mut finer = TriMesh::new(positions.to_vec(), faces.to_vec());
    while finer.faces.len() < FEW_FACES {
        finer = subdivide(&finer);
    }
    let topology = Topology::new(finer.positions.len(), &finer.faces);
    let photographed = Photographed::new(views, targets, &finer.positions, &finer.faces);
    let even = Exposure::even(views.len());
    let mut colors = color::vertex_colors(&photographed, &topology, &even, None);
    Exposure::found(&photographed, &topology, &mut colors)
}
