//! A sparse factorisation `A = Pᵀ L D Lᵀ P` of the diffusion operator.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::Csr;

/// The end of a list.
const NONE: u32 = u32::MAX;

/// Each neighbour that is eliminated goes through the list of the others: the time is the square of their number.
const MOST_NEIGHBORS: usize = 4096;

/// The factors of `I + λ L`, in an order that leaves few entries in them.
#[derive(Clone, Debug)]
pub(super) struct Factor {
    /// The vertex that is eliminated at each step.
    order: Vec<u32>,
    /// For each step the later steps in its column of `L`, ascending; the diagonal is one.
    columns: Csr,
    values: Vec<f32>,
    /// One over the diagonal `D`.
    inverse_diagonal: Vec<f32>,
    /// A right-hand side in the order of elimination.
    work: Vec<[f32; 4]>,
}

impl Factor {
    /// Factors `I + λ (D - A)` of the graph `rows`, or gives up where the factor would have more
    /// than `most` entries, or a vertex has more than [`MOST_NEIGHBORS`].
    pub(super) fn new(rows: &Csr, lambda: f32, most: usize) -> Option<Self> {
        if rows.rows().any(|ring| ring.len() > MOST_NEIGHBORS) {
            return None;
        }
        let (order, columns) = eliminate(rows, most)?;
        let count = order.len();
        let mut step_of = vec![0_u32; count];
        for (step, &vertex) in order.iter().enumerate() {
            step_of[vertex as usize] = step as u32;
        }

        // Column by column: what is left of column j of the matrix after all earlier columns with
        // an entry in row j have been taken off. `waiting[j]` heads the list of those columns.
        let mut values = vec![0.0_f64; columns.indices.len()];
        let mut diagonal = vec![0.0_f64; count];
        let mut column = vec![0.0_f64; count];
        let mut waiting = vec![NONE; count];
        let mut after = vec![NONE; count];
        let mut place: Vec<usize> = columns.offsets.iter().map(|&o| o as usize).collect();
        let lambda = f64::from(lambda);
        for j in 0..count {
            let ring = rows.row(order[j] as usize);
            column[j] = 1.0 + lambda * ring.len() as f64;
            for &vertex in ring {
                let step = step_of[vertex as usize] as usize;
                if step > j {
                    column[step] -= lambda;
                }
            }
            let mut k = waiting[j];
            while k != NONE {
                let following = after[k as usize];
                let range = place[k as usize]..columns.offsets[k as usize + 1] as usize;
                let factor = values[range.start] * diagonal[k as usize];
                for slot in range.clone() {
                    column[columns.indices[slot] as usize] -= factor * values[slot];
                }
                place[k as usize] += 1;
                if range.len() > 1 {
                    let head = &mut waiting[columns.indices[range.start + 1] as usize];
                    after[k as usize] = std::mem::replace(head, k);
                }
                k = following;
            }
            // At least one: the operator is the identity and something that is not negative.
            diagonal[j] = std::mem::take(&mut column[j]);
            for slot in columns.range(j) {
                let row = columns.indices[slot] as usize;
                values[slot] = std::mem::take(&mut column[row]) / diagonal[j];
            }
            if let Some(&first) = columns.row(j).first() {
                after[j] = std::mem::replace(&mut waiting[first as usize], j as u32);
            }
        }
        Some(Self {
            work: vec![[0.0; 4]; count],
            inverse_diagonal: diagonal.into_iter().map(|d| (1.0 / d) as f32).collect(),
            values: values.into_iter().map(|v| v as f32).collect(),
            order,
            columns,
        })
    }

    /// Computes `z = A⁻¹ r`, to the accuracy of `f32`.
    pub(super) fn solve(&mut self, r: &[[f32; 4]], z: &mut [[f32; 4]]) {
        let Self { order, columns, values, inverse_diagonal, work } = self;
        for (w, &vertex) in work.iter_mut().zip(&*order) {
            *w = r[vertex as usize];
        }
        let entries = |step: usize| {
            let range = columns.range(step);
            columns.indices[range.clone()].iter().zip(&values[range])
        };
        for step in 0..work.len() {
            let here = work[step];
            for (&row, &l) in entries(step) {
                let w = &mut work[row as usize];
                for k in 0..4 {
                    w[k] -= l * here[k];
                }
            }
        }
        for step in (0..work.len()).rev() {
            let mut here = work[step].map(|w| w * inverse_diagonal[step]);
            for (&row, &l) in entries(step) {
                let w = work[row as usize];
                for k in 0..4 {
                    here[k] -= l * w[k];
                }
            }
            work[step] = here;
            z[order[step] as usize] = here;
        }
    }
}

