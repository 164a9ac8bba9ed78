//! Where the faces of a mesh lie in a texture: in charts, with room between them.

mod chart;
mod coverage;
mod packing;
mod padding;

use mesh_core::{Image, Texture};

pub use chart::mean_edge;
use chart::{Chart, charts};
pub use coverage::UvCoverage;
use packing::pack;
use padding::PADDING;

/// Boxes of charts begin and end at multiples of this: a texel three mipmap levels up belongs to one chart.
const ALIGNMENT: usize = 8;

/// Texels around pieces that a mesh laid out itself: half a texel of the mipmap that is five levels up.
const RINGS: usize = 16;

/// Rows of a texture that are drawn at a time.
const BAND: usize = 512;

/// A texel that a face fills.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Texel {
    /// Its place in the image, by rows from the top.
    pub index: u32,
    /// The face.
    pub face: u32,
    /// Where its centre lies on the face; outside of it, at a border of a chart of [`Atlas::new`], the face's plane goes on.
    pub barycentric: [f32; 3],
}

/// A layout of charts: pieces of the surface that are nearly flat, each drawn as it is seen from straight above.
///
/// Around each there are four texels or more that repeat its border, and charts lie in boxes of multiples of eight texels.
/// So neither bilinear filtering nor the first three mipmap levels mix what does not belong together, the latter where the side is a
/// multiple of eight, as that of [`Atlas::new`] is; beyond them what lies between the charts has their colours.
///
/// ```
/// use mesh_core::{Image, primitives};
/// use recon::atlas::Atlas;
///
/// let ball = primitives::icosphere(2);
/// let atlas = Atlas::new(&ball.positions, &ball.faces, 20.0, 4096);
/// let mut image = Image::new(atlas.side(), atlas.side(), 3);
/// for texel in atlas.texels() {
///     let at = 3 * texel.index as usize;
///     image.data[at..at + 3].copy_from_slice(&[0.8, 0.2, 0.1]);
/// }
/// let texture = atlas.texture(image);
/// assert_eq!(texture.faces.len(), ball.faces.len());
/// // What lies between the charts is filled.
/// assert!(texture.image.data.chunks(3).all(|c| (c[0] - 0.8).abs() < 1e-5));
/// ```
#[derive(Clone, Debug)]
pub struct Atlas {
    side: usize,
    uvs: Vec<[f32; 2]>,
    faces: Vec<[u32; 3]>,
    texels: Vec<Texel>,
    /// Left, top, width and height of each chart's box.
    boxes: Vec<[usize; 4]>,
    /// Texels around a chart that repeat its border, at most.
    rings: usize,
}

impl Atlas {
    /// So many texels to a unit of length (none are wished for if that is NaN), or as many as an image of side `most` has room for.
    ///
    /// # Cost
    /// Some 100 ms for 20,000 faces and four million texels.
    /// # Panics
    /// If a face names a vertex that is not there.
    pub fn new(positions: &[[f32; 3]], faces: &[[u32; 3]], density: f32, most: usize) -> Self {
        let charts = charts(positions, faces);
        let mut density = if density.is_nan() { 0.0 } else { density.clamp(0.0, f32::MAX) };
        loop {
            // With nothing but padding any number of charts has its place, be it larger than was wished.
            let limit = if density > 0.0 { most } else { usize::MAX };
            if let Some((side, places)) = pack(&sizes(&charts, density), None, limit) {
                return Self::drawn(&charts, faces, density, side, &places);
            }
            density = if density > 1e-3 { 0.9 * density } else { 0.0 };
        }
    }

    /// The densest layout in an image of this side; `None` where a mean edge would have fewer than two texels.
    ///
    /// # Panics
    /// If a face names a vertex that is not there.
    pub fn within(positions: &[[f32; 3]], faces: &[[u32; 3]], side: usize) -> Option<Self> {
        let area: f32 = mesh_core::face_areas(positions, faces).iter().sum();
        let edge = mean_edge(positions, faces);
        let charts = charts(positions, faces);
        let fits = |density: f32| pack(&sizes(&charts, density), Some(side), side);
        let (mut low, mut high) = (2.0 / edge, side as f32 / area.sqrt().max(f32::MIN_POSITIVE));
        let mut found = (low, fits(low)?);
        for _ in 0..20 {
            let middle = 0.5 * (low + high);
            match fits(middle) {
                Some(packed) => (low, found) = (middle, (middle, packed)),
                None => high = middle,
            }
        }
        let (density, (_, places)) = found;
        Some(Self::drawn(&charts, faces, density, side, &places))
    }

