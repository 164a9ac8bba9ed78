//! Self-intersections of a mesh.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::TriMesh;
use crate::intersect::{BITS, Facet, Point, cross, normal};
use crate::kernels::threads;

/// Leaves whose faces' partners are looked for in one parallel task.
const CHUNK: usize = 64;
/// Faces in a leaf of the tree.
const LEAF: usize = 8;
/// Bits that boxes leave out of the coordinates, so that the sum of two is an `i32`.
const COARSE: i32 = BITS - 29;
/// A box with nothing in it, which meets no other.
const NOWHERE: Bounds = [[i32::MAX / 2; 4], [i32::MIN / 2; 4]];

/// Least and greatest coordinates, without their last bits, and nothing: four numbers are one vector register.
type Bounds = [[i32; 4]; 2];

impl TriMesh {
    /// The pairs of faces that pass through each other, sorted, the smaller index first.
    ///
    /// Faces that merely touch do not count, at shared corners and edges or elsewhere; corners at
    /// the same position are the same corner, so a mesh that is cut along its texture's seams is
    /// treated as the closed surface that it is. Faces that share an edge count only when they are
    /// folded flat onto each other; faces that share a corner when they cross beyond it; faces in
    /// one plane when they overlap. Faces that are not valid or have no area are left out.
    ///
    /// The answer is exact for the positions rounded to `2^-40` of the largest coordinate, which
    /// leaves all but the smallest coordinates as they are.
    ///
    /// # Cost
    /// `O(F log F)` and the pairs whose boxes overlap: some 20 ms for 20,000 faces.
    pub fn self_intersections(&self) -> Vec<[u32; 2]> {
        self.self_intersections_with(&|_, _| ())
    }

    /// [`self_intersections`](Self::self_intersections), telling how many parts of how many are done.
    pub(crate) fn self_intersections_with(
        &self,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Vec<[u32; 2]> {
        Crossings::watched(&self.positions, &self.faces, progress).pairs
    }
}

/// The faces of a mesh that pass through each other, as its vertices move: what stays where it was is not compared again.
pub(crate) struct Crossings {
    /// As [`TriMesh::self_intersections`] gives them.
    pub(crate) pairs: Vec<[u32; 2]>,
    scale: Option<Scale>,
    faces: Faces,
    tree: Tree,
}

impl Crossings {
    pub(crate) fn of(positions: &[[f32; 3]], faces: &[[u32; 3]]) -> Self {
        Self::watched(positions, faces, &|_, _| ())
    }

