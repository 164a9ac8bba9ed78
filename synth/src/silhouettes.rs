//! Masks alone.

use std::sync::Arc;

use diff_raster::{Faces, FacesError, NONE};
use mesh_core::{ByteImage, Camera, TriMesh};
use rayon::prelude::*;

use super::sketch::{Sketch, bands};

/// The pixels whose centres a mesh covers, 255 in an image of one channel for each camera: the masks of
/// [`render_views`](super::render_views), without its colours.
///
/// ```
/// use mesh_core::{Camera, primitives};
///
/// let ball = primitives::icosphere(3);
/// let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.8, 64, 48);
/// let masks = synth::silhouettes(&ball, &[camera])?;
/// assert_eq!((masks[0].data[24 * 64 + 32], masks[0].data[0]), (255, 0));
/// # Ok::<(), diff_raster::FacesError>(())
/// ```
///
/// # Errors
/// If a face names a vertex that is not there.
///
/// # Cost
/// A ninth of the samples that a rendering with 3x3 takes, and no colours.
pub fn silhouettes(mesh: &TriMesh, cameras: &[Camera]) -> Result<Vec<ByteImage>, FacesError> {
    let faces = Arc::new(Faces::of(mesh)?);
    let silhouette = |sketch: &mut Sketch, camera: &Camera| {
        let mut mask = ByteImage::new(camera.height, camera.width, 1);
        for part in bands(camera, &mesh.positions, 1) {
            sketch.draw(camera, part, &mesh.positions, &faces, 1);
            let [top, left, _, columns] = part;
            let rows = mask.data.chunks_exact_mut(camera.width).skip(top);
            for (row, shown) in rows.zip(sketch.fragments.face.chunks_exact(columns)) {
                for (pixel, &face) in row[left..].iter_mut().zip(shown) {
                    *pixel = if face == NONE { 0 } else { 255 };
                }
            }
        }
        mask
    };
    Ok(cameras.par_iter().map_init(Sketch::default, silhouette).collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::primitives;

    use super::*;
    use crate::{RenderOptions, render_views};

    #[test]
    fn they_are_the_masks_of_renderings() {
        let ball = primitives::icosphere(3);
        let from = |eye: [f64; 3], target: [f64; 3]| {
            Camera::look_at(eye, target, [0.0, 1.0, 0.0], 0.8, 60, 44)
        };
        // Whole, cut by the border, beside the image, and around the camera.
        let cameras = [
            from([0.0, 0.5, 4.0], [0.0; 3]),
            from([0.0, 0.5, 4.0], [1.0, 0.7, 0.0]),
            from([0.0, 0.0, 4.0], [9.0, 0.0, 0.0]),
            from([0.0, 0.2, 0.3], [0.0; 3]),
        ];
        let views = render_views(&ball, &cameras, &RenderOptions::default(), &|_, _| ()).unwrap();
        let masks = silhouettes(&ball, &cameras).unwrap();
        assert!(views[1].mask.data.contains(&255) && !views[2].mask.data.contains(&255));
        for (mask, view) in masks.iter().zip(&views) {
            assert_eq!(*mask, view.mask);
        }
    }
}
