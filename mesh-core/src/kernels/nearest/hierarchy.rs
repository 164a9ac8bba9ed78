//! The same in boxes of boxes, where comparing all pairs would take long.
//!
//! A linear bounding volume hierarchy (C. Lauterbach et al., "Fast BVH Construction on GPUs", 2009): points are sorted along a Morton
//! curve, sixteen neighbours on it are a leaf, sixteen boxes are a node. It is asked by sixteen queries at a time, those of one leaf of
//! their own hierarchy, which share the way down. What is found is what comparing all pairs finds, to the last bit: the distance
//! between two boxes is computed by the operations that compute the distance between two points, and rounding keeps order, so that
//! it is at most the distance of every pair of points in them.
//!
//! Everything is written on arrays of sixteen numbers, which compilers turn into vectors.

use super::neighbor::Nearest;

/// Points of a leaf, boxes of a node, queries that are asked together: the numbers in the widest vector.
const WIDTH: usize = 16;
/// Levels of nodes above 2^32 points.
const LEVELS: usize = 7;
/// The bits of a distance that give way to the number of a box; distances become smaller by them, never larger.
const PLACE: u32 = WIDTH as u32 - 1;
/// Cells of the curve along an axis.
const CELLS: f32 = 1024.0;

type Lanes = [f32; WIDTH];

/// Points in boxes in boxes.
#[derive(Clone, Debug, Default)]
pub(super) struct Hierarchy {
    leaves: Vec<Leaf>,
    /// Boxes of the leaves, boxes of those nodes, .., up to one node.
    levels: [Vec<Node>; LEVELS],
    /// Where each point is on the curve, and its index below that.
    keys: Vec<u64>,
}

/// Sixteen points; where there are fewer, the last is there several times.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leaf {
    at: [Lanes; 3],
    index: [u32; WIDTH],
}

/// Sixteen boxes; where there are fewer, the others are infinitely far away.
#[derive(Clone, Copy, Debug)]
struct Node {
    low: [Lanes; 3],
    high: [Lanes; 3],
}

/// One box, by its corners.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: [f32; 3],
    high: [f32; 3],
}

/// The nearest points so far to sixteen queries.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    squared: Lanes,
    index: [u32; WIDTH],
}

impl Hierarchy {
    /// Builds it anew; points that are not finite are left out.
    pub(super) fn build(&mut self, points: &[[f32; 3]]) {
        self.sort(points);
        self.leaves.clear();
        self.leaves.extend(self.keys.chunks(WIDTH).map(|keys| Leaf::new(keys, points)));
        self.levels.iter_mut().for_each(Vec::clear);
        if self.leaves.is_empty() {
            return;
        }
        let nodes = self.leaves.chunks(WIDTH).map(|part| Node::new(part.iter().map(Leaf::bounds)));
        self.levels[0].extend(nodes);
        for level in 1..LEVELS {
            let (below, above) = self.levels.split_at_mut(level);
            let below = &below[level - 1];
            if below.len() < 2 {
                break;
            }
            let nodes = below.chunks(WIDTH).map(|part| Node::new(part.iter().map(Node::bounds)));
            above[0].extend(nodes);
        }
    }

    /// Puts the finite points in the order of the curve through the box around them.
    fn sort(&mut self, points: &[[f32; 3]]) {
        let finite = |p: &[f32; 3]| p.iter().all(|v| v.is_finite());
        let around = Bounds::of(points.iter().filter(|p| finite(p)).map(|&at| Bounds::at(at)));
        // An axis that is longer than the largest number, or that has no length, has one cell.
        let scale: [f32; 3] =
            std::array::from_fn(|axis| CELLS / (around.high[axis] - around.low[axis]));
        self.keys.clear();
        self.keys.extend((0_u32..).zip(points).filter(|(_, p)| finite(p)).map(|(index, p)| {
            let cell: [u32; 3] = std::array::from_fn(|axis| {
                let cell = (p[axis] - around.low[axis]) * scale[axis];
                (cell as u32).min(CELLS as u32 - 1)
            });
            u64::from(morton(cell)) << u32::BITS | u64::from(index)
        }));
        self.keys.sort_unstable();
    }

    /// Where each of its leaves is.
    pub(super) fn leaves(&self) -> &[Leaf] {
        &self.leaves
    }

