//! Losses between sets of points, and between points and a surface.

use autodiff_lite::Shapes;
use losses::{Assignment, Directions, Matches};
use pyo3::prelude::*;

use crate::arrays::Floats;
use crate::error;
use crate::recorded::{Arguments, Recorded, fits, record};
use crate::topology::{Given, Topology};
use crate::wanted::Wanted;

/// Checks two sets of points, `[P, 3]` and `[Q, 3]`, or batches of them.
fn check_sets(op: &'static str, x: &Floats<'_>, y: &Floats<'_>) -> PyResult<()> {
    let mut shapes = Shapes::of(op);
    let mut set = |name: &str, array: &Floats<'_>, points: &'static str| {
        array.check_coordinates(op, name)?;
        let found = array.shape();
        fits(if found.len() == 2 {
            shapes.axes(name, found, [points, "3"]).map(drop)
        } else {
            shapes.axes(name, found, ["N", points, "3"]).map(drop)
        })
    };
    set("x", x, "P")?;
    set("y", y, "Q")?;
    let count = |array: &Floats<'_>| array.shape().iter().product::<usize>();
    if x.shape().len() != y.shape().len() || count(x) == 0 || count(y) == 0 {
        return Err(error::value(
            shapes.error("sets of points alike, none of them empty, expected"),
        ));
    }
    Ok(())
}

/// The Chamfer distance: the mean squared distance to the nearest point, both ways, added. PyTorch3D's `chamfer_distance`.
///
/// x: [P, 3] or [N, P, 3]. y: [Q, 3] or [N, Q, 3]. x_to_y, y_to_x: weights of the two directions. Value: a float, in squared units.
/// Gradients: x, y; which points are nearest counts as fixed.
/// Cost: O(N P Q) below 2**20 pairs P Q, which are all compared; from there on a hierarchy of boxes finds them, O(N (P + Q) log(P + Q))
/// where the sets lie near each other.
#[pyfunction]
#[pyo3(signature = (x, y, *, x_to_y=1.0, y_to_x=1.0, wrt=None))]
pub(crate) fn chamfer(
    py: Python<'_>,
    x: Floats<'_>,
    y: Floats<'_>,
    x_to_y: f64,
    y_to_x: f64,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    check_sets("chamfer", &x, &y)?;
    let directions = Directions { x_to_y, y_to_x };
    record!(py, Arguments::new("chamfer", [("x", &x), ("y", &y)], wrt.as_ref())?, |x, y| {
        let mut matches = Matches::default();
        matches.find(x, y);
        losses::chamfer_distance(x, y, &matches, directions)
    })
}

/// The Chamfer distance with the sum of absolute differences, `norm=1` of PyTorch3D; matches are nearest by the same.
///
/// x: [P, 3] or [N, P, 3]. y: [Q, 3] or [N, Q, 3]. x_to_y, y_to_x: weights of the two directions. Value: a float, in units of the points.
/// Gradients: x, y.
/// Cost: O(N P Q), all pairs are compared.
#[pyfunction]
#[pyo3(signature = (x, y, *, x_to_y=1.0, y_to_x=1.0, wrt=None))]
pub(crate) fn chamfer_l1(
    py: Python<'_>,
    x: Floats<'_>,
    y: Floats<'_>,
    x_to_y: f64,
    y_to_x: f64,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    check_sets("chamfer_l1", &x, &y)?;
    let directions = Directions { x_to_y, y_to_x };
    record!(py, Arguments::new("chamfer_l1", [("x", &x), ("y", &y)], wrt.as_ref())?, |x, y| {
        let mut matches = Matches::default();
        matches.find_l1(x, y);
        losses::chamfer_l1(x, y, &matches, directions)
    })
}

/// How far the normals at nearest points are from parallel: the mean of 1 - |cos|, both ways, added. The second result of PyTorch3D's
/// `chamfer_distance`.
///
/// x: [P, 3] or [N, P, 3]. y: [Q, 3] or [N, Q, 3]. x_normals, y_normals: like x and y, of any length. signed: 1 - cos, which tells front from
/// back: PyTorch3D's `abs_cosine=False`. x_to_y, y_to_x: weights of the two directions. Value: a float, for weights of 1 from 0 to 2, signed to 4.
/// Gradients: x_normals, y_normals; x and y say only which points are nearest, as in `chamfer`. Raises ValueError for NaN.
#[pyfunction]
#[pyo3(signature = (x, y, x_normals, y_normals, *, signed=false, x_to_y=1.0, y_to_x=1.0, wrt=None))]
pub(crate) fn chamfer_normals(
    py: Python<'_>,
    x: Floats<'_>,
    y: Floats<'_>,
    x_normals: Floats<'_>,
    y_normals: Floats<'_>,
    signed: bool,
    x_to_y: f64,
    y_to_x: f64,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    let op = "chamfer_normals";
    check_sets(op, &x, &y)?;
    for (name, normals, of, points) in
        [("x_normals", &x_normals, "x", &x), ("y_normals", &y_normals, "y", &y)]
    {
        let (found, expected) = (normals.shape(), points.shape());
        if found != expected {
            return Err(error::value(format!(
                "{op}: {name} like {of}, {expected:?}, expected, found {found:?}"
            )));
        }
        // Nothing is nearest to what is no number, yet a normal would be compared with.
        points.check_numbers(op, of)?;
        normals.check_numbers(op, name)?;
    }
    let directions = Directions { x_to_y, y_to_x };
    let inputs = [("x_normals", &x_normals), ("y_normals", &y_normals), ("x", &x), ("y", &y)];
    let arguments = Arguments::leading(2, op, inputs, wrt.as_ref())?;
    record!(py, arguments, |x_normals, y_normals, x, y| {
        let mut matches = Matches::default();
        matches.find(x, y);
        if signed {
            losses::chamfer_normals_signed(x_normals, y_normals, &matches, directions)
        } else {
            losses::chamfer_normals(x_normals, y_normals, &matches, directions)
        }
    })
}

