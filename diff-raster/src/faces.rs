//! The faces of a mesh, with what the gradients need to know of their topology.

use std::sync::{Arc, OnceLock};

use mesh_core::TriMesh;

/// Stands for "no face".
pub const NONE: u32 = u32::MAX;

/// The shared faces of a batch: corners, and for each vertex the face corners that touch it.
///
/// Make it once per topology and share it in an [`Arc`]: gradients of faces are
/// gathered into vertices along it, in a fixed order and without atomics.
///
/// ```
/// use diff_raster::Faces;
///
/// let faces = Faces::new(4, &[[0, 1, 2], [0, 2, 3]])?;
/// assert_eq!(faces.corners_of(2), [2, 4]); // third corner of face 0, second of face 1
/// assert_eq!(faces.neighbors()[0][1], 1); // across the edge opposite to corner 1
/// # Ok::<(), diff_raster::FacesError>(())
/// ```
#[derive(Debug, Default)]
pub struct Faces {
    corners: Vec<[u32; 3]>,
    vertex_count: usize,
    offsets: Vec<u32>,
    incidence: Vec<u32>,
    neighbors: OnceLock<Vec<[u32; 3]>>,
}

/// Why a list of faces cannot be drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FacesError {
    /// A face names a vertex that is not there.
    #[error("face {face} names vertex {index}, but there are {vertices} vertices")]
    VertexOutOfRange {
        /// The face.
        face: usize,
        /// What it names.
        index: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// More than `(2³² - 2) / 3` faces: their corners could not be numbered in 32 bits.
    #[error("{faces} faces are more than 32 bits number")]
    TooManyFaces {
        /// How many there are.
        faces: usize,
    },
}

/// Whether the same vertices make the same faces.
impl PartialEq for Faces {
    fn eq(&self, other: &Self) -> bool {
        self.vertex_count == other.vertex_count && self.corners == other.corners
    }
}

impl Eq for Faces {}

impl Faces {
    /// Checks the indices and collects the topology. `O(V + F)`.
    ///
    /// # Errors
    /// If an index is out of range, or there are more corners than 32 bits can number.
    pub fn new(vertex_count: usize, corners: &[[u32; 3]]) -> Result<Self, FacesError> {
        if corners.len() > (u32::MAX as usize - 1) / 3 {
            return Err(FacesError::TooManyFaces { faces: corners.len() });
        }
        let mut offsets = vec![0_u32; vertex_count + 1];
        for (face, corner) in corners.iter().enumerate() {
            for &index in corner {
                if index as usize >= vertex_count {
                    let vertices = vertex_count;
                    return Err(FacesError::VertexOutOfRange { face, index, vertices });
                }
                offsets[index as usize + 1] += 1;
            }
        }
        for v in 0..vertex_count {
            offsets[v + 1] += offsets[v];
        }
        let mut next = offsets.clone();
        let mut incidence = vec![0; 3 * corners.len()];
        for (corner, &index) in corners.as_flattened().iter().enumerate() {
            incidence[next[index as usize] as usize] = corner as u32;
            next[index as usize] += 1;
        }
        let corners = corners.to_vec();
        Ok(Self { corners, vertex_count, offsets, incidence, neighbors: OnceLock::new() })
    }

    /// The faces of a mesh.
    ///
    /// # Errors
    /// As [`Faces::new`].
    pub fn of(mesh: &TriMesh) -> Result<Self, FacesError> {
        Self::new(mesh.positions.len(), &mesh.faces)
    }

    /// Faces that the program made itself, or has checked, to be shared: each names a vertex that is there, and
    /// memory holds far fewer than 32 bits number. What a file or a user said goes through [`Faces::new`].
    ///
    /// # Panics
    /// If a face names a vertex that is not there.
    #[track_caller]
    pub fn of_valid(vertex_count: usize, corners: &[[u32; 3]]) -> Arc<Self> {
        match Self::new(vertex_count, corners) {
            Ok(faces) => Arc::new(faces),
            Err(error) => panic!("Faces: {error}"),
        }
    }

    /// Number of faces, `F`.
    pub fn len(&self) -> usize {
        self.corners.len()
    }

    /// Whether there is no face.
    pub fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    /// Number of vertices, `V`.
    pub fn vertex_count(&self) -> usize {
        self.vertex_count
    }

    /// The three vertices of each face.
    pub fn corners(&self) -> &[[u32; 3]] {
        &self.corners
    }

    /// The corners at a vertex, each as `3 face + corner`, in ascending order.
    #[inline]
    pub fn corners_of(&self, vertex: usize) -> &[u32] {
        &self.incidence[self.offsets[vertex] as usize..self.offsets[vertex + 1] as usize]
    }

    /// For each face and corner, the face across the opposite edge; [`NONE`] at a boundary and
    /// where more than two faces meet. Computed at the first call, `O(F log F)`.
    pub fn neighbors(&self) -> &[[u32; 3]] {
        self.neighbors.get_or_init(|| {
            let mut edges = Vec::with_capacity(3 * self.corners.len());
            for (face, corner) in self.corners.iter().enumerate() {
                for k in 0..3 {
                    let (a, b) = (corner[(k + 1) % 3], corner[(k + 2) % 3]);
                    edges.push((a.min(b), a.max(b), (3 * face + k) as u32));
                }
            }
            edges.sort_unstable();
            let mut neighbors = vec![[NONE; 3]; self.corners.len()];
            for group in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
                if let [(.., a), (.., b)] = *group {
                    neighbors[a as usize / 3][a as usize % 3] = b / 3;
                    neighbors[b as usize / 3][b as usize % 3] = a / 3;
                }
            }
            neighbors
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn an_index_out_of_range_is_named() {
        let error = Faces::new(3, &[[0, 1, 2], [0, 2, 3]]).unwrap_err();
        assert_eq!(error, FacesError::VertexOutOfRange { face: 1, index: 3, vertices: 3 });
        assert_eq!(error.to_string(), "face 1 names vertex 3, but there are 3 vertices");
    }

    #[test]
    #[should_panic(expected = "Faces: face 1 names vertex 3, but there are 3 vertices")]
    fn a_programs_own_faces_name_its_vertices() {
        Faces::of_valid(3, &[[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn neighbors_are_mutual_and_boundaries_have_none() {
        let faces = Faces::new(4, &[[0, 1, 2], [2, 1, 3]]).unwrap();
        assert_eq!(faces.neighbors(), [[1, NONE, NONE], [NONE, NONE, 0]]);
    }

    #[test]
    fn three_faces_at_an_edge_are_no_neighbors() {
        let faces = Faces::new(5, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]]).unwrap();
        assert!(faces.neighbors().as_flattened().iter().all(|&n| n == NONE));
    }
}
