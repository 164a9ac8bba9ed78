//! Losses of a mesh by itself, and geometry that carries gradients.

use autodiff_lite::{Real, Shapes, Var};
use mesh_core::{SparseRows, SurfacePoint};
use pyo3::prelude::*;

use crate::arrays::Floats;
use crate::error;
use crate::recorded::{Arguments, Recorded, fits, record};
use crate::sample::SurfaceSamples;
use crate::topology::{Given, Topology};
use crate::wanted::Wanted;

/// Checks vertices `[V, 3]` or `[N, V, 3]` of a topology.
fn check_mesh(
    op: &'static str,
    name: &str,
    positions: &Floats<'_>,
    topology: &Topology,
) -> PyResult<()> {
    positions.check_coordinates(op, name)?;
    let mut shapes = Shapes::of(op);
    fits(shapes.axes("topology", &[topology.faces.vertex_count()], ["V"]))?;
    let found = positions.shape();
    fits(if found.len() == 2 {
        shapes.axes(name, found, ["V", "3"]).map(drop)
    } else {
        shapes.axes(name, found, ["N", "V", "3"]).map(drop)
    })
}

/// Losses of positions and topology alone: each with its docstring, and the function of the tape behind it.
macro_rules! mesh_losses {
    ($($(#[$docs:meta])* $name:ident => |$positions:ident, $topology:ident| $body:expr;)+) => {$(
        $(#[$docs])*
        #[pyfunction]
        #[pyo3(signature = (positions, topology, *, wrt=None))]
        pub(crate) fn $name(
            py: Python<'_>,
            positions: Floats<'_>,
            topology: Given<'_>,
            wrt: Option<Wanted>,
        ) -> PyResult<Recorded> {
            let $topology = topology.get();
            check_mesh(stringify!($name), "positions", &positions, $topology)?;
            let inputs = [("positions", &positions)];
            record!(py, Arguments::new(stringify!($name), inputs, wrt.as_ref())?, |$positions| $body)
        }
    )+};
}

mesh_losses! {
    /// The mean length of each vertex's offset from the mean of its neighbours. PyTorch3D's `mesh_laplacian_smoothing("uniform")`.
    ///
    /// positions: [V, 3] or [N, V, 3]. topology: the faces. Value: a float, in units of the positions. Gradient: positions.
    laplacian_norm => |positions, topology| losses::laplacian_norm(positions, topology.neighbors());
    /// The sum of squared Laplacian coordinates, DIB-R's, of positions or of the offsets from another shape.
    ///
    /// positions: [V, 3] or [N, V, 3]. topology: the faces. Value: a float, in squared units. Gradient: positions.
    laplacian_squared => |positions, topology| losses::laplacian_squared(positions, topology.neighbors());
    /// The mean length of the mean curvature normal. PyTorch3D's `mesh_laplacian_smoothing("cotcurv")`, whose weights count as fixed.
    ///
    /// positions: [V, 3] or [N, V, 3]. topology: the faces. Value: a float, in 1 / units. Gradient: positions.
    laplacian_cotcurv => |positions, topology| losses::laplacian_cotcurv(positions, &topology.connectivity);
    /// The mean of 1 - cos between the normals of faces that share an edge. PyTorch3D's `mesh_normal_consistency`.
    ///
    /// positions: [V, 3] or [N, V, 3]. topology: the faces. Value: a float from 0 to 2. Gradient: positions.
    normal_consistency => |positions, topology| losses::normal_consistency(positions, &topology.connectivity);
    /// The flatness of img2mesh: the sum of squared (1 - cos) over pairs of faces, averaged over the batch.
    ///
    /// positions: [V, 3] or [N, V, 3]. topology: the faces. Value: a float. Gradient: positions.
    face_angle => |positions, topology| losses::face_angle(positions, &topology.connectivity);
    /// The sum of squared lengths of all edges, averaged over the batch.
    ///
    /// positions: [V, 3] or [N, V, 3]. topology: the faces. Value: a float, in squared units. Gradient: positions.
    edge_length_sum => |positions, topology| losses::edge_length_sum(positions, &topology.connectivity);
    /// Unit normals of the faces.
    ///
    /// positions: [V, 3] or [N, V, 3]. topology: the faces. Value [F, 3] or [N, F, 3]. Gradient: positions.
    face_normals => |positions, topology| losses::face_normals(positions, topology.corners());
    /// Unit normals of the vertices, those of the faces weighed by area.
    ///
    /// positions: [V, 3] or [N, V, 3]. topology: the faces. Value like positions. Gradient: positions.
    vertex_normals => |positions, topology| losses::vertex_normals(positions, topology.corners());
}

/// The mean squared deviation of the edges' lengths from `target`. PyTorch3D's `mesh_edge_loss`.
///
/// positions: [V, 3] or [N, V, 3]. topology: the faces. target: a length. Value: a float, in squared units. Gradient: positions.
#[pyfunction]
#[pyo3(signature = (positions, topology, target=0.0, *, wrt=None))]
pub(crate) fn edge_length(
    py: Python<'_>,
    positions: Floats<'_>,
    topology: Given<'_>,
    target: f64,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    let topology = topology.get();
    check_mesh("edge_length", "positions", &positions, topology)?;
    let inputs = [("positions", &positions)];
    record!(py, Arguments::new("edge_length", inputs, wrt.as_ref())?, |positions| {
        losses::edge_length(positions, &topology.connectivity, target)
    })
}

/// The cotangent Laplacians of a batch of meshes as they are. In double precision, since weights of slivers are large and cancel.
fn cotangent_laplacians<F: Real>(
    positions: Var<'_, F>,
    topology: &Topology,
) -> Vec<SparseRows<f64>> {
    let value = positions.value();
    let wide: Vec<f64> = value.as_slice().iter().map(|&x| Real::to_f64(x)).collect();
    let (points, _) = wide.as_chunks::<3>();
    let (count, vertices) = match *value.shape() {
        [count, vertices, _] => (count, vertices),
        _ => (1, points.len()),
    };
    let mesh = |k: usize| &points[k * vertices..(k + 1) * vertices];
    let (corners, connectivity) = (topology.corners(), &topology.connectivity);
    (0..count).map(|k| mesh_core::cotangent_laplacian(mesh(k), corners, connectivity)).collect()
}

/// The mean length of each vertex's offset from the mean of its neighbours, weighed by cotangents: on a plane it is 0 however the vertices are
/// spread, but at the border. PyTorch3D's `mesh_laplacian_smoothing("cot")`, whose weights count as fixed.
///
/// positions: [V, 3] or [N, V, 3]. topology: the faces. Value: a float, in units of the positions. Gradient: positions. A vertex whose weights
/// add up to nearly nothing or less is left out. Raises ValueError where positions are not finite.
#[pyfunction]
#[pyo3(signature = (positions, topology, *, wrt=None))]
pub(crate) fn laplacian_cotangent(
    py: Python<'_>,
    positions: Floats<'_>,
    topology: Given<'_>,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    let (op, topology) = ("laplacian_cotangent", topology.get());
    check_mesh(op, "positions", &positions, topology)?;
    // Faces without a sine are left out of the weights, and vertices without weights of the mean: that of nothing but infinity would be 0.
    if positions.doubles().iter().any(|x| !x.is_finite()) {
        return Err(error::value("laplacian_cotangent: positions must be finite"));
    }
    record!(py, Arguments::new(op, [("positions", &positions)], wrt.as_ref())?, |positions| {
        losses::laplacian_cotangent(positions, &cotangent_laplacians(positions, topology))
    })
}

/// The mean length of the offsets: MCMR's deformation loss.
///
/// offsets: [V, 3] or [N, V, 3]. Value: a float, in units of the offsets. Gradient: offsets.
#[pyfunction]
#[pyo3(signature = (offsets, *, wrt=None))]
pub(crate) fn deformation_norm(
    py: Python<'_>,
    offsets: Floats<'_>,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    if !matches!(*offsets.shape(), [_, 3] | [_, _, 3]) {
        let found = offsets.shape();
        return Err(error::value(format!(
            "deformation_norm: offsets [N, V, 3] expected, found {found:?}"
        )));
    }
    record!(
        py,
        Arguments::new("deformation_norm", [("offsets", &offsets)], wrt.as_ref())?,
        |offsets| { losses::deformation_norm(offsets) }
    )
}

/// Samples that belong to a topology.
fn samples_of<'a>(
    op: &str,
    samples: &'a SurfaceSamples,
    topology: &Topology,
) -> PyResult<&'a [SurfacePoint]> {
    let faces = topology.faces.len();
    match samples.points.iter().find(|point| point.face as usize >= faces) {
        None => Ok(&samples.points),
        Some(point) => {
            let face = point.face;
            Err(error::value(format!(
                "{op}: a sample is on face {face}, but the topology has {faces}"
            )))
        }
    }
}

