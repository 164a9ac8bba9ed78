//! A ball in the visual hull as a start, for slender objects that have holes and must be spheres.
//!
//! A leg that is thinner than a coarse triangle never grows out of a sphere: its mask is too narrow to
//! pull at it. The hull's own surface has the legs, and its holes too. So a ball of one cell is grown
//! inside the hull instead, cell by cell, and never becomes anything but a ball: a cell is added only
//! where what it touches is a disc. The surface of what results is a sphere; where the object has a
//! handle, a slit one cell wide stays open.

use std::collections::VecDeque;

use datasets::View;
use mesh_core::{Topology, TriMesh};
use rayon::prelude::*;

use super::placement::{self, Placement};
use super::target::Target;

/// Cells along each side.
const SIDE: usize = 80;
/// Above this ratio of the hull's reach to the radius of its volume, a sphere is no good start.
const SLENDER: f64 = 1.5;
/// Rounds of smoothing of the cells' surface.
const ROUNDS: usize = 6;

/// Whether an object reaches so far that a sphere would be a bad start.
pub(super) fn is_slender(placement: &Placement) -> bool {
    placement.half_extent >= SLENDER * placement.radius
}

/// Cells, and which of them may hold some of the object.
#[derive(Debug)]
pub(super) struct Hull {
    inside: Vec<bool>,
    /// The side of a cell in units of the placement's radius.
    cell: f64,
}

impl Hull {
    /// The hull around a placement; `targets` are placed anew.
    pub(super) fn of(
        views: &[&View],
        targets: &mut [Target],
        placement: &Placement,
    ) -> Option<Self> {
        // Two cells of air on each side.
        let half = placement.half_extent * SIDE as f64 / (SIDE as f64 - 4.0);
        for target in targets.iter_mut() {
            target.place(placement.center, half);
        }
        let mut inside = vec![false; SIDE * SIDE * SIDE];
        for cell in placement::carve(targets, views, SIDE).ok()? {
            let at = cell.map(|x| ((x + 1.0) * 0.5 * SIDE as f32) as usize);
            if at.iter().all(|&i| i > 0 && i < SIDE - 1) {
                inside[slot(at)] = true;
            }
        }
        Some(Self { inside, cell: 2.0 * half / SIDE as f64 / placement.radius })
    }

    /// The side of a cell in units of the placement's radius.
    pub(super) fn cell(&self) -> f32 {
        self.cell as f32
    }

    /// The surface of a ball of cells that fills the hull, in units of the placement's
    /// radius around its centre: closed, outward, of genus 0. `None` for an empty hull.
    pub(super) fn surface(&self) -> Option<TriMesh> {
        let ball = self.topological_ball()?;
        let mut numbers = vec![u32::MAX; (SIDE + 1).pow(3)];
        let mut mesh = TriMesh::default();
        for cell in (0..ball.len()).filter(|&c| ball[c]) {
            let at = place(cell);
            for axis in 0..3 {
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                for far in [false, true] {
                    let mut next = at;
                    next[axis] = if far { at[axis] + 1 } else { at[axis] - 1 };
                    if ball[slot(next)] {
                        continue;
                    }
                    let mut corner = |du: usize, dv: usize| {
                        let mut p = at;
                        p[axis] += usize::from(far);
                        p[u] += du;
                        p[v] += dv;
                        let number = &mut numbers[(p[0] * (SIDE + 1) + p[1]) * (SIDE + 1) + p[2]];
                        if *number == u32::MAX {
                            *number = mesh.positions.len() as u32;
                            let middle = 0.5 * SIDE as f64;
                            mesh.positions
                                .push(p.map(|i| ((i as f64 - middle) * self.cell) as f32));
                        }
                        *number
                    };
                    let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                    mesh.faces.extend(if far {
                        [[a, b, c], [a, c, d]]
                    } else {
                        [[a, c, b], [a, d, c]]
                    });
                }
            }
        }
        Some(mesh)
    }

    /// A topological ball of cells inside the hull, as large as it can grow from near the middle.
    fn topological_ball(&self) -> Option<Vec<bool>> {
        let middle = (SIDE / 2) as isize;
        let far = |&cell: &usize| -> isize {
            place(cell).iter().map(|&i| (i as isize - middle).pow(2)).sum()
        };
        let start = (0..self.inside.len()).filter(|&c| self.inside[c]).min_by_key(far)?;
        let mut ball = vec![false; self.inside.len()];
        let mut queue = VecDeque::from([start]);
        ball[start] = true;
        let mut first = true;
        while let Some(cell) = queue.pop_front() {
            if !first && (ball[cell] || !touches_a_disc(&ball, place(cell))) {
                continue;
            }
            first = false;
            ball[cell] = true;
            // A neighbour that was refused may fit now.
            for near in neighbors(place(cell)) {
                if self.inside[near] && !ball[near] {
                    queue.push_back(near);
                }
            }
        }
        Some(ball)
    }
}

