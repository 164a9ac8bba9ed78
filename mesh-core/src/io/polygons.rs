//! Polygons of more than three corners, in triangles.
//!
//! Readers make a fan of each polygon as its corners come, since files may name vertices before they give them. Of a polygon that is not
//! convex a fan covers what is outside of it; when the vertices are known, its ears are cut off one by one instead.

use std::ops::Range;

use crate::vector::{add, cross, sub, widen};
use crate::{Budget, OverLimit};

/// Polygons of more corners stay fans: the time grows with the square of their number.
const MOST: usize = 1024;
/// A triangle is turned over if its area is below that of the polygon by this factor, and negative.
const FLAT: f64 = 1e-9;

/// The fans of more than one triangle.
#[derive(Default)]
pub(super) struct Polygons {
    /// The first triangle of each, and the one after the last.
    fans: Vec<[usize; 2]>,
}

impl Polygons {
    /// The triangles in `faces` are the fan of a polygon, from its first corner on.
    pub(super) fn note(
        &mut self,
        faces: Range<usize>,
        budget: &mut Budget,
    ) -> Result<(), OverLimit> {
        if (2..=MOST - 2).contains(&faces.len()) {
            budget.push(&mut self.fans, [faces.start, faces.end])?;
        }
        Ok(())
    }

    /// Makes other triangles, as many, of each polygon that is not convex. What `others` holds of the same triangles, one row each, is
    /// put in the same order.
    pub(super) fn cut<T: Copy>(
        self,
        positions: &[[f32; 3]],
        faces: &mut [[u32; 3]],
        others: Option<&mut [[T; 3]]>,
    ) {
        let mut others = others;
        for [first, end] in self.fans {
            let fan = &mut faces[first..end];
            let corners: Vec<[f64; 3]> =
                corners(fan).iter().map(|&v| widen(positions[v as usize])).collect();
            let Some(triangles) = triangulated(&corners) else { continue };
            reorder(fan, &triangles);
            if let Some(rows) = others.as_deref_mut() {
                reorder(&mut rows[first..end], &triangles);
            }
        }
    }
}

/// The corners that a fan goes through.
fn corners<T: Copy>(fan: &[[T; 3]]) -> Vec<T> {
    fan[0][..2].iter().copied().chain(fan.iter().map(|triangle| triangle[2])).collect()
}

/// The rows of a fan for other triangles of the same corners.
fn reorder<T: Copy>(fan: &mut [[T; 3]], triangles: &[[usize; 3]]) {
    let corners = corners(fan);
    for (row, triangle) in fan.iter_mut().zip(triangles) {
        *row = triangle.map(|k| corners[k]);
    }
}

/// Triangles of a polygon whose fan from the first corner leaves it; `None` where that fan will do, or no triangles are found, as of one
/// that crosses itself.
fn triangulated(corners: &[[f64; 3]]) -> Option<Vec<[usize; 3]>> {
    let flat = flattened(corners);
    let fan = 1..flat.len() - 1;
    let areas: Vec<f64> = fan.map(|k| area(flat[0], flat[k], flat[k + 1])).collect();
    let whole: f64 = areas.iter().sum();
    let is_turned = areas.iter().any(|&area| area < -FLAT * whole);
    (whole > 0.0 && is_turned).then(|| Ears::new(&flat).cut())?
}

/// The polygon seen from where it looks to most, of the three axes: counter-clockwise.
fn flattened(corners: &[[f64; 3]]) -> Vec<[f64; 2]> {
    // Newell's normal: twice the area vector.
    let normal = (1..corners.len() - 1).fold([0.0; 3], |sum, k| {
        add(sum, cross(sub(corners[k], corners[0]), sub(corners[k + 1], corners[0])))
    });
    let larger = |a: usize, b: usize| if normal[b].abs() > normal[a].abs() { b } else { a };
    let axis = larger(larger(0, 1), 2);
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let (u, v) = if normal[axis] < 0.0 { (v, u) } else { (u, v) };
    corners.iter().map(|p| [p[u], p[v]]).collect()
}

