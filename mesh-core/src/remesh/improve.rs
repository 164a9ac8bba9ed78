//! Better triangles from the same vertices and the same number of faces.

use super::error::RemeshError;
use super::shape::smallest_angle;
use super::surface::{Surface, next, previous};
use crate::TriMesh;
use crate::vector::{Vec3, add, angle, area_vector, dot, narrow, norm, scale, sub, unit, widen};

/// Where no angle around a vertex is smaller than this, it may slide though that lowers them: room
/// that others need more.
const ENOUGH_DEGREES: f64 = 35.0;

/// What [`improve`] may do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImproveOptions {
    /// How many times to turn edges and then move vertices.
    pub passes: usize,
    /// Whether edges may be turned. Without it the faces stay as they are.
    pub flips: bool,
    /// How far a vertex may go towards the middle of its neighbours, 0 to 1; 0 keeps all in place.
    pub relaxation: f64,
    /// How far from flat, in degrees, four corners may be for the edge between them to turn.
    pub flat_degrees: f64,
    /// Nothing makes a fold sharper than this, in degrees, unless one beside it was sharper before.
    pub sharpest_fold_degrees: f64,
}

impl Default for ImproveOptions {
    fn default() -> Self {
        Self {
            passes: 3,
            flips: true,
            relaxation: 0.5,
            flat_degrees: 30.0,
            sharpest_fold_degrees: 75.0,
        }
    }
}

/// What [`improve`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Improvement {
    /// Edges turned.
    pub flips: usize,
    /// Moves of vertices, counted once per pass.
    pub moves: usize,
}

/// Raises the small angles of a closed mesh by turning edges and sliding vertices in the surface.
///
/// Vertices keep their numbers, so arrays beside the mesh (colours, momentum) stay in step. An edge
/// is turned where that raises the smallest angle of its two faces and the surface is nearly flat
/// there. A vertex slides in its tangent plane towards the area-weighted middle of the faces around
/// it, where that raises the smallest angle around it, or leaves it above 35 degrees, and turns no
/// face over. The smallest angle of the mesh thus never falls below that or what it was, and its
/// topology stays. The order is fixed, so the result is the same on every machine.
///
/// ```
/// use mesh_core::{ImproveOptions, improve, primitives};
/// // A ball pressed to a tenth of its width: half of its angles are small.
/// let mut mesh = primitives::icosphere(3).scaled([0.1, 1.0, 1.0]);
/// let before = mesh.health().smallest_angle_degrees;
/// improve(&mut mesh, &ImproveOptions::default()).unwrap();
/// assert!(mesh.health().smallest_angle_degrees > before);
/// ```
///
/// # Cost
/// A pass takes some 20 ms for 5,000 faces.
/// # Errors
/// If the mesh is not a closed, oriented manifold, or has a texture; it is then unchanged.
pub fn improve(mesh: &mut TriMesh, options: &ImproveOptions) -> Result<Improvement, RemeshError> {
    let mut surface = Surface::new(mesh)?;
    let mut positions: Vec<Vec3> = mesh.positions.iter().map(|&p| widen(p)).collect();
    let mut done = Improvement::default();
    for _ in 0..options.passes {
        let before = done;
        if options.flips {
            // Each flip raises an angle; a few sweeps bring nearly all that there is to have.
            for _ in 0..4 {
                let flips = flip_sweep(&mut surface, &positions, options);
                done.flips += flips;
                if flips == 0 {
                    break;
                }
            }
        }
        if options.relaxation > 0.0 {
            done.moves += relax_sweep(&surface, &mut positions, options);
        }
        if done == before {
            break;
        }
    }
    for (position, moved) in mesh.positions.iter_mut().zip(positions) {
        *position = narrow(moved);
    }
    mesh.faces = surface.faces;
    Ok(done)
}

/// Turns every edge that is better turned, once through; gives the number turned.
pub(super) fn flip_sweep(
    surface: &mut Surface,
    positions: &[Vec3],
    options: &ImproveOptions,
) -> usize {
    let mut flips = 0;
    for corner in 0..surface.corner_count() {
        if !surface.is_alive(corner) || surface.opposite(corner) < corner {
            continue;
        }
        if raises_angle(surface, positions, corner, options) && surface.can_flip(corner) {
            surface.flip(corner);
            flips += 1;
        }
    }
    flips
}

