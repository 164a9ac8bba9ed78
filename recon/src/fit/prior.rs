//! What a predicted mesh and the masks agree on: where a refinement begins.
//!
//! A prediction knows what no view shows, the masks know where there is nothing, and where there must be something. So the
//! prediction is carved by the hull of the masks, as a solid; and where a pixel of a mask shows none of what is left, the point of
//! the hull on its ray that is nearest to the prediction is added, with what of the hull lies between: the leg of a chair whose
//! prediction has it a little beside.

use mesh_core::vector::norm;
use mesh_core::{ClosestPoint, Topology, TriMesh, voxelize_solid};
use rayon::prelude::*;

use super::{
    hull, lattice::Lattice, placement::Placement, skin::skin, solid::Solid, target::Target,
};

/// Points of the lattice along its longest side.
const LONGEST: usize = 96;
/// And the least distance between them, in pixels.
const FINEST: f32 = 1.0;
/// How far the object may reach, in halves of the prediction's longest side.
const ROOM: f64 = 1.4;
/// A ray with nothing of the prediction nearer than this, in steps, asks for some.
const ALLOWED: f32 = 0.3;
/// How far beyond the nearest point that a pixel asks for is added, in steps.
const MARGIN: f32 = 0.5;
/// How much less may be added for each step away from what pixels ask for: with less than one, arms become lumps; with more, sheets.
const SLOPE: f32 = 1.0;
/// Distances beyond this many steps are those of a block.
const FAR: f32 = 2.0;
/// Points along a side of the blocks whose distance is first measured as a whole.
const BLOCK: usize = 4;

/// A mesh that is believed where masks say nothing else.
#[derive(Debug)]
pub(super) struct Prior<'a> {
    /// Closed, in the frame of the placement: within one radius about the origin along each axis.
    mesh: &'a TriMesh,
    placement: Placement,
    /// How far outside of the mesh the object may be, in radii.
    tolerance: f32,
}

impl<'a> Prior<'a> {
    pub(super) fn new(
        mesh: &'a TriMesh,
        (center, radius): ([f64; 3], f64),
        tolerance: f32,
    ) -> Self {
        Self {
            mesh,
            placement: Placement { center, radius, half_extent: ROOM * radius },
            tolerance,
        }
    }

    /// The closed, oriented surface of what mesh and masks agree on, and the side of its cells, both in the frame of the placement,
    /// in which `targets` are left; `None` where nothing is left.
    pub(super) fn carved(&self, targets: &mut [Target]) -> Option<(TriMesh, f32)> {
        let mut lattice = Lattice::of(targets, &self.placement, LONGEST, FINEST)?;
        let mut prior = distances(self.mesh, &lattice);
        for distance in &mut prior {
            *distance -= self.tolerance / lattice.step;
        }
        let reach = reach(&lattice, &prior, targets, &self.placement);
        for (slot, (&own, &reach)) in prior.iter().zip(&reach).enumerate() {
            let own = own - reach;
            lattice.distance[slot] = lattice.distance[slot].max(own);
            lattice.agreed[slot] = lattice.agreed[slot].max(own);
        }
        let solid = Solid::of(&lattice, targets)?;
        let mut mesh = skin(&lattice, &solid.inside);
        let topology = Topology::of(&mesh);
        hull::smooth(&mut mesh, &topology);
        Some((mesh, lattice.step))
    }
}

