//! The least cut of a graph between two terminals, by augmenting paths of two growing trees.
//!
//! The algorithm is that of Boykov and Kolmogorov, "An experimental comparison of min-cut/max-flow algorithms for energy
//! minimization in vision", TPAMI 26(9), 2004, with the distances of section 3.2.4 of Kolmogorov's thesis that keep trees
//! shallow. Capacities are whole numbers, so that the cut is exact and the same everywhere.

use std::collections::VecDeque;

/// No arc: a node without a parent.
const NONE: u32 = u32::MAX;
/// In place of an arc: the parent is the terminal itself.
const TERMINAL: u32 = u32::MAX - 1;
/// In place of an arc: the parent was cut off, and another is being looked for.
const ORPHAN: u32 = u32::MAX - 2;

#[derive(Clone, Debug)]
struct Node {
    /// The first of its arcs.
    first: u32,
    /// The arc that leads to its parent, or what stands in its place.
    parent: u32,
    /// When `distance` was known to be right.
    stamp: u32,
    /// Steps to the terminal.
    distance: u32,
    in_sink: bool,
    queued: bool,
    /// What is left from the source, above zero, or to the sink, below.
    terminal: i64,
}

#[derive(Clone, Debug)]
struct Arc {
    head: u32,
    next: u32,
    left: i64,
}

/// A graph whose arcs come in pairs of opposite direction.
#[derive(Clone, Debug)]
pub(super) struct Graph {
    nodes: Vec<Node>,
    arcs: Vec<Arc>,
    active: VecDeque<u32>,
    orphans: VecDeque<u32>,
    time: u32,
}

impl Graph {
    /// So many nodes without arcs.
    pub(super) fn new(count: usize, arcs: usize) -> Self {
        let node = Node {
            first: NONE,
            parent: NONE,
            stamp: 0,
            distance: 0,
            in_sink: false,
            queued: false,
            terminal: 0,
        };
        Self {
            nodes: vec![node; count],
            arcs: Vec::with_capacity(2 * arcs),
            active: VecDeque::new(),
            orphans: VecDeque::new(),
            time: 0,
        }
    }

    /// Adds to what it costs to part a node from the source, above zero, or from the sink, below.
    pub(super) fn incline(&mut self, node: usize, toward_source: i64) {
        self.nodes[node].terminal += toward_source;
    }

    /// Adds what it costs to part two nodes, whichever is on which side.
    pub(super) fn join(&mut self, a: usize, b: usize, cost: i64) {
        for (from, to) in [(a, b), (b, a)] {
            let next = self.nodes[from].first;
            self.nodes[from].first = self.arcs.len() as u32;
            self.arcs.push(Arc { head: to as u32, next, left: cost });
        }
    }

    /// For each node whether it is on the source's side of the least cut; a node that may be on either is not.
    pub(super) fn cut(mut self) -> Vec<bool> {
        for k in 0..self.nodes.len() {
            let node = &mut self.nodes[k];
            if node.terminal != 0 {
                node.in_sink = node.terminal < 0;
                node.parent = TERMINAL;
                node.distance = 1;
                self.activate(k as u32);
            }
        }
        while let Some(&node) = self.active.front() {
            let found =
                if self.nodes[node as usize].parent == NONE { None } else { self.grow(node) };
            if let Some(bridge) = found {
                // The node stays in front: it may have more.
                self.time += 1;
                self.augment(bridge);
                while let Some(orphan) = self.orphans.pop_front() {
                    self.adopt(orphan);
                }
            } else {
                self.active.pop_front();
                self.nodes[node as usize].queued = false;
            }
        }
        self.nodes.iter().map(|node| node.parent != NONE && !node.in_sink).collect()
    }

    fn activate(&mut self, node: u32) {
        let entry = &mut self.nodes[node as usize];
        if !entry.queued {
            entry.queued = true;
            self.active.push_back(node);
        }
    }

    /// What can still flow along an arc away from the source's terminal or toward the sink's.
    fn left(&self, arc: u32, in_sink: bool) -> i64 {
        self.arcs[(if in_sink { arc ^ 1 } else { arc }) as usize].left
    }

    /// Takes the free neighbours of a node into its tree; an arc that leads from the source's tree to the sink's, if there is one.
    fn grow(&mut self, at: u32) -> Option<u32> {
        let (in_sink, stamp, distance) = {
            let node = &self.nodes[at as usize];
            (node.in_sink, node.stamp, node.distance)
        };
        let mut arc = self.nodes[at as usize].first;
        while arc != NONE {
            let Arc { head, next, .. } = self.arcs[arc as usize];
            if self.left(arc, in_sink) > 0 {
                let near = &mut self.nodes[head as usize];
                if near.parent == NONE {
                    near.in_sink = in_sink;
                    near.parent = arc ^ 1;
                    near.stamp = stamp;
                    near.distance = distance + 1;
                    self.activate(head);
                } else if near.in_sink != in_sink {
                    return Some(if in_sink { arc ^ 1 } else { arc });
                } else if near.stamp <= stamp && near.distance > distance {
                    near.parent = arc ^ 1;
                    near.stamp = stamp;
                    near.distance = distance + 1;
                }
            }
            arc = next;
        }
        None
    }

