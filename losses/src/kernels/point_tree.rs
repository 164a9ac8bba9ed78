//! Points in a tree of boxes, to be asked for the one closest to a triangle.

use mesh_core::closest_weights;
use mesh_core::vector::{Vec3, add, dot, scale, sub};

/// Points in a leaf.
const LEAF: usize = 8;

/// Points in a tree of boxes.
#[derive(Clone, Debug, Default)]
pub struct PointTree {
    /// In the order of the tree's leaves, each with its place among all.
    points: Vec<(u32, Vec3)>,
    /// Depth first; the second child of an inner node is at `right`.
    nodes: Vec<Node>,
}

#[derive(Clone, Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    first: u32,
    last: u32,
    right: u32,
}

/// From a point to the closest of a triangle: that one's weights, the way from there to the point, and its square.
pub fn offset_to_triangle(corners: [Vec3; 3], p: Vec3) -> (Vec3, Vec3, f64) {
    let weights = closest_weights(corners, p);
    let [a, b, c] = [0, 1, 2].map(|k| scale(corners[k], weights[k]));
    let away = sub(p, add(a, add(b, c)));
    (weights, away, dot(away, away))
}

impl PointTree {
    /// Builds the tree, `O(P log P)`. Points with coordinates that are not finite are left out.
    pub fn new(points: impl IntoIterator<Item = Vec3>) -> Self {
        let named = points.into_iter().enumerate().map(|(i, p)| (i as u32, p));
        let mut points: Vec<_> = named.filter(|(_, p)| p.iter().all(|x| x.is_finite())).collect();
        let mut nodes = Vec::new();
        if !points.is_empty() {
            grow(&mut points, 0, &mut nodes);
        }
        Self { points, nodes }
    }

    /// The point closest to a triangle, of equally close ones the first; none without points, or if a corner is not
    /// finite.
    pub fn closest_to(&self, corners: [Vec3; 3]) -> Option<u32> {
        if self.nodes.is_empty() || !corners.iter().flatten().all(|x| x.is_finite()) {
            return None;
        }
        let low = [0, 1, 2].map(|k| corners.iter().fold(f64::INFINITY, |low, p| low.min(p[k])));
        let high =
            [0, 1, 2].map(|k| corners.iter().fold(f64::NEG_INFINITY, |high, p| high.max(p[k])));
        // No point in a node's box is closer to the triangle than that box is to the triangle's.
        let bound = |node: &Node| -> f64 {
            (0..3)
                .map(|k| (node.low[k] - high[k]).max(low[k] - node.high[k]).max(0.0).powi(2))
                .sum()
        };
        let mut best = (f64::INFINITY, u32::MAX);
        let mut open = vec![(bound(&self.nodes[0]), 0_usize)];
        while let Some((least, index)) = open.pop() {
            if least > best.0 {
                continue;
            }
            let node = &self.nodes[index];
            for &(name, p) in &self.points[node.first as usize..node.last as usize] {
                let (_, _, squared) = offset_to_triangle(corners, p);
                if squared < best.0 || (squared == best.0 && name < best.1) {
                    best = (squared, name);
                }
            }
            if node.first == node.last {
                let mut next = [index + 1, node.right as usize].map(|i| (bound(&self.nodes[i]), i));
                // The nearer one is looked at first: it is pushed last.
                if next[0].0 < next[1].0 {
                    next.swap(0, 1);
                }
                open.extend(next);
            }
        }
        (best.1 != u32::MAX).then_some(best.1)
    }
}

fn grow(points: &mut [(u32, Vec3)], start: usize, nodes: &mut Vec<Node>) {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for (_, p) in &*points {
        for k in 0..3 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    let node = nodes.len();
    let last = if points.len() <= LEAF { start + points.len() } else { start };
    nodes.push(Node { low, high, first: start as u32, last: last as u32, right: 0 });
    if points.len() > LEAF {
        let longer = |&i: &usize, &j: &usize| (high[i] - low[i]).total_cmp(&(high[j] - low[j]));
        let axis = (0..3).max_by(longer).unwrap_or(0);
        let half = points.len() / 2;
        points.select_nth_unstable_by(half, |a, b| {
            a.1[axis].total_cmp(&b.1[axis]).then(a.0.cmp(&b.0))
        });
        let (left, right) = points.split_at_mut(half);
        grow(left, start, nodes);
        nodes[node].right = nodes.len() as u32;
        grow(right, start + half, nodes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn place() -> impl Strategy<Value = Vec3> {
        [-2i8..3, -2i8..3, -2i8..3].prop_map(|p| p.map(|x| f64::from(x) / 2.0))
    }

    proptest! {
        /// Coarse coordinates, so that there are ties, triangles without area and points on them.
        #[test]
        fn as_looking_at_all_of_them(
            points in proptest::collection::vec(place(), 1..60),
            corners in [place(), place(), place()],
        ) {
            let squares: Vec<f64> = points.iter().map(|&p| offset_to_triangle(corners, p).2).collect();
            let least = squares.iter().copied().fold(f64::INFINITY, f64::min);
            let expected = squares.iter().position(|&s| s == least).map(|i| i as u32);
            prop_assert_eq!(PointTree::new(points).closest_to(corners), expected);
        }
    }

    #[test]
    fn what_is_not_finite_is_nowhere() {
        let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let points = [[f64::NAN; 3], [0.0, 0.0, 4.0], [f64::INFINITY, 0.0, 0.0]];
        assert_eq!(PointTree::new(points).closest_to(corners), Some(1));
        assert_eq!(PointTree::new(points).closest_to([[f64::NAN; 3]; 3]), None);
        assert_eq!(PointTree::default().closest_to(corners), None);
    }
}