/// Twice the area of a triangle, positive counter-clockwise.
fn area(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// A polygon in the plane, of which ears are cut off: triangles of three corners in a row with no other corner in them.
struct Ears<'a> {
    corners: &'a [[f64; 2]],
    /// The corner after each and before each, among those that are left.
    next: Vec<usize>,
    previous: Vec<usize>,
    is_ear: Vec<bool>,
}

impl<'a> Ears<'a> {
    fn new(corners: &'a [[f64; 2]]) -> Self {
        let n = corners.len();
        let next = (0..n).map(|k| (k + 1) % n).collect();
        let previous = (0..n).map(|k| (k + n - 1) % n).collect();
        let mut ears = Self { corners, next, previous, is_ear: Vec::new() };
        ears.is_ear = (0..n).map(|k| ears.has_ear(k)).collect();
        ears
    }

    fn around(&self, k: usize) -> [usize; 3] {
        [self.previous[k], k, self.next[k]]
    }

    fn area(&self, k: usize) -> f64 {
        let [a, b, c] = self.around(k).map(|k| self.corners[k]);
        area(a, b, c)
    }

    fn has_ear(&self, k: usize) -> bool {
        let around = self.around(k);
        let [a, b, c] = around.map(|k| self.corners[k]);
        if area(a, b, c) <= 0.0 {
            return false;
        }
        let mut other = self.next[around[2]];
        while other != around[0] {
            let p = self.corners[other];
            // Of a polygon with a hole, that a cut leads to, corners lie on one another.
            let inside = ![a, b, c].contains(&p)
                && area(a, b, p) >= 0.0
                && area(b, c, p) >= 0.0
                && area(c, a, p) >= 0.0;
            // If any corner is inside, one is at which the polygon turns back.
            if inside && self.area(other) <= 0.0 {
                return false;
            }
            other = self.next[other];
        }
        true
    }

    /// Nothing where no ear is left before the end.
    fn cut(mut self) -> Option<Vec<[usize; 3]>> {
        let count = self.corners.len() - 2;
        let mut triangles = Vec::with_capacity(count);
        let mut at = 0;
        while triangles.len() < count {
            let left = self.corners.len() - triangles.len();
            // What lies on a line is cut off when nothing else is: a triangle without area.
            let tip = self.find(at, left, |ears, k| ears.is_ear[k]);
            let tip = tip.or_else(|| self.find(at, left, |ears, k| ears.area(k) == 0.0))?;
            let [before, _, after] = self.around(tip);
            triangles.push([before, tip, after]);
            self.next[before] = after;
            self.previous[after] = before;
            for k in [before, after] {
                self.is_ear[k] = self.has_ear(k);
            }
            at = after;
        }
        Some(triangles)
    }

