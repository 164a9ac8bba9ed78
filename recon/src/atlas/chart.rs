//! Pieces of a surface that are nearly flat.

use std::collections::VecDeque;
use std::ops::Range;

use mesh_core::vector::{cross, dot};
use mesh_core::{Topology, face_normals, vertex_normals};

/// How far outside of its face a texel may lie, in texels, to be coloured as the face's plane goes on.
const BEYOND: f32 = 1.5;
/// The cosine of the angle to the direction from which a chart is seen, at least: no face loses more than this in size.
const FACING: f32 = 0.6;
/// Texels along a mean edge where overlaps are looked for.
const TRIAL: f32 = 6.0;
/// Cells of the largest grid on which they are.
const MOST_CELLS: usize = 1 << 22;

/// Columns from which on a row is looked at only where a triangle reaches it, and what that takes for near, texels.
const LONG_ROW: usize = 24;
const SLACK: f64 = 2.0;

/// A piece of the surface, seen along the mean of its first face's normals, right side up.
#[derive(Clone, Debug)]
pub(super) struct Chart {
    /// Its faces, as the mesh counts them.
    pub(super) faces: Vec<u32>,
    /// For each of them three indices into `places`.
    pub(super) corners: Vec<[u32; 3]>,
    /// Right of and below the left top corner, in the unit of the mesh.
    pub(super) places: Vec<[f32; 2]>,
    /// The greatest of `places`.
    pub(super) extent: [f32; 2],
}

/// Divides a surface into charts, in each of which no two faces overlap.
pub(super) fn charts(positions: &[[f32; 3]], faces: &[[u32; 3]]) -> Vec<Chart> {
    // What is not finite lies somewhere.
    let finite = |p: &[f32; 3]| p.map(|x| if x.is_finite() { x.clamp(-1e18, 1e18) } else { 0.0 });
    let positions: Vec<[f32; 3]> = positions.iter().map(finite).collect();
    let normals = face_normals(&positions, faces);
    let smooth = vertex_normals(&positions, faces);
    let neighbors = neighbors(positions.len(), faces);
    let edge = mean_edge(&positions, faces);
    let trial = if edge > 0.0 { TRIAL / edge } else { 0.0 };
    let mut taken = vec![false; faces.len()];
    let mut local = vec![(u32::MAX, 0u32); positions.len()];
    let mut charts: Vec<Chart> = Vec::new();
    // A face that overlaps its chart is left for a later one; a seed never is, so each round takes one face at least.
    while taken.contains(&false) {
        for seed in 0..faces.len() {
            if taken[seed] {
                continue;
            }
            let sum: [f32; 3] =
                std::array::from_fn(|k| faces[seed].iter().map(|&v| smooth[v as usize][k]).sum());
            let direction = unit(sum).unwrap_or([0.0, 0.0, 1.0]);
            let grown = grown(seed, &neighbors, &mut taken, |f| dot(normals[f], direction));
            let number = 2 * charts.len() as u32;
            let mut chart = Chart::seen(&positions, faces, grown, direction, number, &mut local);
            let kept = chart.without_overlaps(trial);
            if kept.len() < chart.faces.len() {
                for &face in &chart.faces {
                    taken[face as usize] = false;
                }
                for &face in &kept {
                    taken[face as usize] = true;
                }
                chart = Chart::seen(&positions, faces, kept, direction, number + 1, &mut local);
            }
            charts.push(chart);
        }
    }
    charts
}

/// The side of an equilateral triangle of the mean area of the faces; not finite where theirs is not.
pub fn mean_edge(positions: &[[f32; 3]], faces: &[[u32; 3]]) -> f32 {
    let area: f32 = mesh_core::face_areas(positions, faces).iter().sum();
    (area / faces.len().max(1) as f32 * 2.3).sqrt()
}

/// The faces that hang together with a first one and are seen well, from near to far; they are taken.
fn grown(
    seed: usize,
    neighbors: &[[u32; 3]],
    taken: &mut [bool],
    facing: impl Fn(usize) -> f32,
) -> Vec<u32> {
    let mut found = vec![seed as u32];
    taken[seed] = true;
    let mut queue = VecDeque::from([seed]);
    while let Some(face) = queue.pop_front() {
        for &next in neighbors[face].iter().filter(|&&next| next != Topology::NONE) {
            if !taken[next as usize] && facing(next as usize) >= FACING {
                taken[next as usize] = true;
                found.push(next);
                queue.push_back(next as usize);
            }
        }
    }
    found
}