    fn watched(
        positions: &[[f32; 3]],
        faces: &[[u32; 3]],
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Self {
        let scale = Scale::of(positions, faces);
        let mut placed = Faces::none(positions.len(), faces.len());
        placed.place(scale, positions, faces, 0..positions.len() as u32, 0..faces.len() as u32);
        let tree = Tree::new(&placed);
        let mut crossings = Self { pairs: Vec::new(), scale, faces: placed, tree };
        crossings.compare(&vec![true; faces.len()], progress);
        crossings
    }

    /// These vertices have moved, and with them these faces of the same mesh.
    ///
    /// # Cost
    /// Little for each vertex and face, and the comparison of the faces that have moved.
    pub(crate) fn update(&mut self, positions: &[[f32; 3]], faces: &[[u32; 3]], moved: &Moved) {
        let scale = Scale::of(positions, faces);
        if scale != self.scale {
            *self = Self::of(positions, faces);
            return;
        }
        let (vertices, of_them) = (moved.vertices.iter().copied(), moved.faces.iter().copied());
        let has_moved = self.faces.place(scale, positions, faces, vertices, of_them);
        if !has_moved.contains(&true) {
            return;
        }
        self.tree.refit(&self.faces, &has_moved);
        self.pairs.retain(|pair| !pair.iter().any(|&face| has_moved[face as usize]));
        self.compare(&has_moved, &|_, _| ());
    }

    /// Adds the pairs of faces that have moved and all others; of two that have moved the one with the smaller index looks.
    fn compare(&mut self, has_moved: &[bool], progress: &(dyn Fn(usize, usize) + Sync)) {
        let (faces, tree) = (&self.faces, &self.tree);
        let (count, done) = (tree.leaves.len().div_ceil(CHUNK), AtomicUsize::new(0));
        let chunks = threads::map(count, |chunk| {
            let last = (chunk * CHUNK + CHUNK).min(tree.leaves.len());
            let (mut found, mut near, mut open) = (Vec::new(), Vec::new(), Vec::new());
            for leaf in &tree.leaves[chunk * CHUNK..last] {
                let slots = || leaf.clone().map(|slot| slot as usize);
                let looking = || slots().filter(|&slot| has_moved[tree.order[slot] as usize]);
                if looking().next().is_none() {
                    continue;
                }
                // What is near one face of a leaf is near the others.
                let around = looking().fold(NOWHERE, |all, slot| union(all, tree.boxes[slot]));
                near.clear();
                tree.visit(&around, &mut open, |slot| near.push(slot));
                for slot in looking() {
                    let face = tree.order[slot];
                    let facet = Facet::new(faces.corners[face as usize]);
                    for &slot_of_other in &near {
                        let other = tree.order[slot_of_other];
                        let mine = other > face || !has_moved[other as usize];
                        if mine
                            && other != face
                            && !apart(&tree.boxes[slot], &tree.boxes[slot_of_other])
                            && cross(&facet, &faces.corners[other as usize])
                        {
                            found.push([face.min(other), face.max(other)]);
                        }
                    }
                }
            }
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, count);
            found
        });
        self.pairs.extend(chunks.into_iter().flatten());
        self.pairs.sort_unstable();
    }
}

/// What of a mesh has moved.
#[derive(Default)]
pub(crate) struct Moved {
    pub(crate) vertices: Vec<u32>,
    /// Those with such a vertex.
    pub(crate) faces: Vec<u32>,
}

/// The power of two that brings coordinates to integers.
#[derive(Clone, Copy, PartialEq)]
struct Scale(i32);

impl Scale {
    /// Of the corners of faces: a vertex that none names may be anywhere. `None` if nothing is anywhere but in the origin.
    fn of(positions: &[[f32; 3]], faces: &[[u32; 3]]) -> Option<Self> {
        let corners = faces.as_flattened().iter().filter_map(|&v| positions.get(v as usize));
        let finite = corners.filter(|p| p.iter().all(|x| x.is_finite()));
        let largest = finite.flatten().fold(0.0_f64, |largest, &x| largest.max(f64::from(x).abs()));
        (largest > 0.0).then(|| Self(BITS - 1 - largest.log2().floor() as i32))
    }

    fn snap(self, p: [f32; 3]) -> Option<Point> {
        // Two steps, since the power alone may be beyond what f64 can hold for tiny meshes.
        let (half, rest) = (2.0_f64.powi(self.0 / 2), 2.0_f64.powi(self.0 - self.0 / 2));
        let finite = p.iter().all(|x| x.is_finite());
        finite.then(|| p.map(|x| (f64::from(x) * half * rest).round() as i64))
    }
}

/// The faces of a mesh in integers; those that are not valid have [`NOWHERE`] for a box.
struct Faces {
    /// Where the vertices are.
    places: Vec<Option<Point>>,
    corners: Vec<[Point; 3]>,
    boxes: Vec<Bounds>,
}

impl Faces {
    /// So many vertices and faces that are nowhere.
    fn none(vertices: usize, faces: usize) -> Self {
        Self {
            places: vec![None; vertices],
            corners: vec![[[0; 3]; 3]; faces],
            boxes: vec![NOWHERE; faces],
        }
    }

