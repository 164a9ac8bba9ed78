//! Cameras, and points through them.

use autodiff_lite::Shapes;
use mesh_core::Lens;
use mesh_core::nalgebra::{Matrix3, Vector3};
use ndarray::Array3;
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::arrays::{self, Floats, whole};
use crate::error;
use crate::recorded::{Arguments, Recorded, fits, record};
use crate::wanted::Wanted;

/// A camera: pose, lens and image size. Made by `look_at` and the `from_...` of other tools, checked, and never changed.
///
/// The world is right-handed with +Y up. Camera axes are OpenGL's: x right, y up, looking along -z. NDC have x right and y up in [-1, 1].
/// Pixel (i, j) has its centre at (j + 0.5, i + 0.5).
#[pyclass(frozen, from_py_object, module = "unsphere")]
#[derive(Clone)]
pub(crate) struct Camera(pub(crate) mesh_core::Camera);

fn checked(camera: mesh_core::Camera) -> PyResult<Camera> {
    camera.validate().map_err(error::value)?;
    Ok(Camera(camera))
}

#[pymethods]
impl Camera {
    /// A perspective camera at `eye` that looks at `target`. fov_y: the vertical field of view, radians below pi. width, height: pixels.
    #[staticmethod]
    #[pyo3(
        signature = (eye, target, *, up=[0.0, 1.0, 0.0], fov_y=0.8, width, height),
        text_signature = "(eye, target, *, up=(0.0, 1.0, 0.0), fov_y=0.8, width, height)"
    )]
    fn look_at(
        eye: [f64; 3],
        target: [f64; 3],
        up: [f64; 3],
        fov_y: f64,
        #[pyo3(from_py_with = whole)] width: usize,
        #[pyo3(from_py_with = whole)] height: usize,
    ) -> PyResult<Self> {
        // Degrees would make a camera as well: 45 radians are as wide as 58 degrees.
        if !(fov_y > 0.0 && fov_y < std::f64::consts::PI) {
            let text =
                format!("look_at: fov_y: radians above 0 and below pi expected, found {fov_y}");
            return Err(error::value(text));
        }
        checked(mesh_core::Camera::look_at(eye, target, up, fov_y, width, height))
    }

    /// From OpenCV's: x right, y down, looking along +z; world to camera `R p + t`; intrinsics in pixels.
    #[staticmethod]
    fn from_opencv(
        rotation: [[f64; 3]; 3],
        translation: [f64; 3],
        intrinsics: [[f64; 3]; 3],
        #[pyo3(from_py_with = whole)] width: usize,
        #[pyo3(from_py_with = whole)] height: usize,
    ) -> PyResult<Self> {
        let camera =
            mesh_core::Camera::from_opencv(rotation, translation, intrinsics, width, height);
        checked(camera.map_err(error::value)?)
    }

    /// From OpenGL's, Blender's and NeRF's: camera to world, looking along -z. fx, fy, cx, cy: pixels.
    #[staticmethod]
    fn from_opengl(
        camera_to_world: [[f64; 4]; 4],
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        #[pyo3(from_py_with = whole)] width: usize,
        #[pyo3(from_py_with = whole)] height: usize,
    ) -> PyResult<Self> {
        checked(mesh_core::Camera::from_opengl(camera_to_world, fx, fy, cx, cy, width, height))
    }

    /// From PyTorch3D's `PerspectiveCameras` in NDC: rows `p R + T`, focal length and principal point as its cameras have them.
    #[staticmethod]
    #[pyo3(
        signature = (rotation, translation, focal, principal=[0.0, 0.0], *, width, height),
        text_signature = "(rotation, translation, focal, principal=(0.0, 0.0), *, width, height)"
    )]
    fn from_pytorch3d(
        rotation: [[f64; 3]; 3],
        translation: [f64; 3],
        focal: [f64; 2],
        principal: [f64; 2],
        #[pyo3(from_py_with = whole)] width: usize,
        #[pyo3(from_py_with = whole)] height: usize,
    ) -> PyResult<Self> {
        checked(mesh_core::Camera::from_pytorch3d_ndc(
            rotation,
            translation,
            focal,
            principal,
            width,
            height,
        ))
    }

    /// From COLMAP's: quaternion (w, x, y, z) and translation, world to camera; model without distortion, and its parameters.
    #[staticmethod]
    fn from_colmap(
        quaternion: [f64; 4],
        translation: [f64; 3],
        model: &str,
        params: Vec<f64>,
        #[pyo3(from_py_with = whole)] width: usize,
        #[pyo3(from_py_with = whole)] height: usize,
    ) -> PyResult<Self> {
        let camera =
            mesh_core::Camera::from_colmap(quaternion, translation, model, &params, width, height);
        checked(camera.map_err(error::value)?)
    }

    /// Parallel rays. rotation, translation: world to camera, OpenGL's axes. scale: pixels per unit. center: the axis, pixels.
    #[staticmethod]
    fn orthographic(
        rotation: [[f64; 3]; 3],
        translation: [f64; 3],
        scale: [f64; 2],
        center: [f64; 2],
        #[pyo3(from_py_with = whole)] width: usize,
        #[pyo3(from_py_with = whole)] height: usize,
    ) -> PyResult<Self> {
        let rotation = Matrix3::from_fn(|i, j| rotation[i][j]);
        let translation = Vector3::from(translation);
        let ([sx, sy], [cx, cy]) = (scale, center);
        let lens = Lens::Orthographic { sx, sy, cx, cy };
        checked(mesh_core::Camera { rotation, translation, lens, width, height })
    }

    /// Pixels of a row.
    #[getter]
    fn width(&self) -> usize {
        self.0.width
    }

    /// Pixels of a column.
    #[getter]
    fn height(&self) -> usize {
        self.0.height
    }

    /// Whether rays meet in a point.
    #[getter]
    fn is_perspective(&self) -> bool {
        self.0.is_perspective()
    }

    /// Where it is, in the world. [3]
    #[getter]
    fn center(&self) -> [f64; 3] {
        self.0.center().into()
    }

    /// Rotation from the world to the camera, rows. [3][3]
    #[getter]
    fn rotation(&self) -> [[f64; 3]; 3] {
        self.0.rotation.transpose().into()
    }

    /// Translation from the world to the camera, after the rotation. [3]
    #[getter]
    fn translation(&self) -> [f64; 3] {
        self.0.translation.into()
    }

    /// (sx, sy, cx, cy): scales of the axes (focal lengths, or pixels per unit) and the pixel of the axis.
    #[getter]
    fn intrinsics(&self) -> [f64; 4] {
        self.0.lens.numbers()
    }

    /// The rows X, Y and W of the projection, float64 [3, 4], to be applied to (x, y, z, 1) of a point: NDC are X/W and Y/W (X and Y with
    /// parallel rays), planar depth is W.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(arrays::table(py, self.0.projection().to_vec())?.into_any())
    }

    /// The same camera with another image size.
    fn resized(
        &self,
        #[pyo3(from_py_with = whole)] width: usize,
        #[pyo3(from_py_with = whole)] height: usize,
    ) -> PyResult<Self> {
        if width == 0 || height == 0 {
            return Err(error::value("resized: an image of at least one pixel expected"));
        }
        Ok(Self(self.0.resized(width, height)))
    }

    /// What `pickle` and `copy` make it of again, bit by bit: the conventions of other tools would round.
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let make = py.import("unsphere._unsphere")?.getattr("_camera")?;
        let (rotation, translation) = (self.rotation(), self.translation());
        let [width, height] = [self.width(), self.height()];
        let intrinsics = self.intrinsics();
        let parts = (self.is_perspective(), rotation, translation, intrinsics, width, height);
        Ok((make, parts.into_pyobject(py)?))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0 == other.0
    }

    fn __repr__(&self) -> String {
        let [x, y, z] = self.center();
        format!("Camera of {} x {} pixels at ({x:.3}, {y:.3}, {z:.3})", self.0.width, self.0.height)
    }
}

