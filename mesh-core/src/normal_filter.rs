//! Bilateral filtering of normals: flat parts become flat, edges remain.

use crate::kernels::threads;
use crate::vector::{Vec3, add, area_vector, dot, narrow, norm, scale, sub, triangle, unit, widen};
use crate::{Topology, TriMesh};

/// How far, and across how much, normals are averaged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalFilter {
    /// Rounds of averaging; each reaches one ring of faces farther.
    pub rounds: usize,
    /// Difference of unit normals at which a neighbour counts `exp(-1/2)`, above 0: about the angle between them in radians.
    pub spread: f32,
    /// Rounds in which vertices follow their faces.
    pub steps: usize,
}

/// Ten rounds, 0.35 (20 degrees), ten steps: within what the papers advise.
impl Default for NormalFilter {
    fn default() -> Self {
        Self { rounds: 10, spread: 0.35, steps: 10 }
    }
}

impl NormalFilter {
    /// Moves vertices to where each face has the mean normal of those around it that face about the same way.
    ///
    /// What noise and smoothing leave on flat parts, dimples of some degrees, is averaged away, and edges, across which normals differ by
    /// more than the filter sees, remain. It knows nothing of what the mesh was made from: what is to be held to that is filtered and fitted
    /// in turns. Large steps may fold faces; [`untangle`](crate::untangle()) mends them.
    ///
    /// ```
    /// use mesh_core::{NormalFilter, Topology, TriMesh, primitives, subdivide};
    /// let mut cube = primitives::cuboid([1.0; 3]);
    /// for _ in 0..4 {
    ///     cube = subdivide(&cube);
    /// }
    /// let dented = cube.clone().map_positions(|p| [p[0] + 0.005 * (40.0 * (p[1] + p[2])).sin(), p[1], p[2]]);
    /// let mut mended = dented.positions.clone();
    /// NormalFilter::default().apply(&mut mended, &cube.faces, &Topology::of(&cube));
    /// // The sides towards x are less wavy than they were.
    /// let spread = |positions: &[[f32; 3]]| -> f32 {
    ///     positions.iter().filter(|p| p[0] > 0.45 && p[1].abs() < 0.3 && p[2].abs() < 0.3).map(|p| (p[0] - 0.5).abs()).sum()
    /// };
    /// assert!(spread(&mended) < 0.5 * spread(&dented.positions));
    /// ```
    ///
    /// # Shapes
    /// `positions [V, 3]`, `faces [F, 3]`.
    ///
    /// # Cost
    /// `O(F)` a round and a step: some 5 ms for 20,000 faces.
    ///
    /// # Panics
    /// If a face or `topology` names a vertex that does not exist.
    ///
    /// # References
    /// Zheng, Fu, Au and Tai 2011, *Bilateral normal filtering for mesh denoising*, TVCG 17(10), the local scheme; vertices follow by Sun,
    /// Rosin, Martin and Langbein 2007, *Fast and effective feature-preserving mesh denoising*, TVCG 13(5), equation 13.
    pub fn apply(&self, positions: &mut [[f32; 3]], faces: &[[u32; 3]], topology: &Topology) {
        let normals = self.normals(positions, faces, topology);
        for _ in 0..self.steps {
            follow(positions, faces, topology, &normals);
        }
    }

    /// The filtered normals of the faces.
    fn normals(
        &self,
        positions: &[[f32; 3]],
        faces: &[[u32; 3]],
        topology: &Topology,
    ) -> Vec<Vec3> {
        let areas: Vec<Vec3> =
            faces.iter().map(|&face| area_vector(triangle(positions, face))).collect();
        let centers = centers(positions, faces);
        let reach = mean_distance(&centers, topology);
        let around = |face: usize| {
            let mut near: Vec<u32> = faces[face]
                .iter()
                .flat_map(|&v| topology.vertex_faces.row(v as usize))
                .copied()
                .collect();
            near.sort_unstable();
            near.dedup();
            let weight = |other: &u32| {
                let apart = sub(centers[face], centers[*other as usize]);
                let near = (-dot(apart, apart) / (2.0 * reach * reach).max(1e-300)).exp();
                (*other as usize, near * norm(areas[*other as usize]))
            };
            near.iter().map(weight).collect::<Vec<_>>()
        };
        let around: Vec<Vec<(usize, f64)>> = threads::map(faces.len(), around);
        let mut normals: Vec<Vec3> = areas.iter().map(|&area| unit(area)).collect();
        let spread = 2.0 * f64::from(self.spread).powi(2);
        for _ in 0..self.rounds {
            let mean = |face: usize| {
                let own = normals[face];
                let sum = around[face].iter().fold([0.0; 3], |sum, &(other, weight)| {
                    let apart = sub(own, normals[other]);
                    let weight = weight * (-dot(apart, apart) / spread).exp();
                    add(sum, scale(normals[other], weight))
                });
                unit(sum)
            };
            normals = threads::map(faces.len(), mean);
        }
        normals
    }
}

