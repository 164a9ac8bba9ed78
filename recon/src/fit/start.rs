//! What a fit starts from: a sphere, or the surface of the visual hull.

use datasets::View;
use mesh_core::{Topology, TriMesh, coarsen};

use super::{
    config::{FitConfig, TopologyKind},
    grading,
    hull::{self, Hull},
    lattice::Lattice,
    placement::Placement,
    shape::Shape,
    skin::skin,
    solid::Solid,
    target::Target,
};

/// Points of the lattice along its longest side for a mesh of level 5; twice as many for each level more.
const LONGEST: usize = 160;
/// And at most.
const MOST: usize = 256;
/// Background that masks enclose counts where it is so far from their edges, in pixels.
const HOLE: f32 = 1.0;

/// The mesh that a fit begins with.
#[derive(Debug)]
pub(super) enum Start {
    /// The unit sphere.
    Sphere,
    /// A surface in the frame of the placement.
    Surface {
        /// Closed, manifold, oriented outwards.
        mesh: TriMesh,
        /// The side of the cells that it was made of.
        cell: f32,
        /// Holes that were seen in it and filled or cut, since a sphere was asked for.
        cut: usize,
    },
}

impl Start {
    /// Finds it from the masks; the frame of `targets` is left as that of the placement.
    pub(super) fn of(
        views: &[&View],
        targets: &mut [Target],
        placement: &Placement,
        config: &FitConfig,
    ) -> Self {
        let slender = hull::is_slender(placement);
        let found = (slender || targets.iter().any(|t| t.shows_a_hole(HOLE)))
            .then(|| seen(targets, placement, config))
            .flatten();
        let (mesh, solid, cell) = match found {
            Some(found) => found,
            None => return Self::Sphere,
        };
        let holed = solid.genus > 0 || solid.components > 1;
        match config.topology {
            TopologyKind::Auto if holed || slender => Self::Surface { mesh, cell, cut: 0 },
            TopologyKind::Sphere if slender && !holed => Self::Surface { mesh, cell, cut: 0 },
            TopologyKind::Sphere if slender => {
                let ball = Hull::of(views, targets, placement);
                for target in targets {
                    target.place(placement.center, placement.radius);
                }
                let ball = ball.and_then(|hull| Some((hull.surface()?, hull.cell())));
                match ball {
                    Some((mesh, cell)) => Self::Surface { mesh, cell, cut: solid.genus },
                    None => Self::Sphere,
                }
            }
            _ => Self::Sphere,
        }
    }

    /// The mesh of this start, and its level.
    pub(super) fn shape(self, config: &FitConfig) -> (Shape, u32) {
        let coarse = config.start_level;
        let Self::Surface { mesh, cell, .. } = self else {
            return (Shape::sphere(coarse, config), coarse);
        };
        // What is thin would be lost in coarse triangles.
        let level = coarse.max(config.level - super::tune("BELOW", 1.0) as u32);
        let topology = Topology::new(mesh.positions.len(), &mesh.faces);
        let lengths = grading::lengths(&mesh, &topology, (super::tune("FACES", 0.75) * (20 << (2 * level)) as f32) as usize, f64::from(cell * super::tune("SHORT", 1.0)));
        let mesh = coarsen(&mesh, &lengths).unwrap_or(mesh);
        (Shape::of(mesh.positions, mesh.faces, config), level)
    }
}

/// The hull's surface, smoothed, with the holes that masks show.
fn seen(
    targets: &mut [Target],
    placement: &Placement,
    config: &FitConfig,
) -> Option<(TriMesh, Solid, f32)> {
    let longest = ((super::tune("SIDE", LONGEST as f32) as usize) << config.level.saturating_sub(5)).min(MOST);
    let lattice = Lattice::of(targets, placement, longest)?;
    let solid = Solid::of(&lattice, targets)?;
    let mut mesh = skin(&lattice, &solid.inside);
    hull::smooth(&mut mesh);
    Some((mesh, solid, lattice.step))
}
