//! Parting what only touches: each edge gets two faces, and each vertex one fan.

use crate::vector::{cross, dot, sub};
use crate::{Topology, TriMesh};

impl TriMesh {
    /// The same surface with vertices repeated where parts of it only touch, along an edge of more than two faces or at a vertex
    /// of several fans; what was closed and oriented outwards is a manifold then.
    ///
    /// Around an edge the faces that bound the same piece of the inside stay together. Where parts meet again at both ends of such an
    /// edge, each has a vertex of its own in its middle, and a face is two. Edges whose faces do not alternate between
    /// both directions, as on open or disoriented surfaces, are left as they are, but for vertices that only touch. Positions do
    /// not move: parts lie on one another where they touched. Colours are repeated with the vertices; a texture stays.
    ///
    /// [`cubify`](crate::cubify()) makes such edges where two cells touch along an edge alone:
    ///
    /// ```
    /// use mesh_core::{EmptyGrid, VoxelGrid, cubify};
    /// let mut grid = VoxelGrid::new([2; 3], ([0.0; 3], [2.0; 3]));
    /// for cell in [[0, 0, 0], [1, 1, 0]] {
    ///     let index = grid.index(cell);
    ///     grid.bits[index] = true;
    /// }
    /// let cubes = cubify(&grid, EmptyGrid::Nothing);
    /// assert!(!cubes.health().is_watertight());
    /// let parted = cubes.split_nonmanifold();
    /// assert!(parted.health().is_watertight());
    /// assert_eq!((cubes.positions.len(), parted.positions.len()), (14, 16));
    /// ```
    ///
    /// # Cost
    /// `O(V + F)`, and a topology.
    /// # References
    /// Guéziec et al. 2001, *Cutting and Stitching: Converting Sets of Polygons to Manifold Surfaces*; libigl's `split_nonmanifold`.
    #[must_use]
    pub fn split_nonmanifold(&self) -> Self {
        let topology = Topology::new(self.positions.len(), &self.faces);
        let mut corners = Corners::new(self.faces.len());
        for (edge, &ends) in topology.edges.iter().enumerate() {
            let ring = topology.edge_rings.row(edge);
            match self.paired(ends, ring) {
                Some(pairs) => pairs.iter().for_each(|&pair| corners.join(self, ends, pair)),
                None => ring.windows(2).for_each(|two| corners.join(self, ends, [two[0], two[1]])),
            }
        }
        let mut parted = self.renumbered(&mut corners);
        // A face may have several such edges; each round takes one of them.
        while parted.divide_shared_edges() {}
        parted
    }

    /// Gives each pair of faces on an edge of several a vertex in its middle; faces that were divided wait for another time.
    /// Whether there was anything to do.
    fn divide_shared_edges(&mut self) -> bool {
        let topology = Topology::new(self.positions.len(), &self.faces);
        let mut divided = vec![false; self.faces.len()];
        let shared = topology.edges.iter().enumerate().filter_map(|(edge, &ends)| {
            let ring = topology.edge_rings.row(edge);
            (ring.len() > 2).then(|| self.paired(ends, ring)).flatten().map(|pairs| (ends, pairs))
        });
        let shared: Vec<([u32; 2], Vec<[u32; 2]>)> = shared.collect();
        // The first pair may keep the edge.
        let pairs =
            shared.iter().flat_map(|(ends, pairs)| pairs[1..].iter().map(|&pair| (*ends, pair)));
        for (ends, pair) in pairs {
            if pair.iter().any(|&face| std::mem::replace(&mut divided[face as usize], true)) {
                continue;
            }
            let middle = self.add_middle(ends);
            for face in pair {
                self.divide(face as usize, ends, middle);
            }
        }
        !shared.is_empty()
    }

    fn add_middle(&mut self, ends: [u32; 2]) -> u32 {
        let [a, b] = ends.map(|v| v as usize);
        for rows in std::iter::once(&mut self.positions).chain(&mut self.colors) {
            rows.push(std::array::from_fn(|k| 0.5 * (rows[a][k] + rows[b][k])));
        }
        (self.positions.len() - 1) as u32
    }

