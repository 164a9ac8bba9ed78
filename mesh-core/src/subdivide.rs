//! Midpoint subdivision: every face becomes four, and whatever lives on vertices comes along.

use crate::{Texture, Topology, TriMesh};

/// One midpoint subdivision of a triangle list, ready to carry any per-vertex array across.
///
/// The old vertices keep their numbers; one new vertex per edge follows, in the order of the
/// sorted edges. Face `[a, b, c]` becomes its three corners and the middle one,
/// `[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]`, at four times its index.
///
/// ```
/// use mesh_core::{Subdivision, primitives};
/// let mesh = primitives::icosphere(2);
/// let finer = Subdivision::of(mesh.positions.len(), &mesh.faces);
/// let momentum = vec![[1.0, 2.0, 3.0]; mesh.positions.len()]; // of an optimiser, say
/// assert_eq!(finer.apply(&momentum).len(), finer.vertex_count());
/// assert_eq!(finer.faces.len(), 4 * mesh.faces.len());
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Subdivision {
    /// The number of vertices before.
    pub old_vertices: usize,
    /// The new faces, `[4 F]`.
    pub faces: Vec<[u32; 3]>,
    /// For each new vertex, the two old ones it lies between.
    pub parents: Vec<[u32; 2]>,
}

impl Subdivision {
    /// Splits every edge of `faces` at its middle.
    ///
    /// # Panics
    /// If a face names a vertex that is not below `vertex_count`, or if the new vertices or corners
    /// do not fit in `u32`.
    pub fn of(vertex_count: usize, faces: &[[u32; 3]]) -> Self {
        Self::along(&Topology::new(vertex_count, faces), faces)
    }

    /// The same from a topology that is already at hand.
    ///
    /// # Panics
    /// If `topology` was made of other faces, or as [`Subdivision::of`].
    pub fn along(topology: &Topology, faces: &[[u32; 3]]) -> Self {
        assert_eq!(topology.face_count(), faces.len(), "Subdivision: another mesh");
        let old_vertices = topology.vertex_count();
        let count = old_vertices + topology.edges.len();
        assert!(u32::try_from(count.max(faces.len() * 12)).is_ok(), "Subdivision: exceeds u32");
        let mut split = Vec::with_capacity(faces.len() * 4);
        for (&[a, b, c], edges) in faces.iter().zip(&topology.face_edges) {
            // A corner pair that is no edge (the same vertex twice) has itself for its middle.
            let middle = |edge: u32, v: u32| match edge {
                Topology::NONE => v,
                edge => old_vertices as u32 + edge,
            };
            let (ab, bc, ca) = (middle(edges[0], a), middle(edges[1], b), middle(edges[2], c));
            split.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        Self { old_vertices, faces: split, parents: topology.edges.clone() }
    }

    /// The number of vertices after.
    pub fn vertex_count(&self) -> usize {
        self.old_vertices + self.parents.len()
    }

    /// Carries one value per vertex across: old vertices keep theirs, new ones get the mean.
    ///
    /// # Panics
    /// If `values` are not one per old vertex.
    pub fn apply<const K: usize>(&self, values: &[[f32; K]]) -> Vec<[f32; K]> {
        assert_eq!(values.len(), self.old_vertices, "Subdivision::apply: values per vertex");
        let mut finer = Vec::with_capacity(self.vertex_count());
        finer.extend_from_slice(values);
        finer.extend(self.parents.iter().map(|&[i, j]| {
            let (a, b) = (values[i as usize], values[j as usize]);
            std::array::from_fn(|k| 0.5 * (a[k] + b[k]))
        }));
        finer
    }

    /// [`Subdivision::apply`] for rows of a width that is only known at run time, `[V, width]`.
    ///
    /// # Panics
    /// If `values` are not `width` per old vertex.
    pub fn apply_rows(&self, values: &[f32], width: usize) -> Vec<f32> {
        assert_eq!(
            values.len(),
            self.old_vertices * width,
            "Subdivision::apply_rows: [V, {width}]"
        );
        let mut finer = Vec::with_capacity(self.vertex_count() * width);
        finer.extend_from_slice(values);
        for &[i, j] in &self.parents {
            let a = &values[i as usize * width..][..width];
            let b = &values[j as usize * width..][..width];
            finer.extend(a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)));
        }
        finer
    }
}

