//! The neighbourhood of a point of a lattice whose cubes are cut into six tetrahedra each (Freudenthal, Kuhn).
//!
//! Every point has fourteen neighbours, and the triangles that they form around it, its link, are a sphere. So a set of points
//! and its complement are connected alike, and what lies between them is always a manifold: no pair of diagonals is ambiguous,
//! as in a lattice of cubes. A set keeps its topology when a point is added or taken that is simple: whose neighbours in the set
//! are one connected part of the link, and the others too.

/// Steps to the neighbours: first the seven upwards, then the same downwards.
pub(super) const STEPS: [[isize; 3]; 14] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 1, 0],
    [1, 0, 1],
    [0, 1, 1],
    [1, 1, 1],
    [-1, 0, 0],
    [0, -1, 0],
    [0, 0, -1],
    [-1, -1, 0],
    [-1, 0, -1],
    [0, -1, -1],
    [-1, -1, -1],
];

/// The corners of the tetrahedra of a cube, as bits `x + 2 y + 4 z`: up the cube along three axes in each order. Those of odd
/// order are mirrored.
pub(super) const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 5, 1, 7], [0, 3, 2, 7], [0, 6, 4, 7]];

/// For each set of neighbours, a bit each, what the point between them is to the set.
#[derive(Debug)]
pub(super) struct Links {
    simple: Vec<bool>,
    euler: Vec<i8>,
}

impl Links {
    pub(super) fn new() -> Self {
        let joined: [u16; 14] = std::array::from_fn(|i| {
            (0..14).filter(|&j| j != i && joins(i, j)).fold(0, |set, j| set | 1 << j)
        });
        let all = 0..1u16 << STEPS.len();
        let whole = (1 << STEPS.len()) - 1;
        let simple = all
            .clone()
            .map(|set| connected(set, &joined) && connected(whole & !set, &joined))
            .collect();
        let euler = all.map(|set| 1 - euler_number(set, &joined)).collect();
        Self { simple, euler }
    }

    /// Whether a point may be added to the set or taken from it without any change of topology.
    pub(super) fn is_simple(&self, neighbors: u16) -> bool {
        self.simple[usize::from(neighbors)]
    }

    /// By how much the Euler number of the set is larger with the point than without it.
    pub(super) fn euler_with(&self, neighbors: u16) -> i64 {
        i64::from(self.euler[usize::from(neighbors)])
    }
}

/// Whether two neighbours of a point are neighbours of each other.
fn joins(i: usize, j: usize) -> bool {
    let step: [isize; 3] = std::array::from_fn(|k| STEPS[i][k] - STEPS[j][k]);
    STEPS.contains(&step)
}

/// Whether a set of points of the link is one part, and not empty.
fn connected(set: u16, joined: &[u16; 14]) -> bool {
    let mut part = set & set.wrapping_neg();
    loop {
        let reached = (0..14).filter(|i| part >> i & 1 == 1).fold(part, |r, i| r | joined[i]) & set;
        if reached == part {
            return set != 0 && part == set;
        }
        part = reached;
    }
}

/// Points less edges plus triangles of the part of the link that a set spans.
fn euler_number(set: u16, joined: &[u16; 14]) -> i8 {
    let mut sum = 0;
    for i in (0..14).filter(|i| set >> i & 1 == 1) {
        sum += 1;
        for j in (0..i).filter(|&j| (set & joined[i]) >> j & 1 == 1) {
            sum -= 1;
            sum += (set & joined[i] & joined[j] & ((1 << j) - 1)).count_ones() as i8;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_link_is_a_sphere_and_steps_are_in_opposite_pairs() {
        let joined: [u16; 14] = std::array::from_fn(|i| {
            (0..14).filter(|&j| j != i && joins(i, j)).fold(0, |set, j| set | 1 << j)
        });
        assert_eq!(joined.iter().map(|j| j.count_ones()).sum::<u32>(), 72); // 36 edges
        assert_eq!(euler_number((1 << 14) - 1, &joined), 2);
        for i in 0..7 {
            assert_eq!(STEPS[i].map(|x| -x), STEPS[i + 7]);
        }
    }

    #[test]
    fn simple_points_keep_the_euler_number_and_few_others_do() {
        let links = Links::new();
        let of = |indices: &[usize]| indices.iter().fold(0u16, |set, i| set | 1 << i);
        for set in 0..1u16 << 14 {
            if links.is_simple(set) {
                assert_eq!(links.euler_with(set), 0, "{set:b}");
            }
        }
        // Alone: a component more. All around: a cavity less. Two ends: a bridge.
        assert_eq!((links.is_simple(0), links.euler_with(0)), (false, 1));
        let whole = (1 << 14) - 1;
        assert_eq!((links.is_simple(whole), links.euler_with(whole)), (false, -1));
        let ends = of(&[0, 7]);
        assert_eq!((links.is_simple(ends), links.euler_with(ends)), (false, -1));
        // All but two opposite ones: a tunnel is filled.
        assert_eq!((links.is_simple(whole & !ends), links.euler_with(whole & !ends)), (false, 1));
        assert!(links.is_simple(of(&[3])) && links.is_simple(of(&[0, 3])));
    }
}
