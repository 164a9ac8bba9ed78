//! Several images as one, for meshes whose faces have different ones.

use std::borrow::Cow;

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
/// How often an image stands beside itself at most: coordinates of 32 bits that are larger have no fractions, and all that is seen is
/// its mean.
const MOST: u64 = 1 << 24;

/// An image in the atlas, with how often it stands beside itself.
struct Sheet {
    image: usize,
    /// Columns and rows of one copy.
    pixels: [usize; 2],
    repeats: [usize; 2],
    /// Column and row of its margin's corner.
    at: [usize; 2],
}

impl Sheet {
    /// Of one colour: no coordinates are needed.
    fn is_flat(&self) -> bool {
        self.pixels == [1; 2]
    }

    /// Columns and rows with the margin.
    fn size(&self) -> [usize; 2] {
        std::array::from_fn(|k| self.pixels[k].saturating_mul(self.repeats[k]) + 2 * MARGIN)
    }
}

/// Where a corner lies: its look, its texture coordinate, its sheet, and how many whole images are taken off it.
type Corner = (u32, u32, u32, [i32; 2]);

/// One texture of several images (three channels) and the number of corners without a texture coordinate; `None` where not even one of
/// each fits into the limits.
///
/// Faces that need their image more than once have one of its own, as often as the worst of them needs it and made smaller where that
/// is too much, so that the others show all of theirs.
pub(super) fn atlas(
    faces: &Faces<'_>,
    images: &[Image],
    limits: &Limits,
    budget: &mut Budget,
) -> Result<Option<(Texture, usize)>, OverLimit> {
    let mut plan = Plan::new(faces, images);
    let Some(size) = fit(&mut plan.sheets, images, limits) else { return Ok(None) };
    let mut corners: Vec<Corner> = Vec::new();
    budget.reserve(&mut corners, 3 * faces.corners.len())?;
    let mut bare = 0;
    for face in 0..faces.corners.len() {
        let keys = plan.keys(face);
        corners.extend(keys);
        let is_flat = plan.sheets[keys[0].2 as usize].is_flat();
        bare += faces.corners[face].iter().filter(|&&t| t == NONE && !is_flat).count();
    }
    corners.sort_unstable();
    corners.dedup();
    let mut uvs = Vec::new();
    budget.reserve(&mut uvs, corners.len())?;
    uvs.extend(corners.iter().map(|corner| plan.at(corner, size)));
    let mut indices = Vec::new();
    budget.reserve(&mut indices, faces.corners.len())?;
    indices.extend((0..faces.corners.len()).map(|face| {
        plan.keys(face).map(|key| corners.partition_point(|corner| *corner < key) as u32)
    }));
    let image = painted(&plan.sheets, images, size);
    Ok(Some((Texture { uvs, faces: indices, image }, bare)))
}

/// How far a coordinate may be beyond the border of an image without a second one there: a pixel, and little of small ones.
fn slack(image: &Image) -> [f32; 2] {
    [image.width, image.height].map(|n| 1.0 / n.max(64) as f32)
}

/// How many whole images the corners of a face are from the first, and how many they need.
fn shift(corners: &[[f32; 2]; 3], slack: [f32; 2]) -> ([i32; 2], [usize; 2]) {
    let ends = |k: usize| {
        let along = || corners.iter().map(|uv| uv[k]);
        [along().fold(f32::MAX, f32::min), along().fold(f32::MIN, f32::max)]
    };
    let off: [i32; 2] = std::array::from_fn(|k| (ends(k)[0] + slack[k]).floor() as i32);
    let repeats = |k: usize| ((ends(k)[1] - off[k] as f32 - slack[k]).ceil() as u64).clamp(1, MOST);
    (off, [0, 1].map(|k| repeats(k) as usize))
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
}

/// Which sheet lies on which face.
struct Plan<'a> {
    faces: &'a Faces<'a>,
    images: &'a [Image],
    sheets: Vec<Sheet>,
    /// For each image its sheet, and that of faces that need it more than once.
    of: Vec<[usize; 2]>,
}

