//! What is seen of meshes at each pixel.

use std::sync::Arc;

use autodiff_lite::Shapes;
use diff_raster::{Fragments, Renderer, Settings};
use numpy::IntoPyArray;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{self, Floats, whole};
use crate::drawn::{Drawable, Drawn, Seen};
use crate::error;
use crate::precision::{self, Precision};
use crate::recorded::fits;
use crate::topology::{Given, Topology};

/// What is seen of a batch of meshes at each pixel: what `rasterize` finds, and the drawing functions take.
///
/// Its arrays are read-only and share their memory with it. Visibility has no gradient; the functions that draw hold it fixed.
#[pyclass(frozen, module = "unsphere")]
pub(crate) struct Frame {
    pub(crate) seen: Seen,
    pub(crate) topology: Py<Topology>,
}

/// Does the same with what is seen, in either precision.
macro_rules! with_drawn {
    ($frame:expr, $drawn:ident => $body:expr) => {
        match &$frame.seen {
            $crate::drawn::Seen::Single($drawn) => $body,
            $crate::drawn::Seen::Double($drawn) => $body,
        }
    };
}
pub(crate) use with_drawn;

#[pymethods]
impl Frame {
    /// (N, H, W)
    #[getter]
    pub(crate) fn shape(&self) -> [usize; 3] {
        with_drawn!(self, drawn => drawn.fragments.shape())
    }

    /// "float32" or "float64"
    #[getter]
    fn dtype(&self) -> &'static str {
        match self.seen {
            Seen::Single(_) => f32::DTYPE,
            Seen::Double(_) => f64::DTYPE,
        }
    }

    /// The faces that were drawn.
    #[getter]
    fn topology(&self, py: Python<'_>) -> Py<Topology> {
        self.topology.clone_ref(py)
    }

    /// The nearest face at each pixel, int64 [N, H, W]; -1 at background.
    #[getter]
    fn face<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let faces: Vec<i64> = with_drawn!(self, drawn => {
            let index = |&face: &u32| if face == diff_raster::NONE { -1 } else { i64::from(face) };
            drawn.fragments.face.iter().map(index).collect()
        });
        let array = ndarray::Array::from_shape_vec(self.shape(), faces).map_err(error::value)?;
        Ok(array.into_pyarray(py).into_any())
    }

    /// Its barycentric coordinates, [N, H, W, 3]; 0 at background.
    #[getter]
    fn barycentric<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let [n, h, w] = self.shape();
        with_drawn!(self, drawn => values(py, &drawn.fragments, &[n, h, w, 3], |f| &f.barycentric))
    }

    /// Its planar depth, [N, H, W], in the units of the positions; inf at background.
    #[getter]
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let shape = self.shape();
        with_drawn!(self, drawn => values(py, &drawn.fragments, &shape, |f| &f.depth))
    }

    /// Hard coverage, [N, H, W]: 1 where a face is seen, else 0.
    #[getter]
    fn mask<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let shape = self.shape();
        with_drawn!(self, drawn => {
            let mask = ndarray::Array::from_shape_vec(shape, drawn.fragments.mask());
            Ok(mask.map_err(error::value)?.into_pyarray(py).into_any())
        })
    }

    fn __repr__(&self) -> String {
        let ([n, h, w], dtype) = (self.shape(), self.dtype());
        format!("Frame of {n} images, {h} x {w} pixels, {dtype}")
    }
}

/// An array over the fragments' own memory.
fn values<'py, F: Precision>(
    py: Python<'py>,
    fragments: &Arc<Fragments<F>>,
    shape: &[usize],
    of: fn(&Fragments<F>) -> &Vec<F>,
) -> PyResult<Bound<'py, PyAny>> {
    let array = arrays::shared(py, Arc::clone(fragments), |fragments| {
        let view = ndarray::ArrayViewD::from_shape(shape, of(fragments));
        view.expect("fragments are as large as their shape says")
    })?;
    Ok(array.into_any())
}

