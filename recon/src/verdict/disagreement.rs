//! Where a mesh and a mask disagree, beyond what rounding to pixels explains.

use datasets::View;
use diff_raster::FacesError;
use mesh_core::{ByteImage, Camera, TriMesh};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use synth::silhouettes;

/// Longer sides are averaged down to this.
pub(super) const LONGEST: usize = 320;
/// A hole in a mask has at least so large a share of the mask, and so many pixels.
const HOLE: (f64, usize) = (0.002, 8);

/// How a mesh differs from the mask of one view. Shares are of the mask's area, beyond a pixel of an image of at most 320.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Disagreement {
    /// The view's index.
    pub index: usize,
    /// Its name.
    pub name: String,
    /// Intersection over union of mesh and mask.
    pub mask_iou: f64,
    /// What of the mask the mesh misses.
    pub missing: f64,
    /// What the mesh covers beside the mask.
    pub excess: f64,
    /// The largest piece of the two that hangs together.
    pub largest: f64,
    /// Holes in the mask that the mesh covers.
    pub holes: usize,
    /// Whether the mask is cut by the border of the image.
    pub cut: bool,
}

/// A view's mask and the mesh's, both small.
struct Pair {
    width: usize,
    mask: Vec<bool>,
    mesh: Vec<bool>,
    /// Wrong pixels beyond the tolerance: missing, excess.
    wrong: [Vec<bool>; 2],
}

impl Pair {
    /// Of two images of one size.
    fn of(mask: &ByteImage, mesh: &ByteImage) -> Self {
        let bits = |image: &ByteImage| image.data.iter().map(|&m| m >= 128).collect::<Vec<_>>();
        let (width, mask, mesh) = (mask.width, bits(mask), bits(mesh));
        let beyond = |own: &[bool], other: &[bool]| -> Vec<bool> {
            let near = grown(other, width);
            own.iter().zip(near).map(|(&own, near)| own && !near).collect()
        };
        let wrong = [beyond(&mask, &mesh), beyond(&mesh, &mask)];
        Self { width, mask, mesh, wrong }
    }

    fn judged(&self, index: usize, name: &str) -> Disagreement {
        let count = |bits: &[bool]| bits.iter().filter(|bit| **bit).count();
        let area = count(&self.mask).max(1) as f64;
        let both = self.mask.iter().zip(&self.mesh).filter(|(a, b)| **a && **b).count();
        let either = self.mask.iter().zip(&self.mesh).filter(|(a, b)| **a || **b).count();
        let largest = self.wrong.iter().flat_map(|wrong| pieces(wrong, self.width));
        let (w, h) = (self.width, self.mask.len() / self.width);
        let on_border =
            |k: usize| k.is_multiple_of(w) || k % w == w - 1 || k < w || k >= (h - 1) * w;
        let background: Vec<bool> = self.mask.iter().map(|m| !m).collect();
        let least = ((HOLE.0 * area) as usize).max(HOLE.1);
        let is_filled_hole = |piece: &Vec<usize>| {
            piece.len() >= least
                && !piece.iter().any(|&k| on_border(k))
                && 2 * piece.iter().filter(|&&k| self.mesh[k]).count() > piece.len()
        };
        Disagreement {
            index,
            name: name.to_owned(),
            mask_iou: both as f64 / either.max(1) as f64,
            missing: count(&self.wrong[0]) as f64 / area,
            excess: count(&self.wrong[1]) as f64 / area,
            largest: largest.map(|piece| piece.len()).max().unwrap_or(0) as f64 / area,
            holes: pieces(&background, w).iter().filter(|piece| is_filled_hole(piece)).count(),
            cut: (0..self.mask.len()).any(|k| on_border(k) && self.mask[k]),
        }
    }
}

/// The difference in each of some views, which are given with their index and the camera that sees the mesh.
///
/// # Errors
/// If a face names a vertex that is not there.
pub(super) fn of_views(
    mesh: &TriMesh,
    views: &[(usize, &View, &Camera)],
) -> Result<Vec<Disagreement>, FacesError> {
    let small = |&(_, view, camera): &(usize, &View, &Camera)| {
        let mask = &view.mask;
        if mask.height.max(mask.width) > LONGEST {
            let [h, w] = mask.size_within(LONGEST);
            (mask.resized(h, w), camera.resized(w, h))
        } else {
            (mask.clone(), camera.clone())
        }
    };
    let (masks, cameras): (Vec<ByteImage>, Vec<Camera>) = views.par_iter().map(small).unzip();
    let seen = silhouettes(mesh, &cameras)?;
    let pairs = masks.par_iter().zip(&seen).map(|(mask, seen)| Pair::of(mask, seen));
    let judged =
        |(pair, &(index, view, _)): (Pair, &(usize, &View, _))| pair.judged(index, &view.name);
    Ok(pairs.zip(views).map(judged).collect())
}