/// Distance of each point from the surface of a closed mesh in steps, negative inside. Far from it that of a point nearby.
pub(super) fn distances(mesh: &TriMesh, lattice: &Lattice) -> Vec<f32> {
    let [nx, ny, nz] = lattice.dims;
    let corner = |end: [f32; 3]| -> [f32; 3] {
        std::array::from_fn(|k| lattice.origin[k] + lattice.step * end[k])
    };
    let far = lattice.dims.map(|n| n as f32 - 0.5);
    let inside = voxelize_solid(mesh, lattice.dims, (corner([-0.5; 3]), corner(far))).bits;
    let surface = ClosestPoint::new(mesh);
    let away = |p: [f32; 3]| {
        surface.find(p).map_or(f32::MAX, |found| found.distance as f32) / lattice.step
    };
    let mut distances = vec![0.0; inside.len()];
    let slab = nx * ny * BLOCK;
    distances.par_chunks_mut(slab).enumerate().for_each(|(number, out)| {
        let bottom = number * BLOCK;
        let layers = BLOCK.min(nz - bottom);
        let corners =
            (0..ny).step_by(BLOCK).flat_map(|y| (0..nx).step_by(BLOCK).map(move |x| [x, y]));
        for [x, y] in corners {
            let size = [BLOCK.min(nx - x), BLOCK.min(ny - y), layers];
            let first = [x, y, bottom].map(|i| i as f32);
            let half: [f32; 3] = size.map(|n| 0.5 * (n as f32 - 1.0));
            let whole = away(corner(std::array::from_fn(|k| first[k] + half[k])));
            // All of the block is far from the surface, on one side of it.
            let same = (whole > norm(half) + FAR).then_some(whole);
            for local in 0..size.iter().product() {
                let [i, j, k] =
                    [local % size[0], local / size[0] % size[1], local / (size[0] * size[1])];
                let at = (k * ny + y + j) * nx + x + i;
                let slot = number * slab + at;
                let distance = same.unwrap_or_else(|| away(lattice.place(slot)));
                out[at] = if inside[slot] { -distance } else { distance };
            }
        }
    });
    distances
}

/// How far outside of the mesh each point may be, in steps, because of the points nearby that pixels ask for: as far as those are, and less
/// by `SLOPE` for each step away from them, so that what is added is joined to the mesh by a cone and not left beside it as a sheet.
fn reach(lattice: &Lattice, prior: &[f32], targets: &[Target], placement: &Placement) -> Vec<f32> {
    let mut reach = vec![0.0_f32; prior.len()];
    for slot in asked(lattice, prior, targets, placement) {
        reach[slot] = reach[slot].max(prior[slot] + MARGIN);
    }
    spread(&mut reach, lattice.dims);
    reach
}

/// Raises each value to what is left of the values around it. Two passes, with the steps of a chamfer distance.
fn spread(values: &mut [f32], [nx, ny, nz]: [usize; 3]) {
    // The neighbours that come before a point, and what a step to them costs.
    let before: Vec<([isize; 3], f32)> = (0..13)
        .map(|n| [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1])
        .map(|step: [isize; 3]| {
            let squared: isize = step.iter().map(|x| x * x).sum();
            (step, SLOPE * (squared as f32).sqrt())
        })
        .collect();
    let slots = nx * ny * nz;
    for side in [1, -1] {
        for number in 0..slots {
            let slot = if side == 1 { number } else { slots - 1 - number };
            let at = [slot % nx, slot / nx % ny, slot / (nx * ny)];
            let mut best = values[slot];
            for (step, cost) in &before {
                let place: [usize; 3] =
                    std::array::from_fn(|k| at[k].wrapping_add_signed(side * step[k]));
                if place[0] < nx && place[1] < ny && place[2] < nz {
                    best = best.max(values[(place[2] * ny + place[1]) * nx + place[0]] - cost);
                }
            }
            values[slot] = best;
        }
    }
}

/// The points of the hull that pixels ask for because nothing of the mesh is on their ray: the nearest to it on each.
fn asked(
    lattice: &Lattice,
    prior: &[f32],
    targets: &[Target],
    placement: &Placement,
) -> Vec<usize> {
    let found: Vec<Vec<usize>> = targets
        .par_iter()
        .map(|target| {
            let mut found = Vec::new();
            lattice.cast(target, placement, |on_ray| {
                let nearest = on_ray.iter().map(|&s| prior[s]).fold(f32::INFINITY, f32::min);
                if nearest >= ALLOWED {
                    found.extend(on_ray.iter().filter(|&&s| prior[s] <= nearest + MARGIN));
                }
            });
            found
        })
        .collect();
    found.concat()
}