/// Whether what a cell shares with the ball is a disc made of sides of the cell.
///
/// Gluing one ball to another along a disc gives a ball, and a surface without pinches.
fn touches_a_disc(ball: &[bool], at: [usize; 3]) -> bool {
    let filled =
        |d: [isize; 3]| ball[slot(std::array::from_fn(|k| (at[k] as isize + d[k]) as usize))];
    let side = |axis: usize, sign: isize| {
        let mut d = [0; 3];
        d[axis] = sign;
        filled(d)
    };
    let sides: [[bool; 2]; 3] = std::array::from_fn(|axis| [side(axis, -1), side(axis, 1)]);
    // A connected part of the six sides whose complement is connected too.
    let count = sides.iter().flatten().filter(|s| **s).count();
    let opposite = |want: bool| sides.iter().any(|pair| pair[0] == want && pair[1] == want);
    let disc = match count {
        1 | 3 | 5 => true,
        2 => !opposite(true),
        4 => !opposite(false),
        _ => false,
    };
    // Edges and corners must be touched through sides.
    disc && (0..27).all(|i| {
        let d = [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1];
        let off = d.iter().filter(|x| **x != 0).count();
        off < 2
            || !filled(d)
            || (0..3).any(|axis| d[axis] != 0 && sides[axis][usize::from(d[axis] > 0)])
    })
}

fn slot(at: [usize; 3]) -> usize {
    (at[0] * SIDE + at[1]) * SIDE + at[2]
}

fn place(slot: usize) -> [usize; 3] {
    [slot / (SIDE * SIDE), slot / SIDE % SIDE, slot % SIDE]
}

/// The 26 cells around one that is not at the border.
fn neighbors(at: [usize; 3]) -> impl Iterator<Item = usize> {
    (0..27usize)
        .filter(|&i| i != 13)
        .map(move |i| slot([at[0] + i / 9 - 1, at[1] + i / 3 % 3 - 1, at[2] + i % 3 - 1]))
}

/// Rounds off the steps of the cells; every second round swells, so that thin parts stay.
pub(super) fn smooth(mesh: &mut TriMesh, topology: &Topology) {
    for round in 0..2 * ROUNDS {
        let share = if round % 2 == 0 { 0.5 } else { -0.52 };
        mesh.positions = (0..mesh.positions.len())
            .into_par_iter()
            .map(|v| {
                let ring = topology.vertex_vertices.row(v);
                std::array::from_fn(|k| {
                    let sum: f32 = ring.iter().map(|&w| mesh.positions[w as usize][k]).sum();
                    let mean = sum / ring.len().max(1) as f32;
                    mesh.positions[v][k] + share * (mean - mesh.positions[v][k])
                })
            })
            .collect();
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    fn hull(inside: impl Fn([f64; 3]) -> bool) -> Hull {
        let at = |c: usize| place(c).map(|i| (2 * i + 1) as f64 / SIDE as f64 - 1.0);
        let air = |c: usize| place(c).iter().any(|&i| i == 0 || i == SIDE - 1);
        let inside = (0..SIDE * SIDE * SIDE).map(|c| !air(c) && inside(at(c))).collect();
        Hull { inside, cell: 2.0 / SIDE as f64 }
    }

    #[test]
    fn whatever_the_hull_the_surface_is_a_sphere() {
        let ring = |[x, y, z]: [f64; 3]| (x.hypot(z) - 0.6).hypot(y) < 0.15;
        let legs = |[x, y, z]: [f64; 3]| {
            y.abs() < 0.06 && x.hypot(z) < 0.8
                || y < 0.0
                    && y > -0.8
                    && (x.abs() - 0.4).abs() < 0.05
                    && (z.abs() - 0.4).abs() < 0.05
        };
        let lattice = |p: [f64; 3]| p.iter().filter(|x| (*x * 8.0).sin() > 0.0).count() >= 2;
        let volume =
            |hull: &Hull| hull.inside.iter().filter(|i| **i).count() as f64 * hull.cell.powi(3);
        let shapes: [(Hull, f64); 3] = [(hull(ring), 0.9), (hull(legs), 0.9), (hull(lattice), 0.5)];
        for (hull, share) in shapes {
            let mut mesh = hull.surface().unwrap();
            let topology = Topology::of(&mesh);
            smooth(&mut mesh, &topology);
            let health = mesh.health();
            assert!(health.is_watertight(), "{health}");
            assert_eq!((health.components, health.euler), (1, 2));
            assert!(health.volume > share * volume(&hull), "{health}, of {}", volume(&hull));
        }
        assert!(hull(|_| false).surface().is_none());
    }
}
