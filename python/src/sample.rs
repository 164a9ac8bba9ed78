//! Random points on the surface of a mesh.

use mesh_core::{SurfacePoint, TriMesh};
use numpy::IntoPyArray;
use pyo3::prelude::*;

use crate::arrays::{self, Floats, whole};
use crate::error;
use crate::topology::Given;

/// Points that are drawn at most.
const MOST: usize = 1 << 28;

/// Points on the faces of a mesh, as weights of their corners: what `sample_surface` draws.
#[pyclass(frozen, module = "unsphere")]
pub(crate) struct SurfaceSamples {
    pub(crate) points: Vec<SurfacePoint>,
}

#[pymethods]
impl SurfaceSamples {
    fn __len__(&self) -> usize {
        self.points.len()
    }

    /// The face of each point, uint32 [P].
    #[getter]
    fn face<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        let faces: Vec<u32> = self.points.iter().map(|point| point.face).collect();
        faces.into_pyarray(py).into_any()
    }

    /// The weights of its corners, float32 [P, 3]: not negative, of sum 1.
    #[getter]
    fn barycentric<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(arrays::table(py, self.points.iter().map(|p| p.barycentric).collect())?.into_any())
    }
}

/// Draws points evenly over a surface; the same ones for the same seed.
///
/// positions: [V, 3]. topology: the faces. count: how many. Raises ValueError where the surface has no area.
#[pyfunction]
#[pyo3(signature = (positions, topology, count, seed=0))]
pub(crate) fn sample_surface(
    py: Python<'_>,
    positions: Floats<'_>,
    topology: Given<'_>,
    #[pyo3(from_py_with = whole)] count: usize,
    #[pyo3(from_py_with = whole)] seed: u64,
) -> PyResult<SurfaceSamples> {
    let positions = positions.rows("sample_surface: positions")?;
    let mesh = TriMesh::new(positions, topology.get().corners().to_vec());
    mesh.validate().map_err(error::value)?;
    if count > MOST {
        return Err(error::value(format!(
            "sample_surface: {count} points, expected at most {MOST}"
        )));
    }
    let points = py.detach(|| mesh_core::sample_surface(&mesh, count, seed));
    if points.len() == count {
        Ok(SurfaceSamples { points })
    } else {
        Err(error::value("sample_surface: the faces have no area to draw points on"))
    }
}