/// The earth mover's distance: the mean distance of partners, in the pairing of least sum.
///
/// x, y: [P, 3] or [N, P, 3], alike. excess: None finds the least sum (O(P**3), meant up to 2048 points); 0.01, say, stops at one that is at
/// most 1 % more. Value: a float, in units of the points. Gradients: x, y, through the pairing as it is.
#[pyfunction]
#[pyo3(signature = (x, y, *, excess=None, wrt=None))]
pub(crate) fn earth_mover(
    py: Python<'_>,
    x: Floats<'_>,
    y: Floats<'_>,
    excess: Option<f64>,
    wrt: Option<Wanted>,
) -> PyResult<Recorded> {
    check_sets("earth_mover", &x, &y)?;
    if x.shape() != y.shape() {
        let (x, y) = (x.shape(), y.shape());
        return Err(error::value(format!(
            "earth_mover: sets of one size expected, found {x:?}, {y:?}"
        )));
    }
    if excess.is_some_and(|excess| excess.is_nan() || excess <= 0.0) {
        return Err(error::value("earth_mover: excess must be above 0, or None"));
    }
    if [&x, &y].iter().any(|set| set.doubles().iter().any(|x| !x.is_finite())) {
        return Err(error::value("earth_mover: coordinates must be finite"));
    }
    let method = excess.map_or(Assignment::Exact, |excess| Assignment::Auction { excess });
    record!(py, Arguments::new("earth_mover", [("x", &x), ("y", &y)], wrt.as_ref())?, |x, y| {
        losses::earth_mover(x, y, method)
    })
}

/// Checks points `[P, 3]` beside the vertices of a mesh, neither of which may be missing.
fn check_surface(
    op: &'static str,
    x: &Floats<'_>,
    positions: &Floats<'_>,
    topology: &Topology,
) -> PyResult<()> {
    x.check_coordinates(op, "x")?;
    positions.check_coordinates(op, "positions")?;
    let mut shapes = Shapes::of(op);
    fits(shapes.axes("topology", &[topology.faces.vertex_count()], ["V"]))?;
    let [points, _] = fits(shapes.axes("x", x.shape(), ["P", "3"]))?;
    fits(shapes.axes("positions", positions.shape(), ["V", "3"]))?;
    if points == 0 || topology.faces.is_empty() {
        return Err(error::value(shapes.error("at least one point and one face expected")));
    }
    Ok(())
}

/// Distances of points and a mesh: each with its docstring, and the function of the tape behind it.
macro_rules! surface_distances {
    ($($(#[$docs:meta])* $name:ident;)+) => {$(
        $(#[$docs])*
        #[pyfunction]
        #[pyo3(signature = (x, positions, topology, *, wrt=None))]
        pub(crate) fn $name(
            py: Python<'_>,
            x: Floats<'_>,
            positions: Floats<'_>,
            topology: Given<'_>,
            wrt: Option<Wanted>,
        ) -> PyResult<Recorded> {
            let (op, topology) = (stringify!($name), topology.get());
            check_surface(op, &x, &positions, topology)?;
            let inputs = [("x", &x), ("positions", &positions)];
            record!(py, Arguments::new(op, inputs, wrt.as_ref())?, |x, positions| {
                losses::$name(x, positions, topology.corners())
            })
        }
    )+};
}

surface_distances! {
    /// Squared distances between points and a surface, both ways: the mean over points to the nearest face, and the mean over faces to the
    /// nearest point, added. PyTorch3D's `point_mesh_face_distance`.
    ///
    /// x: [P, 3]. positions: [V, 3]. topology: the faces. Value: a float, in squared units. Gradients: x, positions.
    point_mesh_face_distance;
    /// The squared distance of each point to the nearest face.
    ///
    /// x: [P, 3]. positions: [V, 3]. topology: the faces. Value [P], in squared units. Gradients: x, positions.
    point_face_distance;
    /// The squared distance of each face to the nearest point.
    ///
    /// x: [P, 3]. positions: [V, 3]. topology: the faces. Value [F], in squared units. Gradients: x, positions.
    face_point_distance;
}
