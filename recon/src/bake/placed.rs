//! A mesh that is given, in the frame in which views look at it.

use datasets::View;
use mesh_core::vector::widen;
use mesh_core::{TriMesh, bounds};
use rayon::prelude::*;

use crate::fit::FitConfig;
use crate::fit::target::Target;

/// A mesh in units of its own size about its middle.
pub(super) struct Placed {
    /// The middle of its box, in the world.
    pub(super) center: [f64; 3],
    /// Half of the diagonal of its box.
    pub(super) radius: f64,
    /// Vertices: world point = `center + radius * position`.
    pub(super) positions: Vec<[f32; 3]>,
}

impl Placed {
    /// `None` of a mesh without extent, or one that is too large for single precision.
    pub(super) fn of(mesh: &TriMesh) -> Option<Self> {
        let (low, high) = mesh.bounds()?;
        let around = (widen(low), widen(high));
        let (center, radius) = (bounds::center(around), 0.5 * bounds::diagonal::<f64>((low, high)));
        if !(radius.is_finite() && radius > 0.0) {
            return None;
        }
        let inside =
            |p: &[f32; 3]| std::array::from_fn(|k| ((f64::from(p[k]) - center[k]) / radius) as f32);
        Some(Self { center, radius, positions: mesh.positions.iter().map(inside).collect() })
    }

    /// Makes this frame that of the targets.
    pub(super) fn place(&self, targets: &mut [Target]) {
        for target in targets {
            target.place(self.center, self.radius);
        }
    }
}

/// The views that have a mask, each with what of it is looked at.
pub(super) fn targets<'a>(views: &[&'a View]) -> (Vec<Target>, Vec<&'a View>) {
    let config = FitConfig::default();
    let target = |&view: &&'a View| Some((config.target(view)?, view));
    views.par_iter().filter_map(target).unzip()
}
