//! Edges between a face that looks at a camera and one that does not, for a few cameras at once.

use mesh_core::Topology;

use super::planes::{LANES, Planes};

/// Views that are looked at together: a bit each.
pub(super) const AT_ONCE: usize = 8;

/// The edges of a closed, oriented mesh; fixed per topology.
#[derive(Clone, Debug)]
pub(super) struct Edges {
    /// End points, in the order in which they follow one another around the first of the faces.
    ends: Vec<[u32; 2]>,
    /// The two faces of each: all of them are looked at in every view, the ends of few.
    faces: Vec<[u32; 2]>,
}

impl Edges {
    pub(super) fn new(topology: &Topology, faces: &[[u32; 3]]) -> Self {
        let sides = topology.edge_faces.clone();
        let ends = topology.edges.iter().zip(&sides).map(|(&[a, b], &[first, _])| {
            let f = faces[first as usize];
            let forward = (0..3).any(|k| f[k] == a && f[(k + 1) % 3] == b);
            if forward { [a, b] } else { [b, a] }
        });
        Self { ends: ends.collect(), faces: sides }
    }

    /// The ends of a half-edge, in the order in which they follow one another around its face: of edge `e` that of its first face is
    /// `2 e`, that of the other `2 e + 1`.
    #[inline]
    pub(super) fn ends(&self, half: u32) -> [u32; 2] {
        let [a, b] = self.ends[(half / 2) as usize];
        if half.is_multiple_of(2) { [a, b] } else { [b, a] }
    }
}

/// A mesh as views look at it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surface<'a> {
    pub(super) positions: &'a [[f32; 3]],
    pub(super) planes: &'a Planes,
    pub(super) edges: &'a Edges,
}

/// The contours of a mesh in a few views. Buffers are kept from view to view.
#[derive(Debug, Default)]
pub(super) struct Contours {
    facing: Vec<[u8; LANES]>,
    /// Edges whose faces differ in some view, and the views that each of the two looks at; so many of them, what follows is of no account.
    mixed: Vec<(u32, [u8; 2])>,
    halves: Vec<Vec<u32>>,
}

impl Contours {
    /// Finds them for up to [`AT_ONCE`] eyes, as [`Planes::facing`] has them.
    pub(super) fn find(&mut self, surface: Surface<'_>, eyes: &[[f32; 4]]) {
        assert!(eyes.len() <= AT_ONCE, "{} views at once", eyes.len());
        let Self { facing, mixed, halves } = self;
        surface.planes.facing(eyes, facing);
        let facing = facing.as_flattened();
        let edges = &surface.edges.faces;
        // Few edges are of a contour, here and there: written and overwritten, without a branch that would be guessed wrong.
        mixed.resize(edges.len() + 1, (0, [0; 2]));
        let mut count = 0;
        for (e, faces) in edges.iter().enumerate() {
            let looks = faces.map(|face| facing[face as usize]);
            mixed[count] = (e as u32, looks);
            count += usize::from(looks[0] != looks[1]);
        }
        let mixed = &mixed[..count];
        halves.resize_with(eyes.len().max(halves.len()), Vec::new);
        for (view, halves) in halves[..eyes.len()].iter_mut().enumerate() {
            halves.resize(count + 1, 0);
            let mut count = 0;
            for &(e, looks) in mixed {
                let [first, second] = looks.map(|bits| bits >> view & 1);
                halves[count] = 2 * e + u32::from(second);
                count += usize::from(first ^ second);
            }
            halves.truncate(count);
        }
    }

    /// The contour in one of these views: the half-edges, in the order of their edges, of faces that look at it and have a neighbour that does not.
    pub(super) fn of(&self, view: usize) -> &[u32] {
        &self.halves[view]
    }
}
