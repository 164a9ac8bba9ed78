//! Faces, with all that is known of them before any position is.

use std::sync::Arc;

use diff_raster::{Faces, Scratch};
use mesh_core::Csr;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::arrays::{self, whole};
use crate::error;

/// Topology(faces, vertices)
///
/// The faces of a mesh, with who is next to whom. Make it once and give it to all functions that draw or measure the mesh; it also
/// keeps the memory for drawing, which is used again.
///
/// faces: integers [F, 3], counter-clockwise seen from outside. vertices: their number, V.
///
/// Raises ValueError where a face names a vertex that is not there.
#[pyclass(frozen, module = "unsphere")]
pub(crate) struct Topology {
    pub(crate) faces: Arc<Faces>,
    pub(crate) connectivity: mesh_core::Topology,
    pub(crate) single: Scratch<f32>,
    pub(crate) double: Scratch<f64>,
}

impl Topology {
    pub(crate) fn of(vertices: usize, corners: &[[u32; 3]]) -> PyResult<Self> {
        let faces = Arc::new(Faces::new(vertices, corners).map_err(error::value)?);
        let connectivity = mesh_core::Topology::new(vertices, corners);
        let (single, double) = (Scratch::default(), Scratch::default());
        Ok(Self { faces, connectivity, single, double })
    }

    /// The vertices of each face.
    pub(crate) fn corners(&self) -> &[[u32; 3]] {
        self.faces.corners()
    }

    /// The neighbours of each vertex.
    pub(crate) fn neighbors(&self) -> &Csr {
        self.connectivity.as_ref()
    }
}

/// A topology as an argument: who gives something else is told how to have one, where PyO3 would name types alone.
pub(crate) struct Given<'py>(pub(crate) Bound<'py, Topology>);

impl<'py> FromPyObject<'_, 'py> for Given<'py> {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(topology) = object.cast::<Topology>() {
            return Ok(Self(topology.to_owned()));
        }
        let found = arrays::found(&object)?;
        let expected = "topology: mesh.topology() or Topology(faces, number_of_vertices) expected";
        Err(PyTypeError::new_err(format!("{expected}, found {found}")))
    }
}

impl Given<'_> {
    pub(crate) fn get(&self) -> &Topology {
        self.0.get()
    }
}

#[pymethods]
impl Topology {
    #[new]
    fn new(
        faces: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = whole)] vertices: usize,
    ) -> PyResult<Self> {
        Self::of(vertices, &arrays::indices("Topology: faces", faces)?)
    }

    /// The number of vertices, V.
    #[getter]
    fn vertices(&self) -> usize {
        self.faces.vertex_count()
    }

    /// The faces, uint32 [F, 3].
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(arrays::table(py, self.corners().to_vec())?.into_any())
    }

    /// The edges, uint32 [E, 2], each once, the lower index first.
    #[getter]
    fn edges<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let edges: &[[u32; 2]] = self.connectivity.as_ref();
        Ok(arrays::table(py, edges.to_vec())?.into_any())
    }

    /// Whether every edge has two faces.
    #[getter]
    fn is_closed(&self) -> bool {
        self.connectivity.is_closed()
    }

    /// What `pickle` and `copy` make it of again.
    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, usize)> {
        Ok((self.faces(py)?, self.vertices()))
    }

    fn __repr__(&self) -> String {
        let (v, f) = (self.faces.vertex_count(), self.faces.len());
        format!("Topology of {v} vertices and {f} faces")
    }
}