/// The view in grey; what the mesh misses of its mask in orange, what it covers beside it in blue, beyond the tolerance in full
/// colour and within it in half.
pub(super) fn picture(
    mesh: &TriMesh,
    view: &View,
    camera: &Camera,
) -> Result<ByteImage, FacesError> {
    const COLORS: [[u8; 3]; 2] = [[230, 110, 0], [0, 120, 220]];
    let small = view.clone().at_most(LONGEST);
    let camera = camera.resized(small.mask.width, small.mask.height);
    let seen = silhouettes(mesh, std::slice::from_ref(&camera))?;
    let pair = Pair::of(&small.mask, &seen[0]);
    let mut image = ByteImage::new(small.mask.height, small.mask.width, 3);
    for (k, pixel) in image.data.chunks_exact_mut(3).enumerate() {
        let color = &small.color.data[k * small.color.channels..][..small.color.channels];
        let grey = color.iter().map(|&c| usize::from(c)).sum::<usize>() / color.len();
        let grey = if pair.mask[k] { 80 + grey / 2 } else { grey / 4 };
        pixel.fill(grey as u8);
        let kinds = [pair.mask[k] && !pair.mesh[k], pair.mesh[k] && !pair.mask[k]];
        for (kind, color) in COLORS.iter().enumerate().filter(|(kind, _)| kinds[*kind]) {
            let share = if pair.wrong[kind][k] { 4 } else { 2 };
            for (value, &c) in pixel.iter_mut().zip(color) {
                *value = ((usize::from(*value) * (4 - share) + usize::from(c) * share) / 4) as u8;
            }
        }
    }
    Ok(image)
}

/// Pixels that are set or have one beside them that is, diagonally too: less than a pixel from the edge of these.
fn grown(bits: &[bool], width: usize) -> Vec<bool> {
    let mut wider = bits.to_vec();
    for (wide, line) in wider.chunks_exact_mut(width.max(1)).zip(bits.chunks_exact(width.max(1))) {
        for (wide, pair) in wide.iter_mut().zip(line.windows(2)) {
            *wide |= pair[1];
        }
        for (wide, pair) in wide[1..].iter_mut().zip(line.windows(2)) {
            *wide |= pair[0];
        }
    }
    let mut grown = wider.clone();
    for (grown, below) in grown.iter_mut().zip(wider.iter().skip(width)) {
        *grown |= below;
    }
    for (grown, above) in grown.iter_mut().skip(width).zip(&wider) {
        *grown |= above;
    }
    grown
}

/// The pieces that hang together by their sides, each as its pixels.
fn pieces(bits: &[bool], width: usize) -> Vec<Vec<usize>> {
    let mut left = bits.to_vec();
    let mut found = Vec::new();
    for start in 0..bits.len() {
        if !left[start] {
            continue;
        }
        left[start] = false;
        let (mut piece, mut next) = (vec![start], 0);
        while next < piece.len() {
            let k = piece[next];
            next += 1;
            let beside = [
                (k % width > 0).then(|| k - 1),
                (k % width + 1 < width).then_some(k + 1),
                k.checked_sub(width),
                (k + width < bits.len()).then_some(k + width),
            ];
            for n in beside.into_iter().flatten().filter(|&n| std::mem::take(&mut left[n])) {
                piece.push(n);
            }
        }
        found.push(piece);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::signed_distance;

    #[test]
    fn what_is_grown_is_less_than_a_pixel_away() {
        let (height, width) = (9, 13);
        let bits: Vec<bool> = (0..height * width).map(|k| k * k % 17 == 3).collect();
        for bits in [vec![false; bits.len()], vec![true; bits.len()], bits] {
            let distance = signed_distance(&bits, height, width, 0.0);
            let near: Vec<bool> = distance.iter().map(|d| *d <= 1.0).collect();
            assert_eq!(grown(&bits, width), near);
        }
    }
}