    /// The points nearest to those of a leaf of another hierarchy.
    #[inline(always)]
    pub(super) fn nearest(&self, queries: &Leaf) -> Found {
        let mut found = Found::NOTHING;
        let Some(top) = self.levels.iter().rposition(|level| !level.is_empty()) else {
            return found;
        };
        let around = queries.bounds();
        // Of each level the node that is being looked at, and what of it waits.
        let mut nodes = [0; LEVELS];
        let mut waiting = [[0; WIDTH]; LEVELS];
        waiting[top] = self.levels[top][0].keys(&around);
        let (mut level, mut reach) = (top, f32::INFINITY);
        loop {
            let key = smallest(&waiting[level]);
            let (squared, place) = (f32::from_bits(key & !PLACE), (key & PLACE) as usize);
            // What is equally near may have the lower index. At an infinite distance nothing is found.
            if squared > reach || squared == f32::INFINITY {
                if level == top {
                    return found;
                }
                level += 1;
                continue;
            }
            waiting[level][place] = NEVER;
            let (node, child) = (nodes[level], nodes[level] * WIDTH + place);
            if level > 0 {
                level -= 1;
                nodes[level] = child;
                waiting[level] = self.levels[level][child].keys(&around);
            } else if self.levels[0][node].is_near(place, queries, &found) {
                found.look_at(&self.leaves[child], queries);
                reach = largest(&found.squared);
            }
        }
    }
}

/// The key of a box that has been looked at.
const NEVER: u32 = f32::INFINITY.to_bits();

impl Leaf {
    fn new(keys: &[u64], points: &[[f32; 3]]) -> Self {
        // The index is what is left of the key.
        let index = std::array::from_fn(|k| keys[k.min(keys.len() - 1)] as u32);
        let at = std::array::from_fn(|axis| index.map(|index| points[index as usize][axis]));
        Self { at, index }
    }

    #[inline(always)]
    fn bounds(&self) -> Bounds {
        Bounds {
            low: self.at.map(|lanes| lowest(&lanes)),
            high: self.at.map(|lanes| highest(&lanes)),
        }
    }

    /// Gives each of its points what was found for it.
    pub(super) fn write(&self, found: &Found, all: &mut [Nearest]) {
        for (k, &query) in self.index.iter().enumerate() {
            all[query as usize] = Nearest { index: found.index[k], squared: found.squared[k] };
        }
    }
}

impl Node {
    fn new(boxes: impl Iterator<Item = Bounds>) -> Self {
        let mut node =
            Self { low: [[f32::INFINITY; WIDTH]; 3], high: [[f32::NEG_INFINITY; WIDTH]; 3] };
        for (k, bounds) in boxes.enumerate() {
            for axis in 0..3 {
                (node.low[axis][k], node.high[axis][k]) = (bounds.low[axis], bounds.high[axis]);
            }
        }
        node
    }

    fn bounds(&self) -> Bounds {
        Bounds {
            low: self.low.map(|lanes| lowest(&lanes)),
            high: self.high.map(|lanes| highest(&lanes)),
        }
    }

    /// The squared distances of its boxes from another, and in their last bits the places of the boxes: the order of such keys as
    /// whole numbers is that of the distances.
    #[inline(always)]
    fn keys(&self, other: &Bounds) -> [u32; WIDTH] {
        let mut keys = [0; WIDTH];
        for (k, key) in keys.iter_mut().enumerate() {
            let [dx, dy, dz]: [f32; 3] = std::array::from_fn(|axis| {
                let apart = self.low[axis][k] - other.high[axis];
                higher(higher(apart, other.low[axis] - self.high[axis][k]), 0.0)
            });
            let squared = dz.mul_add(dz, dy.mul_add(dy, dx * dx));
            *key = squared.to_bits() & !PLACE | k as u32;
        }
        keys
    }

    /// Whether one of its boxes is as near to one of the queries as what was found for that.
    #[inline(always)]
    fn is_near(&self, place: usize, queries: &Leaf, found: &Found) -> bool {
        let low = self.low.map(|lanes| lanes[place]);
        let high = self.high.map(|lanes| lanes[place]);
        let mut near = 0;
        for k in 0..WIDTH {
            let [dx, dy, dz]: [f32; 3] = std::array::from_fn(|axis| {
                let at = queries.at[axis][k];
                higher(higher(low[axis] - at, at - high[axis]), 0.0)
            });
            let squared = dz.mul_add(dz, dy.mul_add(dy, dx * dx));
            near |= u32::from(squared <= found.squared[k]);
        }
        near != 0
    }
}

impl Bounds {
    fn at(at: [f32; 3]) -> Self {
        Self { low: at, high: at }
    }

    /// The box around others; around none it is inside out.
    fn of(boxes: impl Iterator<Item = Self>) -> Self {
        let none = Self { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };
        boxes.fold(none, |a, b| Self {
            low: std::array::from_fn(|axis| lower(a.low[axis], b.low[axis])),
            high: std::array::from_fn(|axis| higher(a.high[axis], b.high[axis])),
        })
    }
}

