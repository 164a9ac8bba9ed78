//! The same with a k-d tree over the points, where comparing all pairs would take long.
//!
//! J. L. Bentley, "Multidimensional binary search trees used for associative searching", 1975; with leaves of many points in bounding
//! boxes. What is found is what comparing all pairs finds, to the last bit: the distance to a box is computed by the operations that
//! compute the distance to a point, and rounding keeps order, so that it is at most the distance of every point in it.

/// Points in a leaf: whole vectors of every width, and so many that looking at all leaves takes little longer than comparing all pairs.
const LEAF: usize = 256;
/// Points of a leaf are padded to the widest vector there is.
const PAD: usize = 16;
/// Nodes that may wait on the way down: a level has one, and 2^32 points have fewer levels.
const WAITING: usize = 64;

/// Points in boxes in boxes.
#[derive(Clone, Debug, Default)]
pub(super) struct Tree {
    /// The root first, and behind each node that is no leaf its nearer child in memory.
    nodes: Vec<Node>,
    /// Indices of the points, leaf by leaf and ascending in each.
    order: Vec<u32>,
    /// x, y, z of the points in that order, each leaf padded with what is infinitely far away.
    lanes: [Vec<f32>; 3],
}

#[derive(Clone, Copy, Debug)]
struct Node {
    low: [f32; 3],
    high: [f32; 3],
    kind: Kind,
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    /// Of two, where the second one is; the first is next.
    Parted { second: u32 },
    /// Where its points begin in the order and, padded, in the lanes, and how many they are.
    Leaf { first: u32, lane: u32, count: u32 },
}

impl Tree {
    /// Builds it anew; points that are not finite are left out.
    pub(super) fn build(&mut self, points: &[[f32; 3]]) {
        self.nodes.clear();
        self.lanes.iter_mut().for_each(Vec::clear);
        self.order.clear();
        let finite = |(_, p): &(u32, &[f32; 3])| p.iter().all(|v| v.is_finite());
        self.order.extend((0..).zip(points).filter(finite).map(|(index, _)| index));
        if !self.order.is_empty() {
            self.part(points, 0, self.order.len());
        }
    }

    /// The node of a part of the order.
    fn part(&mut self, points: &[[f32; 3]], start: usize, end: usize) {
        let part = &mut self.order[start..end];
        let (low, high) = bounds(points, part);
        let node = self.nodes.len();
        if part.len() <= LEAF {
            part.sort_unstable();
            let lane = self.lanes[0].len();
            for (axis, lanes) in self.lanes.iter_mut().enumerate() {
                lanes.extend(part.iter().map(|&i| points[i as usize][axis]));
                lanes.resize(lanes.len().next_multiple_of(PAD), f32::INFINITY);
            }
            let [first, lane, count] = [start, lane, end - start].map(|n| n as u32);
            self.nodes.push(Node { low, high, kind: Kind::Leaf { first, lane, count } });
            return;
        }
        let extent = |axis: usize| high[axis] - low[axis];
        let axis = (1..3).fold(0, |widest, k| if extent(k) > extent(widest) { k } else { widest });
        let middle = (part.len() / 2).next_multiple_of(LEAF).min(part.len() - 1);
        let key = |i: u32| points[i as usize][axis];
        part.select_nth_unstable_by(middle, |&a, &b| key(a).total_cmp(&key(b)).then(a.cmp(&b)));
        self.nodes.push(Node { low, high, kind: Kind::Parted { second: 0 } });
        self.part(points, start, start + middle);
        let second = self.nodes.len() as u32;
        self.nodes[node].kind = Kind::Parted { second };
        self.part(points, start + middle, end);
    }

