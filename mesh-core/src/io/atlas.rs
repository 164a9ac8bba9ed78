//! Several images as one, for meshes whose faces have different ones.

use crate::{Budget, Image, Limits, OverLimit, Texture};

/// Stands for "no texture coordinate".
pub(super) const NONE: u32 = u32::MAX;

/// How one of the images lies on faces: its texture coordinates are those of the file times `scale` plus `offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Look {
    pub(super) sheet: usize,
    pub(super) scale: [f32; 2],
    pub(super) offset: [f32; 2],
}

impl Look {
    /// A texture coordinate as this look has it; one that is no number becomes 0.
    pub(super) fn place(&self, uv: [f32; 2]) -> [f32; 2] {
        std::array::from_fn(|k| {
            let placed = uv[k] * self.scale[k] + self.offset[k];
            if placed.is_finite() { placed } else { 0.0 }
        })
    }
}

/// What lies on which face of a mesh.
pub(super) struct Faces<'a> {
    pub(super) uvs: &'a [[f32; 2]],
    /// Indices into `uvs`, or [`NONE`].
    pub(super) corners: &'a [[u32; 3]],
    /// For each face its look.
    pub(super) look: &'a [u32],
    pub(super) looks: &'a [Look],
}

/// Pixels around each image that are as its border, so that none of its neighbours shines through: room for a coordinate that
/// is up to a pixel beyond.
const MARGIN: usize = 2;
/// What an atlas may have of pixels so that images that are repeated keep theirs.
const ROOM: u64 = 1 << 24;

/// An image in the atlas, with how often it stands beside itself.
struct Sheet {
    image: Image,
    repeats: [u64; 2],
    /// Column and row of its margin's corner.
    at: [usize; 2],
}

impl Sheet {
    /// How far a coordinate may be beyond the border without a second image there: a pixel, and little of small images.
    fn slack(&self) -> [f32; 2] {
        [self.image.width, self.image.height].map(|n| 1.0 / n.max(64) as f32)
    }

    /// Of one colour: no coordinates are needed.
    fn is_flat(&self) -> bool {
        self.image.width * self.image.height == 1
    }

    /// Columns and rows with the margin.
    fn size(&self) -> [usize; 2] {
        let [x, y] = self.repeats.map(|n| n as usize);
        [self.image.width * x + 2 * MARGIN, self.image.height * y + 2 * MARGIN]
    }
}

/// Where a corner lies: its look, its texture coordinate, and how many whole images are taken off it.
type Corner = (u32, u32, [i32; 2]);

/// One texture of several images (three channels), each repeated as often as its faces need it, made smaller where that is too
/// much, and the number of corners without a texture coordinate; `None` where not even that fits into the limits.
pub(super) fn atlas(
    faces: &Faces<'_>,
    images: Vec<Image>,
    limits: &Limits,
    budget: &mut Budget,
) -> Result<Option<(Texture, usize)>, OverLimit> {
    let mut sheets: Vec<Sheet> =
        images.into_iter().map(|image| Sheet { image, repeats: [1; 2], at: [0; 2] }).collect();
    for face in 0..faces.corners.len() {
        let (look, corners) = faces.placed(face);
        let sheet = &mut sheets[look.sheet];
        let (slack, off) = (sheet.slack(), shift(&corners, sheet));
        for k in 0..2 {
            let most = corners.iter().map(|uv| uv[k]).fold(f32::MIN, f32::max);
            let repeats = (most - off[k] as f32 - slack[k]).ceil() as u64;
            sheet.repeats[k] = sheet.repeats[k].max(repeats);
        }
    }
    shrink(&mut sheets, limits);
    let [width, height] = pack(&mut sheets);
    if (width as u64).saturating_mul(height as u64) > limits.max_pixels / 2 {
        return Ok(None);
    }
    let mut corners: Vec<Corner> = Vec::new();
    budget.reserve(&mut corners, 3 * faces.corners.len())?;
    let mut bare = 0;
    for face in 0..faces.corners.len() {
        corners.extend(faces.keys(face, &sheets));
        let is_flat = sheets[faces.placed(face).0.sheet].is_flat();
        bare += faces.corners[face].iter().filter(|&&t| t == NONE && !is_flat).count();
    }
    corners.sort_unstable();
    corners.dedup();
    let mut uvs = Vec::new();
    budget.reserve(&mut uvs, corners.len())?;
    uvs.extend(corners.iter().map(|corner| faces.at(corner, &sheets, [width, height])));
    let mut indices = Vec::new();
    budget.reserve(&mut indices, faces.corners.len())?;
    indices.extend((0..faces.corners.len()).map(|face| {
        faces.keys(face, &sheets).map(|key| corners.partition_point(|corner| *corner < key) as u32)
    }));
    let image = painted(&sheets, [width, height]);
    Ok(Some((Texture { uvs, faces: indices, image }, bare)))
}