/// Eliminates the vertices of a graph one after the other, always one with the fewest neighbours
/// left (of those, the lowest number); its neighbours become neighbours of each other.
///
/// Neighbours that then have no others go in the same step, for nothing changes for the rest: late
/// in the elimination these are most. Gives the order and for each vertex the later ones that it
/// leaves entries at. On surfaces this is `O(V log V)` entries.
fn eliminate(rows: &Csr, most: usize) -> Option<(Vec<u32>, Csr)> {
    const LEFT: u32 = u32::MAX;
    let count = rows.len();
    let mut rings: Vec<Vec<u32>> = rows.rows().map(<[u32]>::to_vec).collect();
    let mut queue: BinaryHeap<Reverse<(u32, u32)>> =
        rings.iter().zip(0..).map(|(ring, v)| Reverse((ring.len() as u32, v))).collect();
    let mut step_of = vec![LEFT; count];
    let mut order = Vec::with_capacity(count);
    let mut columns = Csr { offsets: vec![0], indices: Vec::new() };
    let (mut leaving, mut union) = (Vec::new(), Vec::new());
    while let Some(Reverse((degree, vertex))) = queue.pop() {
        let done = step_of[vertex as usize] != LEFT;
        if done || rings[vertex as usize].len() != degree as usize {
            continue; // an entry of the queue that is out of date
        }
        let ring = std::mem::take(&mut rings[vertex as usize]);
        leaving.clear();
        leaving.push(vertex);
        leaving.extend(ring.iter().filter(|&&v| within(&rings[v as usize], &ring, vertex)));
        for &vertex in &leaving {
            step_of[vertex as usize] = order.len() as u32;
            order.push(vertex);
            // Those of the same step that come later are still left here.
            columns.indices.extend(ring.iter().filter(|&&v| step_of[v as usize] == LEFT));
            columns.offsets.push(columns.indices.len() as u32);
            if columns.indices.len() > most {
                return None;
            }
        }
        for &other in ring.iter().filter(|&&v| step_of[v as usize] == LEFT) {
            merge(&rings[other as usize], &ring, &mut union);
            let changed = &mut rings[other as usize];
            changed.clear();
            changed.extend(union.iter().filter(|&&v| v != other && step_of[v as usize] == LEFT));
            queue.push(Reverse((changed.len() as u32, other)));
        }
    }
    for entry in &mut columns.indices {
        *entry = step_of[*entry as usize];
    }
    columns.sort_rows();
    Some((order, columns))
}

/// Whether `ring` holds all of `a` but `except`; both are sorted.
fn within(a: &[u32], ring: &[u32], except: u32) -> bool {
    if a.len() > ring.len() {
        return false;
    }
    let mut rest = ring.iter();
    a.iter().all(|&x| x == except || rest.any(|&y| y == x))
}

/// The union of two sorted lists.
fn merge(a: &[u32], b: &[u32], union: &mut Vec<u32>) {
    union.clear();
    let (mut i, mut j) = (0, 0);
    while i < a.len() && j < b.len() {
        let (x, y) = (a[i], b[j]);
        union.push(x.min(y));
        i += usize::from(x <= y);
        j += usize::from(y <= x);
    }
    union.extend_from_slice(&a[i..]);
    union.extend_from_slice(&b[j..]);
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::{DiffusionSolver, Topology, primitives};

    #[test]
    fn inverts_the_operator() {
        for mesh in [primitives::icosphere(3), primitives::torus(1.0, 0.4, 21, 13)] {
            let topology = Topology::new(mesh.positions.len() + 1, &mesh.faces);
            let mut factor = Factor::new(&topology.vertex_vertices, 20.0, usize::MAX).unwrap();
            let x: Vec<[f32; 4]> = (0..=mesh.positions.len())
                .map(|i| std::array::from_fn(|k| ((i * 31 + k * 7) % 23) as f32 - 11.0))
                .collect();
            let (mut b, mut z) = (x.clone(), x.clone());
            DiffusionSolver::new(&topology, 20.0).apply(&x, &mut b);
            factor.solve(&b, &mut z);
            for (x, z) in x.iter().flatten().zip(z.iter().flatten()) {
                approx::assert_abs_diff_eq!(x, z, epsilon = 1e-3);
            }
        }
    }

    #[test]
    fn a_path_fills_nothing_and_a_limit_is_kept() {
        // A fan of triangles around one vertex: the rim first, each with two neighbours left.
        let fan: Vec<[u32; 3]> = (1..9).map(|i| [0, i, i + 1]).collect();
        let topology = Topology::new(10, &fan);
        let (order, columns) = eliminate(&topology.vertex_vertices, usize::MAX).unwrap();
        assert_eq!(columns.indices.len(), topology.edges.len());
        assert_eq!(order.len(), 10);
        assert!(Factor::new(&topology.vertex_vertices, 1.0, 5).is_none());
        // The middle of a fan of 100,000 would take minutes.
        let fan: Vec<[u32; 3]> = (1..100_000).map(|i| [0, i, i + 1]).collect();
        let topology = Topology::new(100_001, &fan);
        assert!(Factor::new(&topology.vertex_vertices, 1.0, usize::MAX).is_none());
    }
}