impl Found {
    pub(super) const NOTHING: Self = Self { squared: [f32::INFINITY; WIDTH], index: [0; WIDTH] };

    /// Compares all points of a leaf with all queries.
    #[inline(always)]
    #[expect(
        clippy::needless_bitwise_bool,
        reason = "with a branch it is no vector: 2.3 ms instead of 1.4"
    )]
    fn look_at(&mut self, leaf: &Leaf, queries: &Leaf) {
        for j in 0..WIDTH {
            let [x, y, z] = leaf.at.map(|lanes| lanes[j]);
            let index = leaf.index[j];
            for k in 0..WIDTH {
                let [dx, dy, dz] =
                    [queries.at[0][k] - x, queries.at[1][k] - y, queries.at[2][k] - z];
                let squared = dz.mul_add(dz, dy.mul_add(dy, dx * dx));
                let first = (squared == self.squared[k]) & (index < self.index[k]);
                let nearer = (squared < self.squared[k]) | first;
                self.squared[k] = if nearer { squared } else { self.squared[k] };
                self.index[k] = if nearer { index } else { self.index[k] };
            }
        }
    }
}

/// What is nearest to the points of each leaf.
#[inline(always)]
pub(super) fn ask(points: &Hierarchy, leaves: &[Leaf], found: &mut [Found]) {
    for (leaf, found) in leaves.iter().zip(found) {
        *found = points.nearest(leaf);
    }
}

/// Of two numbers the lower one; unlike `min` one instruction, and the second where one is none.
#[inline(always)]
fn lower(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Of two numbers the higher one; unlike `max` one instruction, and the second where one is none.
#[inline(always)]
fn higher(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The lowest of sixteen numbers, half of them compared with the other half.
#[inline(always)]
fn lowest(lanes: &Lanes) -> f32 {
    let eight: [f32; 8] = std::array::from_fn(|k| lower(lanes[k], lanes[k + 8]));
    let four: [f32; 4] = std::array::from_fn(|k| lower(eight[k], eight[k + 4]));
    lower(lower(four[0], four[2]), lower(four[1], four[3]))
}

/// The highest of sixteen numbers.
#[inline(always)]
fn highest(lanes: &Lanes) -> f32 {
    -lowest(&lanes.map(|v| -v))
}

#[inline(always)]
fn smallest(keys: &[u32; WIDTH]) -> u32 {
    keys.iter().fold(u32::MAX, |a, &b| a.min(b))
}

/// The largest of numbers none of which is negative: as whole numbers, whose order takes no care of what is not a number.
#[inline(always)]
fn largest(lanes: &Lanes) -> f32 {
    f32::from_bits(lanes.iter().fold(0, |a, b| a.max(b.to_bits())))
}

/// The place of a cell on the curve: the bits of its three numbers in turns.
fn morton(cell: [u32; 3]) -> u32 {
    let spread = |v: u32| {
        let v = (v | v << 16) & 0x0300_00ff;
        let v = (v | v << 8) & 0x0300_f00f;
        let v = (v | v << 4) & 0x030c_30c3;
        (v | v << 2) & 0x0924_9249
    };
    spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{Nearest, NearestScratch, in_hierarchy, nearest_scalar};

    fn cloud(max: usize) -> impl Strategy<Value = Vec<[f32; 3]>> {
        // Few distinct values, so that ties are common: alone, since one query that is far from all else keeps every box in reach.
        let small = prop::array::uniform3((-3_i8..=3).prop_map(f32::from));
        let any = prop::array::uniform3(-10.0_f32..10.0);
        let odd = prop::array::uniform3(prop_oneof![
            Just(f32::NAN),
            Just(f32::INFINITY),
            Just(3e38),
            Just(1.0)
        ]);
        let mixed = prop_oneof![4 => small.clone(), 4 => any, 1 => odd];
        prop_oneof![prop::collection::vec(small, 1..max), prop::collection::vec(mixed, 1..max)]
    }

    fn found(queries: &[[f32; 3]], points: &[[f32; 3]]) -> Vec<Nearest> {
        let NearestScratch { queries: mut from, points: mut to, mut by_leaf, .. } =
            NearestScratch::default();
        from.build(queries);
        to.build(points);
        let mut found = Vec::new();
        in_hierarchy(&from, &to, queries.len(), &mut by_leaf, &mut found);
        found
    }

    proptest! {
        #[test]
        fn it_equals_all_pairs(queries in cloud(70), points in cloud(1500)) {
            prop_assert_eq!(found(&queries, &points), nearest_scalar(&queries, &points));
        }
    }
}