    /// The first of the corners that are left, from `at` on.
    fn find(
        &self,
        at: usize,
        left: usize,
        is_wanted: impl Fn(&Self, usize) -> bool,
    ) -> Option<usize> {
        let mut k = at;
        for _ in 0..left {
            if is_wanted(self, k) {
                return Some(k);
            }
            k = self.next[k];
        }
        None
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    /// The triangles of a polygon in the plane z = 1, after its fan was looked at.
    fn cut(corners: &[[f32; 2]]) -> Vec<[u32; 3]> {
        let positions: Vec<[f32; 3]> = corners.iter().map(|&[x, y]| [x, y, 1.0]).collect();
        let mut faces: Vec<[u32; 3]> =
            (1..corners.len() as u32 - 1).map(|k| [0, k, k + 1]).collect();
        let mut polygons = Polygons::default();
        let mut budget = crate::Limits::default().budget(0);
        polygons.note(0..faces.len(), &mut budget).unwrap();
        let mut others: Vec<[f32; 3]> = faces.iter().map(|f| f.map(|v| v as f32)).collect();
        polygons.cut(&positions, &mut faces, Some(&mut others));
        assert!(faces.iter().zip(&others).all(|(a, b)| a.map(|v| v as f32) == *b));
        faces
    }

    /// Areas, which add up to that of the polygon only if nothing is outside of it, where all have its sign.
    fn areas(corners: &[[f32; 2]]) -> Vec<f64> {
        let at = |v: u32| corners[v as usize].map(f64::from);
        cut(corners).iter().map(|&[a, b, c]| 0.5 * area(at(a), at(b), at(c))).collect()
    }

    /// By hand: an arrow, an L, a comb, and a frame whose hole a cut leads to; either way round.
    #[test]
    fn no_triangle_leaves_a_polygon_that_is_not_convex() {
        let arrow = [[0.0, 0.0], [2.0, 1.0], [0.0, 2.0], [0.5, 1.0]];
        let shapes: [(&[[f32; 2]], f64); 4] = [
            (&arrow, 1.5),
            (&[[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]], 4.0),
            (
                &[
                    [0.0, 0.0],
                    [5.0, 0.0],
                    [5.0, 3.0],
                    [4.0, 3.0],
                    [4.0, 1.0],
                    [3.0, 1.0],
                    [3.0, 3.0],
                    [2.0, 3.0],
                    [2.0, 1.0],
                    [1.0, 1.0],
                    [1.0, 3.0],
                    [0.0, 3.0],
                ],
                11.0,
            ),
            (
                &[
                    [0.0, 0.0],
                    [3.0, 0.0],
                    [3.0, 3.0],
                    [0.0, 3.0],
                    [0.0, 0.0],
                    [1.0, 1.0],
                    [1.0, 2.0],
                    [2.0, 2.0],
                    [2.0, 1.0],
                    [1.0, 1.0],
                ],
                8.0,
            ),
        ];
        for (corners, expected) in shapes {
            for turn in 0..corners.len() {
                let mut turned = corners.to_vec();
                turned.rotate_left(turn);
                for sign in [1.0, -1.0] {
                    let found = areas(&turned);
                    assert_eq!(found.len(), corners.len() - 2);
                    assert!(found.iter().all(|area| sign * area >= 0.0), "{turned:?}: {found:?}");
                    let sum: f64 = found.iter().sum();
                    assert!((sum - sign * expected).abs() < 1e-9, "{turned:?}: {sum}");
                    turned.reverse();
                }
            }
        }
    }

    #[test]
    fn convex_and_crossing_ones_stay_fans() {
        let fan = [[0, 1, 2], [0, 2, 3]];
        assert_eq!(cut(&[[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]), fan);
        // On a line, and a bow tie.
        assert_eq!(cut(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]), fan);
        assert_eq!(cut(&[[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0]]), fan);
        let pentagram: Vec<[f32; 2]> =
            (0..5).map(|k| (2.513 * k as f32).sin_cos()).map(|(x, y)| [x, y]).collect();
        assert_eq!(cut(&pentagram).len(), 3);
        assert_eq!(cut(&[[0.0, f32::MAX], [f32::MAX, 0.0], [0.0, -f32::MAX], [0.0, 0.0]]).len(), 2);
    }

    /// A saw of many teeth is done in no time, and one of more stays as it is.
    #[test]
    fn many_corners_take_the_square_of_their_number_at_most() {
        let saw = |teeth: usize| -> Vec<[f32; 2]> {
            let upper = (0..teeth).flat_map(|k| {
                let x = (teeth - k) as f32;
                [[x, 1.0], [x - 0.5, 0.1]]
            });
            [[0.0, 0.0], [teeth as f32, 0.0]].into_iter().chain(upper).collect()
        };
        let found = areas(&saw(500));
        assert!(found.iter().all(|&area| area >= 0.0));
        assert!(areas(&saw(600)).iter().any(|&area| area < 0.0));
    }
}
