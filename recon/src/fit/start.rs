//! What a fit starts from: a sphere, or the surface of the visual hull.

use datasets::View;
use mesh_core::TriMesh;

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
    /// A closed, oriented surface in the frame of the placement, and the side of the cells that it was made of.
    Surface(TriMesh, f32),
}

impl Start {
    /// Finds it from the masks, and what there is to say of it; the frame of `targets` is left as that of the placement.
    pub(super) fn of(
        views: &[&View],
        targets: &mut [Target],
        placement: &Placement,
        config: &FitConfig,
    ) -> (Self, Option<String>) {
        let slender = hull::is_slender(placement);
        if !slender && !targets.iter().any(|target| target.shows_a_hole(HOLE)) {
            return (Self::Sphere, None);
        }
        let longest = (LONGEST << config.level.saturating_sub(5)).min(MOST);
        let lattice = Lattice::of(targets, placement, longest);
        let found = lattice.and_then(|l| Solid::of(&l, targets).map(|solid| (l, solid)));
        let Some((lattice, solid)) = found else { return (Self::Sphere, None) };
        let holed = solid.genus > 0 || solid.components > 1;
        if holed && config.topology == TopologyKind::Sphere {
            let ball = slender.then(|| ball(views, targets, placement)).flatten();
            return (ball.unwrap_or(Self::Sphere), Some(cut(&solid)));
        }
        // Without a hole too: where a mask shows one, arms or handles reach around it, and a sphere loses such.
        let mut mesh = skin(&lattice, &solid.inside);
        hull::smooth(&mut mesh);
        (Self::Surface(mesh, lattice.step), None)
    }

    /// The mesh of this start, and its level.
    pub(super) fn shape(self, config: &FitConfig) -> (Shape, u32) {
        let coarse = config.start_level;
        let Self::Surface(mesh, cell) = self else {
            return (Shape::sphere(coarse, config), coarse);
        };
        // What is thin would be lost in coarse triangles.
        let level = coarse.max(config.level - 1);
        let mesh = grading::graded(&mesh, 20 << (2 * level), f64::from(cell));
        (Shape::of(mesh.positions, mesh.faces, config), level)
    }
}

/// A ball grown inside the hull: what is left of an object with holes if it must be a sphere.
fn ball(views: &[&View], targets: &mut [Target], placement: &Placement) -> Option<Start> {
    let hull = Hull::of(views, targets, placement);
    for target in targets {
        target.place(placement.center, placement.radius);
    }
    let hull = hull?;
    Some(Start::Surface(hull.surface()?, hull.cell()))
}

/// What a sphere cannot become.
fn cut(solid: &Solid) -> String {
    let holes = if solid.genus == 1 { "a hole" } else { "holes" };
    let what = match (solid.genus, solid.components) {
        (0, parts) => format!("{parts} parts, of which a sphere becomes one"),
        (genus, 1) => format!("{holes} (genus {genus}), which a sphere is cut or skinned over at"),
        (genus, parts) => {
            format!("{parts} parts and {holes} (genus {genus}); a sphere has neither")
        }
    };
    format!("the masks show {what}: `topology = \"auto\"` keeps them")
}