    /// Takes vertices that moved from these positions, and tells of each face whether that changes it, of those that are `looked` at.
    fn place(
        &mut self,
        scale: Option<Scale>,
        positions: &[[f32; 3]],
        faces: &[[u32; 3]],
        moved: impl Iterator<Item = u32>,
        looked: impl Iterator<Item = u32>,
    ) -> Vec<bool> {
        for v in moved {
            self.places[v as usize] = scale.and_then(|scale| scale.snap(positions[v as usize]));
        }
        let mut has_moved = vec![false; faces.len()];
        for f in looked.map(|f| f as usize) {
            let corners = faces[f].map(|v| self.places.get(v as usize).copied().flatten());
            let corners = match corners {
                [Some(a), Some(b), Some(c)] => [a, b, c],
                _ => [[0; 3]; 3],
            };
            if corners == self.corners[f] {
                continue;
            }
            self.corners[f] = corners;
            self.boxes[f] = if normal(&corners) == [0; 3] { NOWHERE } else { bounds(&corners) };
            has_moved[f] = true;
        }
        has_moved
    }
}

fn bounds(corners: &[Point; 3]) -> Bounds {
    let mut bounds = NOWHERE;
    for corner in corners {
        let [x, y, z] = corner.map(|x| (x >> COARSE) as i32);
        bounds = union(bounds, [[x, y, z, 0]; 2]);
    }
    bounds
}

/// The smallest box around two.
fn union([low, high]: Bounds, other: Bounds) -> Bounds {
    [
        std::array::from_fn(|k| low[k].min(other[0][k])),
        std::array::from_fn(|k| high[k].max(other[1][k])),
    ]
}

/// Whether two boxes have no place in common.
#[inline]
fn apart(a: &Bounds, b: &Bounds) -> bool {
    // All at once, without a branch that would be guessed wrong.
    let beyond = |k: usize| u32::from(a[0][k] > b[1][k]) + u32::from(b[0][k] > a[1][k]);
    (0..4).map(beyond).sum::<u32>() > 0
}

/// A tree of boxes over faces, halved at the median of the longest side.
struct Tree {
    order: Vec<u32>,
    /// Depth first; the second child of an inner node is at `right`.
    nodes: Vec<Node>,
    /// Parts of the order, each of a leaf.
    leaves: Vec<Range<u32>>,
    /// Those of the faces, in the order.
    boxes: Vec<Bounds>,
}

struct Node {
    bounds: Bounds,
    /// Faces `first..last` of the order, of a leaf.
    leaf: Option<(u32, u32)>,
    right: u32,
}

impl Tree {
    fn new(faces: &Faces) -> Self {
        let mut tree = Self {
            order: (0..faces.corners.len() as u32).collect(),
            nodes: Vec::new(),
            leaves: Vec::new(),
            boxes: vec![NOWHERE; faces.corners.len()],
        };
        if !tree.order.is_empty() {
            tree.grow(faces, 0, faces.corners.len());
        }
        tree.refit(faces, &vec![true; faces.corners.len()]);
        tree
    }

    fn grow(&mut self, faces: &Faces, first: usize, last: usize) {
        let part = &mut self.order[first..last];
        let around = |bounds, &face: &u32| union(bounds, faces.boxes[face as usize]);
        let bounds = part.iter().fold(NOWHERE, around);
        let node = self.nodes.len();
        let leaf = (last - first <= LEAF).then_some((first as u32, last as u32));
        self.nodes.push(Node { bounds, leaf, right: 0 });
        if leaf.is_some() {
            self.leaves.push(first as u32..last as u32);
        } else {
            let axis = (0..3).max_by_key(|&k| bounds[1][k] - bounds[0][k]).unwrap_or(0);
            let half = (last - first) / 2;
            // The index breaks ties, so the tree does not depend on the order of equals.
            part.select_nth_unstable_by_key(half, |&face| {
                let [low, high] = faces.boxes[face as usize];
                (low[axis] + high[axis], face)
            });
            self.grow(faces, first, first + half);
            self.nodes[node].right = self.nodes.len() as u32;
            self.grow(faces, first + half, last);
        }
    }

    /// Takes the boxes of the faces that have moved; which nodes they are in stays.
    fn refit(&mut self, faces: &Faces, has_moved: &[bool]) {
        let mut changed = vec![false; self.nodes.len()];
        // Children stand behind their parents.
        for index in (0..self.nodes.len()).rev() {
            let Node { leaf, right, .. } = self.nodes[index];
            changed[index] = match leaf {
                Some((first, last)) => {
                    self.refit_leaf(first as usize..last as usize, faces, has_moved)
                }
                None => changed[index + 1] || changed[right as usize],
            };
            if !changed[index] {
                continue;
            }
            self.nodes[index].bounds = match leaf {
                Some((first, last)) => self.boxes[first as usize..last as usize]
                    .iter()
                    .fold(NOWHERE, |bounds, &other| union(bounds, other)),
                None => union(self.nodes[index + 1].bounds, self.nodes[right as usize].bounds),
            };
        }
    }