/// How many whole images the corners of a face are from the first.
fn shift(corners: &[[f32; 2]; 3], sheet: &Sheet) -> [i32; 2] {
    let slack = sheet.slack();
    std::array::from_fn(|k| {
        let least = corners.iter().map(|uv| uv[k]).fold(f32::MAX, f32::min);
        (least + slack[k]).floor() as i32
    })
}

impl Faces<'_> {
    /// The look of a face and its texture coordinates.
    fn placed(&self, face: usize) -> (&Look, [[f32; 2]; 3]) {
        let look = &self.looks[self.look[face] as usize];
        (look, self.corners[face].map(|uv| look.place(self.uv(uv))))
    }

    fn uv(&self, uv: u32) -> [f32; 2] {
        self.uvs.get(uv as usize).copied().unwrap_or_default()
    }

    fn keys(&self, face: usize, sheets: &[Sheet]) -> [Corner; 3] {
        let (look, corners) = self.placed(face);
        let sheet = &sheets[look.sheet];
        if sheet.is_flat() {
            return [(self.look[face], NONE, [0; 2]); 3];
        }
        let shift = shift(&corners, sheet);
        self.corners[face].map(|uv| (self.look[face], uv, shift))
    }

    /// The texture coordinate in the atlas.
    fn at(&self, &(look, uv, shift): &Corner, sheets: &[Sheet], size: [usize; 2]) -> [f32; 2] {
        let look = &self.looks[look as usize];
        let sheet = &sheets[look.sheet];
        let own = [sheet.image.width, sheet.image.height];
        let (placed, slack) = (look.place(self.uv(uv)), sheet.slack());
        let [u, v] = std::array::from_fn(|k| {
            let most = sheet.repeats[k] as f32;
            let within = (placed[k] - shift[k] as f32).clamp(-slack[k], most + slack[k]);
            let within = if sheet.is_flat() { 0.5 * most } else { within };
            // v goes up, and rows go down.
            let along = if k == 0 { within } else { most - within };
            let pixel = f64::from(along) * own[k] as f64 + (sheet.at[k] + MARGIN) as f64;
            pixel / size[k] as f64
        });
        [u as f32, (1.0 - v) as f32]
    }
}

/// Makes images smaller until all of them, repeated, fit into what there is room for.
fn shrink(sheets: &mut [Sheet], limits: &Limits) {
    let area = |sheet: &Sheet| (sheet.image.width * sheet.image.height) as u64;
    let plain: u64 = sheets.iter().map(area).sum();
    let repeated = |sheet: &Sheet| {
        let [x, y] = sheet.repeats;
        area(sheet).saturating_mul(x.saturating_mul(y))
    };
    let needed = sheets.iter().map(repeated).fold(0_u64, u64::saturating_add);
    // A quarter of the limit: what is not filled between images must have room too.
    let room = plain.max(ROOM).min(limits.max_pixels / 4);
    if needed <= room {
        return;
    }
    for sheet in sheets {
        let share = room as f64 * (area(sheet) as f64 / plain as f64);
        let factor = (share / repeated(sheet) as f64).sqrt();
        if factor >= 1.0 {
            continue;
        }
        let [mut height, mut width] =
            [sheet.image.height, sheet.image.width].map(|n| (n as f64 * factor) as usize);
        if height.min(width) == 0 {
            // Repeated so often that nothing but its mean colour would be seen.
            (height, width, sheet.repeats) = (1, 1, [1; 2]);
        }
        sheet.image = sheet.image.resized(height, width);
    }
}

/// Puts the images on shelves, the highest first; columns and rows of all.
fn pack(sheets: &mut [Sheet]) -> [usize; 2] {
    let mut order: Vec<usize> = (0..sheets.len()).collect();
    order.sort_by_key(|&k| (std::cmp::Reverse(sheets[k].size()[1]), k));
    let area: f64 =
        sheets.iter().map(|s| s.size().iter().map(|&n| n as f64).product::<f64>()).sum();
    let widest = sheets.iter().map(|sheet| sheet.size()[0]).max().unwrap_or(1);
    let width = widest.max(area.sqrt().ceil() as usize);
    let (mut x, mut y, mut shelf) = (0, 0, 0);
    for k in order {
        let [columns, rows] = sheets[k].size();
        if x + columns > width {
            (x, y, shelf) = (0, y + shelf, 0);
        }
        sheets[k].at = [x, y];
        x += columns;
        shelf = shelf.max(rows);
    }
    [width, y + shelf]
}

