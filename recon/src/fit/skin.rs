//! The surface between the points of a lattice that are inside and those that are not.

use std::collections::HashMap;

use mesh_core::TriMesh;

use super::{kuhn::TETRAHEDRA, lattice::Lattice};

/// How near to an end of its edge a vertex may be: nearer ones make slivers.
const NEAREST: f32 = 0.2;

/// One or two triangles through each tetrahedron that has points of both kinds: closed, manifold, oriented outwards, without
/// self-intersections, of the topology of the set.
///
/// A vertex is where the distance is zero along its edge, as far as the points' kinds allow.
///
/// # Cost
/// Some six triangles for each cube that the surface goes through.
pub(super) fn skin(lattice: &Lattice, inside: &[bool]) -> TriMesh {
    let [nx, ny, nz] = lattice.dims;
    let corners: [usize; 8] =
        std::array::from_fn(|c| (c & 1) + nx * ((c >> 1 & 1) + ny * (c >> 2)));
    let mut skin = Skin { lattice, vertices: HashMap::new(), mesh: TriMesh::default() };
    for z in 0..nz - 1 {
        for y in 0..ny - 1 {
            for x in 0..nx - 1 {
                let base = (z * ny + y) * nx + x;
                let filled = corners.iter().filter(|&&c| inside[base + c]).count();
                if filled == 0 || filled == 8 {
                    continue;
                }
                for tetrahedron in TETRAHEDRA {
                    skin.cut(tetrahedron.map(|c| base + corners[c]), inside);
                }
            }
        }
    }
    skin.mesh
}

struct Skin<'a> {
    lattice: &'a Lattice,
    vertices: HashMap<(usize, usize), u32>,
    mesh: TriMesh,
}

impl Skin<'_> {
    /// The triangles of a tetrahedron that is oriented positively.
    fn cut(&mut self, points: [usize; 4], inside: &[bool]) {
        // The points inside first, by an even permutation.
        let set =
            points.iter().enumerate().fold(0, |set, (i, &p)| set | usize::from(inside[p]) << i);
        let order: [usize; 4] = match set {
            1 | 14 | 3 | 12 => [0, 1, 2, 3],
            2 | 13 => [1, 0, 3, 2],
            4 | 11 => [2, 3, 0, 1],
            8 | 7 => [3, 2, 1, 0],
            5 | 10 => [0, 2, 3, 1],
            9 | 6 => [0, 3, 1, 2],
            _ => return,
        };
        let [a, b, c, d] = order.map(|i| points[i]);
        let mut vertex = |from: usize, to: usize| self.vertex(from, to, inside);
        if set.count_ones() == 2 {
            // Around the four edges between the pairs.
            let [ac, bc, bd, ad] = [vertex(a, c), vertex(b, c), vertex(b, d), vertex(a, d)];
            if inside[a] {
                self.mesh.faces.extend([[ac, bd, bc], [ac, ad, bd]]);
            } else {
                self.mesh.faces.extend([[ac, bc, bd], [ac, bd, ad]]);
            }
        } else {
            let [ab, ac, ad] = [vertex(a, b), vertex(a, c), vertex(a, d)];
            // Seen from outside the triangle turns as its far points do seen from the near one.
            self.mesh.faces.push(if inside[a] { [ab, ac, ad] } else { [ab, ad, ac] });
        }
    }

    fn vertex(&mut self, a: usize, b: usize, inside: &[bool]) -> u32 {
        let (a, b) = if inside[a] { (a, b) } else { (b, a) };
        *self.vertices.entry((a, b)).or_insert_with(|| {
            let [near, far] = [a, b].map(|p| self.lattice.distance[p]);
            let t =
                if near < 0.0 && far > 0.0 { near / (near - far) } else { f32::from(near < 0.0) };
            let t = t.clamp(NEAREST, 1.0 - NEAREST);
            let [p, q] = [a, b].map(|p| self.lattice.place(p));
            let number = self.mesh.positions.len() as u32;
            self.mesh.positions.push(std::array::from_fn(|k| p[k] + t * (q[k] - p[k])));
            number
        })
    }
}
