//! The solid that a mesh encloses, where the mesh runs through itself.

use std::borrow::Cow;

use mesh_core::bounds::longest_side;
use mesh_core::{Topology, TriMesh};

use super::error::FitError;
use super::grading::{Graded, graded};
use super::hull;
use super::lattice::Lattice;
use super::prior::distances;
use super::skin::skin;
use super::solid::Solid;
use super::unit::unit_near;
use crate::bake::closest_colors::closest_colors;

/// Points of the lattice along its longest side.
const LONGEST: usize = 128;
/// Points of air on each side of the mesh.
const AIR: usize = 4;
/// The fewest faces: with fewer a mesh of a few boxes would lose its shape.
const FACES: usize = 4_000;

/// The surface of all that a closed mesh encloses: one without the faces inside, of parts that are sunk into each other, of pockets
/// and folds, and with none that run through each other. What a network predicts becomes something that can be printed.
///
/// It is made anew, of about as many faces as the mesh has (4,000 at least), on a lattice of 128 points along the longest side: sheets
/// thinner than a step of that become as thick as some half of one, edges are rounded, gaps and holes narrower than three steps close, as
/// do hollows within. Colours are those of the closest points, a texture's too.
///
/// ```
/// use mesh_core::primitives::{cuboid, icosphere};
/// use recon::fit::solidify;
///
/// // A bar through a ball.
/// let mut mesh = icosphere(3);
/// mesh.append(&cuboid([3.0, 0.4, 0.4]))?;
/// assert!(!mesh.self_intersections().is_empty());
/// let solid = solidify(&mesh)?;
/// assert!(solid.examined().is_solid());
/// assert_eq!(solid.health().components, 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Cost
/// Some 0.2 seconds for 5,000 faces on two cores.
///
/// # Errors
/// [`FitError::Placement`] where the mesh is not closed or has no volume.
pub fn solidify(mesh: &TriMesh) -> Result<TriMesh, FitError> {
    let refused = |reason: &str| FitError::Placement { reason: reason.to_owned() };
    if !Topology::of(mesh).is_closed() {
        return Err(refused("the mesh is not closed, so that it has no inside"));
    }
    let unit =
        mesh.bounds().map_or(1.0, |bounds| unit_near(f64::from(longest_side(bounds))) as f32);
    // Bounds on edges and bends are for objects about as large as 1.
    let mesh = &if (unit - 1.0).abs() > 0.0 {
        Cow::Owned(mesh.clone().scaled([1.0 / unit; 3]))
    } else {
        Cow::Borrowed(mesh)
    };
    let mut lattice = around(mesh).ok_or_else(|| refused("the mesh has no size"))?;
    lattice.distance = distances(mesh, &lattice);
    lattice.agreed.clone_from(&lattice.distance);
    let solid = Solid::of(&lattice, &[]).ok_or_else(|| refused("the mesh encloses nothing"))?;
    let mut fine = skin(&lattice, &solid.inside);
    let topology = Topology::of(&fine);
    hull::smooth(&mut fine, &topology);
    let faces = mesh.faces.len().max(FACES);
    let Graded { mesh: coarse, sound } = graded(&fine, &topology, faces, f64::from(lattice.step));
    let positions = sound.unwrap_or(coarse.positions);
    let colors = closest_colors(mesh, &positions);
    let solid = TriMesh { positions, faces: coarse.faces, colors, texture: None };
    Ok(solid.scaled([unit; 3]))
}

