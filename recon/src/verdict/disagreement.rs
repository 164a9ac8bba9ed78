//! Where a mesh and a mask disagree, beyond what rounding to pixels explains.

use datasets::View;
use diff_raster::FacesError;
use mesh_core::{ByteImage, Camera, Components, Mask, TriMesh, iou};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use synth::silhouettes;

use crate::inspect::Window;

/// A hole in a mask has at least so large a share of the mask, and so many pixels.
const HOLE: (f64, usize) = (0.002, 8);

/// How a mesh differs from the mask of one view. Shares are of the mask's area, beyond a pixel of an image of at most 320, or of the part
/// of it around an object that would be smaller than 80 pixels there.
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
    mask: Mask,
    mesh: Mask,
    /// Wrong pixels beyond the tolerance: missing, excess.
    wrong: [Mask; 2],
}

impl Pair {
    /// Of two images of one size.
    fn of(mask: Mask, mesh: &ByteImage) -> Self {
        let mesh = Mask::at_least(mesh, 128);
        // Less than a pixel from the edge of the other is within the tolerance.
        let beyond = |own: &Mask, other: &Mask| {
            let near = other.dilated();
            let data = own.data.iter().zip(&near.data).map(|(&own, &near)| own && !near).collect();
            Mask { data, ..*own }
        };
        let wrong = [beyond(&mask, &mesh), beyond(&mesh, &mask)];
        Self { mask, mesh, wrong }
    }

    fn judged(&self, index: usize, name: &str) -> Disagreement {
        let area = self.mask.count().max(1) as f64;
        let pixels = self.mask.data.iter().copied().zip(self.mesh.data.iter().copied());
        let largest = self.wrong.iter().flat_map(|wrong| wrong.components().sizes).max();
        Disagreement {
            index,
            name: name.to_owned(),
            mask_iou: iou(pixels).unwrap_or(0.0),
            missing: self.wrong[0].count() as f64 / area,
            excess: self.wrong[1].count() as f64 / area,
            largest: largest.unwrap_or(0) as f64 / area,
            holes: self.filled_holes(((HOLE.0 * area) as usize).max(HOLE.1)),
            cut: self.mask.touches_border(),
        }
    }

    /// How many holes of the mask of at least so many pixels the mesh covers by more than half.
    fn filled_holes(&self, least: usize) -> usize {
        let Components { labels, sizes } = self.mask.holes().components();
        let mut covered = vec![0_usize; sizes.len() + 1];
        for (&label, &mesh) in labels.iter().zip(&self.mesh.data) {
            covered[label as usize] += usize::from(mesh);
        }
        let filled = |(size, covered): (&usize, &usize)| *size >= least && 2 * covered > *size;
        sizes.iter().zip(&covered[1..]).filter(|&hole| filled(hole)).count()
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
        let window = Window::of(view);
        (window.mask(view), window.camera(camera))
    };
    let (masks, cameras): (Vec<Mask>, Vec<Camera>) = views.par_iter().map(small).unzip();
    let seen = silhouettes(mesh, &cameras)?;
    let pairs = masks.into_par_iter().zip(&seen).map(|(mask, seen)| Pair::of(mask, seen));
    let judged =
        |(pair, &(index, view, _)): (Pair, &(usize, &View, _))| pair.judged(index, &view.name);
    Ok(pairs.zip(views).map(judged).collect())
}

/// The view in grey; what the mesh misses of its mask in orange, what it covers beside it in blue, beyond the tolerance in full
/// colour and within it in half; and what was looked at as it is.
pub(super) fn picture(
    mesh: &TriMesh,
    view: &View,
    camera: &Camera,
) -> Result<[ByteImage; 2], FacesError> {
    const COLORS: [[u8; 3]; 2] = [[230, 110, 0], [0, 120, 220]];
    let small = Window::of(view).view(view, camera);
    let seen = silhouettes(mesh, std::slice::from_ref(&small.camera))?;
    let pair = Pair::of(Mask::at_least(&small.mask, 128), &seen[0]);
    let mut image = ByteImage::new(small.mask.height, small.mask.width, 3);
    for (k, pixel) in image.data.chunks_exact_mut(3).enumerate() {
        let color = &small.color.data[3 * k..][..3];
        let gray = color.iter().map(|&c| usize::from(c)).sum::<usize>() / 3;
        let gray = if pair.mask.data[k] { 80 + gray / 2 } else { gray / 4 };
        pixel.fill(gray as u8);
        let kinds =
            [pair.mask.data[k] && !pair.mesh.data[k], pair.mesh.data[k] && !pair.mask.data[k]];
        for (kind, color) in COLORS.iter().enumerate().filter(|(kind, _)| kinds[*kind]) {
            let share = if pair.wrong[kind].data[k] { 4 } else { 2 };
            for (value, &c) in pixel.iter_mut().zip(color) {
                *value = ((usize::from(*value) * (4 - share) + usize::from(c) * share) / 4) as u8;
            }
        }
    }
    Ok([image, small.color])
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::primitives;
    use synth::{Orbit, RenderOptions, render_views};

    use super::*;

    /// An object of some 50 pixels in an image of 1280 is not judged as one of 12.
    #[test]
    fn small_objects_in_large_images_keep_their_pixels() {
        let object = primitives::icosphere(3).scaled([0.12; 3]).colored([0.8; 3]);
        let orbit = Orbit { count: 1, width: 1280, height: 1280, ..Orbit::default() };
        let cameras = orbit.cameras();
        let views = render_views(&object, &cameras, &RenderOptions::default(), &|_, _| {}).unwrap();
        let [_, _, rows, _] = views[0].mask_bounds().unwrap();
        assert!((30..80).contains(&rows), "{rows}");
        let seen = [(0, &views[0], &cameras[0])];
        let found = of_views(&object.clone().scaled([1.2; 3]), &seen).unwrap();
        assert!(found[0].excess > 0.1 && found[0].missing == 0.0, "{found:?}");
        let found = of_views(&object, &seen).unwrap();
        assert!(found[0].mask_iou > 0.99 && found[0].excess == 0.0, "{found:?}");
        let [difference, photograph] = picture(&object, &views[0], &cameras[0]).unwrap();
        assert_eq!([difference.height, photograph.height], [320; 2]);
        let lit = photograph.data.chunks_exact(3).filter(|pixel| pixel[0] > 0).count();
        let whole = views[0].mask_pixels();
        assert!((whole..whole * 11 / 10).contains(&lit), "{lit} of {whole}");
    }
}
