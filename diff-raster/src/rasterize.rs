//! Faces to fragments: the nearest face at each pixel.

use std::sync::Arc;

use autodiff_lite::Real;
use autodiff_lite::kernels::parallel::{InParts, Parts};
use ndarray::ArrayView3;

use crate::faces::{Faces, NONE};
use crate::fragments::Fragments;
use crate::kernels::setup::{BAND_ROWS, Setup};
use crate::kernels::visibility::{BandOutput, draw_band};
use crate::{Positions, Scratch, Settings};

/// Finds what is seen at each pixel of a batch of images.
///
/// `projected` is `[N, V, 3]`, a variable of a tape, a tensor or an array: NDC `x` (right), NDC `y` (up) and planar depth (positive in front
/// of the camera). The centre of pixel (row `i`, column `j`) is at
/// `((2j+1-W)/W, (H-2i-1)/H)`. Faces with a corner that is not finite, or not beyond
/// [`Settings::near`], are dropped whole, never clipped and never wrapped; so are faces of zero
/// area. There is no other limit.
///
/// Images of a batch are drawn in parallel, and so are bands of rows of one image; results do not
/// depend on the number of threads. The nearest face wins, and the first of equally near ones.
///
/// # Panics
/// If the last axis is not 3, or `V` is not the vertex count of `faces`.
///
/// # Examples
/// ```
/// use std::sync::Arc;
/// use diff_raster::{Faces, NONE, Settings, rasterize};
///
/// // One triangle over the lower left half of a 4x4 image.
/// let corners = ndarray::arr3(&[[[-1.0_f32, -1.0, 2.0], [1.0, -1.0, 2.0], [-1.0, 1.0, 2.0]]]);
/// let faces = Arc::new(Faces::new(3, &[[0, 1, 2]])?);
/// let fragments = rasterize(corners.view(), &faces, &Settings::new(4, 4));
/// assert_eq!(fragments.face[..4], [0, NONE, NONE, NONE]); // the top row
/// assert_eq!(fragments.depth[0], 2.0);
/// // Positions on a tape are taken as they are.
/// let tape = autodiff_lite::Tape::eval();
/// assert_eq!(fragments, rasterize(tape.constant(corners), &faces, &Settings::new(4, 4)));
/// # Ok::<(), diff_raster::FacesError>(())
/// ```
pub fn rasterize<F: Real>(
    projected: impl Positions<F>,
    faces: &Arc<Faces>,
    settings: &Settings,
) -> Arc<Fragments<F>> {
    let mut fragments = Fragments::default();
    projected.with(|projected| {
        rasterize_into(projected, faces, settings, &Scratch::default(), &mut fragments);
    });
    Arc::new(fragments)
}

/// [`rasterize`] into the memory of earlier fragments, for those who draw without a tape.
///
/// Nothing is allocated if `fragments` were as large before and `scratch` is the same. On a tape a
/// [`Renderer`](crate::Renderer) does all that.
///
/// # Shapes
/// `projected [N, V, 3]` as for [`rasterize`].
///
/// # Panics
/// As [`rasterize`].
///
/// # Examples
/// ```
/// use std::sync::Arc;
/// use diff_raster::{Faces, Fragments, Scratch, Settings, rasterize, rasterize_into};
///
/// let faces = Arc::new(Faces::new(3, &[[0, 1, 2]])?);
/// let settings = Settings::new(8, 8);
/// let (scratch, mut fragments) = (Scratch::default(), Fragments::default());
/// for depth in [2.0_f32, 3.0] {
///     let corners = ndarray::arr3(&[[[-1.0, -1.0, depth], [1.0, -1.0, depth], [-1.0, 1.0, depth]]]);
///     rasterize_into(corners.view(), &faces, &settings, &scratch, &mut fragments);
///     assert_eq!(fragments, *rasterize(corners.view(), &faces, &settings));
/// }
/// # Ok::<(), diff_raster::FacesError>(())
/// ```
#[allow(clippy::needless_pass_by_value, reason = "views are passed like slices")]
#[inline(never)]
pub fn rasterize_into<F: Real>(
    projected: ArrayView3<'_, F>,
    faces: &Arc<Faces>,
    settings: &Settings,
    scratch: &Scratch<F>,
    fragments: &mut Fragments<F>,
) {
    let (batch, vertices, axes) = projected.dim();
    assert!(
        axes == 3 && vertices == faces.vertex_count(),
        "rasterize: projected positions need the shape [N, V, 3]\n  projected  {:?}\n  faces      \
         of V = {} vertices",
        projected.shape(),
        faces.vertex_count()
    );
    settings.check();
    let own = fragments;
    let pixels = settings.pixels();
    own.batch = batch;
    own.faces.clone_from(faces);
    own.settings.clone_from(settings);
    own.centers.prepare(settings.height, settings.width);
    own.face.resize(batch * pixels, NONE);
    own.barycentric.resize(3 * batch * pixels, F::zero());
    own.depth.resize(batch * pixels, F::zero());
    own.setups.resize_with(batch, Setup::default);
    if pixels == 0 || batch == 0 {
        return;
    }

    let positions = projected.as_standard_layout();
    let positions = positions.as_slice().expect("standard layout");
    let (centers, planes) = (&own.centers, &scratch.planes);
    let images = own
        .setups
        .par_iter_mut()
        .zip(own.face.par_chunks_mut(pixels))
        .zip(own.barycentric.par_chunks_mut(3 * pixels))
        .zip(own.depth.par_chunks_mut(pixels));
    images.enumerate().for_each(|(n, (((setup, face), barycentric), depth))| {
        let positions = &positions[3 * vertices * n..3 * vertices * (n + 1)];
        setup.prepare(positions, faces.corners(), centers, settings);
        let setup = &*setup;
        let rows = BAND_ROWS * settings.width;
        face.par_chunks_mut(rows)
            .zip(barycentric.par_chunks_mut(3 * rows))
            .zip(depth.par_chunks_mut(rows))
            .enumerate()
            .for_each(|(band, ((face, barycentric), depth))| {
                let output = BandOutput { face, barycentric, depth };
                planes.with(|planes| draw_band(setup, centers, settings, band, planes, output));
            });
    });
}