    /// The index of the nearest point to a query, and its squared distance; `scan` looks at a leaf: of its points the nearest, if it
    /// is finite and no further than the best so far, by its place, and its squared distance.
    #[inline(always)]
    pub(super) fn nearest(
        &self,
        query: [f32; 3],
        scan: impl Fn([f32; 3], [&[f32]; 3], f32) -> Option<(usize, f32)>,
    ) -> (u32, f32) {
        let mut best = (0, f32::INFINITY);
        if self.nodes.is_empty() || !query.iter().all(|v| v.is_finite()) {
            return best;
        }
        let mut waiting = [(0_u32, 0.0_f32); WAITING];
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (at, bound) = waiting[count];
            // What is equally near may have the lower index.
            if bound > best.1 {
                continue;
            }
            match self.nodes[at as usize].kind {
                Kind::Parted { second } => {
                    let child = |at: u32| (at, self.nodes[at as usize].squared(query));
                    let (a, b) = (child(at + 1), child(second));
                    let (near, far) = if b.1 < a.1 { (b, a) } else { (a, b) };
                    // The nearer one is on top.
                    waiting[count] = far;
                    waiting[count + 1] = near;
                    count += 2;
                }
                Kind::Leaf { first, lane, count } => {
                    let from = lane as usize;
                    let to = from + (count as usize).next_multiple_of(PAD);
                    let [x, y, z] = &self.lanes;
                    let lanes = [&x[from..to], &y[from..to], &z[from..to]];
                    if let Some((k, squared)) = scan(query, lanes, best.1) {
                        let index = self.order[first as usize + k];
                        if squared < best.1 || index < best.0 {
                            best = (index, squared);
                        }
                    }
                }
            }
        }
        best
    }
}

impl Node {
    /// At most the squared distance to any point in it.
    #[inline(always)]
    fn squared(&self, query: [f32; 3]) -> f32 {
        let [dx, dy, dz]: [f32; 3] = std::array::from_fn(|axis| {
            (self.low[axis] - query[axis]).max(query[axis] - self.high[axis]).max(0.0)
        });
        dz.mul_add(dz, dy.mul_add(dy, dx * dx))
    }
}

/// The corners of the box around some of the points.
fn bounds(points: &[[f32; 3]], part: &[u32]) -> ([f32; 3], [f32; 3]) {
    let none = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    part.iter().fold(none, |(low, high), &i| {
        let point = points[i as usize];
        let corner = |corner: [f32; 3], pick: fn(f32, f32) -> f32| {
            std::array::from_fn(|axis| pick(corner[axis], point[axis]))
        };
        (corner(low, f32::min), corner(high, f32::max))
    })
}

/// Of a leaf's points the nearest, if it is finite and no further than `best`: its place, and its squared distance.
#[cfg(not(feature = "simd"))]
pub(super) fn scan(query: [f32; 3], lanes: [&[f32]; 3], best: f32) -> Option<(usize, f32)> {
    let mut found = None;
    let mut limit = best;
    for k in 0..lanes[0].len() {
        let [dx, dy, dz]: [f32; 3] = std::array::from_fn(|axis| query[axis] - lanes[axis][k]);
        let squared = dz.mul_add(dz, dy.mul_add(dy, dx * dx));
        let nearer = if found.is_none() { squared <= limit } else { squared < limit };
        if nearer && squared.is_finite() {
            (found, limit) = (Some((k, squared)), squared);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{NearestScratch, in_tree, nearest_scalar};

    fn cloud(max: usize) -> impl Strategy<Value = Vec<[f32; 3]>> {
        // Few distinct values, so that ties are common.
        let small = prop::array::uniform3((-3_i8..=3).prop_map(f32::from));
        let any = prop::array::uniform3(-10.0_f32..10.0);
        let odd = prop::array::uniform3(prop_oneof![
            Just(f32::NAN),
            Just(f32::INFINITY),
            Just(3e38),
            Just(1.0)
        ]);
        prop::collection::vec(prop_oneof![4 => small, 4 => any, 1 => odd], 1..max)
    }

    proptest! {
        #[test]
        fn it_equals_all_pairs(queries in cloud(70), points in cloud(1500)) {
            let (mut scratch, mut found) = (NearestScratch::default(), Vec::new());
            in_tree(&queries, &points, &mut scratch, &mut found);
            prop_assert_eq!(found, nearest_scalar(&queries, &points));
        }
    }
}
