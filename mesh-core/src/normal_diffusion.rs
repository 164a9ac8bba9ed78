//! Anisotropic diffusion of normals: even where nothing is known, free to break at creases.

use crate::conjugate_gradients::{ConjugateGradients, SymmetricSystem, multiply_rows};
use crate::vector::{norm, sub};
use crate::{Topology, face_normals};

/// How far normals are spread over a surface, and where they may break.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalDiffusion {
    /// How far a face that is not trusted listens to others, in faces, above 0, up to 100 or so.
    pub reach: f32,
    /// Difference of unit normals, about the angle between them in radians, from which neighbours do not know one another, above 0.
    pub crease: f32,
    /// How often neighbours are weighted anew.
    pub rounds: usize,
}

/// As far as 30 faces, creases of 0.3 (17 degrees), two rounds.
impl Default for NormalDiffusion {
    fn default() -> Self {
        Self { reach: 30.0, crease: 0.3, rounds: 2 }
    }
}

impl NormalDiffusion {
    /// Unit normals of the faces that differ from those they have, where these are not trusted, and little from one another.
    ///
    /// Least squares, solved for all faces at once, so that dents as wide as `reach` go in one call, which a
    /// [filter](crate::NormalFilter) from face to face takes hundreds of rounds for:
    ///
    /// ```text
    /// Σ_f (trust_f + 1 / reach²) |n_f - n0_f|² + Σ_fg w(|n_f - n_g|) |n_f - n_g|²,    w(d) = (1 - (d / crease)²)² for d < crease, else 0
    /// ```
    ///
    /// over neighbouring faces `f g`; `w` (Tukey's biweight) is that of the round before. [`integrate_normals`](crate::integrate_normals) finds the surface that has them.
    ///
    /// ```
    /// use mesh_core::{NormalDiffusion, Topology, primitives, subdivide};
    /// let board = (0..4).fold(primitives::cuboid([1.0; 3]), |mesh, _| subdivide(&mesh));
    /// let dented = board.clone().map_positions(|p| [p[0], p[1], p[2] - if p[2] > 0.0 { 0.02 * (3.0 * p[0]).cos() } else { 0.0 }]);
    /// let normals = NormalDiffusion::default().normals(&dented.positions, &Topology::of(&dented), &vec![0.0; dented.faces.len()]);
    /// // The lid is flat again, and the sides have not noticed.
    /// assert!(normals.iter().filter(|n| n[2] > 0.999).count() as f32 > 0.9 * normals.len() as f32 / 6.0);
    /// ```
    ///
    /// # Shapes
    /// `positions [V, 3]`, `trust [F]`, not negative: 1 holds a face's normal about as much as a neighbour pulls at it. The result is `[F, 3]`; a
    /// face without area has the normal of its neighbours, or zero. Nothing passes through borders, and edges of more than two faces.
    ///
    /// # Cost
    /// Some `3 · reach` passes over the faces a round, at most 300, which is what a reach of 100 needs: 10 ms for 20,000 faces and a reach of 30. The passes are on all threads.
    ///
    /// # Panics
    /// If `reach` is not above 0, a face names a vertex that does not exist, or `trust` has not one value a face.
    ///
    /// # References
    /// Tasdizen, Whitaker, Burchard and Osher 2003, *Geometric surface processing via normal maps*, TOG 22(4): diffuse normals, then fit the
    /// surface to them.
    pub fn normals(
        &self,
        positions: &[[f32; 3]],
        topology: &Topology,
        trust: &[f32],
    ) -> Vec<[f32; 3]> {
        let faces = &topology.faces;
        assert_eq!(trust.len(), faces.len(), "NormalDiffusion: trust of {} faces", trust.len());
        assert!(self.reach > 0.0, "NormalDiffusion: reach {}", self.reach);
        let given = face_normals(positions, faces);
        let own: Vec<f32> = trust.iter().map(|t| t + 1.0 / (self.reach * self.reach)).collect();
        let right: Vec<[f32; 3]> = given.iter().zip(&own).map(|(n, t)| n.map(|n| t * n)).collect();
        let neighbors = neighbors(topology);
        let mut normals = given;
        let mut solver = ConjugateGradients::new(faces.len());
        for _ in 0..self.rounds {
            let mut system = Coupling::new(&own, &neighbors, |f, g| {
                let [f, g] = [normals[f], normals[g]];
                // A face without area has no normal yet.
                let missing = f == [0.0; 3] || g == [0.0; 3];
                if missing { 1.0 } else { biweight(difference(f, g), self.crease) }
            });
            solver.solve(&mut system, &right, &mut normals, TOLERANCE, MOST);
            normals.iter_mut().for_each(normalize);
        }
        normals
    }
}

