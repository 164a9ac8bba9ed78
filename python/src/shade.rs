//! Images of what is seen, with gradients.

use autodiff_lite::{Shapes, Var};
use pyo3::prelude::*;

use crate::arrays::Floats;
use crate::drawn::{Attributes, Draw};
use crate::error;
use crate::frame::{Frame, with_drawn};
use crate::precision::Precision;
use crate::recorded::{Recorded, fits};
use crate::wanted::Wanted;

/// Attributes of the vertices at each pixel, 0 at background.
///
/// frame: from `rasterize`. attributes: [V, C], shared by all images, or [N, V, C]; any C. Value [N, H, W, C].
/// Gradients: projected [N, V, 3] (visibility held fixed), attributes.
/// Cost: O(N H W C). Raises ValueError where the attributes do not fit the vertices.
#[pyfunction]
#[pyo3(signature = (frame, attributes, *, wrt=None))]
pub(crate) fn interpolate(
    py: Python<'_>,
    frame: &Frame,
    attributes: Floats<'_>,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    let mut shapes = Shapes::of("interpolate");
    let [n, ..] = frame.shape();
    fits(shapes.axes(
        "projected",
        &[n, frame.topology.get().faces.vertex_count(), 3],
        ["N", "V", "3"],
    ))?;
    if attributes.shape().len() == 2 {
        fits(shapes.axes("attributes", attributes.shape(), ["V", "C"]))?;
    } else {
        fits(shapes.axes("attributes", attributes.shape(), ["N", "V", "C"]))?;
    }
    with_drawn!(frame, drawn => drawn.interpolate(py, &attributes, Attributes::Vertices, wrt.as_ref()))
}

/// Attributes of the corners of faces at each pixel, 0 at background: texture coordinates across a seam, or one colour per face.
///
/// frame: from `rasterize`. attributes: [F, 3, C], the same for all images. Value [N, H, W, C].
/// Gradients: projected [N, V, 3] (visibility held fixed), attributes.
#[pyfunction]
#[pyo3(signature = (frame, attributes, *, wrt=None))]
pub(crate) fn interpolate_corners(
    py: Python<'_>,
    frame: &Frame,
    attributes: Floats<'_>,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    let mut shapes = Shapes::of("interpolate_corners");
    fits(shapes.axes("faces", &[frame.topology.get().faces.len(), 3], ["F", "3"]))?;
    fits(shapes.axes("attributes", attributes.shape(), ["F", "3", "C"]))?;
    with_drawn!(frame, drawn => drawn.interpolate(py, &attributes, Attributes::Corners, wrt.as_ref()))
}

struct SoftSilhouette;

impl Draw for SoftSilhouette {
    const OP: &'static str = "soft_silhouette";

    fn draw<'t, F: Precision>(&self, frame: &diff_raster::Frame<'t, F>) -> Var<'t, F> {
        frame.soft_silhouette()
    }
}

/// DIB-R's soft silhouette: 1 where a face is seen, and around it the probability that any face reaches the pixel.
///
/// It pulls from afar but is larger than the mesh, so that alone it makes the mesh too small. `antialiased_silhouette` is exact and pulls
/// within a pixel; fits want both: 0.5 * mask_iou(soft silhouette, target) + 10 * l2(antialiased silhouette, target).
///
/// frame: from `rasterize`, whose sigma_inv, box_length and max_faces shape it. Value [N, H, W] in [0, 1].
/// Gradient: projected [N, V, 3]; none to depth, none from pixels that show a face.
#[pyfunction]
#[pyo3(signature = (frame, *, wrt=None))]
pub(crate) fn soft_silhouette(
    py: Python<'_>,
    frame: &Frame,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    with_drawn!(frame, drawn => drawn.draw(py, SoftSilhouette, wrt.as_ref()))
}

struct AntialiasedSilhouette;

impl Draw for AntialiasedSilhouette {
    const OP: &'static str = "antialiased_silhouette";

    fn draw<'t, F: Precision>(&self, frame: &diff_raster::Frame<'t, F>) -> Var<'t, F> {
        frame.antialiased_silhouette()
    }
}

/// Coverage with the sub-pixel position of the silhouette: hard inside and outside, exact on straight borders. Pulls from both sides,
/// but only within a pixel; `soft_silhouette` pulls from afar.
///
/// frame: from `rasterize`. Value [N, H, W] in [0, 1]. Gradient: projected [N, V, 3]; none to depth.
#[pyfunction]
#[pyo3(signature = (frame, *, wrt=None))]
pub(crate) fn antialiased_silhouette(
    py: Python<'_>,
    frame: &Frame,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    with_drawn!(frame, drawn => drawn.draw(py, AntialiasedSilhouette, wrt.as_ref()))
}

struct Depth {
    background: f64,
}

impl Draw for Depth {
    const OP: &'static str = "depth";

    fn draw<'t, F: Precision>(&self, frame: &diff_raster::Frame<'t, F>) -> Var<'t, F> {
        frame.depth(F::from_f64(self.background))
    }
}

/// Planar depth at each pixel, in the units of the positions, and `background` where nothing is seen.
///
/// frame: from `rasterize`. Value [N, H, W]. Gradient: projected [N, V, 3], visibility held fixed.
#[pyfunction]
#[pyo3(signature = (frame, background=0.0, *, wrt=None))]
pub(crate) fn depth(
    py: Python<'_>,
    frame: &Frame,
    background: f64,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    with_drawn!(frame, drawn => drawn.draw(py, Depth { background }, wrt.as_ref()))
}

/// Colours of a texture at each pixel, bilinear; 0 at background.
///
/// frame: from `rasterize`. uv: [N, H, W, 2], interpolated texture coordinates, v up, clamped to [0, 1]. image: [Ht, Wt, C], the same for all
/// images of the batch. Value [N, H, W, C]. Gradients: uv (with kinks between texels), image.
#[pyfunction]
#[pyo3(signature = (frame, uv, image, *, wrt=None))]
pub(crate) fn texture(
    py: Python<'_>,
    frame: &Frame,
    uv: Floats<'_>,
    image: Floats<'_>,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    let mut shapes = Shapes::of("texture");
    fits(shapes.axes("frame", &frame.shape(), ["N", "H", "W"]))?;
    let [.., two] = fits(shapes.axes("uv", uv.shape(), ["N", "H", "W", "2"]))?;
    let [height, width, _] = fits(shapes.axes("image", image.shape(), ["Ht", "Wt", "C"]))?;
    if two != 2 || height == 0 || width == 0 {
        return Err(error::value(
            shapes.error("two coordinates and an image that has texels expected"),
        ));
    }
    with_drawn!(frame, drawn => drawn.texture(py, &uv, &image, wrt.as_ref()))
}
