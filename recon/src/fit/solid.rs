//! Which points of the lattice are the object, and how many holes it has.
//!
//! The hull as the lattice has it is full of accidents: pinholes where a sheet is thinner than a step, parts that touch where
//! masks leave no pixel between them, specks. What is real persists: a tunnel is one that stays open when the hull swells by
//! some steps (it closes at the distance up to which views see through it), and a part is one without which some
//! pixel of a mask shows nothing.

use std::collections::BinaryHeap;
use std::ops::Range;

use super::{kuhn::Links, lattice::Lattice, target::Target};

/// Points no further outside than this, in steps or in pixels, whichever are wider, are inside: a sheet between two layers of points
/// is not lost, nor one that masks show a little too thin.
const SKIN: f32 = 0.3;
/// A tunnel that is nowhere further than this from the hull is none.
const TUNNEL: f32 = 1.5;
/// Two parts nowhere further than this apart are one.
const GAP: f32 = 0.75;
/// A part that alone covers so many pixels of a mask is one, if they are such a share of the mask.
const PIXELS: (usize, f32) = (6, 4e-4);

/// The points inside.
#[derive(Clone, Debug)]
pub(super) struct Solid {
    /// One for each point of the lattice; none on its border.
    pub(super) inside: Vec<bool>,
    /// Parts.
    pub(super) components: usize,
    /// Holes through them: handles of their surface.
    pub(super) genus: usize,
}

impl Solid {
    /// The object in a lattice, as `targets` show it, if there are any; `None` where there is nothing.
    pub(super) fn of(lattice: &Lattice, targets: &[Target]) -> Option<Self> {
        let links = Links::new();
        let width = SKIN * (lattice.pixel / lattice.step).max(1.0);
        let mut hull = vec![false; lattice.distance.len()];
        for slot in lattice.inner_rows().flatten() {
            hull[slot] = lattice.distance[slot] < width;
        }
        fill_cavities(lattice, &mut hull);
        let parts = Parts::of(lattice, &hull);
        let needed = parts.needed(lattice, targets);
        for (slot, inside) in hull.iter_mut().enumerate() {
            *inside &= parts.of[slot] != 0 && needed[parts.of[slot] as usize];
        }
        // The swollen hull, of which what is not needed is taken off again without a change of topology.
        let mut solid = hull.clone();
        for slot in lattice.inner_rows().flatten() {
            solid[slot] |= lattice.agreed[slot] < TUNNEL && lattice.distance[slot] < 4.0 * TUNNEL;
        }
        fill_cavities(lattice, &mut solid);
        shrink(lattice, &links, &mut solid, &hull);
        cut_bridges(lattice, &links, &mut solid, &hull);
        // Again, since where a bridge was is room.
        shrink(lattice, &links, &mut solid, &hull);
        let parts = Parts::of(lattice, &solid);
        let mut holds = vec![false; parts.count + 1];
        for slot in (0..hull.len()).filter(|&s| hull[s]) {
            holds[parts.of[slot] as usize] = true;
        }
        for (slot, inside) in solid.iter_mut().enumerate() {
            *inside &= holds[parts.of[slot] as usize];
        }
        let components = holds[1..].iter().filter(|h| **h).count();
        let euler = euler_number(lattice, &links, &solid);
        // Without cavities: components less tunnels.
        let genus = usize::try_from(components as i64 - euler).ok()?;
        (components > 0).then_some(Self { inside: solid, components, genus })
    }
}

/// The neighbours of a point that are in a set, a bit each.
fn neighbors(set: &[bool], strides: &[isize; 14], slot: usize) -> u16 {
    strides
        .iter()
        .enumerate()
        .fold(0, |bits, (i, step)| bits | u16::from(set[slot.wrapping_add_signed(*step)]) << i)
}

/// Adds all that cannot be reached from the border, of which nothing may be in the set.
fn fill_cavities(lattice: &Lattice, inside: &mut [bool]) {
    let runs = Runs::of(lattice, inside);
    for (run, range) in runs.ranges.iter().enumerate() {
        if runs.root(run as u32) != 0 {
            inside[range.clone()].fill(true);
        }
    }
}

