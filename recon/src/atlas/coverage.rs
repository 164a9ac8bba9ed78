//! Whether texture coordinates that a mesh brings along are of use.

use mesh_core::{TriMesh, face_areas};
use serde::Serialize;

use super::chart::around;

/// Cells along each side of the grid on which overlaps are looked for.
const GRID: usize = 2048;
/// Shares that are too small to be seen: of texels that several faces fill, of the surface that has none.
const LITTLE: f64 = 1e-3;
/// How far outside of the unit square coordinates may lie: less than a texel of most textures.
const BEYOND: f32 = 1e-3;
/// The unit square filled this often is no layout at all.
const MOST_LAYERS: f64 = 16.0;

/// How the texture coordinates of a mesh lie in the unit square.
///
/// ```
/// use mesh_core::{Image, Texture, TriMesh};
/// use recon::atlas::UvCoverage;
///
/// let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let faces = vec![[0, 1, 2], [0, 2, 3]];
/// let uvs = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
/// let texture = Texture { uvs, faces: faces.clone(), image: Image::new(1, 1, 3) };
/// let mut mesh = TriMesh { texture: Some(texture), ..TriMesh::new(positions, faces) };
/// assert_eq!(UvCoverage::of(&mesh).and_then(|found| found.problem()), None);
///
/// // Both triangles on the same half of the image.
/// mesh.texture.as_mut().unwrap().faces[1] = [2, 1, 0];
/// let found = UvCoverage::of(&mesh).unwrap();
/// assert_eq!(found.overlap, 1.0);
/// assert!(found.problem().unwrap().contains("overlap"));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct UvCoverage {
    /// The least coordinates that a face has.
    pub low: [f32; 2],
    /// The greatest.
    pub high: [f32; 2],
    /// The sum of the faces' areas in the unit of the square: 1 fills it once.
    pub area: f64,
    /// Of what faces fill of the square, the share that two of them or more do, 0 to 1; found by 2048 x 2048 samples.
    pub overlap: f64,
    /// The share of the surface's area, 0 to 1, that has no extent in the square.
    pub unplaced: f64,
}

impl UvCoverage {
    /// Looks at [`TriMesh::texture`]; its image is not looked at. `None` for a mesh without.
    ///
    /// # Cost
    /// A few nanoseconds for each of four million samples and each face; 4 MB.
    ///
    /// # Panics
    /// If the texture does not fit the mesh (see [`TriMesh::validate`]).
    pub fn of(mesh: &TriMesh) -> Option<Self> {
        let texture = mesh.texture.as_ref()?;
        let corners = |face: &[u32; 3]| face.map(|t| texture.uvs[t as usize]);
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        let (mut area, mut surface, mut unplaced) = (0.0, 0.0, 0.0);
        for (face, own) in texture.faces.iter().zip(face_areas(&mesh.positions, &mesh.faces)) {
            let corners = corners(face);
            for (uv, k) in corners.iter().flat_map(|uv| [(uv, 0), (uv, 1)]) {
                (low[k], high[k]) = (low[k].min(uv[k]), high[k].max(uv[k]));
            }
            let [a, b, c] = corners.map(|uv| uv.map(f64::from));
            let twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            area += 0.5 * twice.abs();
            surface += f64::from(own);
            // Some rounding of coordinates makes areas of nothing.
            unplaced += if twice.abs() < 1e-14 { f64::from(own) } else { 0.0 };
        }
        let unplaced = if surface > 0.0 { unplaced / surface } else { 0.0 };
        let mut found = Self { low, high, area, overlap: 0.0, unplaced };
        if texture.faces.is_empty() || found.is_outside() {
            return Some(found);
        }
        found.overlap = if area > MOST_LAYERS {
            1.0 - 1.0 / area
        } else {
            overlap(texture.faces.iter().map(corners))
        };
        Some(found)
    }

    /// Why a texture would not show the surface as it is, in words that go on after "the mesh's texture coordinates"; `None`
    /// where it would.
    pub fn problem(&self) -> Option<String> {
        if let Some(problem) = self.hindrance() {
            return Some(problem);
        }
        if self.overlap > LITTLE {
            return Some(format!(
                "overlap: {:.1} % of the texels that are in use are those of several faces",
                100.0 * self.overlap
            ));
        }
        (self.unplaced > LITTLE).then(|| {
            format!("leave out {:.1} % of the surface, which has no texels", 100.0 * self.unplaced)
        })
    }

