//! Triangle meshes, their files, and the simplest of them.

use std::path::PathBuf;

use mesh_core::{Image, TriMesh, primitives};
use numpy::{IntoPyArray, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::arrays::{self, Floats, whole};
use crate::error;
use crate::topology::Topology;

/// Mesh(vertices, faces, colors=None, *, uv=None, uv_faces=None, texture=None)
///
/// A triangle mesh as arrays, which may be changed in place or replaced.
///
/// vertices: float32 [V, 3], any unit, +Y up. faces: uint32 [F, 3], counter-clockwise seen from outside. colors: float32 [V, 3], sRGB in
/// [0, 1]. uv: float32 [T, 2], v up; uv_faces: uint32 [F, 3], indices into uv; texture: float32 [Ht, Wt, 3], sRGB; these three together.
///
/// Other floating-point and integer types are converted. Raises ValueError where an index is out of range or a coordinate is not finite.
#[pyclass(module = "unsphere")]
pub(crate) struct Mesh {
    #[pyo3(get, set)]
    vertices: Py<PyAny>,
    #[pyo3(get, set)]
    faces: Py<PyAny>,
    #[pyo3(get, set)]
    colors: Option<Py<PyAny>>,
    #[pyo3(get, set)]
    uv: Option<Py<PyAny>>,
    #[pyo3(get, set)]
    uv_faces: Option<Py<PyAny>>,
    #[pyo3(get, set)]
    texture: Option<Py<PyAny>>,
}

impl Mesh {
    /// Takes a mesh over.
    pub(crate) fn of(py: Python<'_>, mesh: TriMesh) -> PyResult<Self> {
        let TriMesh { positions, faces, colors, texture } = mesh;
        let vertices = arrays::table(py, positions)?.into_any().unbind();
        let faces = arrays::table(py, faces)?.into_any().unbind();
        let colors = match colors {
            Some(colors) => Some(arrays::table(py, colors)?.into_any().unbind()),
            None => None,
        };
        let (mut uv, mut uv_faces, mut image) = (None, None, None);
        if let Some(texture) = texture {
            uv = Some(arrays::table(py, texture.uvs)?.into_any().unbind());
            uv_faces = Some(arrays::table(py, texture.faces)?.into_any().unbind());
            let Image { height, width, channels, data } = texture.image;
            let texels = ndarray::Array3::from_shape_vec((height, width, channels), data);
            image = Some(texels.map_err(error::value)?.into_pyarray(py).into_any().unbind());
        }
        Ok(Self { vertices, faces, colors, uv, uv_faces, texture: image })
    }

    /// The mesh that the arrays hold now, checked.
    pub(crate) fn checked(&self, py: Python<'_>) -> PyResult<TriMesh> {
        let floats = |array: &Py<PyAny>| array.bind(py).extract::<Floats<'_>>();
        let positions = floats(&self.vertices)?.rows("vertices")?;
        let faces = arrays::indices("faces", self.faces.bind(py))?;
        let colors =
            self.colors.as_ref().map(|colors| floats(colors)?.rows("colors")).transpose()?;
        let texture = match (&self.uv, &self.uv_faces, &self.texture) {
            (None, None, None) => None,
            (Some(uv), Some(uv_faces), Some(texture)) => Some(mesh_core::Texture {
                uvs: floats(uv)?.rows("uv")?,
                faces: arrays::indices("uv_faces", uv_faces.bind(py))?,
                image: image("texture", &floats(texture)?)?,
            }),
            _ => return Err(error::value("uv, uv_faces and texture belong together")),
        };
        let mesh = TriMesh { positions, faces, colors, texture };
        mesh.validate().map_err(error::value)?;
        Ok(mesh)
    }
}

/// An array `[H, W, C]` as an image.
pub(crate) fn image(name: &str, array: &Floats<'_>) -> PyResult<Image> {
    match *array.shape() {
        [height, width, channels] => Ok(Image { height, width, channels, data: array.singles() }),
        [height, width] => Ok(Image { height, width, channels: 1, data: array.singles() }),
        _ => {
            let found = array.shape();
            Err(error::value(format!("{name}: an image [H, W, C] expected, found {found:?}")))
        }
    }
}

#[pymethods]
impl Mesh {
    #[new]
    #[pyo3(signature = (vertices, faces, colors=None, *, uv=None, uv_faces=None, texture=None))]
    fn new(
        py: Python<'_>,
        vertices: Py<PyAny>,
        faces: Py<PyAny>,
        colors: Option<Py<PyAny>>,
        uv: Option<Py<PyAny>>,
        uv_faces: Option<Py<PyAny>>,
        texture: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let given = Self { vertices, faces, colors, uv, uv_faces, texture };
        let checked = given.checked(py)?;
        // Arrays that are as they should be stay the caller's own.
        let mut made = Self::of(py, checked)?;
        if given.vertices.bind(py).cast::<PyArrayDyn<f32>>().is_ok() {
            made.vertices = given.vertices;
        }
        if given.faces.bind(py).cast::<PyArrayDyn<u32>>().is_ok() {
            made.faces = given.faces;
        }
        Ok(made)
    }

    /// The topology of the faces, for drawing and losses.
    fn topology(&self, py: Python<'_>) -> PyResult<Topology> {
        let vertices = self.vertices.bind(py).extract::<Floats<'_>>()?;
        let &[vertices, 3] = vertices.shape() else {
            let found = vertices.shape();
            return Err(error::value(format!(
                "vertices: an array [V, 3] expected, found {found:?}"
            )));
        };
        let faces = arrays::indices("faces", self.faces.bind(py))?;
        py.detach(|| Topology::of(vertices, &faces))
    }

    /// Area of the surface, in squared units.
    #[getter]
    fn area(&self, py: Python<'_>) -> PyResult<f64> {
        Ok(self.checked(py)?.area())
    }

    /// Volume inside, in cubic units; meant for closed meshes.
    #[getter]
    fn volume(&self, py: Python<'_>) -> PyResult<f64> {
        Ok(self.checked(py)?.volume())
    }

    /// Whether it is closed, oriented and without degenerate faces.
    #[getter]
    fn is_watertight(&self, py: Python<'_>) -> PyResult<bool> {
        let mesh = self.checked(py)?;
        Ok(py.detach(|| mesh.health().is_watertight()))
    }

    /// What is good and bad about it, as a text: counts, holes, handles, angles, folds.
    fn health(&self, py: Python<'_>) -> PyResult<String> {
        let mesh = self.checked(py)?;
        Ok(py.detach(|| mesh.health().to_string()))
    }

    /// How many pairs of faces run through each other, exactly.
    fn self_intersections(&self, py: Python<'_>) -> PyResult<usize> {
        let mesh = self.checked(py)?;
        Ok(py.detach(|| mesh.self_intersections().len()))
    }

    /// Each face in four, with colours and texture.
    fn subdivided(&self, py: Python<'_>) -> PyResult<Self> {
        let mesh = self.checked(py)?;
        Self::of(py, py.detach(|| mesh_core::subdivide(&mesh)))
    }

    /// What `pickle` and `copy` make it of again.
    fn __getnewargs_ex__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let arrays = (&self.vertices, &self.faces, &self.colors).into_pyobject(py)?;
        let named = PyDict::new(py);
        named.set_item("uv", &self.uv)?;
        named.set_item("uv_faces", &self.uv_faces)?;
        named.set_item("texture", &self.texture)?;
        Ok((arrays, named))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let count = |array: &Py<PyAny>| array.bind(py).len();
        let (v, f) = (count(&self.vertices)?, count(&self.faces)?);
        Ok(format!("Mesh of {v} vertices and {f} faces"))
    }
}