    /// Makes a face two, by a vertex in the middle of one of its edges; the second goes to the end.
    fn divide(&mut self, face: usize, ends: [u32; 2], middle: u32) {
        let corners = self.faces[face];
        let Some(k) = (0..3).find(|&k| !ends.contains(&corners[k])) else { return };
        let (next, last) = ((k + 1) % 3, (k + 2) % 3);
        let two = |corners: [u32; 3], middle: u32| {
            let (mut first, mut second) = (corners, corners);
            (first[last], second[next]) = (middle, middle);
            [first, second]
        };
        let [first, second] = two(corners, middle);
        self.faces[face] = first;
        self.faces.push(second);
        if let Some(texture) = &mut self.texture {
            let corners = texture.faces[face];
            let [a, b] = [next, last].map(|k| texture.uvs[corners[k] as usize]);
            texture.uvs.push(std::array::from_fn(|k| 0.5 * (a[k] + b[k])));
            let [first, second] = two(corners, (texture.uvs.len() - 1) as u32);
            texture.faces[face] = first;
            texture.faces.push(second);
        }
    }

    /// The faces around an edge two by two, those together that bound the same piece of the inside; none where the faces do
    /// not alternate.
    fn paired(&self, ends: [u32; 2], ring: &[u32]) -> Option<Vec<[u32; 2]>> {
        if ring.len() <= 2 {
            return (ring.len() == 2).then(|| vec![[ring[0], ring[1]]]);
        }
        let [a, b] = ends.map(|v| self.positions[v as usize].map(f64::from));
        let along = sub(b, a);
        let third = |face: u32| {
            let corners = self.faces[face as usize];
            corners.into_iter().find(|v| !ends.contains(v))
        };
        let away = |face: u32| Some(sub(self.positions[third(face)? as usize].map(f64::from), a));
        let x = flat(away(ring[0])?, along);
        let y = cross(along, x);
        let length = dot(along, along).sqrt();
        let mut around = Vec::with_capacity(ring.len());
        for &face in ring {
            let t = away(face)?;
            let angle = (dot(t, y) / length).atan2(dot(t, x));
            around.push((angle, self.runs(face, ends), face));
        }
        around.sort_by(|p, q| p.0.total_cmp(&q.0));
        // Behind a face that runs along the edge, at smaller angles, is the inside, up to one that runs against it.
        let next = |i: usize| (i + 1) % around.len();
        let first = (0..around.len()).find(|&i| !around[i].1 && around[next(i)].1)?;
        let order = (0..around.len()).map(|k| around[(first + k) % around.len()]);
        let order: Vec<(f64, bool, u32)> = order.collect();
        let pairs = order.as_chunks::<2>();
        let alternate = pairs.1.is_empty() && pairs.0.iter().all(|[p, q]| !p.1 && q.1);
        alternate.then(|| pairs.0.iter().map(|[p, q]| [p.2, q.2]).collect())
    }

    /// Whether a face runs from the first end of an edge to the second.
    fn runs(&self, face: u32, [a, b]: [u32; 2]) -> bool {
        let [u, v, w] = self.faces[face as usize];
        [[u, v], [v, w], [w, u]].contains(&[a, b])
    }

    /// With a vertex for each class of corners: the first of an old vertex keeps its number, others follow all old ones.
    fn renumbered(&self, corners: &mut Corners) -> Self {
        let count = self.positions.len();
        let (mut class_of, mut taken) = (vec![u32::MAX; 3 * self.faces.len()], vec![false; count]);
        let mut from: Vec<u32> = (0..count as u32).collect();
        let mut faces = self.faces.clone();
        for (corner, vertex) in faces.iter_mut().flatten().enumerate() {
            let class = corners.class(corner as u32) as usize;
            if class_of[class] == u32::MAX {
                class_of[class] = if std::mem::replace(&mut taken[*vertex as usize], true) {
                    from.push(*vertex);
                    (from.len() - 1) as u32
                } else {
                    *vertex
                };
            }
            *vertex = class_of[class];
        }
        let of = |rows: &[[f32; 3]]| from.iter().map(|&v| rows[v as usize]).collect();
        Self {
            positions: of(&self.positions),
            faces,
            colors: self.colors.as_deref().map(of),
            texture: self.texture.clone(),
        }
    }
}