    /// Sends what fits along the path through an arc between the trees.
    fn augment(&mut self, bridge: u32) {
        let mut flow = self.arcs[bridge as usize].left;
        let ends = [self.arcs[(bridge ^ 1) as usize].head, self.arcs[bridge as usize].head];
        for (end, in_sink) in ends.into_iter().zip([false, true]) {
            let mut at = end;
            while self.nodes[at as usize].parent != TERMINAL {
                let parent = self.nodes[at as usize].parent;
                // Toward the child in the source's tree, toward the parent in the sink's.
                flow = flow.min(self.left(parent ^ 1, in_sink));
                at = self.arcs[parent as usize].head;
            }
            flow = flow.min(self.nodes[at as usize].terminal.abs());
        }
        self.arcs[bridge as usize].left -= flow;
        self.arcs[(bridge ^ 1) as usize].left += flow;
        for (end, in_sink) in ends.into_iter().zip([false, true]) {
            let mut at = end;
            while self.nodes[at as usize].parent != TERMINAL {
                let parent = self.nodes[at as usize].parent;
                let along = if in_sink { parent } else { parent ^ 1 };
                self.arcs[along as usize].left -= flow;
                self.arcs[(along ^ 1) as usize].left += flow;
                if self.arcs[along as usize].left == 0 {
                    self.nodes[at as usize].parent = ORPHAN;
                    self.orphans.push_back(at);
                }
                at = self.arcs[parent as usize].head;
            }
            let root = &mut self.nodes[at as usize];
            root.terminal -= if in_sink { -flow } else { flow };
            if root.terminal == 0 {
                root.parent = ORPHAN;
                self.orphans.push_back(at);
            }
        }
    }

    /// Steps from a node to its terminal; `None` where an orphan lies between.
    fn distance(&mut self, from: u32) -> Option<u32> {
        let (mut at, mut steps) = (from, 0);
        loop {
            let node = &self.nodes[at as usize];
            if node.stamp == self.time && node.parent < ORPHAN {
                steps += node.distance;
                break;
            }
            match node.parent {
                TERMINAL => {
                    steps += 1;
                    break;
                }
                ORPHAN | NONE => return None,
                parent => at = self.arcs[parent as usize].head,
            }
            steps += 1;
        }
        // What was found holds for all on the way.
        let (mut at, mut left) = (from, steps);
        while self.nodes[at as usize].stamp != self.time {
            let node = &mut self.nodes[at as usize];
            node.stamp = self.time;
            node.distance = left;
            if node.parent == TERMINAL {
                break;
            }
            left -= 1;
            at = self.arcs[node.parent as usize].head;
        }
        Some(steps)
    }

    /// Finds the nearest new parent of an orphan, or sets it and its children free.
    fn adopt(&mut self, orphan: u32) {
        let in_sink = self.nodes[orphan as usize].in_sink;
        let mut best = (u32::MAX, NONE);
        let mut arc = self.nodes[orphan as usize].first;
        while arc != NONE {
            let Arc { head, next, .. } = self.arcs[arc as usize];
            let near = &self.nodes[head as usize];
            if near.in_sink == in_sink
                && near.parent != NONE
                && self.left(arc ^ 1, in_sink) > 0
                && let Some(steps) = self.distance(head)
                && steps < best.0
            {
                best = (steps, arc);
            }
            arc = next;
        }
        if best.1 != NONE {
            let node = &mut self.nodes[orphan as usize];
            node.parent = best.1;
            node.stamp = self.time;
            node.distance = best.0 + 1;
            return;
        }
        let mut arc = self.nodes[orphan as usize].first;
        while arc != NONE {
            let Arc { head, next, .. } = self.arcs[arc as usize];
            let near = &self.nodes[head as usize];
            if near.in_sink == in_sink && near.parent != NONE {
                let parent = near.parent;
                if self.left(arc ^ 1, in_sink) > 0 {
                    self.activate(head);
                }
                if parent < ORPHAN && self.arcs[parent as usize].head == orphan {
                    self.nodes[head as usize].parent = ORPHAN;
                    self.orphans.push_back(head);
                }
            }
            arc = next;
        }
        self.nodes[orphan as usize].parent = NONE;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn cost(sides: &[bool], inclined: &[i64], joined: &[(usize, usize, i64)]) -> i64 {
        let alone: i64 = sides
            .iter()
            .zip(inclined)
            .map(|(&source, &toward)| if source { (-toward).max(0) } else { toward.max(0) })
            .sum();
        alone + joined.iter().filter(|j| sides[j.0] != sides[j.1]).map(|j| j.2).sum::<i64>()
    }

    #[test]
    fn a_chain_is_cut_at_its_weakest_link() {
        let mut graph = Graph::new(5, 4);
        graph.incline(0, 100);
        graph.incline(4, -100);
        for (k, cost) in [7, 5, 2, 6].into_iter().enumerate() {
            graph.join(k, k + 1, cost);
        }
        assert_eq!(graph.cut(), [true, true, true, false, false]);
        assert!(Graph::new(0, 0).cut().is_empty());
        assert_eq!(Graph::new(2, 0).cut(), [false; 2]);
    }

    proptest! {
        /// No other way to part ten nodes costs less.
        #[test]
        fn the_cut_is_the_least(
            inclined in prop::collection::vec(-20i64..20, 10),
            joined in prop::collection::vec((0usize..10, 0usize..10, 0i64..12), 0..40),
        ) {
            let joined: Vec<_> = joined.into_iter().filter(|j| j.0 != j.1).collect();
            let mut graph = Graph::new(10, joined.len());
            inclined.iter().enumerate().for_each(|(k, &toward)| graph.incline(k, toward));
            for &(a, b, cost) in &joined {
                graph.join(a, b, cost);
            }
            let found = cost(&graph.cut(), &inclined, &joined);
            let least = (0..1u32 << 10).map(|bits| {
                let sides: Vec<bool> = (0..10).map(|k| bits >> k & 1 == 1).collect();
                cost(&sides, &inclined, &joined)
            });
            prop_assert_eq!(found, least.min().unwrap_or(0));
        }
    }
}