/// Whether turning the edge of a corner raises the smaller angle of its faces, on flat ground.
fn raises_angle(
    surface: &Surface,
    positions: &[Vec3],
    corner: u32,
    options: &ImproveOptions,
) -> bool {
    let at = |v: u32| positions[v as usize];
    let (a, e) = (at(surface.vertex(corner)), at(surface.vertex(surface.opposite(corner))));
    let [b, d] = surface.edge(corner).map(at);
    let old = smallest_angle([a, b, d]).min(smallest_angle([e, d, b]));
    let new = smallest_angle([a, b, e]).min(smallest_angle([e, d, a]));
    if new <= old + 1e-6 {
        return false;
    }
    // The normal of the four corners together: a sliver's own is not worth much.
    let ground = add(area_vector([a, b, d]), area_vector([e, d, b]));
    let flat = options.flat_degrees.to_radians().cos();
    let along = |normal: Vec3| dot(normal, ground) >= flat * norm(normal) * norm(ground);
    let (left, right) = (area_vector([a, b, e]), area_vector([e, d, a]));
    if !along(left) || !along(right) {
        return false;
    }
    // The sharpest fold of the five edges before and after.
    let (old_left, old_right) = (area_vector([a, b, d]), area_vector([e, d, b]));
    let beyond = |corner: u32| {
        let other = surface.opposite(corner);
        let [p, q] = surface.edge(other).map(at);
        area_vector([at(surface.vertex(other)), p, q])
    };
    let opposite = surface.opposite(corner);
    let (ab, da) = (beyond(previous(corner)), beyond(next(corner)));
    let (ed, be) = (beyond(previous(opposite)), beyond(next(opposite)));
    let sharpest =
        |folds: [[Vec3; 2]; 5]| folds.map(|[m, n]| angle(m, n)).into_iter().fold(0.0, f64::max);
    let old_folds =
        [[old_left, old_right], [old_left, ab], [old_left, da], [old_right, ed], [old_right, be]];
    let new_folds = [[left, right], [left, ab], [right, da], [right, ed], [left, be]];
    sharpest(new_folds) <= sharpest(old_folds).max(options.sharpest_fold_degrees.to_radians())
}

/// Slides every vertex once, in order; gives the number that moved.
pub(super) fn relax_sweep(
    surface: &Surface,
    positions: &mut [Vec3],
    options: &ImproveOptions,
) -> usize {
    let allowed = options.sharpest_fold_degrees.to_radians();
    let mut moves = 0;
    for vertex in 0..positions.len() as u32 {
        if surface.valence(vertex) == 0 {
            continue; // it was removed
        }
        let here = positions[vertex as usize];
        let step = slide(surface, positions, vertex);
        let (old, _) = around(surface, positions, vertex, here);
        let mut share = options.relaxation;
        for _ in 0..3 {
            let there = add(here, scale(step, share));
            let (new, _) = around(surface, positions, vertex, there);
            let better = new > old + 1e-6 || new >= ENOUGH_DEGREES.to_radians();
            if better
                && keeps_facing(surface, positions, vertex, there)
                && sharpest_fold(surface, positions, vertex, there)
                    <= sharpest_fold(surface, positions, vertex, here).max(allowed)
            {
                positions[vertex as usize] = there;
                moves += 1;
                break;
            }
            share *= 0.5;
        }
    }
    moves
}

/// From a vertex to the area-weighted middle of its faces, without the part along the normal.
fn slide(surface: &Surface, positions: &[Vec3], vertex: u32) -> Vec3 {
    let here = positions[vertex as usize];
    let (mut normal, mut middle, mut weight) = ([0.0; 3], [0.0; 3], 0.0);
    for corner in surface.fan(vertex) {
        let [b, c] = [next(corner), previous(corner)]
            .map(|corner| positions[surface.vertex(corner) as usize]);
        let n = area_vector([here, b, c]);
        let area = norm(n);
        normal = add(normal, n);
        middle = add(middle, scale(add(here, add(b, c)), area / 3.0));
        weight += area;
    }
    if weight <= 0.0 {
        return [0.0; 3];
    }
    let n = unit(normal);
    let step = sub(scale(middle, 1.0 / weight), here);
    sub(step, scale(n, dot(step, n)))
}

/// The smallest angle of the faces around a vertex if it were at `at`, and the sum of their normals.
fn around(surface: &Surface, positions: &[Vec3], vertex: u32, at: Vec3) -> (f64, Vec3) {
    let (mut smallest, mut normal) = (f64::INFINITY, [0.0; 3]);
    for corner in surface.fan(vertex) {
        let [b, c] = [next(corner), previous(corner)]
            .map(|corner| positions[surface.vertex(corner) as usize]);
        smallest = smallest.min(smallest_angle([at, b, c]));
        normal = add(normal, area_vector([at, b, c]));
    }
    (smallest, normal)
}