/// Takes off points outside of `kept`, the furthest from the hull first, as long as that changes no topology.
fn shrink(lattice: &Lattice, links: &Links, solid: &mut [bool], kept: &[bool]) {
    let strides = lattice.strides();
    // Positive numbers are in the order of their bits; of equals the first point.
    let key = |slot: usize| {
        u64::from(lattice.distance[slot].max(0.0).to_bits()) << 32 | u64::from(!(slot as u32))
    };
    let mut waiting: Vec<bool> = solid.iter().zip(kept).map(|(&s, &k)| s && !k).collect();
    let mut queue: BinaryHeap<u64> = (0..solid.len()).filter(|&s| waiting[s]).map(key).collect();
    while let Some(key_of) = queue.pop() {
        let slot = !(key_of as u32) as usize;
        waiting[slot] = false;
        if !links.is_simple(neighbors(solid, &strides, slot)) {
            continue;
        }
        solid[slot] = false;
        for step in strides {
            let next = slot.wrapping_add_signed(step);
            if solid[next] && !kept[next] && !waiting[next] {
                waiting[next] = true;
                queue.push(key(next));
            }
        }
    }
}

/// Takes off what joins parts of the hull that are apart; what closes a tunnel stays.
fn cut_bridges(lattice: &Lattice, links: &Links, solid: &mut [bool], hull: &[bool]) {
    let strides = lattice.strides();
    let added: Vec<bool> = solid.iter().zip(hull).map(|(&s, &h)| s && !h).collect();
    let parts = Parts::of(lattice, &added);
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); parts.count + 1];
    for slot in (0..added.len()).filter(|&s| added[s]) {
        members[parts.of[slot] as usize].push(slot);
    }
    for part in &members[1..] {
        let widest = part.iter().map(|&s| lattice.distance[s]).fold(0.0, f32::max);
        let mut lost = 0;
        for &slot in part {
            lost += links.euler_with(neighbors(solid, &strides, slot));
            solid[slot] = false;
        }
        // The Euler number falls where a tunnel opens.
        if lost > 0 || widest < GAP {
            for &slot in part {
                solid[slot] = true;
            }
        }
    }
}

fn euler_number(lattice: &Lattice, links: &Links, solid: &[bool]) -> i64 {
    let strides = lattice.strides();
    // Point by point: each with those that were there before.
    let mut there = vec![false; solid.len()];
    let mut sum = 0;
    for slot in (0..solid.len()).filter(|&s| solid[s]) {
        sum += links.euler_with(neighbors(&there, &strides, slot));
        there[slot] = true;
    }
    sum
}

/// What is not in a set, in runs along the first axis, joined where they meet: a box of air is as many runs as it has rows.
struct Runs {
    ranges: Vec<Range<usize>>,
    /// A run that each is joined to, one before it; itself if there is none.
    parents: Vec<u32>,
}

impl Runs {
    fn of(lattice: &Lattice, set: &[bool]) -> Self {
        let [nx, ny, nz] = lattice.dims;
        let mut runs = Self { ranges: Vec::new(), parents: Vec::new() };
        let mut starts = vec![0];
        for row in 0..ny * nz {
            let (first, end) = (row * nx, (row + 1) * nx);
            let mut at = first;
            while let Some(start) = (at..end).find(|&s| !set[s]) {
                at = (start..end).find(|&s| set[s]).unwrap_or(end);
                let run = runs.ranges.len() as u32;
                runs.ranges.push(start..at);
                runs.parents.push(run);
                // The border is one.
                let (y, z) = (row % ny, row / ny);
                let outermost = |i: usize, n: usize| i == 0 || i + 1 == n;
                if start == first || at == end || outermost(y, ny) || outermost(z, nz) {
                    runs.join(run, 0);
                }
            }
            starts.push(runs.ranges.len());
        }
        for (y, z) in (0..nz).flat_map(|z| (0..ny).map(move |y| (y, z))) {
            let row = z * ny + y;
            for (dy, dz) in [(1, 0), (0, 1), (1, 1)] {
                if y + dy < ny && z + dz < nz {
                    let next = row + dz * ny + dy;
                    let both = [row, next].map(|row| starts[row]..starts[row + 1]);
                    runs.join_rows(both, (next - row) * nx);
                }
            }
        }
        runs
    }