/// A lattice around a mesh, with nothing measured yet.
fn around(mesh: &TriMesh) -> Option<Lattice> {
    let (low, high) = mesh.bounds()?;
    let step = longest_side((low, high)) / (LONGEST - 2 * AIR) as f32;
    let count = |k: usize| ((high[k] - low[k]) / step).ceil() as usize + 2 * AIR;
    (step.is_normal()).then(|| Lattice {
        dims: std::array::from_fn(count),
        origin: low.map(|x| x - AIR as f32 * step),
        step,
        pixel: step,
        distance: Vec::new(),
        agreed: Vec::new(),
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::{Texture, primitives};

    use super::*;

    /// A ball of which a cap is pushed in until it comes out of the other side: inside out there, and three times around the middle.
    #[test]
    fn a_pocket_that_comes_out_on_the_far_side_is_part_of_the_solid() {
        let mut pocket = primitives::icosphere(4).colored([0.2, 0.4, 0.6]);
        for p in &mut pocket.positions {
            let depth = (0.5 * (p[1] - 0.85).max(0.0) / 0.15).min(0.5);
            p[1] -= 5.0 * depth;
        }
        let pairs = pocket.self_intersections().len();
        assert!(pairs > 100, "{pairs}");
        let (low, high) = pocket.bounds().unwrap();
        let solid = solidify(&pocket).unwrap();
        let found = solid.examined();
        assert!(found.is_solid() && found.health.components == 1, "{found}");
        let (bottom, top) = solid.bounds().unwrap();
        assert!((bottom[1] - low[1]).abs() < 0.05 && (top[1] - high[1]).abs() < 0.05);
        let colors = solid.colors.unwrap();
        assert!(
            colors
                .iter()
                .flatten()
                .zip([0.2, 0.4, 0.6].iter().cycle())
                .all(|(a, b)| (a - b).abs() < 1e-6)
        );
    }

    #[test]
    fn parts_sunk_into_each_other_are_one_and_parts_apart_stay() {
        let mut parts = primitives::icosphere(3);
        parts.append(&primitives::icosphere(3).translated([1.2, 0.0, 0.0])).unwrap();
        parts.append(&primitives::icosphere(3).translated([5.0, 0.0, 0.0])).unwrap();
        let found = solidify(&parts).unwrap().examined();
        assert!(found.is_solid() && found.health.components == 2, "{found}");
        // What two balls of radius 1 at this distance have in common: pi / 12 (4 + d) (2 - d)^2.
        let ball = 4.0 / 3.0 * std::f64::consts::PI;
        let lens = std::f64::consts::PI / 12.0 * (4.0 + 1.2) * (2.0_f64 - 1.2).powi(2);
        let expected = 3.0 * ball - lens;
        assert!((found.health.volume / expected - 1.0).abs() < 0.03, "{}", found.health.volume);
    }

    #[test]
    fn a_sheet_of_hardly_any_thickness_stays() {
        let mut sheet = primitives::cuboid([2.0, 1e-3, 2.0]);
        sheet.append(&primitives::cuboid([0.5, 1.0, 0.5])).unwrap();
        let found = solidify(&sheet).unwrap().examined();
        assert!(found.is_solid() && found.health.components == 1, "{found}");
        assert!(found.health.area > 0.9 * 2.0 * 4.0, "{}", found.health.area);
    }

    #[test]
    fn the_unit_of_the_world_does_not_matter() {
        let mut parts = primitives::cuboid([2.0, 0.5, 1.0]);
        parts.append(&primitives::icosphere(3)).unwrap();
        let solid = solidify(&parts).unwrap();
        for unit in [1.0 / 16_777_216.0, 16_777_216.0] {
            let other = solidify(&parts.clone().scaled([unit; 3])).unwrap();
            assert!(
                other.faces == solid.faces
                    && other.positions == solid.clone().scaled([unit; 3]).positions
            );
        }
    }

    #[test]
    fn what_has_no_inside_is_refused() {
        let mut open = primitives::icosphere(2);
        open.faces.pop();
        for (mesh, said) in [
            (open, "not closed"),
            (TriMesh::default(), "no size"),
            (primitives::icosphere(1).scaled([0.0; 3]), "no size"),
        ] {
            let error = solidify(&mesh).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn a_texture_becomes_colors() {
        let mut mesh = primitives::icosphere(2);
        let mut image = mesh_core::Image::new(2, 2, 3);
        image.data.chunks_exact_mut(3).for_each(|pixel| pixel[0] = 1.0);
        let uvs = vec![[0.5, 0.5]];
        mesh.texture = Some(Texture { faces: vec![[0; 3]; mesh.faces.len()], uvs, image });
        let colors = solidify(&mesh).unwrap().colors.unwrap();
        assert!(colors.iter().all(|color| *color == [1.0, 0.0, 0.0]));
    }
}