/// The image of all, black between them.
fn painted(sheets: &[Sheet], [width, height]: [usize; 2]) -> Image {
    let mut image = Image::new(height, width, 3);
    for sheet in sheets {
        let (own, [columns, rows]) = (&sheet.image, sheet.size());
        let source =
            |k: usize, n: usize, all: usize| k.saturating_sub(MARGIN).min(all - 2 * MARGIN - 1) % n;
        for row in 0..rows {
            let from = own.width * source(row, own.height, rows);
            let start = (sheet.at[1] + row) * width + sheet.at[0];
            for column in 0..columns {
                let pixel = 3 * (from + source(column, own.width, columns));
                image.data[3 * (start + column)..][..3].copy_from_slice(&own.data[pixel..][..3]);
            }
        }
    }
    image
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::vector::interpolate;

    fn image(width: usize, colors: &[[f32; 3]]) -> Image {
        let height = colors.len() / width;
        Image { height, width, channels: 3, data: colors.concat() }
    }

    const RED: [f32; 3] = [1.0, 0.0, 0.0];
    const GREEN: [f32; 3] = [0.0, 1.0, 0.0];
    const BLUE: [f32; 3] = [0.0, 0.0, 1.0];

    fn look(sheet: usize) -> Look {
        Look { sheet, scale: [1.0; 2], offset: [0.0; 2] }
    }

    /// What an image shows on a face it shows there out of the atlas, also beyond 0 to 1; but for half a pixel where it is
    /// repeated, for there a texture ends with its border's colours and what is painted goes over into the next.
    #[test]
    fn faces_show_what_their_image_shows() {
        let images =
            [image(2, &[RED, GREEN, BLUE, RED]), image(1, &[BLUE]), image(3, &[GREEN, RED, BLUE])];
        let uvs = [[0.0, 0.0], [1.0, 0.0], [0.5, 1.0], [-2.9, 7.2], [-1.75, 7.5], [-2.5, 8.8]];
        let looks =
            [look(0), look(1), look(2), Look { scale: [2.0, -1.0], offset: [0.5, 0.25], sheet: 2 }];
        let corners = [[0, 1, 2], [3, 4, 5], [0, 1, 2], [NONE; 3], [3, 4, 5], [0, 1, 2]];
        let of_face = [0, 0, 2, 1, 2, 3];
        let faces = Faces { uvs: &uvs, corners: &corners, look: &of_face, looks: &looks };
        let mut budget = Limits::default().budget(0);
        let made = atlas(&faces, images.to_vec(), &Limits::default(), &mut budget).unwrap();
        let (texture, bare) = made.unwrap();
        assert_eq!(bare, 0, "one colour needs no coordinates");
        let steps = (0..10).flat_map(|i| (0..10 - i).map(move |j| [i, j].map(|n| 0.1 * n as f32)));
        let weights: Vec<[f32; 3]> = steps.map(|[u, v]| [u, v, 1.0 - u - v]).collect();
        let mut compared = 0;
        for face in 0..corners.len() {
            let (look, placed) = faces.placed(face);
            let alone = Texture { uvs: vec![], faces: vec![], image: images[look.sheet].clone() };
            for &weights in &weights {
                let place = interpolate(weights, &placed);
                let size = [alone.image.width, alone.image.height];
                let near = |k: usize| {
                    let away = (place[k] - place[k].round()).abs() * size[k] as f32;
                    size[k] > 1 && away < 0.51
                };
                if near(0) || near(1) {
                    continue;
                }
                compared += 1;
                let expected = alone.color(place);
                let uvs = texture.faces[face].map(|t| texture.uvs[t as usize]);
                let found = texture.color(interpolate(weights, &uvs));
                for (a, b) in found.iter().zip(expected) {
                    assert!((a - b).abs() < 1e-3, "{face} {weights:?}: {found:?} {expected:?}");
                }
            }
        }
        assert!(compared >= 60, "{compared}");
    }

    /// An image that is repeated a thousand times is made smaller, one that is a billion times its mean.
    #[test]
    fn what_is_repeated_too_often_shrinks() {
        let colors: Vec<[f32; 3]> =
            (0..4096).map(|k| if k % 2 == 0 { RED } else { BLUE }).collect();
        let limits = Limits { max_pixels: 1 << 22, ..Limits::default() };
        for (most, flat) in [(100.0, false), (1e9, true), (f32::MAX, true)] {
            let uvs = [[0.0; 2], [most, 0.0], [0.0, most]];
            let faces = Faces { uvs: &uvs, corners: &[[0, 1, 2]], look: &[0], looks: &[look(0)] };
            let mut budget = limits.budget(0);
            let made = atlas(&faces, vec![image(64, &colors)], &limits, &mut budget).unwrap();
            let (texture, _) = made.unwrap();
            assert!(texture.image.data.len() <= 3 << 21);
            assert_eq!(texture.image.width == 1 + 2 * MARGIN, flat, "{most}");
            let mean = texture.color(texture.uvs[0]);
            assert!((mean[0] - 0.5).abs() < 0.1 || !flat, "{mean:?}");
        }
        let limits = Limits { max_pixels: 20, ..limits };
        let faces = Faces { uvs: &[], corners: &[[NONE; 3]], look: &[0], looks: &[look(0)] };
        let images = vec![image(1, &[RED])];
        assert!(atlas(&faces, images, &limits, &mut limits.budget(0)).unwrap().is_none());
    }
}
