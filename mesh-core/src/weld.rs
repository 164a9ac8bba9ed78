//! Vertices that are one, and those that no face uses.

use std::collections::HashMap;

use crate::TriMesh;
use crate::vector::{dot, sub, widen};

impl TriMesh {
    /// The mesh with vertices within `tolerance` of an earlier one made that one: what was cut apart at seams, or is the corners of
    /// triangles each on its own, is joined. 0 joins those at the same place.
    ///
    /// Faces that then name a vertex twice are left out. A vertex that is not finite stays as it is; any other keeps the place and
    /// the colour of the first; texture coordinates are those of faces and stay. Vertices of no face stay too.
    ///
    /// ```
    /// use mesh_core::{TriMesh, primitives};
    /// let ball = primitives::icosphere(1);
    /// // Each triangle with corners of its own, as programs write them that know no other.
    /// let corners = ball.faces.iter().flatten().map(|&v| ball.positions[v as usize]).collect();
    /// let soup = TriMesh::new(corners, (0..80).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect());
    /// assert_eq!(soup.health().boundary_edges, 240);
    /// let welded = soup.welded(0.0);
    /// assert!(welded.health().is_watertight());
    /// assert_eq!(welded.positions.len(), ball.positions.len());
    /// ```
    ///
    /// # Cost
    /// Linear, where few vertices are nearer to each other than 2^-40 of the largest coordinate.
    ///
    /// # Panics
    /// If `tolerance` is negative or not finite, or a face names a vertex that does not exist.
    #[must_use]
    pub fn welded(&self, tolerance: f32) -> Self {
        assert!(tolerance >= 0.0 && tolerance.is_finite(), "welded: tolerance {tolerance}");
        let tolerance = f64::from(tolerance);
        let largest = self.positions.iter().flatten().filter(|x| x.is_finite());
        let largest = largest.fold(0.0_f64, |most, &x| most.max(f64::from(x).abs()));
        // Cells as wide as the tolerance, but so that their numbers stay small.
        let cell = tolerance.max(largest * (-40.0_f64).exp2()).max(f64::MIN_POSITIVE);
        let mut first_of: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        let mut target: Vec<u32> = Vec::with_capacity(self.positions.len());
        for (v, &position) in (0..).zip(&self.positions) {
            let p = widen(position);
            if !p.iter().all(|x| x.is_finite()) {
                target.push(v); // in no cell
                continue;
            }
            let place = p.map(|x| (x / cell).floor() as i64);
            let near = (0..27).filter_map(|k| {
                let [x, y, z] = place;
                first_of.get(&[x + k / 9 - 1, y + k / 3 % 3 - 1, z + k % 3 - 1])
            });
            let is_one = |other: &&u32| {
                let away = sub(p, widen(self.positions[**other as usize]));
                dot(away, away) <= tolerance * tolerance
            };
            // Of several the first, whichever cell it is in.
            let first = near.flatten().filter(is_one).min().copied();
            if first.is_none() {
                first_of.entry(place).or_default().push(v);
            }
            target.push(first.unwrap_or(v));
        }
        let is_kept: Vec<bool> = (0..).zip(&target).map(|(v, &first)| v == first).collect();
        let mut welded = self.renamed(&target, &is_kept);
        let is_whole = |&[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
        if let Some(texture) = &mut welded.texture {
            let mut whole = welded.faces.iter().map(is_whole);
            texture.faces.retain(|_| whole.next().unwrap_or(true));
        }
        welded.faces.retain(is_whole);
        welded
    }

    /// The mesh without the vertices that no face uses. Faces stay what they are, by other numbers.
    ///
    /// # Panics
    /// If a face names a vertex that does not exist.
    #[must_use]
    pub fn without_unused_vertices(&self) -> Self {
        let is_used = self.used();
        let same: Vec<u32> = (0..self.positions.len() as u32).collect();
        self.renamed(&same, &is_used)
    }

    #[cfg(feature = "camera")]
    pub(crate) fn has_unused_vertices(&self) -> bool {
        self.used().contains(&false)
    }

    /// Whether a face uses a vertex.
    fn used(&self) -> Vec<bool> {
        let mut is_used = vec![false; self.positions.len()];
        for &v in self.faces.iter().flatten() {
            is_used[v as usize] = true;
        }
        is_used
    }

    /// Each vertex made another, which is kept.
    fn renamed(&self, target: &[u32], is_kept: &[bool]) -> Self {
        let mut number = vec![0_u32; target.len()];
        let kept = number.iter_mut().zip(is_kept).filter(|(_, kept)| **kept);
        for (count, (number, _)) in (0..).zip(kept) {
            *number = count;
        }
        let kept = |rows: &[[f32; 3]]| -> Vec<[f32; 3]> {
            rows.iter().zip(is_kept).filter(|(_, kept)| **kept).map(|(row, _)| *row).collect()
        };
        let name = |&v: &u32| number[target[v as usize] as usize];
        Self {
            positions: kept(&self.positions),
            faces: self.faces.iter().map(|face| face.each_ref().map(name)).collect(),
            colors: self.colors.as_deref().map(kept),
            texture: self.texture.clone(),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use crate::{Image, Texture, TriMesh, primitives};

    #[test]
    fn what_is_nearer_than_the_tolerance_is_one() {
        let positions = vec![
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [1.0, 1e-3, 0.0],
            [-0.0, 1.0, 0.0],
            [1.0, 1.0, 0.0],
            [f32::NAN; 3],
            [f32::INFINITY, f32::NEG_INFINITY, 0.0],
        ];
        let mut mesh = TriMesh::new(positions, vec![[0, 1, 2], [3, 5, 4], [1, 3, 5]]);
        mesh.colors = Some((0..8).map(|v| [v as f32 / 8.0; 3]).collect());
        let image = Image { height: 1, width: 1, channels: 3, data: vec![1.0; 3] };
        let faces = vec![[0; 3], [1; 3], [2; 3]];
        mesh.texture = Some(Texture { uvs: vec![[0.0; 2]; 3], faces, image });
        let same = mesh.welded(0.0);
        assert_eq!((same.positions.len(), &same.faces[1]), (7, &[3, 4, 2]));
        let near = mesh.welded(2e-3);
        assert_eq!(near.faces, [[0, 1, 2], [1, 3, 2]], "the third has no area any more");
        assert_eq!(near.texture.unwrap().faces, [[0; 3], [1; 3]]);
        assert_eq!(near.colors.unwrap()[3], [5.0 / 8.0; 3]);
        assert_eq!(TriMesh::default().welded(1.0), TriMesh::default());
        // Everything is one vertex, and no face is left.
        let ball = primitives::icosphere(2);
        let point = ball.welded(10.0);
        assert_eq!((point.positions.len(), point.faces.len()), (1, 0));
        assert_eq!(ball.welded(1e-6), ball);
    }

    #[test]
    fn unused_vertices_go() {
        let ball = primitives::icosphere(1);
        let mut loose = ball.clone();
        loose.positions.insert(0, [9.0; 3]);
        loose.positions.push([8.0; 3]);
        loose.faces.iter_mut().flatten().for_each(|v| *v += 1);
        assert_eq!(loose.without_unused_vertices(), ball);
        assert_eq!(ball.without_unused_vertices(), ball);
        // A face without area is a face all the same.
        loose.faces.push([1, 1, 2]);
        assert_eq!(loose.without_unused_vertices().faces.last(), Some(&[0, 0, 1]));
    }
}