impl Chart {
    /// The faces as they are seen along a direction, turned so that their box is small. `local` remembers for each vertex in
    /// which chart it was met last, by a number that is new.
    fn seen(
        positions: &[[f32; 3]],
        faces: &[[u32; 3]],
        found: Vec<u32>,
        direction: [f32; 3],
        number: u32,
        local: &mut [(u32, u32)],
    ) -> Self {
        let least = (0..3).min_by(|&a, &b| direction[a].abs().total_cmp(&direction[b].abs()));
        let mut axis = [0.0; 3];
        axis[least.unwrap_or(0)] = 1.0;
        let right = unit(cross(axis, direction)).unwrap_or([1.0, 0.0, 0.0]);
        let up = cross(direction, right);
        let mut places: Vec<[f32; 2]> = Vec::new();
        let corner = |v: u32, places: &mut Vec<[f32; 2]>, local: &mut [(u32, u32)]| {
            let entry = &mut local[v as usize];
            if entry.0 != number {
                *entry = (number, places.len() as u32);
                let p = positions[v as usize];
                places.push([dot(p, right), -dot(p, up)]);
            }
            entry.1
        };
        let corners =
            found.iter().map(|&f| faces[f as usize].map(|v| corner(v, &mut places, local)));
        let corners = corners.collect();
        let turned = |quarter: u32| {
            let (sin, cos) = (std::f32::consts::FRAC_PI_2 * quarter as f32 / 6.0).sin_cos();
            let of = move |&[x, y]: &[f32; 2]| [cos * x - sin * y, sin * x + cos * y];
            let all: Vec<[f32; 2]> = places.iter().map(of).collect();
            let low =
                all.iter().fold([f32::INFINITY; 2], |low, p| [low[0].min(p[0]), low[1].min(p[1])]);
            let moved: Vec<[f32; 2]> = all.iter().map(|p| [p[0] - low[0], p[1] - low[1]]).collect();
            let extent =
                moved.iter().fold([0.0f32; 2], |high, p| [high[0].max(p[0]), high[1].max(p[1])]);
            (extent, moved)
        };
        let area = |(extent, _): &([f32; 2], Vec<[f32; 2]>)| extent[0] * extent[1];
        let (extent, places) = (0..6)
            .map(turned)
            .min_by(|a, b| area(a).total_cmp(&area(b)))
            .expect("there are six turns");
        Self { faces: found, corners, places, extent }
    }

    /// The faces that can stay: none covers a cell of a grid that an earlier one covers.
    fn without_overlaps(&self, density: f32) -> Vec<u32> {
        let cells = |density: f32| self.extent.map(|length| (length * density) as usize + 3);
        let mut density = density;
        while cells(density)[0].saturating_mul(cells(density)[1]) > MOST_CELLS {
            density *= 0.7;
        }
        let [width, height] = cells(density);
        let mut covered = vec![false; width * height];
        let mut kept = Vec::with_capacity(self.faces.len());
        let mut own = Vec::new();
        for (&face, corners) in self.faces.iter().zip(&self.corners) {
            let corners = corners.map(|v| self.places[v as usize].map(|x| density * x + 1.0));
            own.clear();
            around(corners, [0, 0, width, height], 0.0, |column, row, inside, _| {
                if inside > 0.01 {
                    own.push(row * width + column);
                }
            });
            if !own.iter().any(|&cell| covered[cell]) {
                for &cell in &own {
                    covered[cell] = true;
                }
                kept.push(face);
            }
        }
        kept
    }

    /// Calls `visit` once for each texel of the box (left, top, width, height) that a face fills or nearly does, with the face
    /// and the barycentric coordinates of the texel's centre. `pixels` are the places in the image.
    pub(super) fn draw(
        &self,
        pixels: &[[f32; 2]],
        [left, top, width, height]: [usize; 4],
        mut visit: impl FnMut(usize, usize, u32, [f32; 3]),
    ) {
        let mut best: Vec<(f32, u32, [f32; 3])> =
            vec![(f32::NEG_INFINITY, 0, [0.0; 3]); width * height];
        let start = [left, top].map(|corner| corner as f32);
        for (&face, corners) in self.faces.iter().zip(&self.corners) {
            let corners =
                corners.map(|v| std::array::from_fn(|k| pixels[v as usize][k] - start[k]));
            around(corners, [0, 0, width, height], BEYOND, |column, row, inside, barycentric| {
                let entry = &mut best[row * width + column];
                if inside > entry.0 {
                    *entry = (inside, face, barycentric);
                }
            });
        }
        for (k, (inside, face, barycentric)) in best.into_iter().enumerate() {
            if inside > f32::NEG_INFINITY {
                visit(left + k % width, top + k / width, face, barycentric);
            }
        }
    }
}