impl<'a> Plan<'a> {
    fn new(faces: &'a Faces<'a>, images: &'a [Image]) -> Self {
        let mut plan = Self { faces, images, sheets: Vec::new(), of: Vec::new() };
        let mut repeats = vec![[1; 2]; images.len()];
        let mut is_plain = vec![false; images.len()];
        for face in 0..faces.corners.len() {
            let (image, _, needed) = plan.need(face);
            is_plain[image] |= needed == [1; 2];
            repeats[image] = std::array::from_fn(|k| needed[k].max(repeats[image][k]));
        }
        for (image, own) in images.iter().enumerate() {
            let pixels = [own.width, own.height];
            let mut sheet = |repeats: [usize; 2]| {
                plan.sheets.push(Sheet { image, pixels, repeats, at: [0; 2] });
                plan.sheets.len() - 1
            };
            let first = sheet(if is_plain[image] { [1; 2] } else { repeats[image] });
            let is_both = is_plain[image] && repeats[image] != [1; 2];
            let second = if is_both { sheet(repeats[image]) } else { first };
            plan.of.push([first, second]);
        }
        plan
    }

    /// The image of a face, how many whole ones its corners are from the first, and how many it needs.
    fn need(&self, face: usize) -> (usize, [i32; 2], [usize; 2]) {
        let (look, corners) = self.faces.placed(face);
        let image = &self.images[look.sheet];
        if image.width * image.height == 1 {
            return (look.sheet, [0; 2], [1; 2]);
        }
        let (off, needed) = shift(&corners, slack(image));
        (look.sheet, off, needed)
    }

    fn keys(&self, face: usize) -> [Corner; 3] {
        let (image, off, needed) = self.need(face);
        let sheet = self.of[image][usize::from(needed != [1; 2])];
        let (look, name) = (self.faces.look[face], sheet as u32);
        if self.sheets[sheet].is_flat() {
            return [(look, NONE, name, [0; 2]); 3];
        }
        self.faces.corners[face].map(|uv| (look, uv, name, off))
    }

    /// The texture coordinate in the atlas.
    fn at(&self, &(look, uv, sheet, off): &Corner, size: [usize; 2]) -> [f32; 2] {
        let look = &self.faces.looks[look as usize];
        let sheet = &self.sheets[sheet as usize];
        let slack = slack(&self.images[sheet.image]);
        let placed = look.place(self.faces.uv(uv));
        let [u, v] = std::array::from_fn(|k| {
            let most = sheet.repeats[k] as f32;
            let within = (placed[k] - off[k] as f32).clamp(-slack[k], most + slack[k]);
            let within = if sheet.is_flat() { 0.5 * most } else { within };
            // v goes up, and rows go down.
            let along = if k == 0 { within } else { most - within };
            let pixel = f64::from(along) * sheet.pixels[k] as f64 + (sheet.at[k] + MARGIN) as f64;
            pixel / size[k] as f64
        });
        [u as f32, (1.0 - v) as f32]
    }
}

/// Packs the sheets, those that are repeated made smaller until there is room for all; columns and rows of all, `None` where there is
/// none.
fn fit(sheets: &mut [Sheet], images: &[Image], limits: &Limits) -> Option<[usize; 2]> {
    let pixels = |[x, y]: [usize; 2]| (x as u64).saturating_mul(y as u64);
    let plain = |image: &Image| pixels([image.width, image.height].map(|n| n + 2 * MARGIN));
    let plain: u64 = images.iter().map(plain).sum();
    // Twice as much, since shelves do not fill the whole.
    let room = (2 * plain).max(ROOM).min(limits.max_pixels / 2);
    loop {
        let size = pack(sheets);
        if pixels(size) <= room {
            return Some(size);
        }
        let sides = |sheet: &Sheet| [0, 1].map(|k| (sheet.repeats[k] > 1).then(|| sheet.size()[k]));
        let Some(longest) = sheets.iter().flat_map(sides).flatten().max() else {
            return (pixels(size) <= limits.max_pixels / 2).then_some(size);
        };
        // All that are nearly as long, lest many take many rounds.
        for sheet in &mut *sheets {
            for (k, side) in sides(sheet).into_iter().enumerate() {
                if side.is_some_and(|side| side > longest / 4 * 3) {
                    halve(sheet, k);
                }
            }
        }
    }
}