    /// Joins the runs of two rows, whose points are this far apart, where they meet: at steps of no and of one point along the row.
    fn join_rows(&mut self, [here, there]: [Range<usize>; 2], apart: usize) {
        let (mut a, mut b) = (here.start, there.start);
        while a < here.end && b < there.end {
            let (from, to) = (self.ranges[a].clone(), self.ranges[b].clone());
            let (start, end) = (from.start + apart, from.end + apart + 1);
            if start < to.end && to.start < end {
                self.join(a as u32, b as u32);
            }
            if end <= to.end { a += 1 } else { b += 1 }
        }
    }

    /// The first run of those that a run is joined to.
    fn root(&self, mut run: u32) -> u32 {
        while self.parents[run as usize] != run {
            run = self.parents[run as usize];
        }
        run
    }

    fn join(&mut self, a: u32, b: u32) {
        let [a, b] = [a, b].map(|run| {
            let root = self.root(run);
            self.parents[run as usize] = root;
            root
        });
        self.parents[a.max(b) as usize] = a.min(b);
    }
}

/// The connected parts of a set.
struct Parts {
    /// For each point the number of its part, from 1 on; 0 outside.
    of: Vec<u32>,
    count: usize,
}

impl Parts {
    fn of(lattice: &Lattice, set: &[bool]) -> Self {
        let strides = lattice.strides();
        let mut of = vec![0; set.len()];
        let mut count = 0;
        let mut queue = Vec::new();
        for first in 0..set.len() {
            if !set[first] || of[first] != 0 {
                continue;
            }
            count += 1;
            of[first] = count;
            queue.push(first);
            while let Some(slot) = queue.pop() {
                for step in strides {
                    let next = slot.wrapping_add_signed(step);
                    if set[next] && of[next] == 0 {
                        of[next] = count;
                        queue.push(next);
                    }
                }
            }
        }
        Self { of, count: count as usize }
    }

    /// For each part whether it alone covers pixels of some mask; without masks each is.
    fn needed(&self, lattice: &Lattice, targets: &[Target]) -> Vec<bool> {
        if self.count <= 1 || targets.is_empty() {
            return vec![true; self.count + 1];
        }
        let strides = lattice.strides();
        let surface: Vec<usize> = (0..self.of.len())
            .filter(|&s| self.of[s] != 0)
            .filter(|&s| strides.iter().any(|d| self.of[s.wrapping_add_signed(*d)] == 0))
            .collect();
        let mut needed = vec![false; self.count + 1];
        for target in targets {
            let pixels = self.alone(lattice, target, &surface);
            let least = PIXELS.0.max((PIXELS.1 * target.mask_area() as f32) as usize);
            for (part, pixels) in pixels.into_iter().enumerate() {
                needed[part] |= part > 0 && pixels >= least;
            }
        }
        needed
    }