/// What of `t` is across a line.
fn flat(t: [f64; 3], along: [f64; 3]) -> [f64; 3] {
    let share = dot(t, along) / dot(along, along);
    std::array::from_fn(|k| t[k] - share * along[k])
}

/// Corners of faces, joined where they are one vertex.
struct Corners {
    parent: Vec<u32>,
}

impl Corners {
    fn new(faces: usize) -> Self {
        Self { parent: (0..3 * faces as u32).collect() }
    }

    fn class(&mut self, mut corner: u32) -> u32 {
        while self.parent[corner as usize] != corner {
            let above = self.parent[self.parent[corner as usize] as usize];
            self.parent[corner as usize] = above;
            corner = above;
        }
        corner
    }

    /// Two faces across an edge: each end is one vertex of both.
    fn join(&mut self, mesh: &TriMesh, ends: [u32; 2], faces: [u32; 2]) {
        for end in ends {
            let [a, b] = faces.map(|face| {
                let place = mesh.faces[face as usize].iter().position(|&v| v == end);
                3 * face + place.map_or(0, |k| k as u32)
            });
            let [a, b] = [self.class(a), self.class(b)];
            // The smaller is above: classes do not depend on the order of joining.
            self.parent[a.max(b) as usize] = a.min(b);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::primitives::icosphere;
    use crate::{EmptyGrid, VoxelGrid, cubify};

    fn grid(dims: [usize; 3], occupied: impl Fn(usize) -> bool) -> VoxelGrid {
        let mut grid = VoxelGrid::new(dims, ([0.0; 3], dims.map(|n| n as f32)));
        grid.bits.iter_mut().enumerate().for_each(|(i, bit)| *bit = occupied(i));
        grid
    }

    #[test]
    fn what_is_manifold_stays_as_it_is() {
        let ball = icosphere(2);
        assert_eq!(ball.split_nonmanifold(), ball);
        let open = TriMesh::new(ball.positions.clone(), ball.faces[1..].to_vec());
        assert_eq!(open.split_nonmanifold(), open);
        assert_eq!(TriMesh::default().split_nonmanifold(), TriMesh::default());
    }

    #[test]
    fn cubes_at_a_corner_become_two() {
        let cubes = cubify(&grid([2; 3], |i| i == 0 || i == 7), EmptyGrid::Nothing);
        assert_eq!(cubes.health().non_manifold_vertices, 1);
        let parted = cubes.split_nonmanifold();
        assert_eq!((parted.health().components, parted.positions.len()), (2, 16));
    }

    /// Three faces on an edge bound no inside: nothing is parted there.
    #[test]
    fn a_fin_is_left() {
        let corners = vec![
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, 1.0],
        ];
        let fin = TriMesh::new(corners, vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
        assert_eq!(fin.split_nonmanifold(), fin);
    }

    proptest! {
        /// Whatever cells are occupied: closed, manifold, the same surface.
        #[test]
        fn cells_become_manifolds(bits in proptest::collection::vec(any::<bool>(), 4 * 3 * 3)) {
            let cubes = cubify(&grid([4, 3, 3], |i| bits[i]), EmptyGrid::Nothing);
            let parted = cubes.split_nonmanifold();
            prop_assume!(!cubes.faces.is_empty());
            prop_assert!(parted.health().is_watertight(), "{}", parted.health());
            prop_assert!((parted.volume() - cubes.volume()).abs() < 1e-9);
            prop_assert!((parted.health().area - cubes.health().area).abs() < 1e-9);
            // Where nothing had to be divided, the same faces in the same places.
            for (a, b) in parted.faces.iter().zip(&cubes.faces).filter(|_| parted.faces.len() == cubes.faces.len()) {
                let places = |mesh: &TriMesh, face: &[u32; 3]| face.map(|v| mesh.positions[v as usize]);
                prop_assert_eq!(places(&parted, a), places(&cubes, b));
            }
        }
    }
}