/// Reads a mesh: OBJ, PLY, GLB, STL or OFF, with colours and texture, by the file's extension.
///
/// Raises OSError with the file, the field, what was found and what was expected, where it cannot be read.
#[pyfunction]
pub(crate) fn read_mesh(py: Python<'_>, path: PathBuf) -> PyResult<Mesh> {
    let mesh = py.detach(|| mesh_core::read_mesh(path)).map_err(error::file)?;
    Mesh::of(py, mesh)
}

/// Writes a mesh: OBJ, PLY, GLB, STL or 3MF, by the path's extension; whole or not at all.
#[pyfunction]
pub(crate) fn write_mesh(py: Python<'_>, path: PathBuf, mesh: &Mesh) -> PyResult<()> {
    let mesh = mesh.checked(py)?;
    py.detach(|| mesh_core::write_mesh(path, &mesh)).map_err(error::file)
}

/// Writes an image as PNG.
///
/// image: uint8 or floating-point in [0, 1], [H, W], [H, W, 1], [H, W, 3] or [H, W, 4], sRGB.
#[pyfunction]
pub(crate) fn write_png(py: Python<'_>, path: PathBuf, image: &Bound<'_, PyAny>) -> PyResult<()> {
    let bytes = match image.cast::<PyArrayDyn<u8>>() {
        Ok(array) => byte_image("write_png: image", &array.readonly())?,
        Err(_) => self::image("write_png: image", &image.extract::<Floats<'_>>()?)?.to_bytes(),
    };
    if !matches!(bytes.channels, 1 | 3 | 4) || bytes.data.is_empty() {
        return Err(error::value("write_png: an image of 1, 3 or 4 channels, not empty, expected"));
    }
    py.detach(|| mesh_core::write_png(path, &bytes)).map_err(error::file)
}

/// Reads a PNG or JPEG: uint8 [H, W, C], sRGB.
#[pyfunction]
pub(crate) fn read_image(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyAny>> {
    let image = py.detach(|| mesh_core::read_image(path)).map_err(error::file)?;
    let shape = (image.height, image.width, image.channels);
    let array = ndarray::Array3::from_shape_vec(shape, image.data).map_err(error::value)?;
    Ok(array.into_pyarray(py).into_any())
}

/// An array `[H, W, C]` or `[H, W]` of bytes as an image.
pub(crate) fn byte_image(
    name: &str,
    array: &numpy::PyReadonlyArrayDyn<'_, u8>,
) -> PyResult<mesh_core::ByteImage> {
    let view = array.as_array();
    let [height, width, channels] = match *view.shape() {
        [h, w] => [h, w, 1],
        [h, w, c] => [h, w, c],
        _ => {
            let found = view.shape();
            return Err(error::value(format!(
                "{name}: an image [H, W, C] expected, found {found:?}"
            )));
        }
    };
    Ok(mesh_core::ByteImage { height, width, channels, data: view.iter().copied().collect() })
}

/// A unit sphere of 20 * 4**level faces. PyTorch3D's `ico_sphere`, with other numbers for the vertices. level: 0 to 9.
#[pyfunction]
pub(crate) fn icosphere(
    py: Python<'_>,
    #[pyo3(from_py_with = whole)] level: u32,
) -> PyResult<Mesh> {
    if level > 9 {
        return Err(error::value(format!("icosphere: level {level}, expected at most 9")));
    }
    Mesh::of(py, primitives::icosphere(level))
}

/// A torus around the y axis. major, minor: radii of ring and tube. rings, sides: parts around either.
#[pyfunction]
#[pyo3(signature = (major=1.0, minor=0.4, rings=48, sides=24))]
pub(crate) fn torus(
    py: Python<'_>,
    major: f32,
    minor: f32,
    #[pyo3(from_py_with = whole)] rings: usize,
    #[pyo3(from_py_with = whole)] sides: usize,
) -> PyResult<Mesh> {
    if rings < 3 || sides < 3 || rings.saturating_mul(sides) > 1 << 24 {
        return Err(error::value(
            "torus: 3 or more rings and sides, at most 2**24 in all, expected",
        ));
    }
    Mesh::of(py, error::caught(|| primitives::torus(major, minor, rings, sides))?)
}

/// A box around the origin, of 12 faces. sides: lengths along x, y and z.
#[pyfunction]
pub(crate) fn cuboid(py: Python<'_>, sides: [f32; 3]) -> PyResult<Mesh> {
    if !sides.iter().all(|side| side.is_finite() && *side > 0.0) {
        return Err(error::value(format!("cuboid: sides {sides:?}, expected lengths above 0")));
    }
    Mesh::of(py, primitives::cuboid(sides))
}

/// A solid of revolution around the y axis. profile: [n, 2], pairs of radius and height, upwards. segments: parts around.
#[pyfunction]
#[pyo3(signature = (profile, segments=48))]
pub(crate) fn lathe(
    py: Python<'_>,
    profile: Floats<'_>,
    #[pyo3(from_py_with = whole)] segments: usize,
) -> PyResult<Mesh> {
    let profile = profile.rows("lathe: profile")?;
    if profile.len() < 2 || !(3..=1 << 16).contains(&segments) {
        return Err(error::value(
            "lathe: a profile of 2 points or more and 3 to 65536 segments expected",
        ));
    }
    Mesh::of(py, error::caught(|| primitives::lathe(&profile, segments))?)
}