impl TriMesh {
    /// [`NormalFilter::apply`] on its own positions. Colours and texture stay as they are.
    pub fn filter_normals(&mut self, filter: &NormalFilter) {
        let topology = Topology::new(self.positions.len(), &self.faces);
        filter.apply(&mut self.positions, &self.faces, &topology);
    }
}

/// Moves each vertex towards the planes that its faces would have.
fn follow(positions: &mut [[f32; 3]], faces: &[[u32; 3]], topology: &Topology, normals: &[Vec3]) {
    let centers = centers(positions, faces);
    for (v, position) in positions.iter_mut().enumerate() {
        let (at, around) = (widen(*position), topology.vertex_faces.row(v));
        let sum = around.iter().fold([0.0; 3], |sum, &face| {
            let normal = normals[face as usize];
            add(sum, scale(normal, dot(normal, sub(centers[face as usize], at))))
        });
        *position = narrow(add(at, scale(sum, 1.0 / around.len().max(1) as f64)));
    }
}

fn centers(positions: &[[f32; 3]], faces: &[[u32; 3]]) -> Vec<Vec3> {
    let center = |&face: &[u32; 3]| {
        let [a, b, c] = triangle(positions, face);
        scale(add(add(a, b), c), 1.0 / 3.0)
    };
    faces.iter().map(center).collect()
}

/// Of the centres of two faces on one edge.
fn mean_distance(centers: &[Vec3], topology: &Topology) -> f64 {
    let (sum, count) = topology
        .edge_faces
        .iter()
        .filter(|faces| !faces.contains(&Topology::NONE))
        .map(|faces| faces.map(|face| centers[face as usize]))
        .fold((0.0, 0usize), |(sum, count), [a, b]| (sum + norm(sub(a, b)), count + 1));
    sum / count.max(1) as f64
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::{face_normals, primitives, subdivide};

    fn cube() -> TriMesh {
        (0..4).fold(primitives::cuboid([1.0; 3]), |cube, _| subdivide(&cube))
    }

    #[test]
    fn what_is_flat_already_stays() {
        let cube = cube();
        let mut filtered = cube.clone();
        filtered.filter_normals(&NormalFilter::default());
        for (a, b) in cube.positions.iter().zip(&filtered.positions) {
            assert!((0..3).all(|k| (a[k] - b[k]).abs() < 2e-3), "{a:?} {b:?}");
        }
    }

    #[test]
    fn noise_goes_and_edges_stay() {
        let cube = cube();
        let noise = |k: usize| 0.004 * ((k as f32 * 12.9898).sin() * 43758.547).fract();
        let mut noisy = cube.clone();
        noisy.positions.iter_mut().flatten().enumerate().for_each(|(k, x)| *x += noise(k));
        let before = noisy.clone();
        noisy.filter_normals(&NormalFilter { spread: 0.5, ..NormalFilter::default() });
        // Degrees between the faces' normals and those that they had before the noise, where no edge is near.
        let wanted = face_normals(&cube.positions, &cube.faces);
        let inner = |face: &[u32; 3]| {
            let inside = |v: &u32| cube.positions[*v as usize].map(|x| u8::from(x.abs() < 0.3));
            face.iter().all(|v| inside(v).iter().sum::<u8>() == 2)
        };
        let off = |mesh: &TriMesh| -> f32 {
            let found = face_normals(&mesh.positions, &mesh.faces);
            let angle = |face: usize| {
                let cos: f32 = (0..3).map(|k| found[face][k] * wanted[face][k]).sum();
                cos.clamp(-1.0, 1.0).acos().to_degrees()
            };
            let faces = (0..found.len()).filter(|&face| inner(&cube.faces[face]));
            faces.map(angle).fold(0.0, f32::max)
        };
        assert!(off(&before) > 4.0 && off(&noisy) < 1.5, "{} of {}", off(&noisy), off(&before));
        // The corners of the box are where they were.
        let corner = |mesh: &TriMesh| mesh.bounds().map(|(low, high)| [low, high].concat());
        let moved = corner(&noisy).unwrap().into_iter().zip(corner(&cube).unwrap());
        assert!(moved.clone().all(|(a, b)| (a - b).abs() < 0.02), "{moved:?}");
    }

    #[test]
    fn faces_without_area_and_open_meshes_do_no_harm() {
        let mut mesh = TriMesh::new(
            vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0], [5.0; 3]],
            vec![[0, 1, 2], [0, 1, 3]],
        );
        mesh.filter_normals(&NormalFilter::default());
        assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()));
        assert_eq!(mesh.positions[4], [5.0; 3]);
    }
}