/// Halves the pixels along an axis; one that is repeated is the same all along.
fn halve(sheet: &mut Sheet, k: usize) {
    sheet.pixels[k] = (sheet.pixels[k] / 2).max(1);
    if sheet.pixels[k] == 1 {
        sheet.repeats[k] = 1;
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
fn painted(sheets: &[Sheet], images: &[Image], [width, height]: [usize; 2]) -> Image {
    let mut image = Image::new(height, width, 3);
    for sheet in sheets {
        let ([across, down], [columns, rows]) = (sheet.pixels, sheet.size());
        let whole = &images[sheet.image];
        let own = if [whole.width, whole.height] == sheet.pixels {
            Cow::Borrowed(whole)
        } else {
            Cow::Owned(whole.resized(down, across))
        };
        let source =
            |k: usize, n: usize, all: usize| k.saturating_sub(MARGIN).min(all - 2 * MARGIN - 1) % n;
        for row in 0..rows {
            let from = across * source(row, down, rows);
            let start = (sheet.at[1] + row) * width + sheet.at[0];
            for column in 0..columns {
                let pixel = 3 * (from + source(column, across, columns));
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
        let made = atlas(&faces, &images, &Limits::default(), &mut budget).unwrap();
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
            let made = atlas(&faces, &[image(64, &colors)], &limits, &mut budget).unwrap();
            let (texture, _) = made.unwrap();
            assert!(texture.image.data.len() <= 3 << 21);
            assert_eq!(texture.image.width == 1 + 2 * MARGIN, flat, "{most}");
            let mean = texture.color(texture.uvs[0]);
            assert!((mean[0] - 0.5).abs() < 0.1 || !flat, "{mean:?}");
        }
        let limits = Limits { max_pixels: 20, ..limits };
        let faces = Faces { uvs: &[], corners: &[[NONE; 3]], look: &[0], looks: &[look(0)] };
        let images = vec![image(1, &[RED])];
        assert!(atlas(&faces, &images, &limits, &mut limits.budget(0)).unwrap().is_none());
    }
    /// One face with coordinates that mean nothing, or many images, makes no other coarse.
    #[test]
    fn what_is_repeated_takes_nothing_from_the_rest() {
        let colors: Vec<[f32; 3]> = (0..4096).map(|k| [k as f32 / 4096.0; 3]).collect();
        for most in [100.0, 1e9] {
            let uvs = [[0.0; 2], [1.0, 0.0], [0.0, 1.0], [most, 0.0], [0.0, most]];
            let corners = [[0, 1, 2], [0, 3, 4]];
            let faces = Faces { uvs: &uvs, corners: &corners, look: &[0; 2], looks: &[look(0)] };
            let limits = Limits { max_pixels: 1 << 20, ..Limits::default() };
            let images = [image(64, &colors)];
            let made = atlas(&faces, &images, &limits, &mut limits.budget(0)).unwrap();
            let (texture, _) = made.unwrap();
            let uvs = texture.faces[0].map(|t| texture.uvs[t as usize]);
            let alone = Texture { uvs: vec![], faces: vec![], image: images[0].clone() };
            let (found, expected) =
                (texture.color(interpolate([0.4, 0.35, 0.25], &uvs)), alone.color([0.35, 0.25]));
            assert!((found[0] - expected[0]).abs() < 1e-4, "{most}: {found:?} {expected:?}");
        }
    }

    /// A wide image that is repeated sidewards is as wide as shelves are: it gives way until they fit, and only along its repeats.
    #[test]
    fn a_long_strip_beside_a_large_image_fits() {
        let limits = Limits { max_pixels: 1 << 18, ..Limits::default() };
        let images = [Image::new(256, 256, 3), Image::new(128, 128, 3)];
        let uvs = [[0.0; 2], [1.0, 0.0], [0.0, 1.0], [300.0, 0.0]];
        let corners = [[0, 1, 2], [0, 3, 2]];
        let looks = [look(0), look(1)];
        let faces = Faces { uvs: &uvs, corners: &corners, look: &[0, 1], looks: &looks };
        let mut plan = Plan::new(&faces, &images);
        let [width, height] = fit(&mut plan.sheets, &images, &limits).unwrap();
        assert!(width * height <= 1 << 17, "{width} x {height}");
        assert_eq!((plan.sheets[0].pixels, plan.sheets[1].pixels[1]), ([256; 2], 128));
    }
}