/// The camera of what `Camera.__reduce__` says.
#[pyfunction]
#[pyo3(name = "_camera")]
pub(crate) fn of_parts(
    is_perspective: bool,
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
    intrinsics: [f64; 4],
    #[pyo3(from_py_with = whole)] width: usize,
    #[pyo3(from_py_with = whole)] height: usize,
) -> PyResult<Camera> {
    let [x, y, cx, cy] = intrinsics;
    let lens = if is_perspective {
        Lens::Perspective { fx: x, fy: y, cx, cy }
    } else {
        Lens::Orthographic { sx: x, sy: y, cx, cy }
    };
    let rotation = Matrix3::from_fn(|i, j| rotation[i][j]);
    let translation = Vector3::from(translation);
    checked(mesh_core::Camera { rotation, translation, lens, width, height })
}

/// The matrices of cameras.
///
/// cameras: N of them. dtype: "float32" or "float64". Result [N, 3, 4], as `Camera.matrix`.
#[pyfunction]
#[pyo3(signature = (cameras, dtype="float32"))]
pub(crate) fn matrices<'py>(
    py: Python<'py>,
    cameras: Vec<Camera>,
    dtype: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let cameras: Vec<_> = cameras.into_iter().map(|camera| camera.0).collect();
    match dtype {
        "float32" => {
            let found: Array3<f32> = mesh_core::Camera::matrices(&cameras);
            Ok(found.into_pyarray(py).into_any())
        }
        "float64" => {
            let found: Array3<f64> = mesh_core::Camera::matrices(&cameras);
            Ok(found.into_pyarray(py).into_any())
        }
        _ => Err(error::value(format!("matrices: dtype {dtype:?}, expected float32 or float64"))),
    }
}

/// Points through cameras, to NDC and planar depth: what `rasterize` takes.
///
/// points: [N, V, 3], or [V, 3] shared by all cameras, in the world. matrices: [N, 3, 4], from `matrices`. perspective: False for parallel rays.
/// Value [N, V, 3]: x right, y up, depth. Gradients: points, matrices.
#[pyfunction]
#[pyo3(signature = (points, matrices, *, perspective=true, wrt=None))]
pub(crate) fn project(
    py: Python<'_>,
    points: Floats<'_>,
    matrices: Floats<'_>,
    perspective: bool,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    points.check_coordinates("project", "points")?;
    let mut shapes = Shapes::of("project");
    let [_, rows, columns] = fits(shapes.axes("matrices", matrices.shape(), ["N", "3", "4"]))?;
    if [rows, columns] != [3, 4] {
        return Err(error::value(shapes.error("matrices of 3 rows and 4 columns expected")));
    }
    fits(match *points.shape() {
        [_, _] => shapes.axes("points", points.shape(), ["V", "3"]).map(drop),
        [1, _, _] => Ok(()),
        _ => shapes.axes("points", points.shape(), ["N", "V", "3"]).map(drop),
    })?;
    let inputs = [("points", &points), ("matrices", &matrices)];
    record!(py, Arguments::new("project", inputs, wrt.as_ref())?, |points, matrices| {
        if perspective { points.project(matrices) } else { points.project_affine(matrices) }
    })
}