    /// Takes the boxes of a leaf's faces that have moved, and says whether there are any.
    fn refit_leaf(&mut self, leaf: Range<usize>, faces: &Faces, has_moved: &[bool]) -> bool {
        let mut any = false;
        for slot in leaf {
            let face = self.order[slot] as usize;
            if has_moved[face] {
                self.boxes[slot] = faces.boxes[face];
                any = true;
            }
        }
        any
    }

    /// Calls `meet` with the place in the order of each face whose box meets this one; `open` is a buffer.
    fn visit(&self, bounds: &Bounds, open: &mut Vec<u32>, mut meet: impl FnMut(usize)) {
        open.clear();
        open.extend((!self.nodes.is_empty()).then_some(0));
        while let Some(index) = open.pop() {
            let node: &Node = &self.nodes[index as usize];
            if apart(bounds, &node.bounds) {
                continue;
            }
            if let Some((first, last)) = node.leaf {
                let slots = first as usize..last as usize;
                slots.filter(|&slot| !apart(bounds, &self.boxes[slot])).for_each(&mut meet);
            } else {
                open.extend([node.right, index + 1]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{primitives, subdivide};

    /// Where edges meet edges exactly, each of the two faces beside one is on one side of the other's plane, or touches it; the surfaces
    /// cross there all the same.
    #[test]
    fn boxes_whose_edges_meet_edges_cross() {
        let mut boxes = subdivide(&primitives::cuboid([2.0; 3]));
        let bar = subdivide(&primitives::cuboid([2.0, 1.0, 1.0]));
        boxes.append(&bar.translated([1.0, 0.0, 0.0])).expect("neither has a texture");
        assert!(!boxes.self_intersections().is_empty());
        assert!(!boxes.examined().is_solid());
    }

    /// Two balls, one of which moves through the other and away, is shrunk to a point, and is lost.
    #[test]
    fn what_moved_is_found_as_if_all_were_looked_at_again() {
        let ball = primitives::icosphere(2);
        let count = ball.positions.len();
        let faces: Vec<[u32; 3]> = ball
            .faces
            .iter()
            .copied()
            .chain(ball.faces.iter().map(|f| f.map(|v| v + count as u32)))
            .collect();
        let placed = |at: f32, scale: f32| -> Vec<[f32; 3]> {
            let far = ball.positions.iter().map(|p| p.map(|x| 1.6 * x));
            far.chain(
                ball.positions.iter().map(|p| [at + scale * p[0], scale * p[1], scale * p[2]]),
            )
            .collect()
        };
        let mut moving = Crossings::of(&placed(5.0, 0.9), &faces);
        assert!(moving.pairs.is_empty());
        let mut seen = 0;
        for (at, scale) in [
            (2.0, 0.9),
            (1.9, 0.9),
            (0.1, 0.9),
            (1.5, 0.9),
            (1.5, 0.0),
            (1.5, f32::NAN),
            (1.5, 0.8),
            (9.0, 0.9),
        ] {
            let positions = placed(at, scale);
            let moved = Moved {
                vertices: (0..positions.len() as u32).collect(),
                faces: (0..faces.len() as u32).collect(),
            };
            moving.update(&positions, &faces, &moved);
            assert_eq!(moving.pairs, Crossings::of(&positions, &faces).pairs, "at {at}, {scale}");
            seen += moving.pairs.len();
        }
        assert!(seen > 100, "{seen}");
    }

    #[test]
    fn a_vertex_that_no_face_names_changes_nothing() {
        let ball = crate::primitives::icosphere(2);
        let mut two = ball.clone();
        let _ = two.append(&ball.translated([1.9, 0.0, 0.0]));
        let found = two.self_intersections();
        two.positions.push([1e13; 3]);
        assert!(!found.is_empty());
        assert_eq!(two.self_intersections(), found);
    }
}