    /// The layout that a mesh has already: `faces` are three indices into `uvs` each, as those of [`Texture`], and the image is
    /// `side` texels wide and high, at least one.
    ///
    /// A texel that several faces fill is that of the face in which it lies deepest. Around each piece 1.5 texels are those
    /// of the nearest place of its border and 16 more repeat them, as far as there is room up to the next piece. What lies outside of the unit
    /// square has no texels; [`UvCoverage`] tells how much that is, and what overlaps.
    ///
    /// ```
    /// use mesh_core::Image;
    /// use recon::atlas::Atlas;
    ///
    /// let uvs = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    /// let atlas = Atlas::of_uvs(uvs, vec![[0, 1, 2], [0, 2, 3]], 64);
    /// assert_eq!(atlas.texels().len(), 64 * 64);
    /// ```
    ///
    /// # Cost
    /// Some 50 ms for a million texels; each face's share of them, and 20 bytes for each texel.
    /// # Panics
    /// If a face names coordinates that are not there.
    pub fn of_uvs(uvs: Vec<[f32; 2]>, faces: Vec<[u32; 3]>, side: usize) -> Self {
        let chart = Chart {
            faces: (0..faces.len() as u32).collect(),
            corners: faces.clone(),
            places: uvs.iter().map(|&[u, v]| [u, 1.0 - v].map(|x| x * side as f32)).collect(),
            extent: [side as f32; 2],
        };
        let mut texels = Vec::new();
        // In bands, so that what is remembered of each texel while faces are drawn stays small.
        for top in (0..side).step_by(BAND) {
            let band = [0, top, side, BAND.min(side - top)];
            chart.draw(&chart.places, band, |column, row, face, barycentric| {
                let index = (row * side + column) as u32;
                // Beyond a sharp edge the face's plane goes on through the air, where views show something else.
                let inside = barycentric.map(|b| b.max(0.0));
                let barycentric = inside.map(|b| b / inside.iter().sum::<f32>());
                texels.push(Texel { index, face, barycentric });
            });
        }
        Self { side, uvs, faces, texels, boxes: vec![[0, 0, side, side]], rings: RINGS }
    }

    /// Draws the charts at their places, of which each is the left top corner of its box.
    fn drawn(
        charts: &[Chart],
        faces: &[[u32; 3]],
        density: f32,
        side: usize,
        places: &[[usize; 2]],
    ) -> Self {
        let boxes = charts.iter().zip(places);
        let boxes = boxes.map(|(chart, &[left, top])| {
            let [width, height] = size(chart, density);
            [left, top, width, height]
        });
        let mut atlas = Self {
            side,
            uvs: Vec::new(),
            faces: vec![[0; 3]; faces.len()],
            texels: Vec::new(),
            boxes: boxes.collect(),
            rings: PADDING + 1,
        };
        for (k, chart) in charts.iter().enumerate() {
            let [left, top, ..] = atlas.boxes[k];
            let start = atlas.uvs.len() as u32;
            let origin = [left, top].map(|corner| (corner + PADDING) as f32 + 0.5);
            let pixels: Vec<[f32; 2]> = chart
                .places
                .iter()
                .map(|p| std::array::from_fn(|k| origin[k] + density * p[k]))
                .collect();
            let uv = |[x, y]: &[f32; 2]| [x / side as f32, 1.0 - y / side as f32];
            atlas.uvs.extend(pixels.iter().map(uv));
            for (&face, corners) in chart.faces.iter().zip(&chart.corners) {
                atlas.faces[face as usize] = corners.map(|v| start + v);
            }
            chart.draw(&pixels, atlas.boxes[k], |column, row, face, barycentric| {
                let index = (row * side + column) as u32;
                atlas.texels.push(Texel { index, face, barycentric });
            });
        }
        atlas
    }

    /// Width and height of the image.
    pub fn side(&self) -> usize {
        self.side
    }

    /// The texels that have a face, each once, those of a chart together.
    pub fn texels(&self) -> &[Texel] {
        &self.texels
    }

    /// The texture whose image has these texels; all others take the colours of those around them.
    ///
    /// # Panics
    /// If the image is not of this side, with three channels.
    pub fn texture(self, mut image: Image) -> Texture {
        assert_eq!(
            [image.height, image.width, image.channels],
            [self.side, self.side, 3],
            "the image of the atlas"
        );
        let mut known = vec![false; self.side * self.side];
        self.texels.iter().for_each(|texel| known[texel.index as usize] = true);
        padding::fill(&mut image, &known, &self.boxes, self.rings);
        Texture { uvs: self.uvs, faces: self.faces, image }
    }
}