    /// The same for what leaves no texture at all.
    pub fn hindrance(&self) -> Option<String> {
        if self.is_outside() {
            let ([u, v], [right, top]) = (self.low, self.high);
            return Some(format!(
                "lie in [{u}, {right}] x [{v}, {top}], expected the unit square: they repeat an image, or are those of several"
            ));
        }
        if self.area > MOST_LAYERS {
            return Some(format!("fill the unit square {:.0} times", self.area));
        }
        // Not a number where there is no surface.
        (self.unplaced > 0.99 || self.area <= 0.0)
            .then(|| "have no extent: no face has a place in an image".to_owned())
    }

    fn is_outside(&self) -> bool {
        self.low.iter().any(|&x| x < -BEYOND) || self.high.iter().any(|&x| x > 1.0 + BEYOND)
    }
}

/// Of the cells of a grid that triangles of the unit square fill, the share that several do.
fn overlap(triangles: impl Iterator<Item = [[f32; 2]; 3]>) -> f64 {
    let mut layers = vec![0u8; GRID * GRID];
    for corners in triangles {
        let corners = corners.map(|[u, v]| [u * GRID as f32, v * GRID as f32]);
        around(corners, [0, 0, GRID, GRID], 0.0, |column, row, inside, _| {
            // Of a common edge both sides have the middle.
            if inside > 0.01 {
                let cell = &mut layers[row * GRID + column];
                *cell = cell.saturating_add(1);
            }
        });
    }
    let count = |least: u8| layers.iter().filter(|&&layer| layer >= least).count();
    count(2) as f64 / count(1).max(1) as f64
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::{Image, Texture, primitives};

    use super::*;
    use crate::atlas::Atlas;

    /// A ball with the layout of an atlas of ours.
    fn ball() -> TriMesh {
        let ball = primitives::icosphere(3);
        let atlas = Atlas::within(&ball.positions, &ball.faces, 256).unwrap();
        TriMesh { texture: Some(atlas.texture(Image::new(256, 256, 3))), ..ball }
    }

    fn changed(change: impl Fn(&mut Texture)) -> UvCoverage {
        let mut mesh = ball();
        change(mesh.texture.as_mut().unwrap());
        UvCoverage::of(&mesh).unwrap()
    }

    #[test]
    fn atlases_of_ours_are_layouts() {
        let found = changed(|_| ());
        assert_eq!(found.problem(), None, "{found:?}");
        assert!(found.overlap < 1e-5 && found.unplaced == 0.0 && found.area > 0.3, "{found:?}");
        assert!(UvCoverage::of(&primitives::icosphere(1)).is_none());
    }

    #[test]
    fn what_overlaps_is_measured() {
        // Half of the faces once more on a few of the others.
        let found = changed(|texture| {
            let count = texture.faces.len();
            for k in count / 2..count {
                texture.faces[k] = texture.faces[k - count / 2];
            }
        });
        assert!((found.overlap - 1.0).abs() < 1e-3, "{found:?}");
        // One face of 1280 on another one: one of 1279 places.
        let found = changed(|texture| texture.faces[7] = texture.faces[1000]);
        assert!((2e-4..2e-3).contains(&found.overlap), "{found:?}");
        // Mirrored is as good as not.
        let found = changed(|texture| texture.uvs.iter_mut().for_each(|uv| uv[0] = 1.0 - uv[0]));
        assert_eq!(found.problem(), None);
    }

    #[test]
    fn what_cannot_be_kept_is_said() {
        let said = |change: &dyn Fn(&mut Texture)| changed(change).hindrance().unwrap();
        assert!(said(&|t| t.uvs.iter_mut().for_each(|uv| uv[1] *= 2.0)).contains("unit square"));
        assert!(said(&|t| t.uvs.fill([0.5; 2])).contains("no extent"));
        let far = |t: &mut Texture| t.uvs.iter_mut().for_each(|uv| *uv = [1e30, -1e30]);
        assert!(said(&far).contains("unit square"));
        let whole = |t: &mut Texture| {
            t.uvs = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
            t.faces.fill([0, 1, 2]);
        };
        assert!(said(&whole).contains("640 times"));
        let part = changed(|texture| texture.faces[..40].fill([3, 3, 4]));
        assert!(part.hindrance().is_none() && part.problem().unwrap().contains("leave out"));
    }
}