/// Finds what is seen at each pixel of a batch of images, as DIB-R does.
///
/// projected: [N, V, 3], what `project` gives: x right and y up in [-1, 1] over the image, planar depth. topology: the faces, the same for
/// all images. height, width: pixels. The centre of pixel (i, j) is at ((2j+1-W)/W, (H-2i-1)/H). Faces with a corner at depth `near` or
/// nearer are left out whole.
///
/// perspective: whether attributes are interpolated as a perspective camera sees them; False for orthographic cameras. cull_back_faces:
/// whether faces that turn clockwise on the screen are invisible. sigma_inv: sharpness of the soft silhouette, exp(-sigma_inv d**2) at
/// distance d in NDC. box_length: how far it reaches, in NDC. max_faces: at most so many faces make the soft silhouette of a pixel.
/// published: DIB-R as kaolin computes it, number by number; near, perspective, and max_faces are then those of kaolin.
///
/// Cost: O(N (V + F + H W)) plus the pixels of the boxes of all faces. Raises ValueError where shapes do not fit or a vertex is NaN.
#[pyfunction]
#[pyo3(signature = (
    projected, topology, height, width, *, near=1e-4, perspective=true, cull_back_faces=false,
    sigma_inv=7000.0, box_length=0.02, max_faces=None, published=false
))]
#[allow(clippy::fn_params_excessive_bools, reason = "keywords of Python")]
pub(crate) fn rasterize(
    py: Python<'_>,
    projected: Floats<'_>,
    topology: Given<'_>,
    #[pyo3(from_py_with = whole)] height: usize,
    #[pyo3(from_py_with = whole)] width: usize,
    near: f64,
    perspective: bool,
    cull_back_faces: bool,
    sigma_inv: f64,
    box_length: f64,
    max_faces: Option<usize>,
    published: bool,
) -> PyResult<Frame> {
    let drawing =
        Settings { cull_back_faces, sigma_inv, box_length, ..Settings::new(height, width) };
    let settings = if published {
        Settings { cull_back_faces, sigma_inv, box_length, ..Settings::published(height, width) }
    } else {
        Settings { near, perspective, max_faces, ..drawing }
    };
    let faces = topology.get();
    check(&settings, &projected, faces)?;
    let seen = match projected {
        Floats::Single(_) => draw::<f32>(py, &projected, faces, settings)?,
        Floats::Double(_) => draw::<f64>(py, &projected, faces, settings)?,
    };
    Ok(Frame { seen, topology: topology.0.unbind() })
}

/// What a mistake in the call would be.
fn check(settings: &Settings, projected: &Floats<'_>, topology: &Topology) -> PyResult<()> {
    projected.check_coordinates("rasterize", "projected")?;
    let mut shapes = Shapes::of("rasterize");
    fits(shapes.axes("topology", &[topology.faces.vertex_count()], ["V"]))?;
    let [n, ..] = fits(shapes.axes("projected", projected.shape(), ["N", "V", "3"]))?;
    let pixels = settings.height.checked_mul(settings.width).and_then(|p| p.checked_mul(n.max(1)));
    if pixels.is_none_or(|pixels| pixels > u32::MAX as usize) {
        let (height, width) = (settings.height, settings.width);
        let text =
            format!("rasterize: {n} images of {height} x {width} pixels are more than 2**32");
        return Err(PyValueError::new_err(text));
    }
    // Faces with such a corner are not drawn: an optimisation that has diverged would see an empty image.
    projected.check_numbers("rasterize", "projected")?;
    for (name, value) in [("sigma_inv", settings.sigma_inv), ("box_length", settings.box_length)] {
        if !(value >= 0.0 && value.is_finite()) {
            return Err(error::value(format!("rasterize: {name} is {value}, expected 0 or more")));
        }
    }
    Ok(())
}

fn draw<F: Drawable>(
    py: Python<'_>,
    projected: &Floats<'_>,
    topology: &Topology,
    settings: Settings,
) -> PyResult<Seen> {
    let tape = precision::tape::<F>();
    let projected = projected.tensor("rasterize: projected", &tape)?;
    let (faces, scratch) = (Arc::clone(&topology.faces), F::scratch(topology).clone());
    let drawn = py.detach(move || {
        error::caught(|| {
            let renderer = Renderer::new(faces, settings).with_scratch(&scratch);
            let fragments =
                Arc::clone(renderer.frame(tape.constant(projected.clone())).fragments());
            Drawn { projected, fragments, scratch }
        })
    })?;
    Ok(F::seen(drawn))
}