/// Calls `visit` with every cell whose centre lies in a triangle or at most `beyond` outside of it: column, row, how far inside
/// of the nearest edge's line it is, and its barycentric coordinates.
pub(super) fn around(
    [a, b, c]: [[f32; 2]; 3],
    [left, top, right, bottom]: [usize; 4],
    beyond: f32,
    mut visit: impl FnMut(usize, usize, f32, [f32; 3]),
) {
    let turn = |p: [f32; 2], q: [f32; 2], r: [f32; 2]| {
        (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
    };
    let twice = turn(a, b, c);
    let length = |p: [f32; 2], q: [f32; 2]| (q[0] - p[0]).hypot(q[1] - p[1]);
    // The heights above the sides opposite to the corners.
    let heights = [length(b, c), length(c, a), length(a, b)].map(|side| twice.abs() / side);
    if heights.iter().any(|height| !height.is_finite() || *height < 1e-6) {
        return;
    }
    let range = |k: usize, low: usize, high: usize| {
        let least = a[k].min(b[k]).min(c[k]) - beyond - 0.5;
        let most = a[k].max(b[k]).max(c[k]) + beyond + 0.5;
        (least.max(low as f32) as usize).max(low)..(most.max(0.0) as usize).min(high)
    };
    let whole = range(0, left, right);
    let sides = [[b, c], [c, a], [a, b]];
    for row in range(1, top, bottom) {
        let columns = if whole.len() < LONG_ROW {
            whole.clone()
        } else {
            reached(sides, twice.signum(), row, beyond, whole.clone())
        };
        for column in columns {
            let p = [column as f32 + 0.5, row as f32 + 0.5];
            let w = [turn(p, b, c) / twice, turn(p, c, a) / twice, turn(p, a, b) / twice];
            let inside = (0..3).map(|k| w[k] * heights[k]).fold(f32::INFINITY, f32::min);
            if inside >= -beyond {
                visit(column, row, inside, w);
            }
        }
    }
}

/// The columns of a row in which something can lie in a triangle or little more than `beyond` outside of it: of a long diagonal one
/// a small part of its box.
fn reached(
    sides: [[[f32; 2]; 2]; 3],
    sign: f32,
    row: usize,
    beyond: f32,
    columns: Range<usize>,
) -> Range<usize> {
    let (mut low, mut high) = (columns.start as f64, columns.end as f64);
    let y = row as f64 + 0.5;
    for [q, r] in sides {
        let [q, r] = [q, r].map(|p| p.map(f64::from));
        let scale = f64::from(sign) / (q[0] - r[0]).hypot(q[1] - r[1]);
        // How far inside a place of the row is: `across * x + at`.
        let across = scale * (q[1] - r[1]);
        let at = scale * ((r[0] - q[0]) * y + q[0] * r[1] - q[1] * r[0]);
        let bound = (-f64::from(beyond) - SLACK - at) / across;
        if across > 1e-6 {
            low = low.max(bound - 1.0);
        } else if across < -1e-6 {
            high = high.min(bound + 1.0);
        }
    }
    let start = low as usize;
    start..(high.max(0.0).ceil() as usize).min(columns.end).max(start)
}

/// The up to three faces across the edges of each.
fn neighbors(vertices: usize, faces: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let topology = Topology::new(vertices, faces);
    let mut neighbors = vec![[Topology::NONE; 3]; faces.len()];
    let mut add = |face: u32, other: u32| {
        if let Some(free) =
            neighbors[face as usize].iter_mut().find(|free| **free == Topology::NONE)
        {
            *free = other;
        }
    };
    for &[f, g] in &topology.edge_faces {
        if f != Topology::NONE && g != Topology::NONE {
            add(f, g);
            add(g, f);
        }
    }
    neighbors
}

fn unit(a: [f32; 3]) -> Option<[f32; 3]> {
    let length = dot(a, a).sqrt();
    (length.is_finite() && length > 0.0).then(|| a.map(|x| x / length))
}

#[cfg(test)]
mod tests {
    use mesh_core::primitives;

    use super::*;

    #[test]
    fn a_ball_has_few_charts_and_each_face_is_in_one() {
        let ball = primitives::icosphere(4);
        let charts = charts(&ball.positions, &ball.faces);
        assert!((4..40).contains(&charts.len()), "{}", charts.len());
        let mut seen = vec![0; ball.faces.len()];
        charts.iter().flat_map(|chart| &chart.faces).for_each(|&f| seen[f as usize] += 1);
        assert!(seen.iter().all(|&count| count == 1));
    }

    #[test]
    fn rows_are_looked_at_only_where_a_triangle_is() {
        let mut state = 1u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let mut visits = 0;
        for round in 0..300 {
            let mut corners: [[f32; 2]; 3] =
                [[0.0; 2]; 3].map(|p| p.map(|_| 160.0 * next() - 16.0));
            if round % 3 == 0 {
                // A long sliver.
                corners[2] =
                    [0, 1].map(|k| corners[0][k] + 0.7 * (corners[1][k] - corners[0][k]) + next());
            }
            let beyond = [0.0, BEYOND][round % 2];
            let mut found = vec![f32::NEG_INFINITY; 128 * 128];
            around(corners, [0, 0, 128, 128], beyond, |column, row, inside, _| {
                found[row * 128 + column] = inside;
                visits += 1;
            });
            for (cell, &inside) in found.iter().enumerate() {
                let p = [(cell % 128) as f64 + 0.5, (cell / 128) as f64 + 0.5];
                let corners = corners.map(|q| q.map(f64::from));
                let turn = |[p, q, r]: [[f64; 2]; 3]| {
                    (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
                };
                let sign = turn(corners).signum();
                let depth = |k: usize| {
                    let [q, r] = [corners[(k + 1) % 3], corners[(k + 2) % 3]];
                    sign * turn([p, q, r]) / (q[0] - r[0]).hypot(q[1] - r[1])
                };
                let truth = (0..3).map(depth).fold(f64::INFINITY, f64::min);
                let beyond = f64::from(beyond);
                // Of a sharp corner the lines go on beyond what is looked at.
                let within = |k: usize| {
                    let ends = [0, 1, 2].map(|c| corners[c][k]);
                    p[k] > ends.into_iter().fold(f64::INFINITY, f64::min) - beyond
                        && p[k] < ends.into_iter().fold(f64::NEG_INFINITY, f64::max) + beyond
                };
                if !(within(0) && within(1)) {
                    continue;
                }
                assert!(
                    truth < -beyond + 0.01 || f64::from(inside) > -beyond - 0.01,
                    "{corners:?} {p:?}"
                );
                assert!(inside == f32::NEG_INFINITY || (f64::from(inside) - truth).abs() < 0.01);
            }
        }
        assert!(visits > 100_000, "{visits}");
    }

    #[test]
    fn a_spiral_stair_does_not_lie_on_itself() {
        // Three turns of a ramp: all of it faces up, and each turn lies above the one before.
        let steps = 90u32;
        let place = |k: u32, r: f32| {
            let angle = std::f32::consts::TAU * 3.0 * k as f32 / steps as f32;
            [r * angle.cos(), 0.02 * k as f32, -r * angle.sin()]
        };
        let positions: Vec<[f32; 3]> =
            (0..=steps).flat_map(|k| [place(k, 1.0), place(k, 2.0)]).collect();
        let faces: Vec<[u32; 3]> = (0..steps)
            .flat_map(|k| [[2 * k, 2 * k + 1, 2 * k + 3], [2 * k, 2 * k + 3, 2 * k + 2]])
            .collect();
        let charts = charts(&positions, &faces);
        assert!((3..12).contains(&charts.len()), "{}", charts.len());
        let count: usize = charts.iter().map(|chart| chart.faces.len()).sum();
        assert_eq!(count, faces.len());
        for chart in &charts {
            // A finer grid sees a sliver where the ends meet.
            assert!(chart.without_overlaps(50.0).len() + 1 >= chart.faces.len());
        }
    }
}