/// Width and height of a chart's box.
fn size(chart: &Chart, density: f32) -> [usize; 2] {
    chart.extent.map(|length| {
        // What is absurdly large is too large for any image.
        let texels = (length * density).min(1e6).ceil() as usize + 1;
        (texels + 2 * PADDING).next_multiple_of(ALIGNMENT)
    })
}

fn sizes(charts: &[Chart], density: f32) -> Vec<[usize; 2]> {
    charts.iter().map(|chart| size(chart, density)).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::vector::interpolate;
    use mesh_core::{TriMesh, primitives};

    use super::*;

    /// Every level of an image: the next has the mean of two by two texels.
    fn levels(image: &Image) -> Vec<Image> {
        let mut levels = vec![image.clone()];
        while let Some(last) = levels.last().filter(|last| last.width > 1) {
            let half = last.width / 2;
            let mut next = Image::new(half, half, 3);
            for (k, value) in next.data.iter_mut().enumerate() {
                let (row, column, c) = (k / (3 * half), k / 3 % half, k % 3);
                let at = |i: usize, j: usize| {
                    last.data[((2 * row + i) * last.width + 2 * column + j) * 3 + c]
                };
                *value = 0.25 * (at(0, 0) + at(0, 1) + at(1, 0) + at(1, 1));
            }
            levels.push(next);
        }
        levels
    }

    /// Bilinear, with the border repeated.
    fn sampled(image: &Image, [u, v]: [f32; 2]) -> [f32; 3] {
        let side = image.width;
        let place = |t: f32| (t * side as f32 - 0.5).clamp(0.0, (side - 1) as f32);
        let (x, y) = (place(u), place(1.0 - v));
        let (i, j) = (x as usize, y as usize);
        let (s, t) = (x - i as f32, y - j as f32);
        std::array::from_fn(|c| {
            let at =
                |i: usize, j: usize| image.data[(j.min(side - 1) * side + i.min(side - 1)) * 3 + c];
            (1.0 - t) * ((1.0 - s) * at(i, j) + s * at(i + 1, j))
                + t * ((1.0 - s) * at(i, j + 1) + s * at(i + 1, j + 1))
        })
    }

    /// A red ball and a green cup beside it.
    fn pair() -> (TriMesh, usize) {
        let mut mesh = primitives::icosphere(3);
        let red = mesh.faces.len();
        let cup = primitives::lathe(
            &[[0.0, 0.0], [0.5, 0.0], [0.6, 0.8], [0.5, 0.8], [0.4, 0.1], [0.0, 0.1]],
            24,
        );
        mesh.append(&cup.translated([3.0, 0.0, 0.0])).unwrap();
        (mesh, red)
    }

    fn painted(mesh: &TriMesh, red: usize, density: f32) -> Texture {
        let atlas = Atlas::new(&mesh.positions, &mesh.faces, density, 4096);
        let mut image = Image::new(atlas.side(), atlas.side(), 3);
        for texel in atlas.texels() {
            let color = if (texel.face as usize) < red { [1.0, 0.0, 1.0] } else { [0.0, 1.0, 1.0] };
            image.data[3 * texel.index as usize..][..3].copy_from_slice(&color);
        }
        atlas.texture(image)
    }

    #[test]
    fn mipmaps_mix_nothing_that_does_not_belong_together() {
        let (mesh, red) = pair();
        for density in [6.0, 17.0, 40.0] {
            let texture = painted(&mesh, red, density);
            for (level, image) in levels(&texture.image).iter().enumerate() {
                let mut worst = [0.0f32; 2];
                for (index, corners) in texture.faces.iter().enumerate() {
                    let corners = corners.map(|t| texture.uvs[t as usize]);
                    // Corners, edges and the middle.
                    for w in [[1.0, 0.0, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.3, 0.3, 0.4]] {
                        let [r, g, filled] = sampled(image, interpolate(w, &corners));
                        let own = if index < red { r - g } else { g - r };
                        worst[0] = worst[0].max(1.0 - own);
                        worst[1] = worst[1].max(1.0 - filled);
                    }
                }
                // Black is in no level at all; the other's colour in none of the first four.
                assert!(worst[1] < 1e-4, "level {level} of {}: {worst:?}", image.width);
                assert!(
                    level > 3 || worst[0] < 1e-4,
                    "level {level} of {}: {worst:?}",
                    image.width
                );
            }
        }
    }

    #[test]
    fn pieces_that_a_mesh_laid_out_are_padded() {
        // Two squares of 64 x 64 texels with 40 between them: red and green, on black.
        let square = |left: f32| {
            [[0.0, 0.0], [64.0, 0.0], [64.0, 64.0], [0.0, 64.0]]
                .map(|[x, y]: [f32; 2]| [(left + x) / 256.0, (96.0 + y) / 256.0])
        };
        let uvs = [square(32.0), square(136.0)].concat();
        let faces = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        let atlas = Atlas::of_uvs(uvs, faces, 256);
        // Their own texels, and around them two whose middles are near enough.
        assert_eq!(atlas.texels().len(), 2 * 68 * 68);
        let mut image = Image::new(256, 256, 3);
        for texel in atlas.texels() {
            let color = if texel.face < 2 { [1.0, 0.0, 1.0] } else { [0.0, 1.0, 1.0] };
            image.data[3 * texel.index as usize..][..3].copy_from_slice(&color);
        }
        let texture = atlas.texture(image);
        for (level, image) in levels(&texture.image).iter().take(5).enumerate() {
            for (face, corners) in texture.faces.iter().enumerate() {
                for uv in corners.map(|t| texture.uvs[t as usize]) {
                    let [r, g, filled] = sampled(image, uv);
                    let own = if face < 2 { r - g } else { g - r };
                    assert!(own > 0.999 && filled > 0.999, "level {level}: {r} {g} {filled}");
                }
            }
        }
    }

    #[test]
    fn faces_have_texels_of_their_own_where_they_lie() {
        let (mesh, _) = pair();
        let atlas = Atlas::new(&mesh.positions, &mesh.faces, 40.0, 4096);
        let mut owner = vec![u32::MAX; atlas.side() * atlas.side()];
        for texel in atlas.texels() {
            assert_eq!(owner[texel.index as usize], u32::MAX, "two faces in one texel");
            owner[texel.index as usize] = texel.face;
            let sum: f32 = texel.barycentric.iter().sum();
            assert!((sum - 1.0).abs() < 1e-3, "{texel:?}");
        }
        let side = atlas.side() as f32;
        let texture = atlas.clone().texture(Image::new(atlas.side(), atlas.side(), 3));
        // The texel's centre is where its barycentric coordinates say.
        for texel in atlas.texels() {
            let corners = texture.faces[texel.face as usize].map(|t| texture.uvs[t as usize]);
            let [u, v] = interpolate(texel.barycentric, &corners);
            let (column, row): (f32, f32) = (u * side - 0.5, (1.0 - v) * side - 0.5);
            let found = row.round() as usize * atlas.side() + column.round() as usize;
            assert_eq!(found, texel.index as usize, "{texel:?}");
        }
        // Texels on surfaces that are far apart in space are not the neighbours of a chart.
        let area: f32 = mesh_core::face_areas(&mesh.positions, &mesh.faces).iter().sum();
        let share = atlas.texels().len() as f32 / (area * 40.0 * 40.0);
        assert!((0.6..1.4).contains(&share), "{share}");
        assert!(texture.uvs.len() < 2 * mesh.positions.len(), "{}", texture.uvs.len());
    }

    #[test]
    fn an_image_that_is_given_is_filled_or_refused() {
        let (mesh, _) = pair();
        assert!(Atlas::within(&mesh.positions, &mesh.faces, 64).is_none());
        for side in [500, 1024] {
            let atlas = Atlas::within(&mesh.positions, &mesh.faces, side).unwrap();
            assert_eq!(atlas.side(), side);
            assert!(atlas.texels().len() > side * side / 4, "{} of {side}", atlas.texels().len());
        }
    }

    #[test]
    fn what_is_no_surface_has_an_atlas_all_the_same() {
        let nan = [f32::NAN, 1e38, 0.0];
        for positions in [vec![[0.0; 3]; 3], vec![nan, [1.0; 3], [-1e38; 3]]] {
            let atlas = Atlas::new(&positions, &[[0, 1, 2], [2, 1, 0]], 1e9, 256);
            let image = Image::new(atlas.side(), atlas.side(), 3);
            assert_eq!(atlas.texture(image).faces.len(), 2);
        }
        let none = Atlas::new(&[], &[], 5.0, 256);
        assert_eq!(none.texels(), &[]);
    }
}
