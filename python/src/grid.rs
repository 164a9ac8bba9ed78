//! Values on a grid, and the surfaces in them.

use mesh_core::{Bounds, EmptyGrid, VoxelGrid};
use pyo3::prelude::*;

use crate::arrays::Floats;
use crate::error;
use crate::mesh::Mesh;

/// More values than this are a mistake. The surface has at most three vertices for each of so many, which are numbered by 32 bits.
const MOST: usize = 1 << 30;

/// Values `[D, H, W]` over a box.
struct Grid {
    /// Along x, y and z.
    dims: [usize; 3],
    bounds: Bounds,
    values: Vec<f32>,
}

impl Grid {
    /// Checks values, and the box that they are in. Along each axis there must be `least` of them.
    fn checked(
        op: &str,
        name: &str,
        values: &Floats<'_>,
        [low, high]: [[f32; 3]; 2],
        least: usize,
    ) -> PyResult<Self> {
        let shape = values.shape();
        let &[depth, height, width] = shape else {
            return Err(error::value(format!(
                "{op}: {name}: an array [D, H, W] expected, found {shape:?}"
            )));
        };
        if depth.min(height).min(width) < least {
            return Err(error::value(format!(
                "{op}: {name}: {least} or more along each axis expected, found {shape:?}"
            )));
        }
        let count = shape.iter().try_fold(1_usize, |count, &size| count.checked_mul(size));
        if count.is_none_or(|count| count > MOST) {
            return Err(error::value(format!(
                "{op}: {name}: at most 2**30 values expected, found {shape:?}"
            )));
        }
        // The length too, of which the vertices are made.
        let is_box = |k: usize| low[k] < high[k] && (high[k] - low[k]).is_finite();
        if !(0..3).all(is_box) {
            return Err(error::value(format!(
                "{op}: bounds {low:?} to {high:?}, expected two finite corners, each coordinate of the first below that of the second"
            )));
        }
        values.check_numbers(op, name)?;
        Ok(Self { dims: [width, height, depth], bounds: (low, high), values: values.singles() })
    }
}

/// Checks the value that tells inside from outside.
fn check_finite(op: &str, name: &str, value: f32) -> PyResult<()> {
    if value.is_finite() {
        Ok(())
    } else {
        Err(error::value(format!("{op}: {name} is {value}, expected a finite number of float32")))
    }
}

/// The surface where values on a grid of points pass `level`. PyTorch3D's `marching_cubes`, without its holes.
///
/// values: [D, H, W], along z, y and x; inside where they are `level` or more, so turn the sign of a signed distance. bounds: the corners of the
/// box, (x, y, z) each, where the first and the last point are; PyTorch3D's local coordinates if nothing is said. The surface ends where the
/// grid does: a layer of low values around it closes it. Where no value passes the level the mesh is empty.
/// Raises ValueError for fewer than 2 points along an axis, or NaN.
#[pyfunction]
#[pyo3(
    signature = (values, level, *, bounds=[[-1.0; 3], [1.0; 3]]),
    text_signature = "(values, level, *, bounds=((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)))"
)]
pub(crate) fn marching_cubes(
    py: Python<'_>,
    values: Floats<'_>,
    level: f32,
    bounds: [[f32; 3]; 2],
) -> PyResult<Mesh> {
    check_finite("marching_cubes", "level", level)?;
    let Grid { dims, bounds, values } =
        Grid::checked("marching_cubes", "values", &values, bounds, 2)?;
    let mesh =
        py.detach(|| error::caught(|| mesh_core::marching_cubes(dims, bounds, &values, level)))?;
    Mesh::of(py, mesh)
}

/// The surface of the occupied cells of a grid: two faces for each side between one and an empty one. PyTorch3D's `cubify`.
///
/// occupancy: [D, H, W], along z, y and x; occupied where it is `threshold` or more. What lies beyond the grid is empty, so the surface is closed.
/// bounds: the corners of the box that the cells fill, (x, y, z) each; PyTorch3D's `align="corner"` if nothing is said. Where no cell is occupied
/// the mesh is empty; where two meet along an edge alone, that edge has four faces. Raises ValueError for a grid without cells, or NaN.
#[pyfunction]
#[pyo3(
    signature = (occupancy, threshold, *, bounds=[[-1.0; 3], [1.0; 3]]),
    text_signature = "(occupancy, threshold, *, bounds=((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)))"
)]
pub(crate) fn cubify(
    py: Python<'_>,
    occupancy: Floats<'_>,
    threshold: f32,
    bounds: [[f32; 3]; 2],
) -> PyResult<Mesh> {
    check_finite("cubify", "threshold", threshold)?;
    let Grid { dims, bounds, values } =
        Grid::checked("cubify", "occupancy", &occupancy, bounds, 1)?;
    let mesh = py.detach(|| {
        error::caught(|| {
            let grid = VoxelGrid::from_values(dims, bounds, &values, threshold);
            mesh_core::cubify(&grid, EmptyGrid::Nothing)
        })
    })?;
    Mesh::of(py, mesh)
}