/// Of the right-hand side, which is what trusted normals weigh.
const TOLERANCE: f64 = 1e-3;
/// Iterations of a solve.
const MOST: usize = 300;

/// For each face those on its edges; itself where there is none, or more than one.
fn neighbors(topology: &Topology) -> Vec<[u32; 3]> {
    let across = |face: u32, edge: u32| match topology.edge_faces.get(edge as usize) {
        Some(&[f, g]) if f != Topology::NONE && g != Topology::NONE => f ^ g ^ face,
        _ => face,
    };
    let edges = topology.face_edges.iter().enumerate();
    edges.map(|(face, edges)| edges.map(|edge| across(face as u32, edge))).collect()
}

/// Tukey's: 1 for no difference, 0 from `limit` on.
fn biweight(difference: f32, limit: f32) -> f32 {
    let ratio = (difference / limit).min(1.0);
    (1.0 - ratio * ratio).powi(2)
}

fn difference(a: [f32; 3], b: [f32; 3]) -> f32 {
    norm(sub(a, b))
}

fn normalize(n: &mut [f32; 3]) {
    let length = norm(*n).max(1e-12);
    *n = n.map(|n| n / length);
}

/// Each face's own weight, and that of each of its neighbours.
struct Coupling<'a> {
    neighbors: &'a [[u32; 3]],
    weights: Vec<[f32; 3]>,
    diagonal: Vec<f32>,
}

impl<'a> Coupling<'a> {
    fn new(own: &[f32], neighbors: &'a [[u32; 3]], weight: impl Fn(usize, usize) -> f32) -> Self {
        let to = |face: usize, other: usize| if face == other { 0.0 } else { weight(face, other) };
        let each = neighbors.iter().enumerate();
        let weights: Vec<[f32; 3]> =
            each.map(|(face, others)| others.map(|other| to(face, other as usize))).collect();
        let diagonal = own.iter().zip(&weights).map(|(own, w)| own + w[0] + w[1] + w[2]).collect();
        Self { neighbors, weights, diagonal }
    }
}