/// What samples of a surface have: each with its docstring, and the function of the tape behind it.
macro_rules! sampled {
    ($($(#[$docs:meta])* $name:ident;)+) => {$(
        $(#[$docs])*
        #[pyfunction]
        #[pyo3(signature = (positions, topology, samples, *, wrt=None))]
        pub(crate) fn $name(
            py: Python<'_>,
            positions: Floats<'_>,
            topology: Given<'_>,
            samples: &SurfaceSamples,
            wrt: Option<Wanted>,
        ) -> PyResult<Recorded> {
            let (op, topology) = (stringify!($name), topology.get());
            check_single(op, &positions, topology)?;
            let points = samples_of(op, samples, topology)?;
            let inputs = [("positions", &positions)];
            record!(py, Arguments::new(op, inputs, wrt.as_ref())?, |positions| {
                losses::$name(positions, topology.corners(), points)
            })
        }
    )+};
}

sampled! {
    /// Where samples of a surface are, as functions of its vertices. With `sample_surface` it is PyTorch3D's `sample_points_from_meshes`.
    ///
    /// positions: [V, 3]. topology: the faces. samples: P of them. Value [P, 3]. Gradient: positions, the samples held on their faces.
    surface_points;
    /// Unit normals at samples of a surface: those of their faces.
    ///
    /// positions: [V, 3]. topology: the faces. samples: P of them. Value [P, 3]. Gradient: positions.
    surface_normals;
}

fn check_single(op: &'static str, positions: &Floats<'_>, topology: &Topology) -> PyResult<()> {
    check_mesh(op, "positions", positions, topology)?;
    if positions.shape().len() == 2 {
        return Ok(());
    }
    let found = positions.shape();
    Err(error::value(format!("{op}: one set of vertices [V, 3] expected, found {found:?}")))
}