/// Splits every face of a mesh into four at the middles of its edges.
///
/// The surface stays where it is. Colours are averaged. Texture coordinates are subdivided along
/// their own edges, so seams stay seams.
///
/// # Panics
/// If the mesh is not valid (see [`TriMesh::validate`]), or its result does not fit in `u32`.
pub fn subdivide(mesh: &TriMesh) -> TriMesh {
    let finer = Subdivision::of(mesh.positions.len(), &mesh.faces);
    let texture = mesh.texture.as_ref().map(|texture| {
        let seams = Subdivision::of(texture.uvs.len(), &texture.faces);
        Texture { uvs: seams.apply(&texture.uvs), faces: seams.faces, image: texture.image.clone() }
    });
    TriMesh {
        positions: finer.apply(&mesh.positions),
        colors: mesh.colors.as_ref().map(|colors| finer.apply(colors)),
        texture,
        faces: finer.faces,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::{Image, primitives};

    #[test]
    fn of_one_triangle_by_hand() {
        let mesh =
            TriMesh::new(vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]], vec![[0, 1, 2]]);
        let finer = subdivide(&mesh);
        assert_eq!(finer.positions[3..], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]);
        assert_eq!(finer.faces, [[0, 3, 4], [3, 1, 5], [4, 5, 2], [3, 5, 4]]);
    }

    #[test]
    fn counts_are_those_of_pixel2mesh() {
        let mesh = primitives::pixel2mesh_ellipsoid(0);
        let once = subdivide(&mesh);
        let twice = subdivide(&once);
        assert_eq!((once.positions.len(), once.faces.len()), (618, 1232));
        assert_eq!((twice.positions.len(), twice.faces.len()), (2466, 4928));
    }

    #[test]
    fn colors_and_seams_come_along() {
        // Two faces that share an edge in space, but not on the texture.
        let mut mesh = TriMesh::new(
            vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
            vec![[0, 1, 2], [0, 2, 3]],
        );
        mesh.colors = Some(vec![[0.0; 3], [1.0; 3], [0.5; 3], [0.0; 3]]);
        mesh.texture = Some(Texture {
            uvs: vec![[0.0, 0.0], [0.4, 0.0], [0.4, 0.4], [0.6, 0.6], [1.0, 1.0], [0.6, 1.0]],
            faces: vec![[0, 1, 2], [3, 4, 5]],
            image: Image::new(1, 1, 3),
        });
        let finer = subdivide(&mesh);
        finer.validate().unwrap();
        assert_eq!(finer.positions.len(), 4 + 5);
        assert_eq!(finer.colors.as_ref().unwrap().len(), 9);
        let texture = finer.texture.unwrap();
        assert_eq!(texture.uvs.len(), 6 + 6);
        // Every new corner carries the mean of the texture coordinates of its edge.
        assert_eq!(texture.uvs[texture.faces[1][0] as usize], [0.2, 0.0]);
        assert_eq!(texture.uvs[texture.faces[5][0] as usize], [0.8, 0.8]);
    }

    #[test]
    fn rows_equal_arrays() {
        let mesh = primitives::icosphere(1);
        let finer = Subdivision::of(mesh.positions.len(), &mesh.faces);
        let rows = finer.apply_rows(mesh.positions.as_flattened(), 3);
        assert_eq!(rows, finer.apply(&mesh.positions).as_flattened());
    }

    #[test]
    fn a_repeated_vertex_is_its_own_middle() {
        let finer = Subdivision::of(2, &[[0, 0, 1]]);
        assert_eq!(finer.parents, [[0, 1]]);
        assert_eq!(finer.faces, [[0, 0, 2], [0, 0, 2], [2, 2, 1], [0, 2, 2]]);
    }
}