/// The sharpest fold on the edges at and around a vertex if it were at `at`.
fn sharpest_fold(surface: &Surface, positions: &[Vec3], vertex: u32, at: Vec3) -> f64 {
    let place = |v: u32| if v == vertex { at } else { positions[v as usize] };
    let normal = |corner: u32| {
        area_vector([corner, next(corner), previous(corner)].map(|c| place(surface.vertex(c))))
    };
    surface
        .fan(vertex)
        .map(|corner| {
            let here = normal(corner);
            let spoke = angle(here, normal(surface.opposite(next(corner))));
            spoke.max(angle(here, normal(surface.opposite(corner))))
        })
        .fold(0.0, f64::max)
}

/// Whether all faces around a vertex at `at` look to the side that they looked to together.
pub(super) fn keeps_facing(surface: &Surface, positions: &[Vec3], vertex: u32, at: Vec3) -> bool {
    let (_, normal) = around(surface, positions, vertex, positions[vertex as usize]);
    surface.fan(vertex).all(|corner| {
        let [b, c] = [next(corner), previous(corner)]
            .map(|corner| positions[surface.vertex(corner) as usize]);
        let turned = area_vector([at, b, c]);
        let old = area_vector([positions[vertex as usize], b, c]);
        // Not against the neighbourhood, unless it was so before: folds are not ours to undo.
        dot(turned, normal) > 0.0 || (dot(old, normal) <= 0.0 && dot(turned, old) >= 0.0)
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::primitives;

    fn bumpy(mesh: TriMesh) -> TriMesh {
        let mut i = 0_u32;
        mesh.map_positions(|p| {
            i += 1;
            std::array::from_fn(|k| {
                let noise = (i.wrapping_mul(2_654_435_761) >> (8 * k)) & 255;
                p[k] * (0.9 + 0.2 * noise as f32 / 255.0)
            })
        })
    }

    #[test]
    fn angles_rise_and_topology_stays() {
        let meshes = [
            bumpy(primitives::icosphere(3)),
            bumpy(primitives::torus(1.0, 0.2, 40, 20)),
            primitives::icosphere(3).scaled([0.1, 3.0, 1.0]),
        ];
        for mesh in meshes {
            let before = mesh.health();
            let mut better = mesh.clone();
            let done = improve(&mut better, &ImproveOptions::default()).unwrap();
            let after = better.health();
            assert!(done.flips + done.moves > 0);
            assert!(after.is_watertight());
            assert_eq!(after.genus(), before.genus());
            assert_eq!(after.faces, before.faces);
            assert!(
                after.smallest_angle_degrees > before.smallest_angle_degrees,
                "{} {}",
                before.smallest_angle_degrees,
                after.smallest_angle_degrees
            );
            assert!(after.angles_below_5_fraction <= before.angles_below_5_fraction);
            approx::assert_relative_eq!(after.volume, before.volume, max_relative = 0.03);
            assert_eq!(better.faces.len(), mesh.faces.len());
            // Twice the same.
            let mut again = mesh.clone();
            improve(&mut again, &ImproveOptions::default()).unwrap();
            assert_eq!(again, better);
        }
    }

    #[test]
    fn parts_can_be_left_out() {
        let mesh = bumpy(primitives::icosphere(2));
        let mut turned = mesh.clone();
        let only_flips = ImproveOptions { relaxation: 0.0, ..ImproveOptions::default() };
        assert!(improve(&mut turned, &only_flips).unwrap().moves == 0);
        assert_eq!(turned.positions, mesh.positions);
        let mut moved = mesh.clone();
        let only_moves = ImproveOptions { flips: false, ..ImproveOptions::default() };
        assert!(improve(&mut moved, &only_moves).unwrap().moves > 0);
        assert_eq!(moved.faces, mesh.faces);
    }

    #[test]
    fn features_stay() {
        // The edges of a box are folds of 90°: only the diagonals of its sides may turn.
        let mut mesh = primitives::cuboid([1.0, 2.0, 3.0]);
        let options = ImproveOptions { relaxation: 0.0, ..ImproveOptions::default() };
        improve(&mut mesh, &options).unwrap();
        assert_eq!((mesh.volume(), mesh.area()), (6.0, 22.0));
    }

    #[test]
    fn refused_meshes_are_unchanged() {
        let mut open = bumpy(primitives::icosphere(1));
        open.faces.pop();
        let before = open.clone();
        let error = improve(&mut open, &ImproveOptions::default()).unwrap_err();
        assert!(error.to_string().contains("1 face"), "{error}");
        assert_eq!(open, before);
    }
}