    /// How many pixels of a mask each part covers alone.
    fn alone(&self, lattice: &Lattice, target: &Target, surface: &[usize]) -> Vec<usize> {
        const SEVERAL: u32 = u32::MAX;
        let mut shown = vec![0; target.width * target.height];
        for &slot in surface {
            let seen @ [column, row, depth] = target.project(lattice.place(slot));
            if !target.is_before(seen) {
                continue;
            }
            // As wide as the points are apart, and a pixel at least.
            let reach = (0.6 * lattice.step * target.pixels_per_unit(depth)).max(0.7);
            let range = |at: f32, limit: usize| {
                let pixel = |x: f32| (x.max(0.0) as usize).min(limit);
                pixel((at - reach).floor())..pixel((at + reach).ceil())
            };
            for y in range(row, target.height) {
                for x in range(column, target.width) {
                    let shown = &mut shown[y * target.width + x];
                    *shown = match *shown {
                        0 => self.of[slot],
                        part if part == self.of[slot] => part,
                        _ => SEVERAL,
                    };
                }
            }
        }
        let mut pixels = vec![0; self.count + 1];
        for (pixel, &part) in shown.iter().enumerate() {
            if part != SEVERAL && target.in_mask(pixel) {
                pixels[part as usize] += 1;
            }
        }
        pixels
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::fit::skin::skin;

    /// A lattice of a function, in steps, around the origin.
    fn lattice(side: usize, distance: impl Fn([f32; 3]) -> f32) -> Lattice {
        let dims = [side, side + 3, side - 2];
        let origin = dims.map(|n| -0.5 * n as f32);
        let empty = Lattice {
            dims,
            origin,
            step: 1.0,
            pixel: 1.0,
            distance: Vec::new(),
            agreed: Vec::new(),
        };
        let distance: Vec<f32> =
            (0..dims.iter().product()).map(|slot| distance(empty.place(slot))).collect();
        Lattice { agreed: distance.clone(), distance, ..empty }
    }

    fn ring([x, y, z]: [f32; 3], major: f32, minor: f32) -> f32 {
        (x.hypot(y) - major).hypot(z) - minor
    }

    /// Holes and parts, and a surface that is as they say.
    fn found(lattice: &Lattice) -> (usize, usize) {
        let solid = Solid::of(lattice, &[]).unwrap();
        let mesh = skin(lattice, &solid.inside);
        let found = mesh.examined();
        assert!(found.is_solid(), "{found}");
        assert_eq!(found.health.genus(), Some(solid.genus));
        assert_eq!(found.health.components, solid.components);
        (solid.genus, solid.components)
    }

    #[test]
    fn what_persists_is_kept() {
        let ball = |p: [f32; 3], r: f32| p.iter().map(|x| x * x).sum::<f32>().sqrt() - r;
        assert_eq!(found(&lattice(24, |p| ball(p, 8.0))), (0, 1));
        assert_eq!(found(&lattice(30, |p| ring(p, 8.0, 3.0))), (1, 1));
        // The hole is narrower than the images can tell.
        assert_eq!(found(&lattice(30, |p| ring(p, 5.0, 4.2))), (0, 1));
        // A hollow is none that an outline shows.
        assert_eq!(found(&lattice(24, |p| ball(p, 8.0).max(-ball(p, 5.0)))), (0, 1));
        let two = |[x, y, z]: [f32; 3]| {
            ring([x - 4.3, y, z], 4.3, 1.5).min(ring([x + 4.3, y, z], 4.3, 1.5))
        };
        assert_eq!(found(&lattice(36, two)), (2, 1));
    }

    #[test]
    fn parts_close_together_stay_apart_and_a_thin_sheet_stays_whole() {
        // A gap of a step and a half between two slabs, which swelling closes.
        let slab = |[x, y, z]: [f32; 3], low: f32, high: f32| {
            (low - z).max(z - high).max(x.abs() - 8.0).max(y.abs() - 8.0)
        };
        // A slit that is open all around is no tunnel: no membrane stays in it.
        let comb = |p: [f32; 3]| {
            let back = (p[0] - 8.0).max(6.0 - p[0]).max(p[1].abs() - 8.0).max(p[2].abs() - 5.0);
            slab(p, -5.0, -1.3).min(slab(p, 1.3, 5.0)).min(back)
        };
        assert_eq!(found(&lattice(28, comb)), (0, 1));
        // Thinner than a step, and a little tilted, so that points miss it here and there.
        let sheet = |[x, y, z]: [f32; 3]| {
            let height = z + 0.11 * x + 0.07 * y;
            (height.abs() - 0.25).max(x.abs() - 9.0).max(y.abs() - 9.0)
        };
        assert_eq!(found(&lattice(30, sheet)), (0, 1));
    }
}
