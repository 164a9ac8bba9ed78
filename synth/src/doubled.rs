//! Faces that lie on one another, as sheets with two sides have them.

use datasets::mix64;
use mesh_core::{Camera, TriMesh};

/// The groups of faces with the same three corners, in whatever order: rounding would decide anew at each pixel which of them
/// is in front.
pub(super) struct Doubled(Vec<Vec<u32>>);

impl Doubled {
    /// None where no face lies on another. Positions count, not the numbers of vertices.
    ///
    /// # Cost
    /// `O(F log F)`, some 10 ms for 100,000 faces.
    pub(super) fn of(mesh: &TriMesh) -> Option<Self> {
        let keys = mesh.faces.iter().map(|face| key(mesh, face));
        let mut order: Vec<(u64, u32)> = keys.zip(0..).collect();
        order.sort_unstable();
        let alike = order.chunk_by(|a, b| a.0 == b.0).filter(|alike| alike.len() > 1);
        let mut groups = Vec::new();
        for alike in alike {
            // Different corners may have the same key.
            let corners = |f: u32| sorted(mesh, &mesh.faces[f as usize]);
            let mut faces: Vec<_> = alike.iter().map(|&(_, f)| (corners(f), f)).collect();
            faces.sort_unstable();
            let same = faces.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() > 1);
            groups.extend(same.map(|same| same.iter().map(|&(_, f)| f).collect()));
        }
        (!groups.is_empty()).then_some(Self(groups))
    }

    /// The faces of the mesh as a camera is to see them. Of each group one is left, the first that faces the camera or else the
    /// first; the others are points, which are not drawn.
    pub(super) fn shown(&self, mesh: &TriMesh, camera: &Camera) -> Vec<[u32; 3]> {
        let mut faces = mesh.faces.clone();
        for group in &self.0 {
            let seen = group.iter().find(|&&f| is_towards(mesh, &mesh.faces[f as usize], camera));
            let seen = *seen.unwrap_or(&group[0]);
            for &other in group.iter().filter(|&&other| other != seen) {
                faces[other as usize] = [mesh.faces[other as usize][0]; 3];
            }
        }
        faces
    }
}

/// Bits that tell positions apart, and not 0 from -0.
fn bits(mesh: &TriMesh, vertex: u32) -> [u32; 3] {
    mesh.positions[vertex as usize].map(|x| (x + 0.0).to_bits())
}

/// The same for faces with the same corners.
fn key(mesh: &TriMesh, face: &[u32; 3]) -> u64 {
    let corner = |&vertex: &u32| {
        let [x, y, z] = bits(mesh, vertex).map(u64::from);
        mix64(mix64(x << 32 | y) ^ z)
    };
    face.iter().map(corner).fold(0, u64::wrapping_add)
}

fn sorted(mesh: &TriMesh, face: &[u32; 3]) -> [[u32; 3]; 3] {
    let mut corners = face.map(|vertex| bits(mesh, vertex));
    corners.sort_unstable();
    corners
}

/// Whether a camera sees the side of a face around which its corners go counter-clockwise.
fn is_towards(mesh: &TriMesh, face: &[u32; 3], camera: &Camera) -> bool {
    let [a, b, c] = face.map(|vertex| mesh.positions[vertex as usize].map(f64::from));
    let [u, v] = [b, c].map(|p| [0, 1, 2].map(|k| p[k] - a[k]));
    let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let to = if camera.is_perspective() {
        let center = camera.center();
        [0, 1, 2].map(|k| center[k] - a[k])
    } else {
        let forward = camera.forward();
        [0, 1, 2].map(|k| -forward[k])
    };
    let along: f64 = (0..3).map(|k| normal[k] * to[k]).sum();
    along > 0.0
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::primitives;

    use super::*;
    use crate::{RenderOptions, render_view};

    /// A ball whose faces are there twice: red outwards, blue inwards, with vertices of its own.
    fn two_sided() -> TriMesh {
        let ball = primitives::icosphere(3);
        let mut both = ball.clone().colored([1.0, 0.0, 0.0]);
        both.append(&ball.flipped().colored([0.0, 0.0, 1.0])).unwrap();
        both
    }

    fn camera(eye: [f64; 3]) -> Camera {
        Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.9, 60, 50)
    }

    #[test]
    fn the_side_towards_the_camera_is_seen() {
        let mut mesh = two_sided();
        let options = RenderOptions { supersample: 1, ..RenderOptions::default() };
        let from = |mesh: &TriMesh, eye: [f64; 3]| {
            let view = render_view(mesh, &camera(eye), &options).unwrap();
            let colors = view.color.data.chunks_exact(3).zip(&view.mask.data);
            let mut seen: Vec<[u8; 3]> = colors
                .filter(|(_, mask)| **mask != 0)
                .map(|(color, _)| [color[0], color[1], color[2]])
                .collect();
            seen.sort_unstable();
            seen.dedup();
            seen
        };
        for _ in 0..2 {
            assert_eq!(from(&mesh, [0.4, 1.1, 3.0]), [[255, 0, 0]]);
            assert_eq!(from(&mesh, [0.1, 0.05, 0.2]), [[0, 0, 255]]);
            // Whichever comes first.
            mesh.faces.reverse();
        }
    }

    #[test]
    fn groups_are_of_the_same_corners() {
        assert!(Doubled::of(&primitives::torus(1.0, 0.4, 20, 12)).is_none());
        let mesh = two_sided();
        let Doubled(groups) = Doubled::of(&mesh).unwrap();
        assert_eq!(groups.len(), mesh.faces.len() / 2);
        assert!(groups.iter().all(|group| group.len() == 2 && group[0] < group[1]));
        // Of faces in one direction the first is left.
        let faces = vec![[0, 1, 2], [1, 2, 0], [0, 1, 3]];
        let positions = vec![[0.0, 0.0, 0.0], [1.0, -0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
        let mesh = TriMesh::new(positions, faces);
        for z in [3.0, -3.0] {
            let shown = Doubled::of(&mesh).unwrap().shown(&mesh, &camera([0.1, 0.1, z]));
            assert_eq!(shown, [[0, 1, 2], [1; 3], [0, 1, 3]]);
        }
    }
}
