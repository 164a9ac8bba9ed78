//! What a fit starts from: a sphere, or the surface of the visual hull.

use datasets::View;
use mesh_core::{Topology, TriMesh};

use super::{
    config::{FitConfig, TopologyKind},
    grading::{self, Graded},
    hull::{self, Hull},
    lattice::{self, Lattice},
    placement::Placement,
    shape::Shape,
    skin::skin,
    solid::Solid,
    target::Target,
};

/// The lattice of the hull: bars that are a pixel wide are lost between points that are a pixel apart.
const FINE: Fineness = Fineness { longest: 256, finest: 0.7, shortest: 1.2 };
/// That for meshes below level 5, whose few vertices would only follow the steps of finer cells, and for objects of more pixels than
/// a fine lattice has points, where it follows what is wrong with the masks.
const COARSE: Fineness = Fineness { longest: 160, finest: 1.0, shortest: 1.0 };
/// Views of which the hull is still much larger than the object: those of 12 views of people's objects agree with other masks less
/// than spheres grown to the same masks do, those of 20 more.
pub(super) const FEW_VIEWS: usize = 12;
/// Background that masks enclose counts where it is so far from their edges, in pixels.
const HOLE: f32 = 1.0;

/// The mesh that a fit begins with.
#[derive(Debug)]
pub(super) enum Start {
    /// The unit sphere.
    Sphere,
    /// A closed, oriented surface in the frame of the placement.
    Surface {
        /// Its triangles, as small as the steps of a lattice.
        mesh: TriMesh,
        /// The shortest edges that it needs.
        shortest: f32,
        /// Whether a sphere could become it: one part without a hole.
        is_sphere: bool,
    },
}

/// How fine a lattice is, and the mesh made of it.
#[derive(Clone, Copy, Debug)]
struct Fineness {
    /// Points along the longest side, at most.
    longest: usize,
    /// Pixels between points, at least.
    finest: f32,
    /// Edges of the mesh need be no shorter than this, in pixels.
    shortest: f32,
}

impl Fineness {
    fn of(targets: &mut [Target], placement: &Placement, config: &FitConfig) -> Self {
        for target in targets.iter_mut() {
            target.place(placement.center, placement.radius);
        }
        let side = 2.0 * (placement.half_extent / placement.radius) as f32;
        let fine = config.level >= 5 && side < FINE.longest as f32 * lattice::pixel(targets);
        // Large images of a fine mesh: twice as many points for each level more, up to as many.
        let longest = (COARSE.longest << config.level.saturating_sub(5)).min(FINE.longest);
        if fine { FINE } else { Self { longest, ..COARSE } }
    }
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
        let Fineness { longest, finest, shortest } = Fineness::of(targets, placement, config);
        let lattice = Lattice::of(targets, placement, longest, finest);
        let found = lattice.and_then(|l| Solid::of(&l, targets).map(|solid| (l, solid)));
        let Some((lattice, solid)) = found else { return (Self::Sphere, None) };
        let holed = solid.genus > 0 || solid.components > 1;
        if holed && config.topology == TopologyKind::Sphere {
            let inside = slender.then(|| sphere_inside(views, targets, placement)).flatten();
            return (inside.unwrap_or(Self::Sphere), Some(cut(&solid)));
        }
        // Without a hole too: where a mask shows one, arms or handles reach around it, and a sphere loses such.
        let mesh = skin(&lattice, &solid.inside);
        let shortest = lattice.step.max(shortest * lattice.pixel);
        (Self::Surface { mesh, shortest, is_sphere: !holed }, None)
    }

    /// The mesh of this start, its level, and positions of its vertices at which nothing passes through itself, if a surface was
    /// mended to find them.
    pub(super) fn shape(self, config: &FitConfig) -> (Shape, u32, Option<Vec<[f32; 3]>>) {
        let coarse = config.start_level;
        let Self::Surface { mut mesh, shortest, .. } = self else {
            return (Shape::sphere(coarse, config), coarse, None);
        };
        // What is thin would be lost in coarse triangles.
        let level = coarse.max(config.level - 1);
        let topology = Topology::of(&mesh);
        hull::smooth(&mut mesh, &topology);
        let faces = 20 << (2 * level);
        let Graded { mesh, sound } = grading::graded(&mesh, &topology, faces, f64::from(shortest));
        (Shape::of(mesh.positions, mesh.faces, config), level, sound)
    }
}

/// A surface of genus 0 grown inside the hull: what is left of an object with holes if it must be a sphere.
fn sphere_inside(views: &[&View], targets: &mut [Target], placement: &Placement) -> Option<Start> {
    let hull = Hull::of(views, targets, placement);
    for target in targets {
        target.place(placement.center, placement.radius);
    }
    let hull = hull?;
    Some(Start::Surface { mesh: hull.surface()?, shortest: hull.cell(), is_sphere: true })
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use synth::{Orbit, RenderOptions, render_views, shapes::Family};

    use super::*;
    use crate::fit::placement;

    /// Spokes, stays and chain are nearer to each other than the edges of a coarse mesh are long.
    #[test]
    fn a_bicycle_starts_with_nothing_through_anything() {
        let object = Family::Bicycle.draw(2).mesh();
        let orbit = Orbit { count: 24, target: [0.0; 3], distance: [1.6, 1.8], ..Orbit::default() };
        let look = RenderOptions::default();
        let views = render_views(&object, &orbit.cameras(), &look, &|_, _| {}).unwrap();
        let views: Vec<&View> = views.iter().collect();
        let config = FitConfig::default();
        let target = |view: &&View| config.target(view);
        let mut targets: Vec<Target> = views.iter().filter_map(target).collect();
        let placement = placement::place(&views, &mut targets).unwrap();
        let (start, _) = Start::of(&views, &mut targets, &placement, &config);
        let (shape, level, sound) = start.shape(&config);
        assert_eq!(level, 4);
        let faces = shape.faces.clone();
        let sound = TriMesh { positions: sound.unwrap(), faces, ..TriMesh::default() };
        assert!(!sound.tangled().contains(&true));
        assert!(shape.faces.len() < 15_000, "{} faces", shape.faces.len());
    }
}