impl SymmetricSystem for Coupling<'_> {
    const COUPLED: bool = false;

    fn multiply(&self, p: &[[f32; 4]], q: &mut [[f32; 4]]) -> [f64; 4] {
        let Self { neighbors, weights, diagonal } = self;
        multiply_rows(p, q, |face| {
            let mut sum = p[face].map(|x| diagonal[face] * x);
            for (&other, weight) in neighbors[face].iter().zip(&weights[face]) {
                let other = p[other as usize];
                for k in 0..4 {
                    sum[k] -= weight * other[k];
                }
            }
            sum
        })
    }

    fn precondition(&self, row: usize, residual: [f32; 4]) -> [f32; 4] {
        residual.map(|r| r / self.diagonal[row])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TriMesh, primitives, subdivide};

    /// A cube of 6,144 faces whose sides are hollow by `depth` in the middle.
    fn hollow(depth: f32) -> TriMesh {
        let cube = (0..5).fold(primitives::cuboid([1.0; 3]), |cube, _| subdivide(&cube));
        cube.map_positions(|p| {
            let side = (0..3).fold(0, |a, b| if p[a].abs() >= p[b].abs() { a } else { b });
            let bowl = (0..3).filter(|&k| k != side).map(|k| 1.0 - 4.0 * p[k] * p[k]);
            let mut p = p;
            p[side] -= p[side].signum() * depth * bowl.product::<f32>();
            p
        })
    }

    /// The largest and the mean angle to the nearest axis, degrees.
    fn off_axes(normals: &[[f32; 3]]) -> [f32; 2] {
        let angle = |n: &[f32; 3]| n.iter().fold(0.0f32, |a, x| a.max(x.abs())).min(1.0).acos();
        let angles = normals.iter().map(|n| angle(n).to_degrees());
        [angles.clone().fold(0.0, f32::max), angles.sum::<f32>() / normals.len() as f32]
    }

    #[test]
    fn sides_become_flat_as_a_whole_and_edges_stay() {
        let cube = hollow(0.03);
        let topology = Topology::of(&cube);
        let before = off_axes(&face_normals(&cube.positions, &cube.faces));
        let diffusion = NormalDiffusion { reach: 100.0, ..NormalDiffusion::default() };
        let after =
            off_axes(&diffusion.normals(&cube.positions, &topology, &vec![0.0; cube.faces.len()]));
        assert!(before[1] > 3.0 && after[1] < 0.15 * before[1], "{before:?} {after:?}");
        // Without creases to break at, everything is averaged with everything.
        let blind = NormalDiffusion { crease: 1e3, ..diffusion };
        let blind =
            off_axes(&blind.normals(&cube.positions, &topology, &vec![0.0; cube.faces.len()]));
        assert!(blind[1] > before[1], "{blind:?}");
    }

    #[test]
    fn what_is_trusted_stays() {
        let cube = hollow(0.03);
        let trust = vec![1e4; cube.faces.len()];
        let given = face_normals(&cube.positions, &cube.faces);
        let normals =
            NormalDiffusion::default().normals(&cube.positions, &Topology::of(&cube), &trust);
        let worst = given.iter().zip(&normals).map(|(a, b)| difference(*a, *b)).fold(0.0, f32::max);
        assert!(worst < 1e-3, "{worst}");
    }

    #[test]
    fn equals_the_dense_solution() {
        // Twenty faces, by elimination in double precision.
        let mesh = primitives::icosphere(0);
        let topology = Topology::of(&mesh);
        let diffusion = NormalDiffusion { reach: 2.0, crease: 1.5, rounds: 1 };
        let trust: Vec<f32> = (0..20).map(|k| 0.1 * (k % 3) as f32).collect();
        let given = face_normals(&mesh.positions, &mesh.faces);
        let mut rows = vec![vec![0.0f64; 23]; 20];
        for (f, across) in neighbors(&topology).into_iter().enumerate() {
            let own = f64::from(trust[f]) + 0.25;
            rows[f][f] += own;
            for k in 0..3 {
                rows[f][20 + k] = own * f64::from(given[f][k]);
            }
            for g in across.map(|g| g as usize) {
                let d = f64::from(difference(given[f], given[g])) / 1.5;
                let w = (1.0 - d * d).powi(2);
                rows[f][f] += w;
                rows[f][g] -= w;
            }
        }
        for pivot in 0..20 {
            for row in (0..20).filter(|&row| row != pivot) {
                let factor = rows[row][pivot] / rows[pivot][pivot];
                for k in 0..23 {
                    rows[row][k] -= factor * rows[pivot][k];
                }
            }
        }
        let found = diffusion.normals(&mesh.positions, &topology, &trust);
        for (f, row) in rows.iter().enumerate() {
            let mut wanted = [20, 21, 22].map(|k| (row[k] / row[f]) as f32);
            normalize(&mut wanted);
            assert!(difference(found[f], wanted) < 2e-3, "{:?} {wanted:?}", found[f]);
        }
    }

    #[test]
    fn faces_without_area_and_open_meshes_do_no_harm() {
        let mesh = TriMesh::new(
            vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0], [5.0; 3]],
            vec![[0, 1, 2], [0, 1, 3]],
        );
        let topology = Topology::of(&mesh);
        let normals = NormalDiffusion::default().normals(&mesh.positions, &topology, &[0.0, 0.0]);
        assert!(normals.iter().flatten().all(|n| n.is_finite()), "{normals:?}");
        // The second face has no area.
        assert_eq!(normals, [[0.0, 0.0, 1.0]; 2]);
        // A corner twice, and three faces on an edge.
        for faces in [vec![[0, 0, 1], [0, 1, 2]], vec![[0, 1, 2], [1, 0, 4], [0, 1, 3]]] {
            let odd = TriMesh::new(mesh.positions.clone(), faces);
            let trust = vec![0.0; odd.faces.len()];
            let found =
                NormalDiffusion::default().normals(&odd.positions, &Topology::of(&odd), &trust);
            assert!(found.iter().flatten().all(|n| n.is_finite()), "{found:?}");
        }
    }
}
